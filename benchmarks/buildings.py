"""How well is a building simulated that has more modes than sensors, and softens as it is shaken?

    python -m benchmarks.buildings                # four buildings, ten minutes
    python -m benchmarks.buildings --structures 3 --kinds partitions
    python -m benchmarks.buildings --quick        # one building, five short earthquakes

Frames of 9 to 12 storeys on a foundation that sways and rocks, 0.6 to 1.6 s, 1 to 3 % of damping.
The soil, the partitions beside the frame, or both soften smoothly and hysteretically from about the
motion on that the ground causes at 1 m/s²; or nothing does. Sensors on the ground and two floors,
with 2 % of noise on these. 15 earthquakes of 0.3 to 4 m/s² train; prints the relative RMS error
[%] of the simulated accelerations in six others, that of the modal network over that of the linear
state-space model, and processor seconds of its fit. The structure is integrated here, by the
classical Runge–Kutta method, and shares no code with the models.
R motions, T samples, n storeys; m, s, kg
"""

from __future__ import annotations

import time
from argparse import Namespace
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.linalg import eigh

from benchmarks.fitting import free_run_error
from benchmarks.table import show
from benchmarks.unplanted import DT, SAMPLES, ground
from benchmarks.usual_drifts import of_period, shear
from data.arguments import Parser
from data.record import Record, stack
from models import FIR, LinearStateSpace, ModalNetwork
from runner.config.command_line import command_errors

TRAINED, UNSEEN, NOISE = 15, 6, 0.02
QUICK = 4, 1000  # earthquakes of training, samples
STEPS, HEIGHT = 8, 3.2  # of the integration in a sample interval; of a storey [m]
KINDS = {"soil": (True, False), "partitions": (False, True), "both": (True, True)}
MODELS = {"state space": LinearStateSpace, "FIR": FIR, "modal network": ModalNetwork}


@dataclass(frozen=True, eq=False)
class Building:
    """M q̈ + C q̇ + Dᵀ r = −Lᵀ m a,  r = k (p D q + (1 − p) z),  x = L q against the ground.

    q: rotation and sway of the foundation, then floors against its line. p (n + 2,): share of the
    stiffness k that stays; bends (n + 2,): deformations at which the rest softens.
    """

    masses: np.ndarray  # (n + 1,), the foundation first
    M: np.ndarray
    C: np.ndarray
    D: np.ndarray
    L: np.ndarray
    k: np.ndarray
    stays: np.ndarray
    bends: np.ndarray | float = np.inf

    def shaken(self, ground: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Absolute accelerations (R, T, n + 1) under those of the ground (R, T); peaks of D q."""
        R, T = ground.shape
        inverse, pull = np.linalg.inv(self.M), self.L.T @ self.masses
        state = np.zeros((3, R, len(self.k)))  # q, q̇, z
        a, peaks, h = np.empty((R, T, len(self.masses))), np.zeros(len(self.k)), DT / STEPS

        def slope(state: np.ndarray, s: np.ndarray) -> np.ndarray:
            q, v, z = state
            y, rate = q @ self.D.T, v @ self.D.T
            r = self.k * (self.stays * y + (1.0 - self.stays) * z)
            bent = (0.6 * np.sign(rate * z) + 0.4) * np.abs(z) / self.bends
            forces = r @ self.D + v @ self.C.T + s[:, None] * pull
            return np.stack([v, -forces @ inverse.T, rate * (1.0 - bent)])

        for t in range(T):
            first, last = ground[:, t], ground[:, min(t + 1, T - 1)]
            a[:, t] = slope(state, first)[1] @ self.L.T + first[:, None]
            peaks = np.maximum(peaks, np.abs(state[0] @ self.D.T).max(axis=0))
            for i in range(STEPS):
                s = [first + (last - first) * (i + part) / STEPS for part in (0.0, 0.5, 1.0)]
                k1 = slope(state, s[0])
                k2 = slope(state + 0.5 * h * k1, s[1])
                k3 = slope(state + 0.5 * h * k2, s[1])
                k4 = slope(state + h * k3, s[2])
                state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return a, peaks


def building(rng: np.random.Generator, kind: str) -> Building:
    """A frame whose period on rigid soil is known, and soil that makes it 5 to 30 % longer."""
    n = int(rng.integers(9, 13))
    masses, heights = 1e5 * rng.uniform(0.8, 1.2, n + 1), HEIGHT * np.arange(n + 1)
    masses[0] *= 2.0
    L = np.column_stack([heights, np.ones(n + 1), np.eye(n + 1)[:, 1:]])
    M = L.T @ np.diag(masses) @ L
    M[0, 0] += 3e7 * rng.uniform(1.0, 3.0)  # kg m², of the foundation
    D = np.eye(n + 2) - np.diag([0.0, 0.0, *np.ones(n - 1)], -1)[: n + 2, : n + 2]
    k = shear(masses[1:]) ** rng.uniform(0.4, 1.0) * np.exp(0.1 * rng.standard_normal(n))
    period, longer, rocks = rng.uniform(0.6, 1.6), rng.uniform(1.05, 1.3), rng.uniform(0.3, 0.9)
    k = of_period(k, masses[1:], period)
    soil = masses.sum() * (2.0 * np.pi / period) ** 2 / (longer**2 - 1.0)
    k = np.concatenate([[soil * (0.7 * heights[-1]) ** 2 / rocks, soil / (1.0 - rocks)], k])
    w = np.sqrt(eigh(D.T @ np.diag(k) @ D, M, eigvals_only=True)[[0, 3]])
    of_mass, of_springs = np.linalg.solve(
        0.5 * np.column_stack([1.0 / w, w]), np.full(2, rng.uniform(0.01, 0.03))
    )
    C = of_mass * M + of_springs * D.T @ np.diag(k) @ D
    softens = np.repeat(KINDS.get(kind, (False, False)), [2, n])
    stays = np.where(softens, rng.uniform(0.2, 0.6), 1.0)
    return Building(masses, M, C, D, L, k, stays)


def records(kind: str, seed: int, trained: int, samples: int) -> list[Record]:
    """All motions of a building, those of training first: accelerations against the ground."""
    rng = np.random.default_rng([seed, *kind.encode()])
    case = building(rng, kind)
    displaced = [ground(rng, True, samples) for _ in range(trained + UNSEEN)]
    shape = np.gradient(np.gradient(displaced, DT, axis=1, edge_order=2), DT, axis=1, edge_order=2)
    shape /= np.abs(shape).max(axis=1, keepdims=True)
    bends = replace(case, stays=np.ones_like(case.k)).shaken(shape[:3])[1]
    case = replace(case, bends=bends * rng.uniform(0.7, 2.0))
    a = shape * 10.0 ** rng.uniform(-0.5, 0.6, (len(shape), 1))
    top = len(case.masses) - 1
    floors = case.shaken(a)[0][:, :, [round(top * rng.uniform(0.3, 0.6)), top]]
    floors += NOISE * floors.std(axis=1, keepdims=True) * rng.standard_normal(floors.shape)
    pairs = zip(map(torch.from_numpy, floors - a[:, :, None]), torch.from_numpy(-a), strict=True)
    return [Record(DT, own, drive[:, None]) for own, drive in pairs]


def rows(options: Namespace) -> Iterator[list[str]]:
    trained, samples = QUICK if options.quick else (TRAINED, SAMPLES)
    for kind in options.kinds:
        for number in range(options.seed, options.seed + options.structures):
            motions, errors = records(kind, number, trained, samples), {}
            for name, make in MODELS.items():
                begin, model = time.process_time(), make(2, 1, DT)
                model.identify([stack(motions[:trained])])
                seconds = time.process_time() - begin
                errors[name] = free_run_error(model, motions[trained:])
            ratio = errors["modal network"] / errors["state space"]
            numbers = (*(f"{one:.1f}" for one in errors.values()), f"{ratio:.2f}")
            yield [f"{kind}, {number}", *numbers, f"{seconds:.0f}"]


def main() -> None:
    parser = Parser(description=(__doc__ or "").partition("\n\n")[0])
    every = [*KINDS, "linear"]
    parser.add_argument("--kinds", nargs="+", default=every, choices=every, help="what softens")
    parser.add_argument("--structures", type=int, default=1, help="of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of the first one")
    parser.add_argument("--quick", action="store_true", help="one building, shorter motions")
    options = parser.parse_args()
    if options.quick:
        options.kinds, options.structures = ["soil"], 1
    head = ("what softens, seed", *MODELS, "modal / state space", "its fit, s")
    title = "error of unseen earthquakes, %"
    show(title, head, rows(options))


if __name__ == "__main__":
    with command_errors():
        main()
