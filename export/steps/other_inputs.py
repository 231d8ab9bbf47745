"""Steps of elements under other inputs, such as a voltage: laws side by side, weighed by them.

models/composition/other_inputs.py has the equations.   E elements, k other inputs, J laws of each.
"""

from __future__ import annotations

import math

import numpy as np

from export.step import Step
from export.steps import composite
from models.hysteretic_element import HystereticElement


def begin(x0, v0, u, q, rate, z, y, r, left, acc, back, core, inputs, G, D, supports, laws,
          counts, by_q, by_r, by_z, work, places, slopes, w, p, elements, centre, reach,
          ):  # fmt: skip
    """At rest, and with lags that have settled under the first excitation."""
    composite.begin(x0, v0, u, q, rate, z, y, r, left, acc, back, core, inputs, G, D, supports,
                    laws, counts, by_q, by_r, by_z, work, places, slopes)  # fmt: skip
    for i in range(w.size):
        w[i] = (u[2 * elements + i] - centre[i]) / reach[i]
    for j in range(p.size):
        p[j] = u[elements + j % elements]


def observe(r, w, p, elements, nodes, used, places_of, rate_force, rate_knee, offset, force):
    """The laws at the two nodes beside each input, and what lies between."""
    for e in range(elements):
        force[e] = offset[e]
        for i in range(w.size):
            cell = 0
            for a in range(1, nodes):
                if w[i] >= places_of[i, a]:
                    cell += 1
            cell = min(cell, used[i] - 2)
            first, last = places_of[i, cell], places_of[i, cell + 1]
            share = (w[i] - first) / (last - first)
            law = (i * nodes + cell) * elements + e
            low = _whole(law, r, p, rate_force, rate_knee)
            high = _whole(law + elements, r, p, rate_force, rate_knee)
            force[e] += ((1.0 - share) * low + share * high) / w.size


def _whole(law, r, p, rate_force, rate_knee):
    """The force of a law with those that saturate with the rate."""
    total = r[law]
    for m in range(rate_force.shape[1]):
        total += rate_force[law, m] * math.tanh(p[law] / rate_knee[law, m])
    return total


def advance(first, last, dt, q, rate, ahead, acc, left, y, z, r, core, inputs, G, D, supports,
            laws, counts, by_q, by_r, by_z, work, places, slopes, w, p, elements, centre, reach,
            lag, rate_lag):  # fmt: skip
    """The laws, and the lags of inputs and rates, which are linear within the step."""
    composite.advance(last, dt, q, rate, ahead, acc, left, y, z, r, core, inputs, G, D, supports,
                      laws, counts, by_q, by_r, by_z, work, places, slopes)  # fmt: skip
    for i in range(w.size):
        at = 2 * elements + i
        w[i] = _lagged(
            w[i], (first[at] - centre[i]) / reach[i], (last[at] - centre[i]) / reach[i], lag[i], dt
        )
    for j in range(p.size):
        at = elements + j % elements
        p[j] = _lagged(p[j], first[at], last[at], rate_lag[j], dt)


def _lagged(now, before, after, lag, dt):
    decay = math.exp(-dt / lag)
    held = (1.0 - decay) * lag / dt
    return decay * now + (held - decay) * before + (1.0 - held) * after


def step_of(model: HystereticElement, laws: Step) -> Step:
    """The step of elements whose laws stand side by side in the step `laws`."""
    others, E = model.others, model.dofs
    assert others is not None
    numbers = {
        "elements": E, "nodes": others.nodes, "used": others.used.numpy().astype(np.int64),
        "places_of": others.places.numpy().copy(), "centre": others.range.centre.numpy().copy(),
        "reach": others.range.reach.numpy().copy(), "lag": others.lag().detach().numpy().copy(),
        "rate_lag": others.rate_lag().detach().numpy().copy(),
        "rate_force": others.rate_force().detach().numpy().copy(),
        "rate_knee": others.rate_knee().detach().numpy().copy(),
        "offset": others.offset().detach().numpy().copy(),
    }  # fmt: skip
    k = len(numbers["lag"])
    state = {"w": np.zeros(k), "p": np.zeros(others.laws * E), "force": np.zeros(E)}
    names = [(f"s{i + 1}", "m") for i in range(E)] + [(f"s_dot{i + 1}", "m/s") for i in range(E)]
    return Step(
        begin, observe, advance, laws.dt, {**laws.state, **state}, {**laws.numbers, **numbers},
        [*names, *((f"u{i + 1}", "") for i in range(k))],
        [("force", [f"r{i + 1}" for i in range(E)], "N")],
        substeps=laws.substeps, any_step=True, holds=("linear",),
    )  # fmt: skip
