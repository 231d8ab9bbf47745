"""A force under an imposed deformation, followed from one turn or corner to the next, compiled.

Where a law's branches end at deformations, and where the motion turns, time plays no part: between
two corners the force is a function of y, and z, where there is one, is its work along straight
lines. That takes a fraction of the time of the integrator (`element_test.imposed`), which tends to
the same force as its samples get finer.
Between samples y is the cubic through y and its rate.   T samples.
"""

from __future__ import annotations

import math

import numpy as np

from data.simulation.laws.compiling import compiled, inlined
from data.simulation.laws.dispatch import force, margin, next_branch
from data.simulation.laws.element import MEMORY

MOST = 50  # corners between two samples
HALVINGS = 50  # of a way, to its corner
BEHIND = 1e-6  # of a way: a branch that has not ended there has not ended at its beginning
NONE = 1e-12  # of the largest deformation: a way of no length


@inlined
def _turns(y0, y1, d0, d1):
    """Fractions of an interval at which the cubic turns, in order; 2 where it does not."""
    a, b = 6.0 * (y0 - y1) + 3.0 * (d0 + d1), 6.0 * (y1 - y0) - 4.0 * d0 - 2.0 * d1
    square = b * b - 4.0 * a * d0
    if square <= 0.0:
        return 2.0, 2.0
    q = -0.5 * (b + math.copysign(math.sqrt(square), b))
    one = d0 / q if q != 0.0 else 2.0
    two = q / a if a != 0.0 else 2.0
    one, two = min(one, two), max(one, two)
    if not 0.0 < one < 1.0:
        one, two = two, 2.0
    return one if 0.0 < one < 1.0 else 2.0, two if 0.0 < two < 1.0 else 2.0


@inlined
def _cubic(t, y0, y1, d0, d1):
    rise = t * t * (3.0 - 2.0 * t)
    return (1.0 - rise) * y0 + rise * y1 + t * (1.0 - t) * ((1.0 - t) * d0 - t * d1)


@inlined
def _moved(law, p, m, branch, at, to, z, pull):
    """The end of a way on a branch, z and dz/dy there: dz/dy is a straight line, or nothing."""
    if at == to:
        return at, z, pull
    _, there = force(law, p, m, 0, branch, to, 1.0, z, z)
    return to, z + 0.5 * (pull + there) * (to - at), there


@compiled
def follow(law, p, y, rate, dt, r):
    """Fill the forces r (T,) of one law, p (1, P), from rest; whether it could be followed."""
    m, branch, z, pull, none = np.zeros((1, MEMORY)), 0, 0.0, 0.0, 0.0
    for k in range(y.size):
        none = max(none, NONE * abs(y[k]))
    for k in range(y.size):
        d0, d1 = dt * rate[max(k - 1, 0)], dt * rate[k]
        at, before, last = y[max(k - 1, 0)] if k else 0.0, y[max(k - 1, 0)], y[k]
        first, second = _turns(before, last, d0, d1) if k else (2.0, 2.0)
        for leg in range(3):
            if leg < 2:
                turn = first if leg == 0 else second
                if turn > 1.0:
                    continue
                to = _cubic(turn, before, last, d0, d1)
            else:
                to = last
            for corner in range(MOST + 1):
                if abs(to - at) <= none:
                    at = to
                    break
                if corner == MOST:
                    return False
                way = 1.0 if to > at else -1.0
                reached = margin(law, p, m, 0, branch, to, way, z) >= 0.0
                near = at + way * min(max(BEHIND * abs(to - at), none), 0.5 * abs(to - at))
                low, high, place, halved = near, to, near, -1
                while not reached and halved < HALVINGS:
                    # one call for all places: every law is compiled into each call
                    ended = margin(law, p, m, 0, branch, place, way, z) < 0.0
                    if halved >= 0:
                        low, high = low if ended else place, place if ended else high
                    elif place == at:  # where the branch ended near it, too
                        low, high = at, at if ended else near
                    elif ended:
                        place = at
                        continue
                    halved, place = halved + 1, 0.5 * (low + high)
                at, z, pull = _moved(law, p, m, branch, at, high, z, pull)
                if reached:
                    break
                branch, z = next_branch(law, p, m, 0, branch, at, way, z)
        r[k], _ = force(law, p, m, 0, branch, last, rate[k], z, z)
    return True
