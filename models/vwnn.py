"""Volterra/Wiener neural network: fixed low-pass filters, sigmoidal products, least-squares head.

ζ = [ẍ, f],  ξ = [H ζ, H² ζ],  ẍ̂ = Wᵀ φ(ξ)      Brewick & Masri (2016), Sect. 2.1, Eqs. 3–6, Table 2
B records, T samples, n DOFs, m channels of excitation, P features.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import Annotated

import numpy as np
import torch
from torch import Tensor, nn

from data.annotations import MOST, NotNegative, Positive, Range
from data.parallel import interruptible
from data.record import Drive, Record, Response
from data.sample import Sample
from models import vwnn_compiled
from models.estimator import weight_matrix
from models.layers.features import SigmoidProducts
from models.layers.filters import LowPassCascade
from models.layers.integrate import differentiated, integrated
from models.layers.least_squares import CHUNK, LeastSquares
from models.linear_in_weights import LinearInWeights


class VWNN(LinearInWeights):
    """Estimates acceleration from past accelerations and forces alone.

    cutoff: of H(s) = ω_c/(s + ω_c) [rad/s]; stages: filters in series, every one an output of ξ.
    sigmoid_weight: λ of Eq. 6 [1/(unit of ζ)]; None: 0.5 over the largest that each channel of ζ
    has in training, so that no unit counts. order: of the products, 1 to 3, or a list of orders.
    squares, bias: repeated factors and a constant among the features.
    ridge: ≥ 0, without unit, on scaled columns.
    unfiltered_excitation: adds f itself to ξ. The paper's ξ has only filtered signals; with f a
    linear structure's acceleration is within reach.
    """

    reads = ("a", "f")

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        cutoff: float = 50.0,
        stages: Annotated[int, Range(1, MOST)] = 2,
        sigmoid_weight: Positive | None = 0.05,
        order: int | Sequence[int] = 2,
        squares: bool = True,
        bias: bool = True,
        ridge: NotNegative = 0.0,
        unfiltered_excitation: bool = False,
    ) -> None:
        super().__init__(dofs, inputs, dt)
        self.ridge, self.unfiltered_excitation = ridge, unfiltered_excitation
        self.filters = LowPassCascade(cutoff, stages, dt)
        channels = stages * (dofs + inputs) + (inputs if unfiltered_excitation else 0)
        self.activation = SigmoidProducts(channels, sigmoid_weight, order, squares, bias)
        self.weights = weight_matrix(self.activation.features, dofs)  # W (P, n)

    def features(self, record: Record) -> Iterator[tuple[slice, Tensor]]:
        """φ(ξ) (…, CHUNK, P), chunk by chunk in time, with the samples each chunk covers."""
        state, excitation = None, record.excitation
        chunk = max(1, CHUNK // record.a[..., 0, 0].numel())
        for start in range(0, record.samples, chunk):
            span = slice(start, min(start + chunk, record.samples))
            f = excitation[..., span, :]
            zeta = torch.cat([record.a[..., span, :], f], dim=-1)
            xi, state = self.filters(zeta, state)
            if self.unfiltered_excitation:
                xi = torch.cat([xi, f], dim=-1)
            yield span, self.activation.products_of(xi)

    def prepare(self, batches: Iterable[Record]) -> dict[str, float]:
        """Set λ where it is open."""
        if self.activation.weight.ndim:
            signals = ((record.a, record.excitation) for record in batches)
            largest = [[u.abs().flatten(0, -2).amax(dim=0) for u in both] for both in signals]
            a, f = (torch.stack(sizes).amax(dim=0) for sizes in zip(*largest, strict=True))
            zeta = torch.cat([a, f]).repeat(self.filters.stages)
            self.activation.take_sizes(torch.cat([zeta, f]) if self.unfiltered_excitation else zeta)
        return {}

    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        self.prepare(batches)
        fit = LeastSquares(self.ridge)
        for record in batches:
            for span, phi in self.features(record):
                counted = max(record.warmup - span.start, 0)
                fit.add(phi[..., counted:, :], record.a[..., span, :][..., counted:, :])
        solution = fit.solve()
        self.weights.data = solution.weights
        return solution.facts()

    def forward(self, record: Record) -> Tensor:
        self.require_identified(self.weights)
        if not differentiated(record.a, record.excitation):
            return self._run_compiled(record.excitation, record.a)
        return torch.cat([phi @ self.weights for _, phi in self.features(record)], dim=-2)

    def heads(self) -> list[nn.Parameter]:
        return [self.weights]

    def features_of(self, record: Record) -> Iterator[tuple[slice, list[Tensor]]]:
        for span, phi in self.features(record):
            yield span, [phi]

    def at_rest(self) -> Tensor:
        """State of the filters (stages, n + m)."""
        channels = self.dofs + self.inputs
        return self.weights.new_zeros(self.filters.stages, channels)

    def features_at(self, sample: Sample, memory: Tensor) -> list[Tensor]:
        xi = memory.flatten()
        if self.unfiltered_excitation:
            xi = torch.cat([xi, sample.excitation])
        return [self.activation(xi)]

    def remember(self, sample: Sample, a: Tensor, memory: Tensor) -> Tensor:
        return self.filters.step(torch.cat([a, sample.excitation]), memory)

    def free_run(self, drive: Drive) -> Response:
        """The motion from filters at rest, whatever the initial state and the hold."""
        self.require_identified(self.weights)
        compiled = not differentiated(drive.u)
        return integrated(self._run_compiled(drive.u) if compiled else self._run(drive), drive)

    def _run(self, drive: Drive) -> Tensor:
        """ẍ̂ (…, T, n) in PyTorch: the readable reference, for derivatives."""
        driven = self.filters(drive.u)[0].unflatten(-1, (self.filters.stages, -1))
        state, history = torch.zeros_like(drive.x0).unsqueeze(-2), []
        state = state.expand(*drive.x0.shape[:-1], self.filters.stages, self.dofs)
        for filtered, u in zip(driven.unbind(dim=-3), drive.u.unbind(dim=-2), strict=True):
            xi = torch.cat([state, filtered], dim=-1).flatten(-2)  # stage by stage, [ẍ, f]
            if self.unfiltered_excitation:
                xi = torch.cat([xi, u], dim=-1)
            a = self.activation(xi) @ self.weights
            history.append(a)
            state = self.filters.step(a, state)
        return torch.stack(history, dim=-2)

    def _run_compiled(self, excitation: Tensor, past: Tensor | None = None) -> Tensor:
        """ẍ̂ (…, T, n) compiled: the production run, on the processor, some hundred times faster.

        past (…, T, n): the acceleration one sample behind, which a free run has of itself.
        """
        device, excitation = excitation.device, excitation.cpu()
        past = None if past is None else past.cpu()
        a = torch.empty(*excitation.shape[:-1], self.dofs, dtype=torch.float64)
        factors, own = self.activation.places().numpy(), self.weights.detach().cpu().numpy()
        settings = float(self.filters.decay), self.activation.weights(), factors
        for place in np.ndindex(a.shape[:-2]):
            u, estimate = excitation[place].detach().contiguous().numpy(), a[place].numpy()
            seen = estimate if past is None else past[place].detach().contiguous().numpy()
            fixed = self.filters.stages, u, self.unfiltered_excitation, *settings
            run = partial(vwnn_compiled.run, *fixed, own, seen, estimate)
            interruptible(run, len(u) * own.size)
        return a.to(device)
