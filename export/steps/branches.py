"""Steps of networks whose elements follow the branch law (models/composition/branch_law.py).

n DOFs, E elements, m excitations.
"""

from __future__ import annotations

import numpy as np

from export.names import elements_of, inputs_of, motion_of
from export.step import Step
from models.composition.branch_law_compiled import HIGHEST, LOWEST, STATES, Y_TURN
from models.composition.branch_run_compiled import _deformation, _forces
from models.composition.simulate_compiled import _accelerations, _move, _speed_up
from models.element_network_branch import ElementNetworkBranch


def begin(x0, v0, u, q, rate, y, deformation, speed, past, r, left, acc, core, inputs, G, D,
          supports, theta, sizes, scale, by_q, by_r, by_past, work, rows, none, places, slopes,
          ):  # fmt: skip
    """At rest or in motion, with elements that remember nothing."""
    q[:] = x0
    rate[:] = v0
    past[:] = 0.0
    for e in range(y.size):
        at, _ = _deformation(
            e, q, rate, by_q, by_q, u, D, supports, scale[0, e], scale[1, e], none, none, False
        )
        past[e, Y_TURN] = at
        y[e], past[e, HIGHEST], past[e, LOWEST] = at, max(at, 0.0), min(at, 0.0)
    _forces(q, rate, by_q, by_q, False, 0.0, u, D, supports, theta, sizes, scale, y, speed, by_r,
            by_r, past, by_past, r, by_r, work, rows[0], rows[1], rows[2], rows[3])  # fmt: skip
    _accelerations(q, rate, by_q, by_q, u, core, places, slopes, inputs, places, slopes,
                   G, places, slopes, r, by_r, left, by_q)  # fmt: skip
    acc[:] = left


def observe(last, u, q, rate, left, acc, y, deformation, scale, x, v, a, inputs):
    """An excitation that is held between samples jumps at them."""
    for i in range(q.size):
        acc[i] = left[i]
        for j in range(u.size):
            acc[i] += inputs[i, j] * (u[j] - last[j])
        x[i], v[i], a[i] = q[i], rate[i], acc[i]
    for e in range(y.size):
        deformation[e] = scale[0, e] * y[e]


def advance(last, dt, q, rate, ahead, acc, left, y, speed, past, r, core, inputs, G, D, supports,
            theta, sizes, scale, by_q, by_r, by_past, work, rows, places, slopes):  # fmt: skip
    """A velocity-Verlet substep."""
    _move(dt, q, rate, acc, ahead, by_q, by_q, by_q, by_q)
    _forces(q, ahead, by_q, by_q, True, dt, last, D, supports, theta, sizes, scale, y, speed, by_r,
            by_r, past, by_past, r, by_r, work, rows[0], rows[1], rows[2], rows[3])  # fmt: skip
    _accelerations(q, ahead, by_q, by_q, last, core, places, slopes, inputs, places, slopes,
                   G, places, slopes, r, by_r, left, by_q)  # fmt: skip
    _speed_up(dt, rate, acc, left, by_q, by_q, by_q)


def step_of(model: ElementNetworkBranch) -> Step:
    """The step of a network of branch laws. Raises ValueError for one that is not identified."""
    model.require_identified(model.identified)
    made, laws = model.composition(), model.branches
    parts = {"core": made.core, "inputs": made.inputs, "G": made.G, "D": made.D}
    numbers = {name: part.value.detach().numpy().copy() for name, part in parts.items()}
    numbers |= {"supports": made.supports.numpy(), "scale": laws.scale.numpy().copy()}
    numbers["theta"] = laws.theta.detach().numpy().reshape(-1).copy()
    E, n = numbers["D"].shape
    state = {name: np.zeros(n) for name in ("q", "rate", "ahead", "acc", "left", *"xva")}
    state |= {name: np.zeros(E) for name in ("y", "deformation", "speed", "r")}
    state |= {"past": np.zeros((E, STATES)), "rows": np.zeros((4, laws.sizes[0]))}
    empty = {
        "by_q": np.zeros((n, 0)),
        "by_r": np.zeros((E, 0)),
        "by_past": np.zeros((E, STATES, 0)),
    }
    empty |= {"work": np.zeros((5, 0)), "none": np.zeros(0), "slopes": np.zeros((0, 0))}
    names = elements_of(model, E)
    outputs = [
        *motion_of(model),
        ("deformation", [f"deformation_{name}" for name in names], "m"),
        ("r", [f"force_{name}" for name in names], "N"),
    ]
    known = {"sizes": laws.sizes, "places": np.zeros((0, 0), np.int64)}
    return Step(
        begin, observe, advance, model.dt, state, {**numbers, **empty, **known},
        inputs_of(model), outputs, model.substeps, True,
    )  # fmt: skip
