"""An element test: the force of one element whose deformation is imposed, and its file.

What is measured in a laboratory on a brace, a damper or a bearing. T samples.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from data.simulation.laws.compiling import compiled, inlined
from data.simulation.laws.dispatch import entry, margin, next_branch
from data.simulation.laws.dispatch import force as element_force
from data.simulation.laws.element import MEMORY, PARAMETERS, Element
from data.simulation.laws.polynomial import Polynomial
from data.simulation.motion import EscapedMotionError, Motion, simulate
from data.simulation.structure import Structure
from data.whole_file import whole_file

MOST = 50  # corners between two samples
HALVINGS = 50  # of a way, to its corner
BEHIND = 1e-6  # of a way: a branch that has not ended there has not ended at its beginning
NONE = 1e-12  # of the largest deformation: a way of no length


def force(element: Element, y: np.ndarray, dt: float, rate: np.ndarray | None = None) -> np.ndarray:
    """Force (T,) [N] of an element from rest under the deformation y (T,) [m], every dt [s].

    The rate (T,) [m/s] is that of a cubic spline through y, unless it is given; between samples y
    is the cubic through y and its rate. Raises ValueError for shapes that do not fit, values that
    are not finite, and dt ≤ 0.
    """
    if not element.by_path:
        return imposed(element, y, dt, rate).r[:, 0]
    y, rate = _motion(y, dt, rate)
    p = np.zeros((1, PARAMETERS))
    p[0, : len(element.parameters)] = element.parameters
    r, memory = np.zeros(y.size), np.zeros((1, MEMORY))
    if not (follow(entry(element.law), p, memory, y, rate, dt, r) and np.isfinite(r).all()):
        raise EscapedMotionError(
            f"{type(element).__name__} cannot be followed along this deformation; impose a smaller "
            "one",
            dt * y.size,
        )
    return r


def imposed(
    element: Element,
    y: np.ndarray,
    dt: float,
    rate: np.ndarray | None = None,
    tolerance: float = 1e-7,
) -> Motion:
    """The motion, force and work of an element under an imposed deformation, as `force` takes it.

    The element joins a support, which moves by y, to ground.
    """
    y, rate = _motion(y, dt, rate)
    bystander = Polynomial(between=("ground", "x1"), stiffness=1.0)  # a structure has a mass
    tested = replace(element, between=("ground", "s1"))
    structure = Structure([1.0], {"tested": tested, "bystander": bystander})
    at_rest = np.zeros((y.size, 1))
    motion = simulate(structure, at_rest, dt, y[:, None], rate[:, None], tolerance)
    if motion.escape_time is not None:
        raise EscapedMotionError(
            f"{type(element).__name__} cannot be followed beyond t = {motion.escape_time:g} s; "
            "impose a smaller or slower deformation",
            motion.escape_time,
        )
    return motion


def write(path: str | Path, element: Element, y: np.ndarray, dt: float) -> None:
    """Write the test of an element as CSV: time [s], s1 [m], s_dot1 [m/s], r1 [N].

    `python train.py data=measured data.quantity=force data.path=… model=element_test` reads
    it. Raises ValueError as `force` does.
    """
    y = np.asarray(y, dtype=float)
    r = force(element, y, dt)
    table = np.column_stack([dt * np.arange(y.size), y, _rate(y, dt), r])
    header = "time,s1,s_dot1,r1"
    with whole_file(Path(path)) as aside:
        np.savetxt(aside, table, fmt="%.10g", delimiter=",", header=header, comments="")


def growing_cycles(amplitude: float, cycles: int, dt: float, frequency: float) -> np.ndarray:
    """A deformation (T,) [m] of sinusoidal cycles that grow to `amplitude`, at `frequency` [Hz]."""
    t = dt * np.arange(round(cycles / (frequency * dt)) + 1)
    return amplitude * t / t[-1] * np.sin(2.0 * np.pi * frequency * t)


def _motion(y: np.ndarray, dt: float, rate: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    y = np.ascontiguousarray(y, dtype=float)
    if y.ndim != 1 or y.size < 4:
        raise ValueError(f"y has shape {y.shape}; expected (samples,), four at least")
    rate = _rate(y, dt) if rate is None else np.ascontiguousarray(rate, dtype=float)
    if rate.shape != y.shape:
        raise ValueError(f"rate has shape {rate.shape}; expected {y.shape}, that of y")
    return y, rate


def _rate(y: np.ndarray, dt: float) -> np.ndarray:
    from scipy.interpolate import CubicSpline  # slow to import, seldom needed

    if not (isinstance(dt, int | float) and 0.0 < dt < np.inf):
        raise ValueError(f"dt={dt!r} s must be positive")
    if not np.isfinite(y).all():
        bad = int(np.flatnonzero(~np.isfinite(y))[0])
        raise ValueError(f"y is not finite at sample {bad}")
    t = dt * np.arange(y.size)
    return np.asarray(CubicSpline(t, y)(t, 1))


# The force along a path, followed from one turn or corner to the next, compiled.
#
# Where a law's branches end at deformations, and where the motion turns, time plays no part:
# between two corners the force is a function of y, and z, where there is one, is its work along
# straight lines. That takes a fraction of the time of the integrator (`imposed`), which tends to
# the same force as its samples get finer. Between samples y is the cubic through y and its rate.


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
    _, there = element_force(law, p, m, 0, branch, to, 1.0, z, z)
    return to, z + 0.5 * (pull + there) * (to - at), there


@compiled
def follow(law, p, m, y, rate, dt, r):
    """Fill the forces r (T,) of one law, p (1, P), from rest; whether it could be followed."""
    branch, z, pull, none = 0, 0.0, 0.0, 0.0
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
        r[k], _ = element_force(law, p, m, 0, branch, last, rate[k], z, z)
    return True
