"""Laws of the elements of a modal network, compiled, with all their derivatives.

r = Σ_k w_k φ_k(y, ẏ) + Σ_h w_h σ((y − y_h)/s_h) s_h + Σ_u w_u (z_u − y)
φ = y², y³, y⁵, |y| ẏ, y² ẏ;  σ = log(1 + eˣ), a smooth hinge
dz/dy = 1 − b₊ |z| on the way out, 1 − b₋ |z| on the way back,  b₊ = eᵝ,  b₋ = (1 − eᵏ) b₊

A unit is that of Bouc and Wen with the exponent 1, integrated exactly along y; it has no jump.
"""

from __future__ import annotations

import math
from pathlib import Path

from data.numba_cache import compilers

HERE = Path(__file__)
_, inlined = compilers(HERE, contract=True)

TERMS = 5  # φ
HINGE, UNIT = 3, 3  # numbers of each: weight, place, log width; weight, β, κ
FLAT = 30.0  # of x, beyond which eˣ is all of 1 + eˣ
SMALL = 1e-4  # |b| ℓ below which the exponential is a series


@inlined
def terms(y, rate, phi, by_y, by_rate):
    """φ (5,) and its slopes."""
    size, square = abs(y), y * y
    phi[0], by_y[0], by_rate[0] = square, 2.0 * y, 0.0
    phi[1], by_y[1], by_rate[1] = square * y, 3.0 * square, 0.0
    phi[2], by_y[2], by_rate[2] = square * square * y, 5.0 * square * square, 0.0
    phi[3], by_y[3], by_rate[3] = size * rate, math.copysign(rate, y * rate), size
    phi[4], by_y[4], by_rate[4] = square * rate, 2.0 * y * rate, square


@inlined
def hinge(y, place, log_width):
    """s σ((y − p)/s) and its slopes by y and log s; that by p is the negative of that by y."""
    s = math.exp(log_width)
    x = (y - place) / s
    if x > FLAT:
        return y - place, 1.0, 0.0
    if x < -FLAT:
        return 0.0, 0.0, 0.0
    e = math.exp(x)
    value, slope = math.log1p(e), e / (1.0 + e)
    return s * value, slope, s * (value - x * slope)


@inlined
def decay(x, way, b):
    """x after dx = (1 − b x) dℓ over `way`, and its slope by b alone."""
    p = b * way
    if abs(p) < SMALL:
        moved = way * (1.0 - 0.5 * p + p * p / 6.0)
        by_b = -way * way * (0.5 - p / 3.0 + p * p / 8.0)
        return x * math.exp(-p) + moved, -way * math.exp(-p) * x + by_b
    e = math.exp(-p)
    moved = (1.0 - e) / b
    return x * e + moved, -way * e * x + (way * e - moved) / b


@inlined
def unit_step(z, delta, beta, kappa):
    """z after y moved by `delta`; its slopes by z, delta, β and κ."""
    b = math.exp(beta)
    share = -math.expm1(kappa)  # of b, on the way back
    side, way = math.copysign(1.0, delta), abs(delta)
    x = side * z
    back, left = share * b, way
    by_x, by_back, lost = 1.0, 0.0, 0.0
    rate = 1.0
    if x < 0.0:  # the way back: dx = (1 + b₋ x) dℓ
        start = 1.0 + back * x
        if abs(back * x) < SMALL:
            to_zero = -x * (1.0 - 0.5 * back * x + (back * x) ** 2 / 3.0)
            lost = x * x * (0.5 - 2.0 * back * x / 3.0)
        elif start > 0.0:
            to_zero = -math.log(start) / back
            lost = math.log(start) / (back * back) - x / (back * start)
        else:
            to_zero, lost = way + 1.0, 0.0  # it never gets there
        if to_zero >= way:
            end, by_minus = decay(x, way, -back)
            rate = 1.0 + back * end
            by_x, by_back, left = rate / start, -by_minus, 0.0
            x = end
        else:
            by_x, by_back, left, x = 1.0 / start, -lost, way - to_zero, 0.0
    by_plus = 0.0
    if left > 0.0:  # the way out
        first = 1.0 - b * x
        end, by_plus = decay(x, left, b)
        rate = 1.0 - b * end
        scale = math.exp(-b * left) if first != 0.0 else 1.0
        by_x *= scale
        by_back *= scale
        x = end
    # β moves b₊ and b₋ alike; κ moves b₋ alone
    by_beta = by_plus * b + by_back * back
    by_kappa = -by_back * b * math.exp(kappa)
    return side * x, by_x, rate, side * by_beta, side * by_kappa
