"""Corners: where in a step an element first leaves the branch of its law, and what holds then.

Compiled into the integrator, whose names and shapes these are.
"""

from __future__ import annotations

import numpy as np

from data.simulation.laws.compiling import inlined
from data.simulation.laws.dispatch import margin, next_branch

CORNER_RESOLUTION = 1e-7  # of a step
place = np.uintp  # an index without a sign: numba looks whether any other one is negative
NONE = 2.0  # beyond the end of a step, where an element may be just past a corner


@inlined
def _margin(e, q, branch, N, ends, law, p, m):
    """How far element e is from the end of its branch; negative beyond it."""
    start, end = ends[e, 0], ends[e, 1]
    y, ydot = q[end] - q[start], q[N + end] - q[N + start]
    return margin(law[e], p, m, e, branch[e], y, ydot, q[2 * N + e])


@inlined
def _at(u, i, q0, q1, k, h):
    """Entry i of the state at fraction u of a step, on the cubic Hermite interpolant."""
    rise, bend = u * u * (3.0 - 2.0 * u), h * u * (1.0 - u)
    return q0[i] + rise * (q1[i] - q0[i]) + bend * ((1.0 - u) * k[0, i] - u * k[6, i])


@inlined
def _margin_at(u, e, q0, q1, k, h, branch, N, ends, law, p, m):
    """The margin of element e at fraction u of a step."""
    start, end = ends[e, 0], ends[e, 1]
    y = _at(u, end, q0, q1, k, h) - _at(u, start, q0, q1, k, h)
    ydot = _at(u, N + end, q0, q1, k, h) - _at(u, N + start, q0, q1, k, h)
    return margin(law[e], p, m, e, branch[e], y, ydot, _at(u, 2 * N + e, q0, q1, k, h))


@inlined
def _crossing(e, high, at_end, q0, q1, k, h, branch, N, ends, law, p, m):
    """Fraction of a step, below `high`, at which element e leaves its branch: Illinois method."""
    start = _margin(e, q0, branch, N, ends, law, p, m)
    if not start > 0.0:
        return 0.0
    past = CORNER_RESOLUTION * (start - at_end)  # aim a little past the corner
    low, at_low, at_high, kept = 0.0, start + past, at_end + past, 0
    for _ in range(60):
        if at_high > -past:
            break
        u = high - (high - low) * at_high / (at_high - at_low)
        middle = _margin_at(u, e, q0, q1, k, h, branch, N, ends, law, p, m) + past
        if abs(middle) < past:
            return u
        if middle < 0.0:
            high, at_high = u, middle
            at_low, kept = 0.5 * at_low if kept == -1 else at_low, -1
        else:
            low, at_low = u, middle
            at_high, kept = 0.5 * at_high if kept == 1 else at_high, 1
    return high


@inlined
def first_corner(q0, q1, k, h, branch, N, ends, law, p, m):
    """Fraction of a step at which the first element leaves its branch; NONE where none does."""
    cut = NONE
    for e in range(law.size):
        start, end = ends[e, 0], ends[e, 1]
        to_start, to_end = place(N + start), place(N + end)
        before, after = q0[to_end] - q0[to_start], q1[to_end] - q1[to_start]
        until, y = 1.0, q1[place(end)] - q1[place(start)]
        beyond = margin(law[e], p, m, e, branch[e], y, after, q1[place(2 * N + e)])
        if beyond >= 0.0 and before * after < 0.0:
            # an element that turned round may have been beyond its branch in between
            until = before / (before - after)
            beyond = _margin_at(until, e, q0, q1, k, h, branch, N, ends, law, p, m)
        if m is not None and beyond >= 0.0 and before * after > 0.0:
            # an element with a memory may have turned round twice, where its speed is least
            first = before * (k[0, N + end] - k[0, N + start])
            last = before * (k[6, N + end] - k[6, N + start])
            if first < 0.0 < last:
                until = first / (first - last)
                beyond = _margin_at(until, e, q0, q1, k, h, branch, N, ends, law, p, m)
        if beyond < 0.0:
            at = _crossing(e, until, beyond, q0, q1, k, h, branch, N, ends, law, p, m)
            cut = min(cut, at)
    return cut


@inlined
def change_branches(q, branch, N, ends, law, p, m):
    """Move every element that is past the end of its branch to the next; True if one was."""
    changed = False
    for e in range(law.size):
        if _margin(e, q, branch, N, ends, law, p, m) < 0.0:
            start, end, z = ends[e, 0], ends[e, 1], 2 * N + e
            y, ydot = q[end] - q[start], q[N + end] - q[N + start]
            branch[e], q[z] = next_branch(law[e], p, m, e, branch[e], y, ydot, q[z])
            changed = True
    return changed
