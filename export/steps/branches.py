"""Steps of networks whose elements follow the branch law (models/composition/branch_law.py).

n DOFs, E elements, m excitations.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from export.names import elements_of, inputs_of, loops_of, motion_of
from export.step import Step
from export.steps.composite import Motion
from models.composition.branch_law_compiled import HIGHEST, LOWEST, STATES, Y_TURN
from models.composition.branch_run_compiled import Laws, Memory, Room, _deformation, _forces
from models.composition.simulate_compiled import _accelerations, _move, _speed_up
from models.composition.trace import stated_by
from models.element_network_branch import ElementNetworkBranch


def begin(x0, v0, u, motion, memory, room, none, equation, laws):
    """At rest or in motion, with elements that remember nothing."""
    q, rate, left, past = motion.q, motion.rate, motion.left, memory.past
    q[:] = x0
    rate[:] = v0
    past[:] = 0.0
    for e in range(memory.y.size):
        at, _ = _deformation(
            e, q, rate, none, none, u, equation, laws.scale, memory.dy[e], memory.dy[e], False
        )
        past[e, Y_TURN] = at
        memory.y[e], past[e, HIGHEST], past[e, LOWEST] = at, max(at, 0.0), min(at, 0.0)
    _forces(q, rate, none, none, False, 0.0, u, equation, laws, memory, room)
    _accelerations(q, rate, None, None, u, equation, memory.r, None, left, None)
    motion.acc[:] = left


def observe(last, u, motion, memory, deformation, x, v, a, r, equation, laws):
    """An excitation that is held between samples jumps at them."""
    q, rate, _, acc, left = motion
    for i in range(q.size):
        acc[i] = left[i]
        for j in range(u.size):
            acc[i] += equation.inputs.value[i, j] * (u[j] - last[j])
        x[i], v[i], a[i] = q[i], rate[i], acc[i]
    for e in range(r.size):
        deformation[e], r[e] = laws.scale[0, e] * memory.y[e], memory.r[e]


def advance(last, dt, motion, memory, room, none, equation, laws):
    """A velocity-Verlet substep."""
    q, rate, ahead, acc, left = motion
    _move(dt, q, rate, acc, ahead, None, None, None, None)
    _forces(q, ahead, none, none, True, dt, last, equation, laws, memory, room)
    _accelerations(q, ahead, None, None, last, equation, memory.r, None, left, None)
    _speed_up(dt, rate, acc, left, None, None, None)


def step_of(model: ElementNetworkBranch) -> Step:
    """The step of a network of branch laws. Raises ValueError for one that is not identified."""
    model.require_identified(model.identified)
    branches = model.branches
    equation, _ = stated_by(model.composition(), derivatives=False)
    theta = branches.theta.detach().numpy().reshape(-1).copy()
    laws = Laws(theta, branches.sizes, branches.scale.numpy().copy())
    (E, n), width = equation.D.value.shape, branches.sizes[0]
    rows = np.zeros((E, 0))
    memory = Memory(
        np.zeros(E), np.zeros(E), rows, rows, np.zeros((E, STATES)), np.zeros((E, STATES, 0)),
        np.zeros(E), rows,
    )  # fmt: skip
    x, x_turn, by_x = np.zeros((3, width))
    room = Room(np.zeros((5, 0)), x, x_turn, by_x, np.zeros(branches.sizes[1]))
    state: dict[str, Any] = {"motion": Motion(*np.zeros((5, n))), "memory": memory, "room": room}
    state |= {name: np.zeros(n) for name in "xva"}
    state |= {name: np.zeros(E) for name in ("deformation", "r")}
    outputs = [*motion_of(model), *loops_of(elements_of(model, E), "deformation")]
    numbers = {"equation": equation, "laws": laws, "none": np.zeros((n, 0))}
    return Step(
        begin, observe, advance, model.dt, state, numbers, inputs_of(model), outputs,
        model.substeps, True,
    )  # fmt: skip
