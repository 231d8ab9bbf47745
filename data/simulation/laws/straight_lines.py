"""A path of three straight lines, from where an element turned round to where it aims.

Points 0 to 3 of a path stand in the memory, m[2] to m[9]: u and ρ of each, in the direction of the
motion. Of a law that follows such paths odd branches go forward.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from data.simulation.laws.compiling import inlined


def points_of(law: Any, names: Sequence[str], back: str = "", side: float = 1.0) -> list[float]:
    """Force [N] and place [m] of every point of a side of an envelope, as OpenSees takes them."""
    first = getattr(law, f"{back}strength_1") if back else 1.0
    more = [getattr(law, f"{back}strength_{i + 1}") for i in range(1, len(names))]
    places = [getattr(law, f"{back}{name}") for name in names]
    force = law.stiffness * law.yield_displacement
    pairs = zip([first, *more], places, strict=True)
    return [side * number for s, y in pairs for number in (force * s, y)]


@inlined
def way_of(branch):
    """The direction of the motion, 1 or −1."""
    return 1.0 if branch & 1 else -1.0


@inlined
def end_of(m, line):
    """u at the end of a line of the path, 0 to 2."""
    return m[4 + 2 * line]


@inlined
def on_line(m, line, u):
    """ρ of a line of the path at u; where the line has no length, that of its end."""
    if line == 0:
        u0, f0, u1, f1 = m[2], m[3], m[4], m[5]
    elif line == 1:
        u0, f0, u1, f1 = m[4], m[5], m[6], m[7]
    else:
        u0, f0, u1, f1 = m[6], m[7], m[8], m[9]
    if u1 <= u0:
        return f1
    return f0 + (f1 - f0) / (u1 - u0) * (u - u0)
