"""Step of a Wiener–Hammerstein system.

x = G₁ u,   w = f(x),   y = G₂ w + o₀;   a filter: s[t] = u[t] − a₁ s[t−1] − a₂ s[t−2] of a section,
x[t] = d u[t] + Σ c₀ s[t] + c₁ s[t−1]

All of it works at R times the sampling rate. A filter takes its input at the sample, so sections
move in `observe`, into `new`, which `advance` takes over.   p sections, K ramps of the curve.
"""

from __future__ import annotations

import math

import numpy as np

from data.record import HOLDS
from export.names import inputs_of
from export.step import Step
from models.wiener_hammerstein import WienerHammerstein


def begin(one, two):
    """Filters at rest."""
    for i in range(one.shape[0]):
        one[i, 0], one[i, 1] = 0.0, 0.0
    for i in range(two.shape[0]):
        two[i, 0], two[i, 1] = 0.0, 0.0


def _filtered(u, s, new, d, a, c):
    """The output of a filter with states s (p, 2), s[t−1] and s[t−2]; s[t] goes to `new` (p,)."""
    x = d[0] * u
    for i in range(new.size):
        new[i] = u + (-a[i, 1] * s[i, 1] - a[i, 0] * s[i, 0])
        x += c[i, 0] * new[i] + c[i, 1] * s[i, 0]
    return x


def _curve(x, beta, ramps):
    """f(x); ramps (K, 4): weight, place, width, value at zero."""
    f = beta[0] * x
    for k in range(ramps.shape[0]):
        t = (x - ramps[k, 1]) / ramps[k, 2]
        rise = max(t, 0.0) + math.log1p(math.exp(-abs(t)))
        f += ramps[k, 0] * (ramps[k, 2] * rise - ramps[k, 3])
    return f


def _take_over(s, new):
    for i in range(new.size):
        s[i, 1] = s[i, 0]
        s[i, 0] = new[i]


def observe(u, one, two, new_one, new_two, output, d1, a1, c1, beta, ramps, d2, a2, c2, o0,
            units):  # fmt: skip
    """The output, by filters at the sample."""
    x = _filtered(u[0] / units[0], one, new_one, d1, a1, c1)
    y = _filtered(_curve(x, beta, ramps), two, new_two, d2, a2, c2) + o0[0]
    output[0] = units[2] + units[1] * y


def advance(first, last, one, two, new_one, new_two, d1, a1, c1, beta, ramps, d2, a2, c2, units,
            rate):  # fmt: skip
    """The filters' new state is their state; then those between the samples."""
    _take_over(one, new_one)
    _take_over(two, new_two)
    for part in range(1, rate):
        u = first[0] + part / rate * (last[0] - first[0])
        x = _filtered(u / units[0], one, new_one, d1, a1, c1)
        _take_over(one, new_one)
        _filtered(_curve(x, beta, ramps), two, new_two, d2, a2, c2)
        _take_over(two, new_two)


def step_of(model: WienerHammerstein) -> Step:
    """The step of filter, curve and filter. Raises ValueError for ones that are not identified.

    A band-limited input is interpolated from samples that are yet to come, so no step can, unless
    all works at the sampling rate.
    """
    chain = model.chain
    parts = chain.parts.items()
    numbers: dict[str, np.ndarray] = {k: np.array(part) for k, part in parts if k != "laws"}
    weight, place, log_width = chain.parts["laws"].T
    width = np.exp(log_width)
    rest = width * np.logaddexp(0.0, -place / width)
    numbers["ramps"] = np.stack([weight, place, width, rest], axis=1)
    numbers["units"] = model.scales.numpy()[:3].copy()  # of input and output, mean of the latter
    before, after = len(numbers["a1"]), len(numbers["a2"])
    state: dict[str, np.ndarray] = {"one": np.zeros((before, 2)), "two": np.zeros((after, 2))}
    state |= {"new_one": np.zeros(before), "new_two": np.zeros(after), "output": np.zeros(1)}
    return Step(
        begin, observe, advance, model.dt, state, {**numbers, "rate": model.finer},
        inputs_of(model), [("output", ["y1"], "")], holds=HOLDS if model.finer == 1 else HOLDS[:2],
    )  # fmt: skip
