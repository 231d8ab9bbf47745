"""Step of a modal network: the compiled run of models/modal, one substep at a time.

q̈ + c q̇ + k q = Γ (u + u₀) − G r(D q, D q̇, z),   o = C_q q + C_v q̇ + D_u u + D_r r + o₀
J modes, E elements, m inputs, n outputs; all in units of the model but what goes in and out.
"""

from __future__ import annotations

import numpy as np

from export.names import inputs_of
from export.step import Step
from models.modal.core import exact_steps
from models.modal.run import BOUND
from models.modal.run_compiled import _deform, _laws
from models.modal.units_compiled import TERMS
from models.modal_network import ModalNetwork

OWN = ("gamma", "G", "D", "laws", "Cq", "Cv", "Du", "Dr", "o0")


def begin(q, v, z, y, rate, r, before, D, laws, hinges, units, by_q, by_r, by_z, places):
    """Modes at rest, units that remember nothing."""
    q[:] = 0.0
    v[:] = 0.0
    for i in range(r.size):
        before[i] = 0.0
        for unit in range(units):
            z[i, unit] = 0.0
    if r.size > 0:
        _forces(q, v, z, y, rate, r, before, D, laws, hinges, units, False, by_q, by_r, by_z,
                places)  # fmt: skip


def _forces(q, v, z, y, rate, r, before, D, laws, hinges, units, moved, by_q, by_r, by_z,
            places):  # fmt: skip
    """Fills the forces r (E,) of elements; `moved`: whether their units move along."""
    phi = np.zeros((3, TERMS))
    _deform(D, places, q, v, by_q, by_q, y, rate, by_r, by_r)
    _laws(laws, places, hinges, units, y, rate, by_r, by_r, before, by_r, moved, z, by_z, r, by_r,
          phi)  # fmt: skip


def observe(u, q, v, r, output, Cq, Cv, Du, Dr, o0, size_u, size_o, mean):
    """The outputs; none are known once one is beyond its bound, for the run has diverged."""
    lost = 0
    for c in range(output.size):
        value = o0[c]
        for j in range(q.size):
            value += Cq[c, j] * q[j] + Cv[c, j] * v[j]
        for j in range(u.size):
            value += Du[c, j] * (u[j] / size_u[j])
        for i in range(r.size):
            value += Dr[c, i] * r[i]
        output[c] = mean[c] + size_o[c] * value
        if not abs(value) < BOUND:
            lost = 1
    if lost == 1:
        output[:] = np.nan


def _predict(first, last, share, width, q, v, r, core, gamma, u0, G, size_u):
    """Modes a substep on, from a share of the step, the forces of elements as they were."""
    for j in range(q.size):
        begins, middle, ends, held = 0.0, 0.0, 0.0, 0.0
        for n in range(first.size):
            start = first[n] / size_u[n]
            rise = last[n] / size_u[n] - start
            begins += gamma[j, n] * (start + share * rise + u0[n])
            middle += gamma[j, n] * (start + (share + 0.5 * width) * rise + u0[n])
            ends += gamma[j, n] * (start + (share + width) * rise + u0[n])
        for i in range(r.size):
            held -= G[j, i] * r[i]
        moved = (core[j, 4] + core[j, 6]) * held
        moved += core[j, 8] * begins + core[j, 10] * middle + core[j, 12] * ends
        speed = (core[j, 5] + core[j, 7]) * held
        speed += core[j, 9] * begins + core[j, 11] * middle + core[j, 13] * ends
        moved += core[j, 0] * q[j] + core[j, 1] * v[j]
        speed += core[j, 2] * q[j] + core[j, 3] * v[j]
        q[j], v[j] = moved, speed


def _correct(q, v, r, new, core, G):
    """Modes at the end of a substep, where the forces of elements have become `new`."""
    for j in range(q.size):
        change = 0.0
        for i in range(r.size):
            change -= G[j, i] * (new[i] - r[i])
        q[j] += core[j, 6] * change
        v[j] += core[j, 7] * change
    r[:] = new


def advance(first, last, q, v, z, y, rate, r, new, before, output, core, gamma, u0, G, D, laws,
            size_u, hinges, units, substeps, by_q, by_r, by_z, places):  # fmt: skip
    """Substeps: modes by their exponentials, elements by what these predict."""
    if not abs(output[0]) < np.inf:
        q[:] = np.nan
        v[:] = np.nan
    for part in range(substeps):
        _predict(first, last, part / substeps, 1.0 / substeps, q, v, r, core, gamma, u0, G, size_u)
        if r.size > 0:
            _forces(q, v, z, y, rate, new, before, D, laws, hinges, units, True, by_q, by_r, by_z,
                    places)  # fmt: skip
            _correct(q, v, r, new, core, G)


def step_of(model: ModalNetwork) -> Step:
    """The step of a modal network. Raises ValueError for one that is not identified.

    A band-limited excitation is interpolated from samples that are yet to come, so no step can.
    """
    parts = model.layout.split(model.values)
    layout, scale, substeps = model.layout, model.scale, int(model.counts[2])
    J, E, U = layout.modes, layout.elements, layout.units
    h = model.dt / scale.time / substeps
    numbers = {name: np.array(parts[name]) for name in (*OWN, "u0")}
    numbers["core"] = exact_steps(parts["log_k"], parts["log_c"], h)[:, 0].copy()
    numbers |= {"size_u": scale.u, "size_o": scale.y, "mean": scale.mean}
    empty = {"by_q": np.zeros((J, 0)), "by_r": np.zeros((E, 0)), "by_z": np.zeros((E, U, 0))}
    empty["places"] = np.zeros((0, 0), np.int64)
    state = {name: np.zeros(J) for name in "qv"} | {"z": np.zeros((E, U))}
    state |= {name: np.zeros(E) for name in ("y", "rate", "r", "new", "before")}
    state["output"] = np.zeros(model.dofs)
    return Step(
        begin, observe, advance, model.dt, state,
        {**numbers, **empty, "hinges": layout.hinges, "units": U, "substeps": substeps},
        inputs_of(model), [("output", [f"y{i + 1}" for i in range(model.dofs)], "")],
    )  # fmt: skip
