"""Wiener–Hammerstein system: a linear filter, a static curve, another linear filter.

x = G₁ u,   w = f(x),   y = G₂ w + o₀            Billings & Fakhouri (1978); Schoukens et al. (2009)

Choose it for one input and one output, such as a voltage and a voltage, where nothing nonlinear has
a memory. Filters are sums of sections (models/block_structured/filters.py), f smooth ramps
(curve.py); a best linear approximation gives the start (split.py), Levenberg–Marquardt on exact
derivatives the rest, all in `identify`: no solver is needed.   T samples.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from data.record import Drive, Record, Response
from models.block_structured.chain import Chain, Layout, Motion, run
from models.block_structured.fit import ORDERS, Plan, count, fitted
from models.block_structured.problem import first_state
from models.estimator import Estimator
from models.modal.between_samples import interpolated

MOST_POLES, MOST_RAMPS, MOST_FINER = 16, 40, 8


class WienerHammerstein(Estimator):
    """Output (…, T, 1) of filter, curve and filter; every estimate is a free run.

    poles: of each filter; None: beginning with those of the best linear approximation, as many as
    lower the error on held-back motion. A pole that one filter does not need gets a zero upon it.
    finer: R, times the sampling rate at which all of it works, 1 or even. A curve makes
    frequencies that its input has not, and those above half of the sampling rate fold back.
    ramps: of the curve. allocations: of poles and zeros to the filters, that are trained beside
    five fractions of the approximation. iterations: of the last fit. held_back: share of each
    record, its end. prior: weight of Σ θ² beside the squared relative error. The curve may be even,
    a modulus say: where nothing linear follows the motion, starts of another kind join (lifted.py).

    A record of unknown beginning tells its first state by its warm-up samples; of those that are
    trained on, all samples tell. Raises ValueError for more than one input or output.
    """

    reads = ("f",)
    on_processor = True

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        poles: int | None = None,
        finer: int = 2,
        ramps: int = 16,
        allocations: int = 5,
        iterations: int = 120,
        held_back: float = 0.2,
        prior: float = 1e-9,
        seed: int = 0,
    ) -> None:
        super().__init__(dofs, inputs, dt)
        if (dofs, inputs) != (1, 1):
            raise ValueError(
                f"dofs={dofs}, inputs={inputs}: a Wiener–Hammerstein system has one input and one "
                "output; choose other channels, or model=modal_network"
            )
        if poles is not None and not 1 <= poles <= MOST_POLES:
            raise ValueError(f"model.poles={poles}: expected 1 to {MOST_POLES}, or null")
        if finer != 1 and (finer % 2 or not 2 <= finer <= MOST_FINER):
            raise ValueError(f"model.finer={finer}: expected 1, or an even number to {MOST_FINER}")
        if not 1 <= ramps <= MOST_RAMPS:
            raise ValueError(f"model.ramps={ramps}: expected 1 to {MOST_RAMPS}")
        if allocations < 0 or iterations < 1 or not 0.05 <= held_back <= 0.5 or prior < 0.0:
            raise ValueError(
                f"model.allocations={allocations}, iterations={iterations}, held_back={held_back}, "
                f"prior={prior}: expected at least 0 and 1, a share from 0.05 to 0.5, at least 0"
            )
        self.held_back, self.finer = held_back, finer
        orders = ORDERS if poles is None else [poles]
        self.plan = Plan(orders, ramps, allocations, iterations, prior, seed)
        sections = (max(orders) + 1) // 2
        most = Layout(sections, sections, ramps)
        empty = torch.full((most.size,), torch.nan, dtype=torch.float64)
        self.theta = nn.Parameter(empty, requires_grad=False)  # the first of them are used
        self.register_buffer("counts", torch.zeros(4, dtype=torch.int64))
        self.register_buffer("scales", torch.ones(4, dtype=torch.float64))
        self.register_buffer("deviation", torch.zeros(most.states, dtype=torch.float64))

    counts: Tensor  # sections before and after the curve, ramps, learned parameters
    scales: Tensor  # of the input and the output, mean of the output; RMS error over the second
    deviation: Tensor  # RMS of the states, in units of the model

    @property
    def identified_parameters(self) -> int:
        return int(self.counts[3])

    @property
    def chain(self) -> Chain:
        """The identified system, in units of the model, at rest."""
        self.require_identified(self.theta[:1])
        before, after, ramps, _ = self.counts.tolist()
        layout = Layout(before, after, ramps, self.finer)
        values = self.theta[: layout.size].detach().cpu().numpy()
        return Chain(layout, values, np.zeros((1, layout.states)))

    def identify(self, batches: Iterable[Record]) -> dict[str, Any]:
        """Identify all parameters; what was chosen, and its errors on held-back motion."""
        records = [record.to("cpu") for record in batches]
        u = np.concatenate([record.excitation.flatten().numpy() for record in records])
        y = np.concatenate([record.a.flatten().numpy() for record in records])
        sizes = [np.sqrt(np.mean(u * u)), y.std()]
        sizes = [size if size > 0.0 else 1.0 for size in sizes]
        self.scales.copy_(torch.tensor([*sizes, y.mean(), 1.0]))
        motions = [motion for record in records for motion in self._motions(record)]
        chain, facts = fitted(motions, self.plan)
        layout = chain.layout
        numbers = [layout.before, layout.after, layout.ramps, count(chain)]
        self.counts.copy_(torch.tensor(numbers))
        self.theta.data.fill_(0.0)
        self.theta.data[: layout.size] = torch.from_numpy(chain.values)
        self.deviation[: layout.states] = torch.from_numpy(_state_sizes(chain, motions))
        self.scales[3] = max(chain.error, 1e-9)
        return facts

    def _motions(self, record: Record) -> list[Motion]:
        """Those of a batch, in units of the model; the ends of records that are long held back."""
        size_u, size_y, mean, _ = self.scales.tolist()
        T = record.samples
        stop = max(2, round((1.0 - self.held_back) * T))
        us, ys = (s.reshape(-1, T).cpu().numpy() for s in (record.excitation, record.a))
        unknown = record.initial_state != "rest"
        return [
            Motion(self._between(u / size_u, record.hold), (y - mean) / size_y, unknown, stop)
            for u, y in zip(us, ys, strict=True)
        ]

    def _between(self, u: np.ndarray, hold: str) -> np.ndarray:
        """u (T,) at R times its rate, (R (T − 1) + 1,), by what it does between samples."""
        if self.finer == 1:
            return u
        inner = interpolated(u[:, None], hold, self.finer // 2)[:, :-1, 0]
        return np.r_[inner.ravel(), u[-1]]

    def forward(self, record: Record) -> Tensor:
        """Outputs (…, T, 1) of the free run of a record or a batch."""
        return self.run_of(record).a

    def free_run(self, drive: Drive) -> Response:
        """Outputs from rest as `a` of the response; x and v are unknown, and nil."""
        return self._response(drive.u, drive.hold, None)

    def run_of(self, record: Record) -> Response:
        """The free run of a record. An unknown beginning is estimated from the warm-up samples."""
        known = record.initial_state == "rest" or not record.warmup
        return self._response(record.excitation, record.hold, None if known else record)

    def _response(self, excitation: Tensor, hold: str, record: Record | None) -> Response:
        chain, (size_u, size_y, mean, noise) = self.chain, self.scales.tolist()
        T = excitation.shape[-2]
        us = excitation.reshape(-1, T).cpu().numpy() / size_u
        us = [self._between(u, hold) for u in us]
        begins = np.zeros((len(us), chain.layout.states))
        if record is not None:
            seen = [motion.first(record.warmup) for motion in self._motions(record)]
            size = self.deviation[: chain.layout.states].cpu().numpy()
            begins = np.stack([first_state(chain, motion, noise, size) for motion in seen])
        with np.errstate(all="ignore"):
            runs = [
                run(chain.layout, chain.values, u, begin)[0]
                for u, begin in zip(us, begins, strict=True)
            ]
        a = torch.from_numpy(mean + size_y * np.stack(runs)).to(excitation.device)
        a = a.reshape(*excitation.shape[:-1], 1)
        return Response(torch.zeros_like(a), torch.zeros_like(a), a)


def _state_sizes(chain: Chain, motions: list[Motion]) -> np.ndarray:
    """RMS (S,) of s[−1] and s[−2] of each section, in training."""
    from models.block_structured import curve, filters

    p, sizes, samples = chain.parts, np.zeros(chain.layout.states), 0
    for motion, begin in zip(motions, chain.begins, strict=True):
        one, two = chain.layout.states_of(begin)
        s = filters.states(p["a1"], motion.u, one)
        x = run(chain.layout, chain.values, motion.u, begin)[1]
        after = filters.states(p["a2"], curve.value(x, p["beta"][0], p["laws"]), two)
        squares = np.concatenate([(s**2).sum(axis=1), (after**2).sum(axis=1)])
        sizes, samples = sizes + np.repeat(squares, 2), samples + len(motion.u)
    size: np.ndarray = np.sqrt(sizes / samples)
    return size
