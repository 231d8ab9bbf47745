"""Forces and support motions → the motion of a structure, one record or many on all cores.

How the error falls with the tolerance, and what it costs: docs/simulation.md.
T samples, n DOFs, p supports, E elements.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from data.simulation.damage import Changes
from data.simulation.integrator import integrate
from data.simulation.structure import Structure


class EscapedMotionError(ValueError):
    """A motion that left every bound, as softening springs allow; holds the time of escape [s]."""

    def __init__(self, message: str, time: float) -> None:
        super().__init__(message)
        self.time = time


@dataclass(frozen=True)
class Motion:
    """Motion of one record: x, v, a (T, n) and y, r, work (T, E) of the elements, SI units."""

    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    y: np.ndarray
    r: np.ndarray
    work: np.ndarray
    escape_time: float | None = None  # [s]; the motion is valid before it only


def simulate(
    structure: Structure,
    force: np.ndarray,
    dt: float,
    support: np.ndarray | None = None,
    support_velocity: np.ndarray | None = None,
    tolerance: float = 1e-7,
    changes: Changes | None = None,
) -> Motion:
    """Motion of `structure` from rest under `force` (T, n) [N], sampled every `dt` [s].

    `support` (T, m) [m] and `support_velocity` (T, m) [m/s] move the supports; without them they
    stand still. `tolerance` is the allowed error of a step relative to the largest x, v and z so
    far. `changes` of elements come at their instants (data/simulation/damage.py).
    Raises ValueError for shapes that do not fit, values that are not finite and dt ≤ 0.
    A motion that escapes is returned with its `escape_time`.
    """
    T, n, E = len(force), structure.dofs, len(structure.elements)
    if (support is None) != (support_velocity is None):
        raise ValueError("give support and support_velocity together, or neither")
    if support is None or support_velocity is None:
        support = support_velocity = np.zeros((T, structure.supports))
    for name, array, width in (
        ("force", force, n),
        ("support", support, structure.supports),
        ("support_velocity", support_velocity, structure.supports),
    ):
        if array.shape != (T, width):
            raise ValueError(
                f"{name} has shape {array.shape}; expected ({T}, {width}): samples × "
                f"{'DOFs' if name == 'force' else 'supports'}"
            )
        if not np.isfinite(array).all():
            bad = int(np.argwhere(~np.isfinite(array))[0, 0])
            raise ValueError(f"{name} is not finite at sample {bad} (t = {bad * dt:g} s)")
    if not (np.isfinite(dt) and dt > 0.0):
        raise ValueError(f"dt={dt} s must be positive")
    if not 0.0 < tolerance <= 1e-3:
        raise ValueError(f"tolerance={tolerance} must lie between 0 and 1e-3")
    x, v, a = (np.zeros((T, n)) for _ in range(3))
    y, r, work = (np.zeros((T, E)) for _ in range(3))
    model = (structure.masses, structure.ends, structure.law, structure.parameters)
    inputs = [np.ascontiguousarray(u, dtype=float) for u in (force, support, support_velocity)]
    changing = _arrays(changes, structure.parameters.shape[1])
    settings = float(dt), float(tolerance)
    escape = integrate(*model, *inputs, *settings, *changing, x, v, a, y, r, work)
    return Motion(x, v, a, y, r, work, escape_time=None if escape < 0.0 else escape)


def _arrays(changes: Changes | None, width: int) -> tuple[np.ndarray, ...]:
    """Changes as the compiled loop takes them: sample, offset, element, parameters, z's factor."""
    if changes is None:
        none, numbers = np.zeros(0), np.zeros(0, np.int64)
        return numbers, none, numbers, np.zeros((0, width)), none
    c = changes
    return c.sample, c.offset, c.element, c.parameters, c.state


def simulate_many(
    structure: Structure,
    forces: Sequence[np.ndarray],
    dt: float,
    supports: Sequence[np.ndarray] | None = None,
    support_velocities: Sequence[np.ndarray] | None = None,
    tolerance: float = 1e-7,
    changes: Changes | None = None,
) -> list[Motion]:
    """`simulate` for many records at once, on all cores; the same bits as one by one."""
    supports_ = supports if supports is not None else [None] * len(forces)
    velocities_ = support_velocities if support_velocities is not None else [None] * len(forces)

    def one(force: np.ndarray, s: np.ndarray | None, w: np.ndarray | None) -> Motion:
        return simulate(structure, force, dt, s, w, tolerance, changes)

    if len(forces) == 1:
        return [one(forces[0], supports_[0], velocities_[0])]
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # the compiled loop releases the GIL
        return list(pool.map(one, forces, supports_, velocities_))
