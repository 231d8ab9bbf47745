"""Steps of named elements, alone and in networks: the integrator of data/simulation by samples.

It chooses its own steps within a sample and stops at every corner of the laws.
n DOFs, p supports, E elements, m excitations, N nodes.
"""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import numpy as np

from data.simulation.integrator import FINISHED, Samples, System, at_rest, integrate
from data.simulation.laws.polynomial import Polynomial
from data.simulation.motion import LEAST_BUDGET
from data.simulation.structure import Structure
from export.names import elements_of, inputs_of, loops_of, motion_of
from export.step import Step
from models.element_network_named import ElementNetworkNamed
from models.estimator import Estimator
from models.named_element import NamedElement

TOLERANCE = 1e-7  # as data/simulation has it


# gamma (n, m): how the excitations drive the masses. The first `forces` of them do; the others are
# displacements and velocities of the supports. sample: both ends of a sample (2, ·).


def begin(x0, v0, u, system, gamma, forces, sample, kept, lost):
    """At rest; where the excitation is not zero, it jumps to that."""
    lost[0] = 1.0 if _moves(x0, v0) else 0.0
    _excite(u, system, gamma, forces, sample, 0)
    _excite(u, system, gamma, forces, sample, 1)
    integrate(system, sample, kept, kept.at[0], TOLERANCE, 0)
    sample.x[1, :] = sample.x[0]
    sample.v[1, :] = sample.v[0]
    sample.a[1, :] = sample.a[0]
    sample.y[1, :] = sample.y[0]
    sample.r[1, :] = sample.r[0]


def observe(last, u, gamma, forces, sample, lost, x, v, a, y, r):
    """An excitation that is held between samples jumps at them."""
    far = np.inf if lost[0] > 0.0 else 1.0
    for i in range(x.size):
        x[i], v[i], a[i] = far * sample.x[1, i], far * sample.v[1, i], sample.a[1, i]
        for j in range(forces):
            a[i] += gamma[i, j] * (u[j] - last[j])
        a[i] = far * a[i]
    for e in range(y.size):
        y[e], r[e] = sample.y[1, e], sample.r[1, e]


def advance(first, last, dt, system, gamma, forces, sample, kept, lost):
    """One sample; a motion that escapes is infinite from there on."""
    if lost[0] > 0.0:
        return
    _excite(first, system, gamma, forces, sample, 0)
    _excite(last, system, gamma, forces, sample, 1)
    kept.at[1] = 0.0
    counts = kept.counts
    counts[0], counts[1], counts[2], counts[3] = 1, 0, 0, 0
    if integrate(system, sample, kept, dt, TOLERANCE, LEAST_BUDGET) != FINISHED:
        lost[0] = 1.0


def _moves(x0, v0):
    moves = False
    for i in range(x0.size):
        moves = moves or x0[i] != 0.0 or v0[i] != 0.0
    return moves


def _excite(u, system, gamma, forces, sample, row):
    """Forces and motions of supports at one end of a sample."""
    masses, f, s, w = system.masses, sample.f, sample.s, sample.w
    for i in range(masses.size):
        f[row, i] = 0.0
        for j in range(forces):
            f[row, i] += masses[i] * (gamma[i, j] * u[j])
    for j in range(s.shape[1]):
        s[row, j] = u[forces + j]
        w[row, j] = u[forces + s.shape[1] + j]


def observe_element(sample, r):
    """The force of an element test: of all parts but the bystander, which gives it a mass."""
    r[0] = 0.0
    for e in range(sample.r.shape[1] - 1):
        r[0] += sample.r[1, e]


@singledispatch
def step_of(model: Estimator) -> Step:
    """The step of a named element, or of a network of them, from rest.

    Begun in motion, a network is infinite. Raises ValueError for a model that is not identified.
    """
    raise NotImplementedError(f"{type(model).__name__} has no step here")


@step_of.register
def _(model: ElementNetworkNamed) -> Step:
    model.require_identified(model.named.numbers)
    structure, gamma = model.structure(), model.composition().inputs.value.detach().numpy()
    held, numbers = _arrays_of(structure, np.ascontiguousarray(gamma), model.forces, model.dt)
    n, E = structure.dofs, len(structure.elements)
    held |= {name: np.zeros(n) for name in "xva"} | {name: np.zeros(E) for name in "yr"}
    names = elements_of(model, E) if len(model.elements) == E else list(structure.elements)
    outputs = [*motion_of(model), *loops_of(names)]
    return Step(
        begin, observe, advance, model.dt, held, numbers, inputs_of(model), outputs, any_step=True
    )


@step_of.register
def _(model: NamedElement) -> Step:
    """An element between a support, which moves as imposed, and ground."""
    model.require_identified(model.laws.numbers)
    parts = model.laws.elements(0, ("ground", "s1"))
    bystander = Polynomial(between=("ground", "x1"), stiffness=1.0)
    structure = Structure([1.0], {str(i): part for i, part in enumerate((*parts, bystander))})
    held, numbers = _arrays_of(structure, np.zeros((1, 2)), 0, model.dt)
    return Step(
        begin, observe_element, advance, model.dt, {**held, "r": np.zeros(1)}, numbers,
        [("s1", "m"), ("s_dot1", "m/s")], [("r", ["r1"], "N")], any_step=True,
    )  # fmt: skip


def _arrays_of(
    structure: Structure, gamma: np.ndarray, forces: int, dt: float
) -> tuple[dict[str, Any], dict[str, Any]]:
    """State and numbers of the integrator."""
    n, m, E = structure.dofs, structure.supports, len(structure.elements)
    parameters = structure.parameters
    sample = Samples(
        np.zeros((2, n)), np.zeros((2, m)), np.zeros((2, m)), *np.zeros((3, 2, n)),
        *np.zeros((3, 2, E)),
    )  # fmt: skip
    never, nothing = np.array([-1]), np.zeros(1)
    system = System(
        structure.masses, structure.ends, structure.law,
        never, nothing, never, np.zeros((1, parameters.shape[1])), nothing,
    )  # fmt: skip
    kept = at_rest(n, m, parameters, dt, TOLERANCE)
    return (
        {"kept": kept, "sample": sample, "lost": np.zeros(1)},
        {"system": system, "gamma": gamma, "forces": forces},
    )
