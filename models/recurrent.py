"""A recurrent network from excitation to motion: gated recurrent units.

h[0−] = W₀ [x₀, v₀] + b₀,   h[k] = cell(h[k−1], u[k]),   [ẍ, x, ẋ][k] = W [h[k], u[k]] + b
Cho et al. (2014).  T samples, n DOFs, m excitations, H neurons.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

import torch
from torch import Tensor, nn

from data.annotations import Count, Range
from data.record import Drive, Record, Response
from models.fit.trainable import Trainable
from models.layers.integrate import integrated
from models.layers.perceptron import DEEPEST, require_trainable_size
from models.layers.scaling import Extents

Layers = Annotated[int, Range(1, DEEPEST)]


class Recurrent(Trainable):
    """A network that only simulates: its one-step estimate is its free run.

    Estimates read no measured acceleration, and of x and v only the initial state. Training fits
    ẍ, and x and ẋ where the record holds them; without these the free run integrates ẍ.
    hidden: H; layers: cells on top of each other.
    """

    reads = ("f",)
    signals: Tensor

    def __init__(
        self, dofs: int, inputs: int, dt: float, hidden: Count = 32, layers: Layers = 1
    ) -> None:
        super().__init__(dofs, inputs, dt)
        if inputs < 1:
            raise ValueError("a recurrent network follows an excitation; there are no inputs")
        require_trainable_size("hidden", [hidden], [4 * hidden, hidden + inputs])
        double = torch.float64
        self.cells = nn.GRU(inputs, hidden, layers, batch_first=True, dtype=double)
        self.begin = nn.Linear(2 * dofs, layers * hidden, dtype=double)
        self.head = nn.Linear(hidden + inputs, 3 * dofs, dtype=double)
        self.input_scale, self.state_scale = Extents(inputs), Extents(2 * dofs)
        self.register_buffer("signals", torch.full((3, dofs), torch.nan, dtype=double))  # RMS

    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        """Fit the scaling; the weights are fitted by the solver."""
        records = list(batches)
        self.input_scale.fit(r.excitation for r in records)
        motions = [_motion(r) for r in records]
        if motions[0].shape[-1] == 3 * self.dofs:
            self.state_scale.fit(motion[..., self.dofs :] for motion in motions)
        flat = torch.cat([motion.flatten(0, -2) for motion in motions])
        size = flat.square().mean(dim=0).sqrt().view(-1, self.dofs)
        self.signals.zero_()[: len(size)] = torch.where(size > 0.0, size, 1.0)
        return {}

    def restart(self, generator: torch.Generator) -> None:
        """Draw cells uniformly in ±1/√hidden, as at construction, and the linear layers again."""
        super().restart(generator)
        reach = self.cells.hidden_size**-0.5
        with torch.no_grad():
            for weights in self.cells.parameters():
                drawn = torch.rand(weights.shape, generator=generator, dtype=weights.dtype)
                weights.copy_(reach * (2.0 * drawn - 1.0))

    def forward(self, record: Record) -> Tensor:
        return self._motion(record.drive())[..., : self.dofs]

    def regression(self, record: Record) -> tuple[nn.Module, Record, Tensor]:
        """Regression on all measured signals, each scaled to the acceleration of its DOF."""
        self.check(record)
        module = _AllSignals(self)
        return module, record, module.scaled(_motion(record))

    def free_run(self, drive: Drive) -> Response:
        a, x, v = self._motion(drive).split(self.dofs, dim=-1)
        if not self.signals[1:].any():  # trained on accelerations alone
            return integrated(a, drive)
        return Response(x, v, a)

    def _motion(self, drive: Drive) -> Tensor:
        """[ẍ, x, ẋ] (…, T, 3n)."""
        self.require_identified(self.signals)
        shape = drive.u.shape[:-2]
        u = self.input_scale(drive.u).reshape(
            drive.u.shape[:-2].numel(), *drive.u.shape[-2:]
        )  # (B, T, m)
        first = self.state_scale(torch.cat([drive.x0, drive.v0], dim=-1)).reshape(len(u), -1)
        h = self.begin(first).view(len(u), -1, self.cells.hidden_size)
        hidden, _ = self.cells(u, h.transpose(0, 1).contiguous())  # (layers, B, H)
        motion = self.head(torch.cat([hidden, u], dim=-1)) * self.signals.flatten()
        return motion.view(*shape, *motion.shape[-2:])


class _AllSignals(nn.Module):
    """Record → [ẍ, x, ẋ] (…, T, 3n) [m/s²], or ẍ alone where x and v are not measured."""

    def __init__(self, estimator: Recurrent) -> None:
        super().__init__()
        self.estimator = estimator

    def forward(self, record: Record) -> Tensor:
        return self.scaled(self.estimator._motion(record.drive()))

    def scaled(self, motion: Tensor) -> Tensor:
        """Signals scaled to the acceleration of their DOF, so that mean(e²) weighs all alike."""
        sizes = self.estimator.signals
        counted = sizes[sizes.any(dim=1)]
        scale = (counted[0] / counted).flatten()
        return motion[..., : len(scale)] * scale


def _motion(record: Record) -> Tensor:
    """The measured [ẍ, x, ẋ] (…, T, 3n), or ẍ alone."""
    if record.x is None or record.v is None:
        return record.a
    return torch.cat([record.a, record.x, record.v], dim=-1)
