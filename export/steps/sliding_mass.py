"""Step of a sliding mass: exact from corner to corner, as models/sliding/run_compiled.py has it.

ẋ = v,   v̇ = β u − o − sgn(v) (j + G(|v|));   where v = 0 and |β u − o| ≤ j, it sticks

The input is held for a quarter of a sample at the value in its middle.   K knots of G.
"""

from __future__ import annotations

import numpy as np

from export.names import inputs_of
from export.step import Step
from models.sliding.problem import BOUND
from models.sliding.run_compiled import _exponentials, _piece, _until
from models.sliding_mass import PARTS, SlidingMass


def begin(x0, v0, at, units):
    """From the given position and speed."""
    at[0] = (x0[0] - units[2]) / units[1]
    at[1] = v0[0] * units[3] / units[1]


def observe(at, x, v, units):
    """Position and speed."""
    x[0] = units[2] + units[1] * at[0]
    v[0] = units[1] / units[3] * at[1]


def advance(first, last, dt, at, theta, knots, jump, units):
    """A time dt on, from one piece of the friction's curve to the next."""
    u = (first[0] + 0.5 * (last[0] - first[0])) / units[0]
    at[0], at[1] = _held(u, dt / units[3], theta, knots, jump[0], at[0], at[1])
    if not abs(at[0]) < BOUND:  # the run has diverged
        at[0], at[1] = np.nan, np.nan


def _held(u, h, theta, knots, jump, x, v):
    """x and v after a time h under an input u, in units of the model."""
    K = knots.size
    phi = np.zeros(4)
    left = h
    drive = theta[0] * u - theta[1]
    side = 1.0 if v > 0.0 else -1.0
    w = abs(v)
    a = 0
    if w == 0.0:
        side = 1.0 if drive > 0.0 else -1.0
        if abs(drive) <= jump:
            return x, 0.0
    while a < K and w > knots[a]:
        a += 1
    for _ in range(2 * K + 4):
        start, force, slope, _, _, _ = _piece(theta, knots, side, a)
        rate = side * drive - jump - force - slope * (w - start)
        t, target = left, -1.0
        if rate > 0.0 and a < K:
            target = knots[a]
        elif rate < 0.0:
            target = start
        if target >= 0.0:
            reached = _until(target - w, rate, slope)
            if reached < left:
                t = reached
            else:
                target = -1.0
        _exponentials(-slope * t, phi)
        x += side * (w * t + rate * t * t * phi[1])
        w = target if target >= 0.0 else w + rate * t * phi[0]
        left -= t
        if target < 0.0:
            break
        if rate > 0.0:
            a += 1
        elif a > 0:
            a -= 1
        elif abs(drive) <= jump:
            return x, 0.0
        else:  # it turns
            side = 1.0 if drive > 0.0 else -1.0
    return x, side * w


def step_of(model: SlidingMass) -> Step:
    """The step of a sliding mass. Raises ValueError for one that is not identified.

    A band-limited input is interpolated from samples that are yet to come, so no step can.
    """
    mass = model.mass
    numbers = {
        "theta": mass.values.copy(),
        "knots": mass.knots.copy(),
        "jump": np.exp(mass.values[2:3]),
        "units": model.scales.numpy().copy(),  # of the input, the output, its mean, time [s]
    }
    state = {"at": np.zeros(2), "x": np.zeros(1), "v": np.zeros(1)}
    return Step(
        begin, observe, advance, model.dt, state, numbers, inputs_of(model),
        [("x", ["x1"], "m"), ("v", ["v1"], "m/s")], PARTS, any_step=True,
    )  # fmt: skip
