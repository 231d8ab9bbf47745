"""The motion of a sliding mass and its derivatives, exact from corner to corner, compiled.

ẋ = v,   v̇ = β u − o − sgn(v) (j + G(|v|));   where v = 0 and |β u − o| ≤ j, it sticks

G is straight between knots, with weights of its own for each direction. Under an input that is held
v̇ depends on v alone, so that w = |v| goes one way through the pieces of G, in each by an
exponential, and comes to rest or turns once at most. Where it turns, derivatives of w change by
the ratio of its accelerations after and before; where it sticks, they end.
T samples, S parts of a sample, K knots, P columns: β, o, ln j, G at the knots forwards and
backwards; then the first x and v.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.numba_cache import compilers

compiled, inlined = compilers(Path(__file__))

SHARED = 3  # β, o, ln j
SMALL = 0.1  # exponent, below which series are exact to rounding


@inlined
def _exponentials(z, phi):
    """φ₁ = (eᶻ − 1)/z, φ₂ = (eᶻ − 1 − z)/z² and their slopes."""
    if abs(z) > SMALL:
        phi[0] = np.expm1(z) / z
        phi[1] = (phi[0] - 1.0) / z
        phi[2] = (np.exp(z) - phi[0]) / z
        phi[3] = (phi[0] - 2.0 * phi[1]) / z
        return
    for n in range(4):
        phi[n] = 0.0
    term = 1.0
    for n in range(1, 11):
        term /= n  # z^(n−1) / n!
        phi[0] += term
        phi[1] += term / (n + 1)
        phi[2] += term * n / (n + 1)
        phi[3] += term * n / ((n + 1) * (n + 2))
        term *= z


@inlined
def _until(distance, rate, slope):
    """The time until w has gone a distance, where ẇ = rate − slope (way); infinite if never."""
    y = slope * distance / rate
    if y >= 1.0:
        return np.inf
    if abs(y) < 1e-4:
        return distance / rate * (1.0 + y * (0.5 + y * (1.0 / 3.0 + 0.25 * y)))
    return -distance / rate * np.log1p(-y) / y


@inlined
def _piece(theta, knots, side, a):
    """Of the piece above a knots: its start, G there, slope, 1/width, where its weights stand.

    Beyond all knots G goes on straight, but never falls.
    """
    K = knots.size
    first = SHARED + (0 if side > 0.0 else K)
    high = a if a < K else K - 1
    below = theta[first + high - 1] if high > 0 else 0.0
    inverse = 1.0 / (knots[high] - (knots[high - 1] if high > 0 else 0.0))
    slope = (theta[first + high] - below) * inverse
    if a == K and slope < 0.0:
        slope, inverse = 0.0, 0.0
    start = knots[a - 1] if a > 0 else 0.0
    force = theta[first + a - 1] if a > 0 else 0.0
    return start, force, slope, inverse, first + high, first + a - 1


@inlined
def _derived(t, side, u, jump, rate, way, slope, inverse, high, base, a, phi, dw, dx):
    """dw and dx (P,) after a time t within a piece, at a fixed time."""
    t1, t2 = t * phi[0], t * t * phi[1]
    for p in range(dw.size):
        pulled = -slope * dw[p]
        dx[p] += side * (t * dw[p] + t2 * pulled)
        dw[p] += t1 * pulled
    dw[0] += t1 * side * u
    dx[0] += t2 * u
    dw[1] -= t1 * side
    dx[1] -= t2
    dw[2] -= t1 * jump
    dx[2] -= t2 * side * jump
    if a > 0:
        dw[base] -= t1
        dx[base] -= side * t2
    by_slope = -rate * t * t * phi[2] - t1 * way
    by_slope_x = side * (-rate * t * t * t * phi[3] - t2 * way)
    dw[high] += inverse * by_slope
    dx[high] += inverse * by_slope_x
    if high != SHARED and high != SHARED + (dw.size - 2 - SHARED) // 2:
        dw[high - 1] -= inverse * by_slope
        dx[high - 1] -= inverse * by_slope_x


@inlined
def _held(u, h, theta, knots, jump, x, v, dx, dw, phi):
    """x and v after a time h under an input u; dx, and dw as that of v (P,), along."""
    K, P, left = knots.size, dw.size, h
    drive = theta[0] * u - theta[1]
    side, w, a = (1.0 if v > 0.0 else -1.0), abs(v), 0
    if w == 0.0:
        side = 1.0 if drive > 0.0 else -1.0
    if w == 0.0 and abs(drive) <= jump:
        dw[:] = 0.0
        return x, 0.0
    while a < K and w > knots[a]:
        a += 1
    dw *= side
    for _ in range(2 * K + 4):
        start, force, slope, inverse, high, base = _piece(theta, knots, side, a)
        way = w - start
        rate = side * drive - jump - force - slope * way
        t, target = left, -1.0
        if rate > 0.0 and a < K:
            target = knots[a]
        elif rate < 0.0:
            target = start
        if target >= 0.0:
            reached = _until(target - w, rate, slope)
            if reached < left:
                t = reached
            else:
                target = -1.0
        _exponentials(-slope * t, phi)
        x += side * (w * t + rate * t * t * phi[1])
        w = target if target >= 0.0 else w + rate * t * phi[0]
        if P > 0:
            _derived(t, side, u, jump, rate, way, slope, inverse, high, base, a, phi, dw, dx)
        left -= t
        if target < 0.0:
            break
        if rate > 0.0:
            a += 1
        elif a > 0:
            a -= 1
        elif abs(drive) <= jump:
            dw[:] = 0.0
            return x, 0.0
        else:  # it turns
            after = abs(drive) - jump
            dw *= after / (side * drive - jump)
            side = 1.0 if drive > 0.0 else -1.0
    dw *= side
    return x, side * w


@compiled
def run(u, h, theta, knots, begin, bound, x, v, jacobian):
    """Fills x and v (T,) and jacobian (T, P) of x under u (T − 1, S), held for a time h each.

    Returns whether the motion stayed sound.
    """
    T, P = x.size, jacobian.shape[1]
    dx, dw, phi = np.zeros(P), np.zeros(P), np.zeros(4)
    if P > 0:
        dx[P - 2], dw[P - 1] = 1.0, 1.0
    at, speed, jump = begin[0], begin[1], np.exp(theta[2])
    for t in range(T):
        x[t], v[t] = at, speed
        if not abs(at) < bound:
            for later in range(t, T):
                x[later] = v[later] = np.nan
            return False
        for p in range(P):
            jacobian[t, p] = dx[p]
        if t < T - 1:
            for s in range(u.shape[1]):
                at, speed = _held(u[t, s], h, theta, knots, jump, at, speed, dx, dw, phi)
    return True
