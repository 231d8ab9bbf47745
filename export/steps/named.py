"""Steps of named elements, alone and in networks: the integrator of data/simulation by samples.

It chooses its own steps within a sample and stops at every corner of the laws.
n DOFs, p supports, E elements, m excitations, N nodes.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from data.simulation.integrator import Progress, integrate
from data.simulation.laws.polynomial import Polynomial
from data.simulation.structure import Structure
from export.names import elements_of, inputs_of, motion_of
from export.step import Step
from models.element_network_named import ElementNetworkNamed
from models.named_element import NamedElement

TOLERANCE = 1e-7  # as data/simulation has it
MOST_STEPS = 1_000_000  # of the integrator in a sample


def begin(x0, v0, u, masses, ends, law, p, gamma, f, s, w, forces, when, offset, element, changed,
          wx, wv, wa, wy, wr, work, q, k, pull, branch, memory, scale, at, counts, tolerance, lost,
          ):  # fmt: skip
    """At rest; where the excitation is not zero, it jumps to that."""
    lost[0] = 1.0 if _moves(x0, v0) else 0.0
    _excitation(u, masses, gamma, forces, f, s, w, 0)
    _excitation(u, masses, gamma, forces, f, s, w, 1)
    integrate(
        masses, ends, law, p, f, s, w, at[0], tolerance, when, offset, element, changed, offset,
        wx, wv, wa, wy, wr, work, q, k, pull, branch, memory, scale, at, counts, 0,
    )  # fmt: skip
    for i in range(masses.size):
        wx[1, i], wv[1, i], wa[1, i] = wx[0, i], wv[0, i], wa[0, i]
    for e in range(law.size):
        wy[1, e], wr[1, e] = wy[0, e], wr[0, e]


def observe(last, u, gamma, forces, lost, wx, wv, wa, wy, wr, x, v, a, y, r):
    """An excitation that is held between samples jumps at them."""
    far = np.inf if lost[0] > 0.0 else 1.0
    for i in range(x.size):
        x[i], v[i], a[i] = far * wx[1, i], far * wv[1, i], wa[1, i]
        for j in range(forces):
            a[i] += gamma[i, j] * (u[j] - last[j])
        a[i] = far * a[i]
    for e in range(y.size):
        y[e], r[e] = wy[1, e], wr[1, e]


def advance(first, last, dt, masses, ends, law, p, gamma, f, s, w, forces, when, offset, element,
            changed, wx, wv, wa, wy, wr, work, q, k, pull, branch, memory, scale, at, counts,
            tolerance, lost):  # fmt: skip
    """One sample; a motion that escapes is infinite from there on."""
    if lost[0] > 0.0:
        return
    _excitation(first, masses, gamma, forces, f, s, w, 0)
    _excitation(last, masses, gamma, forces, f, s, w, 1)
    at[1] = 0.0
    counts[0], counts[1], counts[2], counts[3] = 1, 0, 0, 0
    ended = integrate(
        masses, ends, law, p, f, s, w, dt, tolerance, when, offset, element, changed, offset,
        wx, wv, wa, wy, wr, work, q, k, pull, branch, memory, scale, at, counts, MOST_STEPS,
    )  # fmt: skip
    if ended != -1.0:
        lost[0] = 1.0


def _moves(x0, v0):
    moves = False
    for i in range(x0.size):
        moves = moves or x0[i] != 0.0 or v0[i] != 0.0
    return moves


def _excitation(u, masses, gamma, forces, f, s, w, row):
    """Forces and motions of supports at one end of a sample."""
    for i in range(masses.size):
        f[row, i] = 0.0
        for j in range(forces):
            f[row, i] += masses[i] * (gamma[i, j] * u[j])
    for j in range(s.shape[1]):
        s[row, j] = u[forces + j]
        w[row, j] = u[forces + s.shape[1] + j]


def observe_element(wr, r):
    """The force of an element test: of all parts but the bystander, which gives it a mass."""
    r[0] = 0.0
    for e in range(wr.shape[1] - 1):
        r[0] += wr[1, e]


def step_of(model: ElementNetworkNamed | NamedElement) -> Step:
    """The step of a named element, or of a network of them, from rest.

    Begun in motion, a network is infinite. Raises ValueError for a model that is not identified.
    """
    if isinstance(model, NamedElement):
        return _of_element(model)
    model.require_identified(model.named.numbers)
    structure, gamma = model.structure(), model.composition().inputs.value.detach().numpy()
    held, numbers = _arrays_of(structure, np.ascontiguousarray(gamma), model.forces, model.dt)
    n, E = structure.dofs, len(structure.elements)
    held |= {name: np.zeros(n) for name in "xva"} | {name: np.zeros(E) for name in "yr"}
    names = elements_of(model, E) if len(model.elements) == E else list(structure.elements)
    outputs = [
        *motion_of(model),
        ("y", [f"deformation_{name}" for name in names], "m"),
        ("r", [f"force_{name}" for name in names], "N"),
    ]
    return Step(
        begin, observe, advance, model.dt, held, numbers, inputs_of(model), outputs, any_step=True
    )


def _of_element(model: NamedElement) -> Step:
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
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """State and numbers of the integrator."""
    n, m, E = structure.dofs, structure.supports, len(structure.elements)
    progress, parameters = Progress(n, m, E, dt, TOLERANCE, memory=True), structure.parameters
    assert progress.memory is not None
    state = {"q": progress.q, "k": progress.k, "pull": progress.forces, "at": progress.at}
    state |= {"branch": progress.branch, "memory": progress.memory, "scale": progress.scale}
    state |= {"counts": progress.counts, "lost": np.zeros(1), "p": parameters}
    state |= {"f": np.zeros((2, n)), "s": np.zeros((2, m)), "w": np.zeros((2, m))}
    state |= {name: np.zeros((2, n)) for name in ("wx", "wv", "wa")}
    state |= {name: np.zeros((2, E)) for name in ("wy", "wr", "work")}
    never, unit = np.array([-1]), np.zeros(1)  # no element changes
    numbers = {
        "masses": structure.masses, "ends": structure.ends, "law": structure.law,
        "gamma": gamma, "forces": forces, "when": never, "offset": unit, "element": never,
        "changed": np.zeros((1, parameters.shape[1])), "tolerance": TOLERANCE,
    }  # fmt: skip
    return state, numbers
