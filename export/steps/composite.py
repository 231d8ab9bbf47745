"""Steps of networks of elements: the compiled run of models/composition, one substep at a time.

n coordinates, E elements, m excitations, o outputs.
"""

from __future__ import annotations

from importlib import import_module

import numpy as np
import torch

from export.names import elements_of, inputs_of, motion_of
from export.step import Step
from models.composition.composite import Composite
from models.composition.simulate_compiled import _accelerations, _forces, _move, _speed_up
from models.hysteretic_element import HystereticElement

NAMES = ("stiffness", "damping", "cubic", "quadratic", "absolute_damping", "square_damping")
UNITS = ("N/m", "N s/m", "N/m3", "N/m2", "N s/m2", "N s/m3")
HINGE = (("stiffness", "N/m"), ("gap", "m"))
TANH = (("stiffness", "N/m"), ("slope", "1/m"), ("place", "m"))
UNIT = (("stiffness", "N/m"), ("limit", "m"), ("rising", "1/m"), ("falling", "1/m"))
GROUPS = (HINGE, TANH, UNIT)


def begin(x0, v0, u, q, rate, z, y, r, left, acc, back, core, inputs, G, D, supports, laws,
          counts, by_q, by_r, by_z, work, places, slopes):  # fmt: skip
    """At rest or in motion, with units that remember nothing."""
    for i in range(q.size):
        q[i] = rate[i] = 0.0
        for c in range(x0.size):
            q[i] += back[i, c] * x0[c]
            rate[i] += back[i, c] * v0[c]
    z[:] = 0.0
    _forces(q, rate, by_q, by_q, False, u, D, places, slopes, supports, laws, places, slopes,
            counts, y, by_r, z, by_z, r, by_r, work)  # fmt: skip
    _accelerations(q, rate, by_q, by_q, u, core, places, slopes, inputs, places, slopes,
                   G, places, slopes, r, by_r, left, by_q)  # fmt: skip
    acc[:] = left


def observe(last, u, q, rate, left, acc, x, v, a, inputs, outputs):
    """An excitation that is held between samples jumps at them."""
    for i in range(q.size):
        acc[i] = left[i]
        for j in range(u.size):
            acc[i] += inputs[i, j] * (u[j] - last[j])
    for c in range(x.size):
        x[c] = v[c] = a[c] = 0.0
        for i in range(q.size):
            x[c] += outputs[c, i] * q[i]
            v[c] += outputs[c, i] * rate[i]
            a[c] += outputs[c, i] * acc[i]


def advance(last, dt, q, rate, ahead, acc, left, y, z, r, core, inputs, G, D, supports, laws,
            counts, by_q, by_r, by_z, work, places, slopes):  # fmt: skip
    """A velocity-Verlet substep."""
    _move(dt, q, rate, acc, ahead, by_q, by_q, by_q, by_q)
    _forces(q, ahead, by_q, by_q, True, last, D, places, slopes, supports, laws, places, slopes,
            counts, y, by_r, z, by_z, r, by_r, work)  # fmt: skip
    _accelerations(q, ahead, by_q, by_q, last, core, places, slopes, inputs, places, slopes,
                   G, places, slopes, r, by_r, left, by_q)  # fmt: skip
    _speed_up(dt, rate, acc, left, by_q, by_q, by_q)


def step_of(model: Composite) -> Step:
    """The step of a network of elements, or of elements under an imposed motion.

    Raises ValueError for one that is not identified.
    """
    model.require_identified(model.identified)
    made = model.composition()
    parts = {"core": made.core, "inputs": made.inputs, "G": made.G, "D": made.D}
    parts |= {"laws": made.laws, "outputs": made.outputs}
    numbers = {name: part.value.detach().numpy().copy() for name, part in parts.items()}
    back = torch.linalg.pinv(made.outputs.value.detach())
    numbers |= {"back": back.numpy(), "supports": made.supports.numpy()}
    (E, n), o, units = numbers["D"].shape, len(numbers["outputs"]), made.counts[2]
    state = {name: np.zeros(n) for name in ("q", "rate", "ahead", "acc", "left")}
    state |= {"y": np.zeros(E), "z": np.zeros((E, units)), "r": np.zeros(E)}
    state |= {name: np.zeros(o) for name in "xva"}
    empty = {"by_q": np.zeros((n, 0)), "by_r": np.zeros((E, 0)), "by_z": np.zeros((E, units, 0))}
    empty |= {"work": np.zeros((2, 0)), "slopes": np.zeros((0, 0))}
    step = Step(
        begin, observe, advance, model.dt, state,
        {**numbers, **empty, "places": np.zeros((0, 0), np.int64), "counts": made.counts},
        inputs_of(model), _outputs(model, E, o), model.substeps, True,
        parameters=_parameters(model, made.counts, E),
    )  # fmt: skip
    if isinstance(model, HystereticElement) and model.others is not None:
        return import_module("export.steps.other_inputs").step_of(model, step)
    return step


def _outputs(model: Composite, E: int, o: int) -> list[tuple[str, list[str], str]]:
    if isinstance(model, HystereticElement):
        return [("r", [f"r{i + 1}" for i in range(o)], "N")]
    names = elements_of(model, E)
    return [
        *motion_of(model),
        ("y", [f"deformation_{name}" for name in names], "m"),
        ("r", [f"force_{name}" for name in names], "N"),
    ]


def _parameters(
    model: Composite, counts: tuple[int, int, int], E: int
) -> list[tuple[str, tuple[int, ...], str, str]]:
    """Coefficients of the laws (E, L), of networks whose elements join nodes."""
    if not hasattr(model, "mass"):
        return []
    columns = list(zip(NAMES, UNITS, strict=True))
    for kind, count, group in zip(("hinge", "tanh", "unit"), counts, GROUPS, strict=True):
        for i in range(count):
            columns += [(f"{kind}{i + 1}_{name}", unit) for name, unit in group]
    return [
        ("laws", (e, column), f"{element}.{name}", unit)
        for e, element in enumerate(elements_of(model, E))
        for column, (name, unit) in enumerate(columns)
    ]
