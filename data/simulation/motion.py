"""Forces and support motions → the motion of a structure.

How the error falls with the tolerance, and what it costs: docs/theory.md.
T samples, n DOFs, p supports, E elements.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data.simulation.damage import Changes
from data.simulation.integrator import UNFINISHED, Progress, Samples, System, at_rest, integrate
from data.simulation.laws.dispatch import entries
from data.simulation.structure import Structure

STEPS_OF_A_CALL = 2_000_000  # over the number of nodes and elements: a fraction of a second
STEPS_OF_A_SAMPLE, LEAST_BUDGET = 1000, 1_000_000  # that a record may take; usual are 1 to 10
LONGEST_STEP = 3.5  # times the fastest time constant: beyond, the method is unstable
REMEDY = "lower its stiffness or damping, raise its mass, or lower data.dt and data.duration"


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
    Raises ValueError for shapes that do not fit, values that are not finite, dt ≤ 0, and a motion
    that takes more steps than `most_steps`.
    A motion that escapes is returned with its `escape_time`.
    """
    given = {"force": force, "support": support, "support_velocity": support_velocity}
    for name, u in given.items():
        if u is None and name != "force":
            continue
        if not (isinstance(u, np.ndarray) and u.dtype.kind in "fi"):
            raise ValueError(f"{name} must be an array of numbers (samples, ·)")
        if u.ndim != 2:
            raise ValueError(f"{name} has shape {u.shape}; expected (samples, ·)")
    if not all(isinstance(u, int | float) for u in (dt, tolerance)):
        raise ValueError(f"dt={dt!r}, tolerance={tolerance!r}: expected numbers")
    T, n, E = len(force), structure.dofs, len(structure.elements)
    if T == 0:
        raise ValueError("force has no samples; expected at least one")
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
    ends = structure.ends
    if not (support.any() or support_velocity.any()):  # supports that stand still are ground
        ends, support = np.minimum(ends, n), np.zeros((T, 0))
        support_velocity = support
    parameters, settings = structure.parameters, (float(dt), float(tolerance))
    changing = _arrays(changes, parameters.shape[1])
    system = System(structure.masses, ends, entries(structure.law), *changing)
    driving = force, support, support_velocity
    f, s, w = (np.ascontiguousarray(u, dtype=float) for u in driving)
    samples = Samples(f, s, w, x, v, a, y, r, work)
    progress = at_rest(n, support.shape[1], parameters, *settings)
    fixed = (system, samples, progress, *settings)
    budget = most_steps(T)
    call = min(budget, max(1, STEPS_OF_A_CALL // (n + structure.supports + E)))
    while (escape := integrate(*fixed, call)) == UNFINISHED:  # between calls Ctrl-C is heard
        if progress.steps >= budget:
            raise ValueError(_beyond(structure, dt, T, progress, budget))
    return Motion(x, v, a, y, r, work, escape_time=None if escape < 0.0 else escape)


def most_steps(samples: int) -> int:
    """Steps that the integrator may take for a record."""
    return max(LEAST_BUDGET, STEPS_OF_A_SAMPLE * samples)


def least_steps(structure: Structure, duration: float) -> tuple[float, str]:
    """Steps that a record of the linearised structure takes at least, and what asks for them.

    An explicit step may not be longer than some LONGEST_STEP/ω of the fastest motion, whether that
    is excited or not; a mass whose neighbours stand still has ω² = Σk/m, and a rate Σc/m where it
    is heavily damped: no more than the fastest of the structure.
    """
    stiffness, damping = np.zeros((2, structure.dofs + structure.supports + 1))
    for (start, end), element in zip(structure.ends, structure.elements.values(), strict=True):
        k, c = element.tangent()
        for node in (start, end):
            stiffness[node] += k
            damping[node] += c
    n = structure.dofs
    rates = np.maximum(
        np.sqrt(np.maximum(stiffness[:n], 0.0) / structure.masses), damping[:n] / structure.masses
    )
    i = int(rates.argmax())
    cause = (
        f"x{i + 1} of {structure.masses[i]:g} kg, held by {stiffness[i]:.3g} N/m and "
        f"{damping[i]:.3g} N s/m, moves at {rates[i]:.3g} rad/s"
    )
    return duration * float(rates[i]) / LONGEST_STEP, cause


def _beyond(structure: Structure, dt: float, T: int, progress: Progress, budget: int) -> str:
    done = max(int(progress.counts[0]), 1)
    return (
        f"the integrator took {progress.steps:.3g} steps for the first {done} of {T} samples, and "
        f"would take {progress.steps * T / done:.3g} for the record; {budget:.3g} are allowed. "
        f"{least_steps(structure, T * dt)[1]}; {REMEDY}"
    )


def _arrays(changes: Changes | None, width: int) -> tuple[np.ndarray, ...]:
    """Changes as the compiled loop takes them: sample, offset, element, parameters, z's factor."""
    if changes is None:
        none, numbers = np.zeros(0), np.zeros(0, np.int64)
        return numbers, none, numbers, np.zeros((0, width)), none
    c = changes
    return c.sample, c.offset, c.element, c.parameters, c.state
