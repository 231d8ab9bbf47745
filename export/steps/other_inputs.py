"""Steps of elements under other inputs, such as a voltage: laws side by side, weighed by them.

models/composition/other_inputs.py has the equations.   E elements, k other inputs, J laws of each.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from export.step import Step
from export.steps import composite
from models.hysteretic_element import HystereticElement


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


def begin(x0, v0, u, motion, elements, equation, back, branches, none, w, p, lags):
    """At rest, and with lags that have settled under the first excitation."""
    composite.begin(x0, v0, u, motion, elements, equation, back, branches, none)
    parts = (u.size - w.size) // 2
    for i in range(w.size):
        w[i] = (u[2 * parts + i] - lags.centre[i]) / lags.reach[i]
    for j in range(p.size):
        p[j] = u[parts + j % parts]


def observe(elements, w, p, nodes, force):
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


def advance(first, last, dt, motion, elements, equation, branches, none, w, p, lags):
    """The laws, and the lags of inputs and rates, which are linear within the step."""
    composite.advance(last, dt, motion, elements, equation, branches, none)
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


def step_of(model: HystereticElement, laws: Step) -> Step:
    """The step of elements whose laws are evaluated side by side in the step `laws`."""
    others, E = model.others, model.dofs
    assert others is not None
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
        begin, observe, advance, laws.dt, {**laws.state, **state},
        {**laws.numbers, "lags": lags, "nodes": nodes},
        [*names, *((f"u{i + 1}", "") for i in range(k))],
        [("force", [f"r{i + 1}" for i in range(E)], "N")],
        substeps=laws.substeps, any_step=True, holds=("linear",),
    )  # fmt: skip
