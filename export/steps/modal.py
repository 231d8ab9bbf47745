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
from models.modal.run_compiled import _correct, _deform, _laws, _predict
from models.modal.units_compiled import TERMS
from models.modal_network import ModalNetwork

OWN = ("gamma", "G", "D", "laws", "Cq", "Cv", "Du", "Dr", "o0")


def begin(q, v, z, y, rate, r, before, D, laws, hinges, units, by_q, by_r, by_z, places):
    """Modes at rest, units that remember nothing."""
    phi = np.zeros((3, TERMS))
    q[:] = 0.0
    v[:] = 0.0
    for i in range(z.shape[0]):
        for unit in range(z.shape[1]):
            z[i, unit] = 0.0
        before[i] = 0.0
    _deform(D, places, q, v, by_q, by_q, y, rate, by_r, by_r)
    _laws(laws, places, hinges, units, y, rate, by_r, by_r, before, by_r, False, z, by_z, r, by_r,
          phi)  # fmt: skip


def observe(u, q, v, r, output, Cq, Cv, Du, Dr, o0, size_u, size_o, mean):
    """The outputs; none are known once one is beyond its bound, for the run has diverged."""
    lost = 0
    for c in range(output.size):
        value = o0[c]
        for j in range(q.size):
            value += Cq[c, j] * q[j] + Cv[c, j] * v[j]
        for j in range(u.size):
            value += Du[c, j] * u[j] / size_u[j]
        for i in range(r.size):
            value += Dr[c, i] * r[i]
        output[c] = mean[c] + size_o[c] * value
        if not abs(value) < BOUND:
            lost = 1
    if lost == 1:
        output[:] = np.nan


def advance(first, last, q, v, z, y, rate, r, before, output, core, gamma, u0, G, D, laws, size_u,
            hinges, units, by_q, by_r, by_z, places, place):  # fmt: skip
    """A substep: modes by their exponentials, elements by what these predict."""
    m, E = first.size, r.size
    phi = np.zeros((3, TERMS))
    now = np.zeros((3, m))
    new = np.zeros(E)
    if not abs(output[0]) < np.inf:
        q[:] = np.nan
        v[:] = np.nan
    for j in range(m):
        now[0, j] = first[j] / size_u[j]
        now[2, j] = last[j] / size_u[j]
        now[1, j] = now[0, j] + 0.5 * (now[2, j] - now[0, j])
    _predict(core, places, gamma, places, u0, place, G, places, now, r, by_r, q, v, by_q, by_q)
    if E > 0:
        _deform(D, places, q, v, by_q, by_q, y, rate, by_r, by_r)
        _laws(laws, places, hinges, units, y, rate, by_r, by_r, before, by_r, True, z, by_z, new,
              by_r, phi)  # fmt: skip
        _correct(core, places, G, places, r, by_r, new, by_r, q, v, by_q, by_q)
        r[:] = new


def step_of(model: ModalNetwork) -> Step:
    """The step of a modal network. Raises ValueError for one that is not identified.

    A band-limited excitation is interpolated from samples that are yet to come, so no step can.
    """
    parts = model.layout.split(model.values)
    layout, scale, substeps = model.layout, model.scale, int(model.counts[2])
    J, E, U = layout.modes, layout.elements, layout.units
    h = model.dt / scale.time / substeps
    numbers = {name: np.array(parts[name]) for name in (*OWN, "u0")}
    numbers |= {"core": exact_steps(parts["log_k"], parts["log_c"], h)}
    numbers |= {"size_u": scale.u, "size_o": scale.y, "mean": scale.mean}
    empty = {"by_q": np.zeros((J, 0)), "by_r": np.zeros((E, 0)), "by_z": np.zeros((E, U, 0))}
    empty |= {"places": np.zeros((0, 0), np.int64), "place": np.zeros(0, np.int64)}
    state = {name: np.zeros(J) for name in "qv"} | {"z": np.zeros((E, U))}
    state |= {name: np.zeros(E) for name in ("y", "rate", "r", "before")}
    state["output"] = np.zeros(model.dofs)
    return Step(
        begin, observe, advance, model.dt, state,
        {**numbers, **empty, "hinges": layout.hinges, "units": U}, inputs_of(model),
        [("output", [f"y{i + 1}" for i in range(model.dofs)], "")], substeps,
    )  # fmt: skip
