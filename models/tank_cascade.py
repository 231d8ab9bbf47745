"""Tank cascade: stores of the first order in a row, the reading that of the last.

ẋ₁ = b (u − u₀)₊ − q₁(x₁),   ẋᵢ = qᵢ₋₁ + χᵢ₋₁ overflowᵢ₋₁ − qᵢ(xᵢ),   y = min(xₙ + o₀, full)

Outflows q are powers, near the square root to begin with, and ramps, which can only rise; tanks run
over at a height, of which a share χ falls into the next; pump and sensor have offsets, the reading
an end: Schoukens, Mattsson, Wigren & Noël (2016). Choose it for levels, temperatures or whatever
else passes from store to store. All is identified in `identify`, by draws and Levenberg–Marquardt
on exact derivatives (models/tanks/fit.py); no solver is needed.   T samples, n tanks.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from data.record import Drive, Record, Response
from models.estimator import Estimator
from models.tanks.fit import Motion, Tanks, first_levels, fitted, simulated, size_of
from models.tanks.run_compiled import LEAST_POWER, POWERS, SHARED

MOST_TANKS = 6


class TankCascade(Estimator):
    """Reading (…, T, 1) of the last of `tanks` in a row; every estimate is a free run.

    draws: of parameters, the likeliest of which are trained. prior: weight of the laws' distance
    from square roots beside the squared error in units of the largest reading.

    First levels are fitted in training. A record with warm-up samples tells its own by them; any
    other begins at the mean levels of training. Raises ValueError for more than one input or
    output. The input is taken as held between samples.
    """

    reads = ("f",)
    on_processor = True

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        tanks: int = 2,
        draws: int = 2000,
        prior: float = 1e-8,
        seed: int = 0,
    ) -> None:
        super().__init__(dofs, inputs, dt)
        if (dofs, inputs) != (1, 1):
            raise ValueError(
                f"dofs={dofs}, inputs={inputs}: tanks in a row have one input and one output; "
                "choose other channels, or another model"
            )
        if not 1 <= tanks <= MOST_TANKS or draws < 1 or prior < 0.0:
            raise ValueError(
                f"model.tanks={tanks}, draws={draws}, prior={prior}: expected 1 to {MOST_TANKS}, "
                "at least 1, at least 0"
            )
        self.tanks, self.draws, self.prior, self.seed = tanks, draws, prior, seed
        empty = torch.full((size_of(tanks),), torch.nan, dtype=torch.float64)
        self.theta = nn.Parameter(empty, requires_grad=False)
        self.register_buffer("scales", torch.ones(4, dtype=torch.float64))
        self.register_buffer("levels", torch.ones(2, tanks, dtype=torch.float64))

    scales: Tensor  # mean and size of the input, size of the output; RMS error over the last
    levels: Tensor  # mean and deviation (n,) of the levels in training, in units of the model

    def identify(self, batches: Iterable[Record]) -> dict[str, Any]:
        """Identify all parameters; returns powers, heights and shares of overflow."""
        records = [record.to("cpu") for record in batches]
        u = np.concatenate([record.excitation.flatten().numpy() for record in records])
        y = np.concatenate([record.a.flatten().numpy() for record in records])
        if len(y) < 2 * size_of(self.tanks):
            raise ValueError(
                f"{len(y)} samples are too few for {self.tanks} tanks; expected at least "
                f"{2 * size_of(self.tanks)}"
            )
        spread, size = float(np.ptp(u)), float(np.abs(y).max())
        self.scales.copy_(torch.tensor([u.mean(), spread or 1.0, size or 1.0, 1.0]))
        motions = [motion for record in records for motion in self._motions(record)]
        rng = np.random.default_rng(self.seed)
        found = fitted(self.tanks, motions, self.draws, self.prior, rng)
        self.theta.data.copy_(torch.from_numpy(found.values))
        runs = [simulated(found, m.u, b) for m, b in zip(motions, found.begins, strict=True)]
        levels = np.concatenate([levels for _, levels, _ in runs])
        errors = np.concatenate([y - m.y for (y, _, _), m in zip(runs, motions, strict=True)])
        self.levels.copy_(torch.from_numpy(np.stack([levels.mean(axis=0), levels.std(axis=0)])))
        self.scales[3] = max(float(np.sqrt((errors**2).mean())), 1e-9)
        return self._facts(found)

    def _facts(self, found: Tanks) -> dict[str, Any]:
        size, facts = float(self.scales[2]), dict[str, Any]()
        for i, own in enumerate(found.values[SHARED:].reshape(self.tanks, -1), start=1):
            facts[f"power_{i}"] = LEAST_POWER + POWERS / (1.0 + float(np.exp(-own[1])))
            facts[f"height_{i}"] = size * float(own[2])
        return facts

    def _motions(self, record: Record) -> list[Motion]:
        mean, spread, size, _ = self.scales.tolist()
        T = record.samples
        us, ys = (s.reshape(-1, T).cpu().numpy() for s in (record.excitation, record.a))
        return [Motion((u - mean) / spread, y / size) for u, y in zip(us, ys, strict=True)]

    def forward(self, record: Record) -> Tensor:
        """Readings (…, T, 1) of the free run of a record or a batch."""
        return self.run_of(record).a

    def free_run(self, drive: Drive) -> Response:
        """Readings as `a` of the response, from the mean levels; x and v are unknown, and nil."""
        return self._response(drive.u, None)

    def run_of(self, record: Record) -> Response:
        """The free run of a record, its first levels estimated from the warm-up samples."""
        return self._response(record.excitation, record if record.warmup else None)

    def _response(self, excitation: Tensor, record: Record | None) -> Response:
        self.require_identified(self.theta)
        mean, spread, size, noise = self.scales.tolist()
        usual, deviation = self.levels.cpu().numpy()
        tanks = Tanks(self.theta.detach().cpu().numpy(), usual[None])
        us = (excitation.reshape(-1, excitation.shape[-2]).cpu().numpy() - mean) / spread
        begins = [usual] * len(us)
        if record is not None:
            seen = [
                Motion(m.u[: record.warmup], m.y[: record.warmup]) for m in self._motions(record)
            ]
            begins = [first_levels(tanks, motion, usual, deviation, noise) for motion in seen]
        runs = [simulated(tanks, u, begin)[0] for u, begin in zip(us, begins, strict=True)]
        a = torch.from_numpy(size * np.stack(runs)).to(excitation.device)
        a = a.reshape(*excitation.shape[:-1], 1)
        return Response(torch.zeros_like(a), torch.zeros_like(a), a)
