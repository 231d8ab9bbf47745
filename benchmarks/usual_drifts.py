"""Drifts of all storeys from few floors, by what is usual: interpolation, linear chains, smoother.

The opponents of benchmarks/few_sensors.py.   E storeys, S sensors on floors, T samples; m, s, kg
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
import torch
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.linalg import block_diag, eigh, expm, solve_discrete_are
from scipy.optimize import least_squares, minimize_scalar

from benchmarks.unplanted import DT
from data.record import Record
from models.layers.reconstructed import integrated

NOISE = 0.05  # of a channel's standard deviation
LACKING = 0.3  # [s]: time constant of what a linear chain lacks
START = 0.7, 0.5, 0.05, 0.05  # of a chain: period [s], power, damping by masses and stiffnesses
BOUNDS = np.log([(0.1, 0.02, 1e-3, 1e-3), (5.0, 3.0, 0.5, 0.5)])
Estimate = Callable[["Event"], np.ndarray]  # drifts (T, E)


@dataclass(frozen=True, eq=False)
class Event:
    """Absolute accelerations of the ground (T,) and of floors (T, S), noisy; true drifts (T, E).

    wires: noisy drifts (T,) by channel, such as drift2, each with a zero of its own.
    """

    ground: np.ndarray
    floors: np.ndarray
    drifts: np.ndarray
    wires: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def record(self) -> Record:
        u, rows = torch.from_numpy(self.ground)[:, None], [*self.wires.values()]
        o = torch.from_numpy(np.stack(rows, axis=1)) if rows else None
        return Record(DT, torch.from_numpy(self.floors) - u, -u, o=o, others=tuple(self.wires))


def shear(masses: np.ndarray) -> np.ndarray:
    """Share of the mass that is above each storey."""
    return np.cumsum(masses[::-1])[::-1] / masses.sum()


def stiffness_matrix(k: np.ndarray) -> np.ndarray:
    joints = np.eye(len(k)) - np.eye(len(k), k=-1)  # drifts of displacements
    return (joints.T * k) @ joints


def of_period(shape: np.ndarray, masses: np.ndarray, period: float) -> np.ndarray:
    """Stiffnesses in proportion to `shape` that give the chain its first period."""
    square = eigh(stiffness_matrix(shape), np.diag(masses), eigvals_only=True)[0]
    return shape * (2.0 * np.pi / period) ** 2 / square


def straight(x: Sequence[int], y: np.ndarray, axis: int) -> Callable:
    """The line through the ground and the highest sensor."""
    return make_interp_spline([x[0], x[-1]], y[:, [0, -1]], k=1, axis=axis)


SPLINES: dict[str, Callable] = {
    "interpolation, linear": partial(make_interp_spline, k=1),
    "interpolation, cubic": partial(CubicSpline, bc_type="natural"),
    "rigid": straight,
}


def interpolated(
    event: Event, sensors: Sequence[int], storeys: int, spline: Callable
) -> np.ndarray:
    """Drifts (T, E) of integrated displacements, interpolated over the height."""
    x, _ = integrated(event.record.a, event.record.f, DT)
    floors = np.pad(x.numpy(), ((0, 0), (1, 0)))
    return np.diff(spline([0, *sensors], floors, axis=1)(np.arange(storeys + 1)), axis=1)


def recursion(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """s (T, N) of s[k] = A s[k − 1] + b[k]."""
    s = b.copy()
    for k in range(1, len(s)):
        s[k] += A @ s[k - 1]
    return s


@dataclass(frozen=True)
class Chain:
    """A linear chain: its period, the power of its stiffnesses by shear, damping; logarithms.

    The state is x and v (2 E,) against the ground.
    """

    masses: np.ndarray
    sensors: Sequence[int]
    numbers: np.ndarray = field(default_factory=lambda: np.log(START))

    @cached_property
    def rates(self) -> np.ndarray:
        """Rates of the state by the state; the last E rows are absolute accelerations."""
        period, power, by_mass, by_stiffness = np.exp(self.numbers)
        n, w = len(self.masses), 2.0 * np.pi / period
        K = stiffness_matrix(of_period(shear(self.masses) ** power, self.masses, period))
        C = 2.0 * by_mass * w * np.diag(self.masses) + 2.0 * by_stiffness / w * K
        lower = -np.hstack([K, C]) / self.masses[:, None]
        return np.vstack([np.eye(n, 2 * n, k=n), lower])

    @cached_property
    def steps(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F and G₀, G₁: of a step, by accelerations (E,) that are linear between two samples."""
        n = len(self.masses)
        whole = np.zeros((4 * n, 4 * n))
        whole[: 2 * n, : 2 * n], whole[n : 2 * n, 2 * n : 3 * n] = DT * self.rates, DT * np.eye(n)
        whole[2 * n : 3 * n, 3 * n :] = np.eye(n)
        F, both, last = np.split(expm(whole)[: 2 * n], [2 * n, 3 * n], axis=1)
        return F, both - last, last

    def driven(self, a: np.ndarray) -> np.ndarray:
        """What the ground (T,) adds to the state at each sample (T, 2 E)."""
        _, first, last = (G.sum(axis=1) for G in self.steps)
        return np.vstack([0.0 * last, -np.outer(a[:-1], first) - np.outer(a[1:], last)])

    def floors(self, a: np.ndarray) -> np.ndarray:
        states = recursion(self.steps[0], self.driven(a))
        return states @ self.rates[len(self.masses) :][np.array(self.sensors) - 1].T

    def drifts(self, event: Event) -> np.ndarray:
        states = recursion(self.steps[0], self.driven(event.ground))
        return np.diff(states[:, : len(self.masses)], axis=1, prepend=0.0)

    def fitted(self, train: Sequence[Event]) -> Chain:
        """The nearest to the floors in training, by simulation, from the best of some periods."""

        def left(numbers: np.ndarray) -> np.ndarray:
            chain = replace(self, numbers=numbers)
            parts = [(chain.floors(e.ground) - e.floors) / e.floors.std(axis=0) for e in train]
            return np.concatenate(parts).ravel()

        starts = [np.log([period, *START[1:]]) for period in np.geomspace(0.2, 3.0, 40)]
        start = min(starts, key=lambda numbers: float((left(numbers) ** 2).sum()))
        return replace(self, numbers=least_squares(left, start, bounds=BOUNDS, x_scale=0.1).x)


@dataclass(frozen=True)
class Smoother:
    """Rauch, Tung & Striebel's (1965) smoother of a chain, with the gains of a long record.

    The state goes on with accelerations (E,) that the chain lacks, of one size, over that of the
    ground. The noise of the sensors is known.
    """

    chain: Chain
    channels: np.ndarray  # standard deviations of ground and floors (1 + S,)
    size: float = 0.5

    @cached_property
    def gains(self) -> tuple[np.ndarray, ...]:
        """F, H, the covariance P of predictions, the Kalman gain L, the smoother's gain J."""
        n, kept = len(self.chain.masses), np.exp(-DT / LACKING)
        step, first, last = self.chain.steps
        G, lacking = first + last, (self.size * self.channels[0]) ** 2 * (1.0 - kept**2)
        F = np.block([[step, G], [np.zeros((n, 2 * n)), kept * np.eye(n)]])
        H = np.hstack([self.chain.rates[n:], np.eye(n)])[np.array(self.chain.sensors) - 1]
        ground, *floors = (NOISE * self.channels) ** 2
        Q = block_diag(np.outer(G.sum(axis=1), G.sum(axis=1)) * ground, lacking * np.eye(n))
        P = solve_discrete_are(F.T, H.T, Q, np.diag(floors))
        L = np.linalg.solve(H @ P @ H.T + np.diag(floors), H @ P).T
        return F, H, P, L, np.linalg.solve(P, F @ (P - L @ H @ P)).T

    def filtered(self, event: Event) -> tuple[np.ndarray, np.ndarray]:
        """States (T, 3 E) as predicted from the samples before, and with their own."""
        F, H, _, L, _ = self.gains
        u = np.pad(self.chain.driven(event.ground), ((0, 0), (0, len(F) // 3)))
        states = recursion(F - L @ H @ F, u - u @ (L @ H).T + event.floors @ L.T)
        return u + np.vstack([0.0 * u[:1], states[:-1] @ F.T]), states

    def drifts(self, event: Event) -> np.ndarray:
        J, n = self.gains[-1], len(self.chain.masses)
        predicted, states = self.filtered(event)
        added = states - np.vstack([predicted[1:] @ J.T, 0.0 * states[-1:]])
        return np.diff(recursion(J, added[::-1])[::-1, :n], axis=1, prepend=0.0)

    def unlikely(self, train: Sequence[Event]) -> float:
        """−2 log of the likelihood of the innovations, over the samples."""
        _, H, P, *_ = self.gains
        V = H @ P @ H.T + np.diag((NOISE * self.channels[1:]) ** 2)
        e = np.concatenate([event.floors - self.filtered(event)[0] @ H.T for event in train])
        return float(np.linalg.slogdet(V)[1] + (e * np.linalg.solve(V, e.T).T).sum() / len(e))

    def fitted(self, train: Sequence[Event]) -> Smoother:
        """With the likeliest size."""
        likely = minimize_scalar(
            lambda q: replace(self, size=np.exp(q)).unlikely(train), bounds=(-5.0, 3.0)
        )
        return replace(self, size=float(np.exp(likely.x)))
