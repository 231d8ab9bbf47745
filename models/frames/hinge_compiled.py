"""A hinge of steel after Menegotto & Pinto, with its slope, compiled.

The law is that of data/simulation/laws/menegotto_pinto.py, which has its formulas, without
isotropic hardening. There a motion is known; here a hinge turns as far as balances its member, so
that a step is tried before it is taken: `new` is what `old` becomes.

law: y_y, k, b, R₀, c₁. Memory of a hinge (MEMORY,): y_r, ρ_r, y₀, R, y₊, y₋, branch, y; branch 0 is
the first loading, 1 goes forward, 2 backward.
"""

from __future__ import annotations

from pathlib import Path

from data.numba_cache import compilers

RUN = Path(__file__).with_name("run_compiled.py")
compiled, inlined = compilers(RUN, Path(__file__))

MEMORY = 8
LOSS_EXCURSION = 0.15  # c₂


@inlined
def _approach(e, b, R):
    """b e + (1 − b) e / (1 + |e|^R)^(1/R) and its slope, also where |e|^R is beyond all numbers."""
    size, side = abs(e), 1.0 if e > 0.0 else -1.0
    if size <= 1.0:
        grown = 1.0 + size**R
        share = (1.0 - b) * grown ** (-1.0 / R)
        return b * e + share * e, b + share / grown
    power = size**-R
    share = (1.0 - b) * (1.0 + power) ** (-1.0 / R)
    return b * e + share * side, b + share * power / (1.0 + power) / size


@inlined
def _shape(law, at, y):
    """ρ = r/k and its slope at y, on the branch that the memory `at` is on."""
    if at[6] == 0.0:
        value, slope = _approach(y / law[0], law[2], law[3])
        return law[0] * value, slope
    span = at[2] - at[0]
    value, slope = _approach((y - at[0]) / span, law[2], at[3])
    return at[1] + span * value, slope


@inlined
def _turned(law, old, forward, new):
    """Turn round where the memory `old` ends."""
    y, y_y, b = old[7], law[0], law[2]
    rho, _ = _shape(law, old, y)
    highest, lowest = max(y_y, old[4]), min(-y_y, old[5])
    if forward:
        lowest, side = min(lowest, y), 1.0
    else:
        highest, side = max(highest, y), -1.0
    span = (y_y * (1.0 - b) - side * (rho - b * y)) / (1.0 - b)
    corner = y + side * max(span, 1e-9 * y_y)
    xi = abs((highest if forward else lowest) - corner) / y_y
    R = law[3] * (1.0 - law[4] * xi / (LOSS_EXCURSION + xi))
    new[0], new[1], new[2], new[3], new[4], new[5] = y, rho, corner, R, highest, lowest
    new[6] = 1.0 if forward else 2.0


@inlined
def turn(law, old, y, new):
    """Force and stiffness of a hinge that goes from its memory `old` to y; fills `new`."""
    for i in range(MEMORY):
        new[i] = old[i]
    last, branch = old[7], old[6]
    if branch == 0.0:
        back = (last > 0.0 and y < last) or (last < 0.0 and y > last)
    else:
        back = (branch == 1.0 and y < last) or (branch == 2.0 and y > last)
    if back:
        _turned(law, old, y > last, new)
    new[7] = y
    rho, slope = _shape(law, new, y)
    return law[1] * rho, law[1] * slope
