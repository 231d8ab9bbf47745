"""Laws of elements, compiled, with their slopes, as compiled runs take them.

Every coefficient depends on one parameter at most, whose number and slope stand beside it (−1: on
none), so that a coefficient adds one number to one derivative.   E elements, P parameters.
"""

from __future__ import annotations

import math
from pathlib import Path

from data.numba_cache import compilers

HERE = Path(__file__)
_, inlined = compilers(HERE, contract=True)

LINEAR = 3  # columns k, c, k₃ before those of hinges and units
SMALL = 0.1  # b y below which the laws of units are summed as series,
TERMS, TERMS_OF_LOGARITHM = 12, 18  # of so many terms
LAST = 1.0 / math.factorial(TERMS)
LARGEST = 100.0  # b y of a step: a unit that grows beyond eᵇʸ is on its limit


@inlined
def add(row, index, value):
    if index >= 0:
        row[index] += value


@inlined
def growth(q):
    """φ = (eᵠ − 1)/q and dφ/dq, to rounding: near 0 by their series."""
    if abs(q) > SMALL:
        q = min(q, LARGEST)
        phi = math.expm1(q) / q
        return phi, (1.0 + q * phi - phi) / q
    phi, slope, share = LAST, 0.0, LAST
    for n in range(TERMS, 2, -1):  # 1/2 + q/6 + q²/24 + … and its derivative, by Horner
        share *= n
        slope = phi + q * slope
        phi = share + q * phi
    slope = phi + q * slope
    phi = 1.0 + q * phi
    return phi, slope


@inlined
def way_to_zero(w, b):
    """Way d > 0 from w < 0 to 0 along dw = (1 + b w) dy, and its slope by b."""
    p = b * w
    if abs(p) > SMALL:
        way = -math.log1p(p) / b
        return way, -(way + w / (1.0 + p)) / b
    series, slope = 0.0, 0.0
    for n in range(TERMS_OF_LOGARITHM, 0, -1):  # log1p(p)/p = 1 − p/2 + p²/3 − …
        slope = -series - p * slope
        series = 1.0 / n - p * series
    return -w * series, -w * w * slope


@inlined
def unit_step(z, delta, limit, slope_up, slope_down):
    """A unit after an increment of deformation: z, its slopes by z, by delta, by b₊ and by b₋.

    Returns z, its side (±1 on the limit, 0 within) and the four slopes. In the direction of the
    motion, w = sgn(dy) z, the law is dw = (1 + b w) d|y| with b₋ for w < 0 and b₊ above: it is
    solved exactly on both sides, so that the force has no jump where w crosses zero.
    """
    sign = 1.0 if delta > 0.0 else -1.0
    w, way = sign * z, abs(delta)
    rising = w >= 0.0
    b = slope_up if rising else slope_down
    phi, slope = growth(b * way)
    h = 1.0 + b * w
    new, by_w, by_way = w + way * h * phi, 1.0 + b * way * phi, h * (1.0 + b * way * phi)
    by_b = way * (w * phi + way * h * slope)
    by_up, by_down = (by_b, 0.0) if rising else (0.0, by_b)
    if not rising and new > 0.0:
        first, first_by_b = way_to_zero(w, b)
        rest = max(way - first, 0.0)
        phi, slope = growth(slope_up * rest)
        new, by_way = rest * phi, 1.0 + slope_up * rest * phi
        by_w, by_up, by_down = by_way / h, rest * rest * slope, -by_way * first_by_b
    if new > limit:
        return sign * limit, sign, 0.0, 0.0, 0.0, 0.0
    if new < -limit:
        return -sign * limit, -sign, 0.0, 0.0, 0.0, 0.0
    return sign * new, 0.0, by_w, by_way, sign * by_up, sign * by_down


@inlined
def memoryless(e, y, rate, laws, hinges, dr):
    """Force of an element without its units, and the slopes of the force by y and ẏ.

    Adds the slopes by the element's own parameters to row e of dr (E, P), unless it is None.
    """
    values, ilaws, slaws = laws
    p = values[e]
    size, side = abs(y), (1.0 if y > 0.0 else -1.0)
    r = p[0] * y + p[1] * rate + p[2] * y**3
    by_y = p[0] + 3.0 * p[2] * y * y
    by_rate = p[1]
    if dr is not None:
        add(dr[e], ilaws[e, 0], slaws[e, 0] * y)
        add(dr[e], ilaws[e, 1], slaws[e, 1] * rate)
        add(dr[e], ilaws[e, 2], slaws[e, 2] * y**3)
    for j in range(LINEAR, LINEAR + 2 * hinges, 2):
        if size > p[j + 1]:
            r += p[j] * side * (size - p[j + 1])
            by_y += p[j]
            if dr is not None:
                add(dr[e], ilaws[e, j], slaws[e, j] * side * (size - p[j + 1]))
                add(dr[e], ilaws[e, j + 1], -slaws[e, j + 1] * side * p[j])
    return r, by_y, by_rate
