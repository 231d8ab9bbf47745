"""A path of three straight lines, from where an element turned round to where it aims.

Points 0 to 3 of a path stand in the memory, m[2] to m[9]: u and ρ of each, in the direction of the
motion. Of a law that follows such paths odd branches go forward.
"""

from __future__ import annotations

from data.simulation.laws.compiling import inlined


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
