"""Steps of networks of elements: the compiled run of models/composition, one substep at a time.

n coordinates, E elements, m excitations, o outputs; k other inputs, J laws of each.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import singledispatch
from typing import Any, NamedTuple

import numpy as np

from export.names import elements_of, inputs_of, loops_of, motion_of
from export.step import Step
from models.composition.composite import Composite
from models.composition.other_inputs import OtherInputs
from models.composition.simulate_compiled import (
    Sensors,
    _accelerations,
    _begin_elements,
    _forces,
    _move,
    _speed_up,
    room_of,
)
from models.composition.trace import stated_by
from models.hysteretic_element import HystereticElement

NAMES = ("stiffness", "damping", "cubic")
UNITS = ("N/m", "N s/m", "N/m3")
HINGE = (("stiffness", "N/m"), ("gap", "m"))
UNIT = (("stiffness", "N/m"), ("limit", "m"), ("rising", "1/m"), ("falling", "1/m"))
GROUPS = (HINGE, UNIT)


def begin(x0, v0, u, motion, elements, equation, back, branches, none):
    """At rest or in motion, with elements that remember nothing."""
    q, rate, left = motion.q, motion.rate, motion.left
    for i in range(q.size):
        q[i] = rate[i] = 0.0
        for c in range(x0.size):
            q[i] += back[i, c] * x0[c]
            rate[i] += back[i, c] * v0[c]
    elements.z[:] = 0.0
    _begin_elements(q, rate, none, none, u, equation, branches, elements)
    _forces(q, rate, none, none, False, 0.0, u, equation, branches, elements)
    _accelerations(q, rate, None, None, u, equation, elements.r, None, left, None)
    motion.acc[:] = left


def observe(last, u, motion, elements, x, v, a, y, r, equation, outputs, branches):
    """An excitation that is held between samples jumps at them."""
    q, rate, _, acc, left = motion
    for i in range(q.size):
        acc[i] = left[i]
        for j in range(u.size):
            acc[i] += equation.inputs.value[i, j] * (u[j] - last[j])
    for c in range(x.size):
        x[c] = v[c] = a[c] = 0.0
        for i in range(q.size):
            x[c] += outputs[c, i] * q[i]
            v[c] += outputs[c, i] * rate[i]
            a[c] += outputs[c, i] * acc[i]
    y[:] = elements.y
    r[:] = elements.r
    if len(branches) > 0:
        for e in range(y.size):
            y[e] *= branches.scale[0, e]


def advance(last, dt, motion, elements, equation, branches, none):
    """A velocity-Verlet substep."""
    q, rate, ahead, acc, left = motion
    _move(dt, q, rate, acc, ahead, None, None, None, None)
    _forces(q, ahead, none, none, True, dt, last, equation, branches, elements)
    _accelerations(q, ahead, None, None, last, equation, elements.r, None, left, None)
    _speed_up(dt, rate, acc, left, None, None, None)


class Motion(NamedTuple):
    """The coordinates (n,), and what is known of them."""

    q: np.ndarray
    rate: np.ndarray
    ahead: np.ndarray
    acc: np.ndarray
    left: np.ndarray  # accelerations before the excitation jumps


@singledispatch
def step_of(model: Composite) -> Step:
    """The step of a network of elements, or of elements under an imposed motion.

    Raises ValueError for one that is not identified.
    """
    step = _step(model)
    names = elements_of(model, step.state["y"].size)
    return replace(step, outputs=[*motion_of(model), *loops_of(names)])


@step_of.register
def _(model: HystereticElement) -> Step:
    step = _step(model)
    forces = ("r", [f"r{i + 1}" for i in range(step.state["a"].size)], "N")
    step = replace(step, outputs=[forces])
    if model.others is None:
        return step
    return _under_other_inputs(model, model.others, step)


def _step(model: Composite) -> Step:
    """A step whose outputs have no names yet."""
    model.require_identified(model.identified)
    made = model.composition()
    equation, sensors = stated_by(made, derivatives=False)
    E, n = equation.D.value.shape
    outputs, back = _of_masses(model, sensors)
    o = len(outputs)
    branches = model.compiled_branches()
    elements = room_of(equation, 0, branches)[2]
    state: dict[str, Any] = {"motion": Motion(*np.zeros((5, n))), "elements": elements}
    state |= {name: np.zeros(o) for name in "xva"} | {name: np.zeros(E) for name in "yr"}
    numbers = {"equation": equation, "outputs": outputs, "back": back, "branches": branches}
    numbers["none"] = np.zeros((n, 0)) if branches else None  # derivatives
    return Step(
        begin, observe, advance, model.dt, state, numbers,
        inputs_of(model), [], model.substeps, True,
        parameters=[] if branches else _parameters(model, made.counts, E),
    )  # fmt: skip


def _of_masses(model: Composite, sensors: Sensors) -> tuple[np.ndarray, np.ndarray]:
    """Outputs by the coordinates, and back: of all masses where some have no sensor."""
    if (masses := getattr(model, "floors", model.dofs)) > model.dofs:
        return np.eye(masses), np.eye(masses)
    return sensors.outputs.value, sensors.back


def _parameters(
    model: Composite, counts: tuple[int, int], E: int
) -> list[tuple[str, tuple[int, ...], str, str]]:
    """Coefficients of the laws (E, L), of networks whose elements join nodes."""
    if not hasattr(model, "mass"):
        return []
    columns = list(zip(NAMES, UNITS, strict=True))
    for kind, count, group in zip(("hinge", "unit"), counts, GROUPS, strict=True):
        for i in range(count):
            columns += [(f"{kind}{i + 1}_{name}", unit) for name, unit in group]
    return [
        ("equation_laws_value", (e, column), f"{element}.{name}", unit)
        for e, element in enumerate(elements_of(model, E))
        for column, (name, unit) in enumerate(columns)
    ]


# Elements under other inputs, such as a voltage: laws side by side, weighed by them.
# models/composition/other_inputs.py has the equations.


class Lags(NamedTuple):
    """How the other inputs, and the rates, lag behind."""

    lag: np.ndarray  # (k,) [s]
    rate_lag: np.ndarray  # (J·E,) [s]
    centre: np.ndarray  # (k,), and reach
    reach: np.ndarray


class Nodes(NamedTuple):
    """Places at which laws are known, and what saturates with the rate there."""

    each: int  # of an input
    used: np.ndarray
    places: np.ndarray
    rate_force: np.ndarray
    rate_knee: np.ndarray
    offset: np.ndarray


def begin_under_inputs(x0, v0, u, motion, elements, equation, back, branches, none, w, p, lags):
    """At rest, and with lags that have settled under the first excitation."""
    begin(x0, v0, u, motion, elements, equation, back, branches, none)
    parts = (u.size - w.size) // 2
    for i in range(w.size):
        w[i] = (u[2 * parts + i] - lags.centre[i]) / lags.reach[i]
    for j in range(p.size):
        p[j] = u[parts + j % parts]


def observe_force(elements, w, p, nodes, force):
    """The laws at the two nodes around each input, interpolated."""
    for e in range(force.size):
        force[e] = nodes.offset[e]
        for i in range(w.size):
            cell = 0
            for a in range(1, nodes.each):
                if w[i] >= nodes.places[i, a]:
                    cell += 1
            cell = min(cell, nodes.used[i] - 2)
            first, last = nodes.places[i, cell], nodes.places[i, cell + 1]
            share = (w[i] - first) / (last - first)
            law = (i * nodes.each + cell) * force.size + e
            low = _whole(law, elements.r, p, nodes)
            high = _whole(law + force.size, elements.r, p, nodes)
            force[e] += ((1.0 - share) * low + share * high) / w.size


def _whole(law, r, p, nodes):
    """The force of a law with those that saturate with the rate."""
    total = r[law]
    for m in range(nodes.rate_force.shape[1]):
        total += nodes.rate_force[law, m] * math.tanh(p[law] / nodes.rate_knee[law, m])
    return total


def advance_under_inputs(first, last, dt, motion, elements, equation, branches, none, w, p, lags):
    """The laws, and the lags of inputs and rates, which are linear within the step."""
    advance(last, dt, motion, elements, equation, branches, none)
    parts = (last.size - w.size) // 2
    for i in range(w.size):
        at = 2 * parts + i
        before = (first[at] - lags.centre[i]) / lags.reach[i]
        after = (last[at] - lags.centre[i]) / lags.reach[i]
        w[i] = _lagged(w[i], before, after, lags.lag[i], dt)
    for j in range(p.size):
        at = parts + j % parts
        p[j] = _lagged(p[j], first[at], last[at], lags.rate_lag[j], dt)


def _lagged(now, before, after, lag, dt):
    decay = math.exp(-dt / lag)
    held = (1.0 - decay) * lag / dt
    return decay * now + (held - decay) * before + (1.0 - held) * after


def _under_other_inputs(model: HystereticElement, others: OtherInputs, laws: Step) -> Step:
    """The step of elements whose laws are evaluated side by side in the step `laws`."""
    E = model.dofs
    lags = Lags(
        others.lag().detach().numpy().copy(), others.rate_lag().detach().numpy().copy(),
        others.range.centre.numpy().copy(), others.range.reach.numpy().copy(),
    )  # fmt: skip
    nodes = Nodes(
        others.nodes, others.used.numpy().astype(np.int64), others.places.numpy().copy(),
        others.rate_force().detach().numpy().copy(), others.rate_knee().detach().numpy().copy(),
        others.offset().detach().numpy().copy(),
    )  # fmt: skip
    k = len(lags.lag)
    state = {"w": np.zeros(k), "p": np.zeros(others.laws * E), "force": np.zeros(E)}
    names = [(f"s{i + 1}", "m") for i in range(E)] + [(f"s_dot{i + 1}", "m/s") for i in range(E)]
    return Step(
        begin_under_inputs, observe_force, advance_under_inputs, laws.dt, {**laws.state, **state},
        {**laws.numbers, "lags": lags, "nodes": nodes},
        [*names, *((f"u{i + 1}", "") for i in range(k))],
        [("force", [f"r{i + 1}" for i in range(E)], "N")],
        substeps=laws.substeps, any_step=True, holds=("linear",),
    )  # fmt: skip
