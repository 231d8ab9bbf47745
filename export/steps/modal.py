"""Step of a modal network: the compiled run of models/modal, one substep at a time.

q̈ + c q̇ + k q = Γ (u + u₀) − G r(D q, D q̇, z),   o = C_q q + C_v q̇ + D_u u + D_r r + o₀
J modes, E elements, m inputs, n outputs; all in units of the model but what goes in and out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from export.names import inputs_of
from export.step import Step
from models.modal.run import BOUND, at_rest, exact_steps
from models.modal.run_compiled import (
    Modes,
    Parts,
    _correct,
    _deform,
    _laws,
    _predict,
    output_of,
)
from models.modal.units_compiled import TERMS
from models.modal_network import ModalNetwork


class Scale(NamedTuple):
    """Units of inputs and outputs."""

    u: np.ndarray  # (m,)
    o: np.ndarray  # (n,)
    mean: np.ndarray  # (n,)


def begin(modes, elements, parts, counts, places):
    """Modes at rest, units that remember nothing."""
    modes.q[:] = 0.0
    modes.v[:] = 0.0
    for i in range(elements.r.size):
        elements.before[i] = 0.0
        for unit in range(counts[1]):
            elements.z[i, unit] = 0.0
    if elements.r.size > 0:
        _fill_forces(modes, elements, parts, counts, places, False, elements.r)


def _fill_forces(modes, elements, parts, counts, places, moved, r):
    """Fills the forces r (E,) of elements; `moved`: whether their units move along."""
    phi = np.zeros((3, TERMS))
    _deform(parts, places, modes, elements)
    _laws(parts, places, counts, elements, moved, r, elements.dr, phi)


def observe(u, modes, elements, now, output, parts, scale):
    """The outputs; none are known once one is beyond its bound, for the run has diverged."""
    lost = 0
    for j in range(u.size):
        now[0, j] = u[j] / scale.u[j]
    for c in range(output.size):
        value = output_of(c, now[0], parts, modes, elements.r)
        output[c] = scale.mean[c] + scale.o[c] * value
        if not abs(value) < np.inf or (elements.r.size > 0 and not abs(value) < BOUND):
            lost = 1
    if lost == 1:
        output[:] = np.nan


def advance(first, last, modes, elements, now, output, parts, counts, substeps, places, scale):
    """Substeps: modes by their exponentials, elements by what these predict."""
    if not abs(output[0]) < np.inf:
        modes.q[:] = np.nan
        modes.v[:] = np.nan
    for part in range(substeps):
        for j in range(first.size):
            start = first[j] / scale.u[j]
            rise = last[j] / scale.u[j] - start
            for place in range(3):
                now[place, j] = start + (part + 0.5 * place) / substeps * rise
        _predict(parts, places, now, elements, modes)
        if elements.r.size > 0:
            _fill_forces(modes, elements, parts, counts, places, True, elements.new)
            _correct(parts, places, elements, modes)
            elements.r[:] = elements.new


def step_of(model: ModalNetwork) -> Step:
    """The step of a modal network. Raises ValueError for one that is not identified.

    A band-limited excitation is interpolated from samples that are yet to come, so no step can.
    """
    split = model.layout.split(model.values)
    layout, scale, substeps = model.layout, model.scale, int(model.counts[2])
    J, E, U = layout.modes, layout.elements, layout.units
    h = model.dt / scale.time / substeps
    core = exact_steps(split["log_k"], split["log_c"], h)[:, :1].copy()
    parts = Parts(core, *(np.array(split[name]) for name in Parts._fields[1:]))
    nowhere = np.zeros((0, 0), np.int64)
    numbers = {
        "parts": parts, "places": Parts(*[nowhere] * len(parts)),
        "counts": (layout.hinges, U), "substeps": substeps,
        "scale": Scale(scale.u, scale.y, scale.mean),
    }  # fmt: skip
    q, v = np.zeros((2, J))
    state = {
        "modes": Modes(q, v, np.zeros((J, 0)), np.zeros((J, 0))),
        "elements": at_rest(np.zeros((E, U)), np.zeros((E, U, 0))),
        "now": np.zeros((3, model.inputs)),
        "output": np.zeros(model.dofs),
    }
    return Step(
        begin, observe, advance, model.dt, state, numbers, inputs_of(model),
        [("output", [f"y{i + 1}" for i in range(model.dofs)], "")],
    )  # fmt: skip
