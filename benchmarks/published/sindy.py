"""Sparse regression of the equation of motion: ẋ and ẍ as polynomials of x, ẋ and f, few terms.

PySINDy 2.1 (MIT), Kaptanoglu et al. (2022), doi 10.21105/joss.03994; Brunton et al. (2016), STLSQ.
Signals are divided by their RMS, since the threshold is on coefficients and states differ in size
(its issue 491 advises to normalise). The threshold is the one whose model simulates held-back
motion best. Accelerations are the model's own: its equation for ẍ at the states it simulates.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np
from scipy.interpolate import interp1d

from data.record import Drive, Record

DEGREE = 3
THRESHOLDS = (0.03, 0.1, 0.3, 1.0)  # the package's default is 0.1
HELD_BACK = 0.2  # of every record, its end
ESCAPE = 100.0  # times the largest scaled state: a simulation ends there
ACCURACY = {"method": "LSODA", "rtol": 1e-6, "atol": 1e-6}  # of the simulation, far below errors
PACKAGE = "pysindy"


def state(record: Record) -> np.ndarray:
    """[x, ẋ] (T, 2n); its derivative is [ẋ, ẍ], all measured."""
    assert record.x is not None
    assert record.v is not None
    return np.concatenate([record.x.numpy(), record.v.numpy()], axis=1)


def derivative(record: Record) -> np.ndarray:
    assert record.v is not None
    return np.concatenate([record.v.numpy(), record.a.numpy()], axis=1)


def rms(signals: list[np.ndarray]) -> np.ndarray:
    """Of every channel (c,)."""
    return np.sqrt(np.mean(np.concatenate(signals) ** 2, axis=0))


def model_of(threshold: float) -> Any:
    """The package's model; its products are taken from a table, for the simulation's speed."""
    ps: Any = import_module("pysindy")

    class SINDy(ps.SINDy):
        def fit(self, *signals: Any, **more: Any) -> Any:
            super().fit(*signals, **more)
            used = np.any(self.coefficients() != 0.0, axis=0)
            powers = self.feature_library.powers_[used]  # (P, 2n + m)
            factors = [np.repeat(np.arange(len(p)) + 1, p) for p in powers]  # column 0 holds ones
            padded = [np.pad(row, (0, DEGREE - len(row))) for row in factors]
            self.factors = np.array(padded, dtype=int).reshape(-1, DEGREE)  # (P, degree)
            self.weights = self.coefficients()[:, used].T
            return self

        def predict(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
            columns = np.concatenate([np.ones((len(x), 1)), x, u], axis=1)
            return columns[:, self.factors].prod(axis=-1) @ self.weights

    library, optimizer = ps.PolynomialLibrary(degree=DEGREE), ps.STLSQ(threshold=threshold)
    return SINDy(optimizer=optimizer, feature_library=library)


def simulated(model: Any, start: np.ndarray, u: np.ndarray, dt: float, limit: float) -> np.ndarray:
    """States (T, 2n) by the package's `simulate`; those after an escape are infinite."""
    t = dt * np.arange(len(u))
    force = interp1d(t, u, axis=0, bounds_error=False, fill_value=(u[0], u[-1]))
    escape = partial(_margin, limit)
    escape.terminal = True  # type: ignore[attr-defined]
    states = model.simulate(start, t, u=force, integrator_kws={**ACCURACY, "events": escape})
    return np.pad(states, ((0, len(u) - len(states)), (0, 0)), constant_values=np.inf)


def _margin(limit: float, t: float, states: np.ndarray) -> float:
    return limit - float(np.abs(states).max())


def fit(records: list[Record], seed: int, seconds: float) -> Callable[[Drive], np.ndarray]:
    """One fit per threshold on the beginnings of the records, then one on all; nothing random."""
    dt, dofs = records[0].dt, records[0].dofs
    size, push = rms([state(r) for r in records]), rms([r.f.numpy() for r in records])
    x, x_dot = [state(r) / size for r in records], [derivative(r) / size for r in records]
    u = [r.f.numpy() / push for r in records]
    limit = ESCAPE * max(float(np.abs(part).max()) for part in x)
    first = round((1.0 - HELD_BACK) * len(x[0]))

    def fitted(threshold: float, part: slice) -> Any:
        signals = {"x_dot": [d[part] for d in x_dot], "u": [f[part] for f in u]}
        return model_of(threshold).fit([s[part] for s in x], t=dt, **signals)

    def held_back_error(threshold: float) -> float:
        model = fitted(threshold, slice(first))
        ends = [
            simulated(model, s[first], f[first:], dt, limit) - s[first:]
            for s, f in zip(x, u, strict=True)
        ]
        return sum(float(np.sum(end**2)) for end in ends)

    best = min(reversed(THRESHOLDS), key=held_back_error)
    model = fitted(best, slice(None))

    def simulate(drive: Drive) -> np.ndarray:
        """Acceleration (T, n)."""
        force = drive.u.numpy() / push
        start = np.concatenate([drive.x0.numpy(), drive.v0.numpy()]) / size
        states = simulated(model, start, force, dt, limit)
        with np.errstate(all="ignore"):  # after an escape
            return (model.predict(states, force) * size)[:, dofs:]

    return simulate
