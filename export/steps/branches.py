"""Steps of networks whose elements follow the branch law (models/composition/branch_law.py).

n DOFs, E elements, m excitations.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from export.names import elements_of, inputs_of, loops_of, motion_of
from export.step import Step
from export.steps.composite import Motion
from models.composition.branch_run_compiled import begin_branches, forces_of_branches, memory_of
from models.composition.simulate_compiled import _accelerations, _move, _speed_up
from models.composition.trace import stated_by
from models.element_network_branch import ElementNetworkBranch


def begin(x0, v0, u, motion, memory, none, equation, laws):
    """At rest or in motion, with elements that remember nothing."""
    q, rate, left = motion.q, motion.rate, motion.left
    q[:] = x0
    rate[:] = v0
    memory.z[:] = 0.0
    begin_branches(q, rate, none, none, u, equation, laws, memory)
    forces_of_branches(q, rate, none, none, False, 0.0, u, equation, laws, memory)
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


def advance(last, dt, motion, memory, none, equation, laws):
    """A velocity-Verlet substep."""
    q, rate, ahead, acc, left = motion
    _move(dt, q, rate, acc, ahead, None, None, None, None)
    forces_of_branches(q, ahead, none, none, True, dt, last, equation, laws, memory)
    _accelerations(q, ahead, None, None, last, equation, memory.r, None, left, None)
    _speed_up(dt, rate, acc, left, None, None, None)


def step_of(model: ElementNetworkBranch) -> Step:
    """The step of a network of branch laws. Raises ValueError for one that is not identified."""
    model.require_identified(model.identified)
    branches = model.branches
    equation, _ = stated_by(model.composition(), derivatives=False)
    laws, (E, n) = branches.compiled(), equation.D.value.shape
    state: dict[str, Any] = {"motion": Motion(*np.zeros((5, n))), "memory": memory_of(laws, 0)}
    state |= {name: np.zeros(n) for name in "xva"}
    state |= {name: np.zeros(E) for name in ("deformation", "r")}
    outputs = [*motion_of(model), *loops_of(elements_of(model, E), "deformation")]
    numbers = {"equation": equation, "laws": laws, "none": np.zeros((n, 0))}
    return Step(
        begin, observe, advance, model.dt, state, numbers, inputs_of(model), outputs,
        model.substeps, True,
    )  # fmt: skip
