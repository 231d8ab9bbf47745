"""Step of a tank cascade: the compiled run of models/tanks, a sample at a time.

ẋ₁ = b ρ(u − u₀) − q₁(x₁),   ẋᵢ = qᵢ₋₁ + χᵢ₋₁ (overflow of i−1) − qᵢ(xᵢ),   y = min(xₙ + o₀, full)

The input is held between samples, whatever it does.   n tanks, in units of the model.
"""

from __future__ import annotations

import numpy as np

from data.record import HOLDS
from export.names import inputs_of
from export.step import Step
from models.tank_cascade import TankCascade
from models.tanks.fit import BOUND, EDGE, RAMPS, WIDTH
from models.tanks.run_compiled import OWN, SHARED, STEPS, _law, _logistic, _ramp, _slopes


def begin(level, levels):
    """The mean levels of training."""
    level[:] = levels


def observe(level, output, shared, units):
    """The last tank's reading."""
    reading = level[level.size - 1] + shared[2]
    if abs(reading) < BOUND:
        output[0] = units[2] * min(reading, shared[3])
    else:
        output[0] = np.nan  # the run has diverged


def advance(first, level, output, shared, laws, heights, shares, ramps, units, empty):
    """Steps of Heun's method; what a step brings above a tank's height runs over."""
    n = level.size
    h = 1.0 / STEPS
    q = np.zeros(n)
    pump = np.zeros(2)
    end = np.zeros(n)
    rate = np.zeros((2, n))
    if not abs(output[0]) < np.inf:
        level[:] = np.nan
    value, _ = _ramp((first[0] - units[0]) / units[1] - shared[1], EDGE)
    pump[0] = shared[0] * value
    for _ in range(STEPS):
        _slopes(laws, pump, level, empty, ramps, WIDTH, rate[0], empty, q, empty)
        for i in range(n):
            end[i] = level[i] + h * rate[0, i]
        _slopes(laws, pump, end, empty, ramps, WIDTH, rate[1], empty, q, empty)
        for i in range(n):
            level[i] += 0.5 * h * (rate[0, i] + rate[1, i])
        for i in range(n):
            over = level[i] - heights[i]
            if over > 0.0:
                if i < n - 1:
                    level[i + 1] += shares[i] * over
                level[i] = heights[i]


def step_of(model: TankCascade) -> Step:
    """The step of tanks in a row. Raises ValueError for ones that are not identified."""
    model.require_identified(model.theta)
    theta, n = model.theta.detach().numpy(), model.tanks
    ramps, each = np.array(RAMPS), OWN + len(RAMPS)
    at = SHARED + each * np.arange(n)
    laws = np.zeros((n, 4 + 2 * len(ramps)))
    for own, place in zip(laws, at, strict=True):
        _law(theta, place, ramps, WIDTH, own)
    numbers = {
        "shared": np.r_[np.exp(theta[0]), theta[1:SHARED]],  # b, u₀, o₀, full
        "laws": laws,
        "heights": theta[at + 2],
        "shares": np.array([_logistic(theta[place + 3]) for place in at]),
        "ramps": ramps,
        "units": model.scales.numpy().copy(),  # mean and size of the input, size of the output
        "levels": model.levels[0].numpy().copy(),
        "empty": np.zeros((n, 0)),
    }
    state = {"level": np.zeros(n), "output": np.zeros(1)}
    return Step(
        begin, observe, advance, model.dt, state, numbers, inputs_of(model),
        [("output", ["y1"], "")], holds=HOLDS,
    )  # fmt: skip
