"""An element test: the force of one element whose deformation is imposed, and its file.

What is measured in a laboratory on a brace, a damper or a bearing. T samples.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from data.simulation.laws.element import PARAMETERS, Element
from data.simulation.laws.polynomial import Polynomial
from data.simulation.motion import EscapedMotionError, Motion, simulate
from data.simulation.path import follow
from data.simulation.structure import Structure
from data.whole_file import whole_file


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
    r = np.zeros(y.size)
    if not (follow(element.law, p, y, rate, dt, r) and np.isfinite(r).all()):
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
