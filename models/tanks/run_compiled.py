"""The levels of tanks in a row and their derivatives, compiled.

ẋ₁ = b ρ(u − u₀) − q₁(x₁),   ẋᵢ = qᵢ₋₁ + χᵢ₋₁ (overflow of i−1) − qᵢ(xᵢ),   y = min(xₙ + o₀, full)
qᵢ(x) = k ((x + ε)ᵖ − εᵖ) + Σ w ρ(x − κ) for x > 0, which rises; a tank is as high as h

Heun's method, second order; what a step brings above h runs over. ρ is a smooth ramp. Volumes are
in units of the last tank's level, time in samples.   n tanks, T samples, P columns: the parameters
as `parameters` lists them, then the first levels.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.numba_cache import compilers

compiled, inlined = compilers(Path(__file__))

SHARED = 4  # ln b, u₀, o₀, full
OWN = 4  # of a tank: ln k, shape of p, h, shape of χ; then ln w of its ramps
LEAST_POWER, POWERS = 0.25, 1.0  # p and its range
EPSILON = 1e-3  # of the largest level
STEPS = 2  # a sample


@inlined
def _logistic(x):
    return 1.0 / (1.0 + np.exp(-x))


@inlined
def _ramp(x, width):
    """A smooth ramp and its slope."""
    t = x / width
    if t > 30.0:
        return x, 1.0
    if t < -30.0:
        return 0.0, 0.0
    e = np.exp(t)
    return width * np.log1p(e), e / (1.0 + e)


@inlined
def _law(theta, at, ramps, width, law):
    """k, the share of p, p, εᵖ, then weight and value at rest of each ramp."""
    law[0], law[1] = np.exp(theta[at]), _logistic(theta[at + 1])
    law[2] = LEAST_POWER + POWERS * law[1]
    law[3] = EPSILON ** law[2]
    for r in range(ramps.size):
        law[4 + 2 * r] = np.exp(theta[at + OWN + r])
        law[5 + 2 * r] = _ramp(-ramps[r], width)[0]


@inlined
def _outflow(law, at, level, dlevel, ramps, width, dq):
    """q and its derivatives dq (P,) of the tank whose parameters begin `at`."""
    P = dq.size
    for p in range(P):
        dq[p] = 0.0
    if level <= 0.0:
        return 0.0
    k, share, power, low = law[0], law[1], law[2], law[3]
    ln = np.log(level + EPSILON)
    up = np.exp(power * ln)
    q = k * (up - low)
    slope = k * power * up / (level + EPSILON)
    for r in range(ramps.size):
        value, steep = _ramp(level - ramps[r], width)
        raised = law[4 + 2 * r] * (value - law[5 + 2 * r])
        q += raised
        slope += law[4 + 2 * r] * steep
        if P > 0:
            dq[at + OWN + r] = raised
    for p in range(P):
        dq[p] += slope * dlevel[p]
    if P > 0:
        dq[at] += k * (up - low)
        dq[at + 1] += k * (up * ln - low * np.log(EPSILON)) * POWERS * share * (1.0 - share)
    return q


@inlined
def _slopes(laws, pump, x, dx, ramps, width, rate, drate, q, dq):
    """ẋ (n,) and its derivatives (n, P)."""
    n, P = dx.shape
    at = SHARED
    for i in range(n):
        q[i] = _outflow(laws[i], at, x[i], dx[i], ramps, width, dq[i])
        rate[i] = -q[i] + (q[i - 1] if i > 0 else pump[0])
        for p in range(P):
            drate[i, p] = -dq[i, p] + (dq[i - 1, p] if i > 0 else 0.0)
        if P > 0 and i == 0:
            drate[i, 0] += pump[0]
            drate[i, 1] += pump[1]
        at += OWN + ramps.size


@compiled
def run(u, theta, begin, ramps, width, edge, bound, y, levels, jacobian):
    """Fills y (T,), levels (T, n) and jacobian (T, P) of a run; returns whether it stayed sound."""
    n, P = begin.size, jacobian.shape[1]
    each = OWN + ramps.size
    x, dx = begin.copy(), np.zeros((n, P))
    if P > 0:
        for i in range(n):
            dx[i, SHARED + n * each + i] = 1.0
    rate, drate, end, dend = np.zeros(n), np.zeros((n, P)), np.zeros(n), np.zeros((n, P))
    later, dlater, q, dq = np.zeros(n), np.zeros((n, P)), np.zeros(n), np.zeros((n, P))
    pump, h = np.zeros(2), 1.0 / STEPS
    b, laws = np.exp(theta[0]), np.zeros((n, 4 + 2 * ramps.size))
    for i in range(n):
        _law(theta, SHARED + i * each, ramps, width, laws[i])
    for t in range(u.size):
        reading = x[n - 1] + theta[2]
        full = reading > theta[3]
        y[t] = theta[3] if full else reading
        for i in range(n):
            levels[t, i] = x[i]
        if not abs(reading) < bound:
            for later in range(t, u.size):
                y[later] = np.nan
            return False
        if P > 0:
            for p in range(P):
                jacobian[t, p] = 0.0 if full else dx[n - 1, p]
            jacobian[t, 3 if full else 2] += 1.0
        value, steep = _ramp(u[t] - theta[1], edge)
        pump[0], pump[1] = b * value, -b * steep
        for _ in range(STEPS):
            _slopes(laws, pump, x, dx, ramps, width, rate, drate, q, dq)
            for i in range(n):
                end[i] = x[i] + h * rate[i]
                for p in range(P):
                    dend[i, p] = dx[i, p] + h * drate[i, p]
            _slopes(laws, pump, end, dend, ramps, width, later, dlater, q, dq)
            for i in range(n):
                x[i] += 0.5 * h * (rate[i] + later[i])
                for p in range(P):
                    dx[i, p] += 0.5 * h * (drate[i, p] + dlater[i, p])
            for i in range(n):
                at = SHARED + i * each
                over = x[i] - theta[at + 2]
                if over <= 0.0:
                    continue
                share = _logistic(theta[at + 3])
                if i < n - 1:
                    x[i + 1] += share * over
                for p in range(P):
                    dover = dx[i, p] - (1.0 if p == at + 2 else 0.0)
                    if i < n - 1:
                        dx[i + 1, p] += share * dover
                    dx[i, p] = 1.0 if p == at + 2 else 0.0
                if P > 0 and i < n - 1:
                    dx[i + 1, at + 3] += share * (1.0 - share) * over
                x[i] = theta[at + 2]
    return True
