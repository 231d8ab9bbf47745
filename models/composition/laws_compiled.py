"""Laws of elements, compiled, with their slopes: the production twin of laws.py.

Every coefficient depends on one parameter at most, whose number and slope stand beside it (−1: on
none), so that a coefficient adds one number to one derivative.   E elements, P parameters.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.numba_cache import compilers

HERE = Path(__file__)
_, inlined = compilers(HERE, contract=True)

LINEAR = 6  # columns before those of hinges, tanhs and units


@inlined
def add(row, index, value):
    if index >= 0:
        row[index] += value


@inlined
def unit_step(z, delta, limit, slope_up, slope_down):
    """A unit after an increment of deformation: z, its slopes by z, by delta and by the b in use.

    dz = (1 + b u) dy with u = sgn(dy) z is solved exactly up to fourth order; then |z| ≤ limit.
    Returns z, its side (±1 on the limit, 0 within), whether b₊ was in use, and the three slopes.
    """
    sign = 1.0 if delta > 0.0 else -1.0
    rising = sign * z > 0.0
    c = sign * (slope_up if rising else slope_down)
    q, h = c * delta, 1.0 + c * z
    phi = 1.0 + q * (0.5 + q * (1.0 / 6.0 + q / 24.0))
    slope = 0.5 + q * (1.0 / 3.0 + q / 8.0)
    new = z + delta * h * phi
    if new > limit:
        return limit, 1, rising, 0.0, 0.0, 0.0
    if new < -limit:
        return -limit, -1, rising, 0.0, 0.0, 0.0
    by_b = sign * delta * (z * phi + delta * h * slope)
    return new, 0, rising, 1.0 + q * phi, h * (phi + q * slope), by_b


@inlined
def memoryless(e, y, rate, laws, ilaws, slaws, hinges, tanhs, dr, sensitive):
    """Force of an element without its units, and the slopes of the force by y and ẏ.

    Where `sensitive`, adds the slopes by the element's own parameters to dr (P,).
    """
    p = laws[e]
    size, side = abs(y), (1.0 if y > 0.0 else -1.0)
    r = p[0] * y + p[1] * rate + p[2] * y**3 + p[3] * y * y + (p[4] * size + p[5] * y * y) * rate
    by_y = p[0] + 3.0 * p[2] * y * y + 2.0 * p[3] * y + (p[4] * side + 2.0 * p[5] * y) * rate
    by_rate = p[1] + p[4] * size + p[5] * y * y
    if sensitive:
        add(dr, ilaws[e, 0], slaws[e, 0] * y)
        add(dr, ilaws[e, 1], slaws[e, 1] * rate)
        add(dr, ilaws[e, 2], slaws[e, 2] * y**3)
        add(dr, ilaws[e, 3], slaws[e, 3] * y * y)
        add(dr, ilaws[e, 4], slaws[e, 4] * size * rate)
        add(dr, ilaws[e, 5], slaws[e, 5] * y * y * rate)
    for j in range(LINEAR, LINEAR + 2 * hinges, 2):
        if size > p[j + 1]:
            r += p[j] * side * (size - p[j + 1])
            by_y += p[j]
            if sensitive:
                add(dr, ilaws[e, j], slaws[e, j] * side * (size - p[j + 1]))
                add(dr, ilaws[e, j + 1], -slaws[e, j + 1] * side * p[j])
    for j in range(LINEAR + 2 * hinges, LINEAR + 2 * hinges + 3 * tanhs, 3):
        g, s, b = p[j], p[j + 1], p[j + 2]
        above, below, middle = np.tanh(s * (y + b)), np.tanh(s * (y - b)), np.tanh(s * b)
        step = (above + below) / (2.0 * s)
        up, down, flat = 1.0 - above * above, 1.0 - below * below, 1.0 - middle * middle
        r += g * (step - flat * y)
        by_y += g * (0.5 * (up + down) - flat)
        if sensitive:
            add(dr, ilaws[e, j], slaws[e, j] * (step - flat * y))
            turn = (0.5 * (up * (y + b) + down * (y - b)) - step) / s
            turn += 2.0 * middle * flat * b * y
            add(dr, ilaws[e, j + 1], slaws[e, j + 1] * g * turn)
            shift = 0.5 * (up - down) + 2.0 * middle * flat * s * y
            add(dr, ilaws[e, j + 2], slaws[e, j + 2] * g * shift)
    return r, by_y, by_rate
