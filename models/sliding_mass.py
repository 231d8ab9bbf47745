"""Sliding mass: a free mass, pushed by an input, against friction; the output is its position.

ẍ = β u − o − sgn(ẋ) (j + G(|ẋ|));   at rest as long as |β u − o| ≤ j

Friction has a part that breaks loose, j, and a curve G of the speed for either direction, straight
between knots: viscous, falling at first (Stribeck), bent, whatever it is. Choose it for drives,
slides, carts and bearings: Janot, Gautier & Brunot (2019). Errors of a free mass add up, hence its
motion is computed exactly (models/sliding/run_compiled.py). All is identified in `identify`, from
differentiated positions to free runs (fit.py); no solver is needed.   T samples, K knots.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from data.record import Drive, Record, Response
from models.estimator import Estimator, Parameter
from models.modal.between_samples import interpolated
from models.sliding.fit import KNOTS, PRIORS, Plan, first_state, fitted, smoothed_by, windows
from models.sliding.problem import Mass, Motion, simulated
from models.sliding.run_compiled import SHARED

MOST_KNOTS = 40
PARTS = 4  # of a sample, in which an input that is not held is taken for held
POSITIONS = ("displacement", "output")


class SlidingMass(Estimator):
    """Position (…, T, 1) of a mass with friction; every estimate is a free run.

    knots: of the friction's curve in either direction. prior: weight of its bends beside the
    squared relative error. None: both are chosen on held-back motion. iterations: of the last fit.
    held_back: share of each record, its end.

    A record of unknown beginning tells its first position and speed by its warm-up samples; of
    those that are trained on, all samples tell. Raises ValueError for more than one input or
    output, and for records of anything but a position.
    """

    reads = ("f",)
    on_processor = True

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        knots: int | None = None,
        prior: float | None = None,
        iterations: int = 100,
        held_back: float = 0.2,
    ) -> None:
        super().__init__(dofs, inputs, dt)
        if (dofs, inputs) != (1, 1):
            raise ValueError(
                f"dofs={dofs}, inputs={inputs}: a sliding mass has one input and one output; "
                "choose other channels, or model=modal_network"
            )
        if knots is not None and not 1 <= knots <= MOST_KNOTS:
            raise ValueError(f"model.knots={knots}: expected 1 to {MOST_KNOTS}, or null")
        if (prior is not None and prior < 0.0) or iterations < 1 or not 0.05 <= held_back <= 0.5:
            raise ValueError(
                f"model.prior={prior}, iterations={iterations}, held_back={held_back}: expected at "
                "least 0 or null, at least 1, a share from 0.05 to 0.5"
            )
        counts = KNOTS if knots is None else (knots,)
        self.plan = Plan(counts, PRIORS if prior is None else (prior,), iterations)
        self.held_back = held_back
        empty = torch.full((SHARED + 2 * max(counts),), torch.nan, dtype=torch.float64)
        self.theta = nn.Parameter(empty, requires_grad=False)  # the first of them are used
        self.register_buffer("count", torch.zeros(1, dtype=torch.int64))
        self.register_buffer("knots", torch.ones(max(counts), dtype=torch.float64))
        self.register_buffer("scales", torch.ones(4, dtype=torch.float64))

    count: Tensor  # of knots
    knots: Tensor  # (K,) in units of the model
    scales: Tensor  # size of the input, size and mean of the output, unit of time [s]

    @property
    def identified_parameters(self) -> int:
        return SHARED + 2 * int(self.count)

    @property
    def mass(self) -> Mass:
        """The identified mass, in units of the model."""
        self.require_identified(self.theta[:1])
        K = int(self.count)
        theta = self.theta[: SHARED + 2 * K].detach().cpu().numpy()
        return Mass(self.knots[:K].cpu().numpy(), theta, np.zeros((1, 2)))

    def identify(self, batches: Iterable[Record]) -> dict[str, Any]:
        """Identify all parameters; returns gain, friction at rest and what was chosen."""
        records = [record.to("cpu") for record in batches]
        for record in records:
            if record.quantity not in POSITIONS:
                raise ValueError(
                    f"model=sliding_mass describes a position; the record holds {record.quantity}: "
                    "choose other channels, or model=element_network"
                )
        self._take_units(records)
        mass, facts = fitted(
            [motion for record in records for motion in self._motions(record)],
            self.plan,
            self.held_back,
        )
        K = len(mass.knots)
        self.count.fill_(K)
        self.knots[:K] = torch.from_numpy(mass.knots)
        self.theta.data.fill_(0.0)
        self.theta.data[: SHARED + 2 * K] = torch.from_numpy(mass.values)
        return facts | self._facts(mass)

    def _take_units(self, records: list[Record]) -> None:
        """Units of the model: RMS of input and output, and a time in which the one is covered."""
        u = np.concatenate([record.excitation.flatten().numpy() for record in records])
        y = np.concatenate([record.a.flatten().numpy() for record in records])
        size_u, size_y = float(np.sqrt(np.mean(u * u))) or 1.0, float(y.std()) or 1.0
        self.scales.copy_(torch.tensor([size_u, size_y, y.mean(), self.dt], dtype=torch.float64))
        motions = [motion for record in records for motion in self._motions(record)]
        slow = smoothed_by(motions, windows(motions)[-1])
        speed = np.sqrt(np.mean(np.concatenate([one.v for one in slow]) ** 2))
        if not speed > 0.0:
            raise ValueError("the position never changes; give a record in which the mass moves")
        self.scales[3] = self.dt / float(speed)

    def _facts(self, mass: Mass) -> dict[str, Any]:
        """Acceleration by input; inputs that friction and offset hold, in the records' units."""
        size_u, size_y, _, time = self.scales.tolist()
        beta, offset, jump = mass.values[0], mass.values[1], np.exp(mass.values[2])
        return {
            "gain": float(beta * size_y / time**2 / size_u),
            "dry_friction": float(jump / abs(beta) * size_u) if beta else 0.0,
            "offset": float(offset / beta * size_u) if beta else 0.0,
        }

    def _physical_parameters(self) -> Iterable[Parameter]:
        units = {"gain": "m/s² per unit", "dry_friction": "of the input", "offset": "of the input"}
        for name, value in self._facts(self.mass).items():
            yield Parameter(f"x1.{name}", float(value), units[name])

    def _held(self, excitation: Tensor, hold: str) -> list[np.ndarray]:
        """Inputs (T − 1, parts) of all runs, held for a part of a sample each."""
        size = float(self.scales[0])
        us = excitation.reshape(-1, excitation.shape[-2], 1).cpu().numpy() / size
        if hold == "zero_order":
            return [np.ascontiguousarray(u[:-1]) for u in us]
        return [np.ascontiguousarray(interpolated(u, hold, PARTS)[:, 1::2, 0]) for u in us]

    def _motions(self, record: Record) -> list[Motion]:
        """Those of a batch, in units of the model."""
        _, size, mean, time = self.scales.tolist()
        us = self._held(record.excitation, record.hold)
        ys = (record.a.reshape(-1, record.samples).cpu().numpy() - mean) / size
        return [Motion(u, y, record.dt / u.shape[1] / time) for u, y in zip(us, ys, strict=True)]

    def forward(self, record: Record) -> Tensor:
        """Positions (…, T, 1) of the free run of a record or a batch."""
        return self.run_of(record).a

    def free_run(self, drive: Drive) -> Response:
        """Positions as `a` of the response and as x, from the x0 and v0 of the drive."""
        us, (_, size, mean, time) = self._held(drive.u, drive.hold), self.scales.tolist()
        x0, v0 = (s.expand(*drive.u.shape[:-2], 1).reshape(-1) for s in (drive.x0, drive.v0))
        begins = np.stack([(x0.cpu().numpy() - mean) / size, v0.cpu().numpy() * time / size], 1)
        return self._response(us, begins, drive.u, drive.dt)

    def run_of(self, record: Record) -> Response:
        """The free run of a record. An unknown beginning is estimated from the warm-up samples."""
        if record.initial_state == "rest" or record.warmup < 2:
            return self.free_run(record.drive())
        mass = self.mass
        seen = [motion.part(0, record.warmup) for motion in self._motions(record)]
        begins = np.stack([first_state(mass, motion) for motion in seen])
        us = self._held(record.excitation, record.hold)
        return self._response(us, begins, record.excitation, record.dt)

    def _response(
        self, us: list[np.ndarray], begins: np.ndarray, like: Tensor, dt: float
    ) -> Response:
        mass, (_, size, mean, time) = self.mass, self.scales.tolist()
        runs = [
            simulated(mass, u, dt / u.shape[1] / time, begin)[:2]
            for u, begin in zip(us, begins, strict=True)
        ]
        shape = (*like.shape[:-1], 1)
        x, v = (
            torch.from_numpy(np.stack(signals)).reshape(shape).to(like.device)
            for signals in zip(*runs, strict=True)
        )
        x = mean + size * x
        return Response(x, size / time * v, x.clone())
