"""Neural state space: a linear system plus a small network, in a latent state.

z[k+1] = A z[k] + B w[k] + W₂ tanh(W₁ [z[k], w[k]] + b₁),    w[k] = [u[k], u[k+1]]
ẍ[k]   = C z[k] + D u[k] + V₂ tanh(V₁ [z[k], u[k]] + c₁)
z = [x, ẋ, q] in units of their RMS; an encoder makes the first memory q of the last measured
samples, which are zero before a motion from rest.
Suykens et al. (1995); encoder: Beintema et al. (2021).
T samples, n DOFs, m excitations, r memory states.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor, nn
from torch.func import jvp, vjp

from data.annotations import Count
from data.record import Drive, Record, Response
from models.fit.trainable import Trainable, windows_of
from models.layers.integrate import between
from models.layers.perceptron import (
    LinearWithNetwork,
    latent_run,
    latent_step,
    require_trainable_size,
)
from models.linear import EquivalentLinear

SLOWEST, FASTEST = 5.0, 0.05  # time constants of the memory at the start [s]


class NeuralStateSpace(Trainable):
    """Starts as the equivalent linear system; its one-step estimate is its free run.

    memory: r states beyond x and ẋ; hidden: neurons of each of the two networks; past: samples
    that the encoder reads. Train it on objective=free_run.
    """

    reads = ("f",)
    sizes: Tensor

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        memory: Count = 6,
        hidden: Count = 10,
        past: Count = 10,
    ) -> None:
        super().__init__(dofs, inputs, dt)
        if inputs < 1:
            raise ValueError("a neural state space follows an excitation; there are no inputs")
        states = 2 * dofs + memory
        sizes = [past * (2 * dofs + inputs), states + 2 * inputs, hidden, states]
        for name, size in (("past", past), ("memory", memory), ("hidden", hidden)):
            require_trainable_size(name, [size], sizes)
        self.memory, self.past = memory, past
        self.step = LinearWithNetwork(states + 2 * inputs, hidden, states)
        self.output = LinearWithNetwork(states + inputs, hidden, dofs)
        self.encoder = nn.Linear(
            past * (2 * dofs + inputs), memory, bias=False, dtype=torch.float64
        )
        nn.init.zeros_(self.encoder.weight)
        empty = torch.full((3 * dofs + inputs,), torch.nan, dtype=torch.float64)
        self.register_buffer("sizes", empty)  # RMS of x, ẋ, u, ẍ

    @torch.no_grad()
    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        """Fit the scaling; take the equivalent linear system as the start of A, B, C and D."""
        n, m = self.dofs, self.inputs
        linear = EquivalentLinear(n, m, self.dt).to(self.sizes.device)
        solution = linear.identify(batches)
        squares, count = torch.zeros_like(self.sizes), 0
        for record in batches:
            all_signals = torch.cat([_state(record), record.excitation, record.a], dim=-1)
            squares += all_signals.flatten(0, -2).square().sum(dim=0)
            count += all_signals[..., 0].numel()
        size = (squares / count).sqrt()
        self.sizes.copy_(torch.where(size > 0.0, size, 1.0))
        of_state, of_u, of_a = self.sizes.split([2 * n, m, n])
        hold = "zero_order" if record.hold == "zero_order" else "linear"
        exact = torch.cat(linear._exact_step(hold))  # rows: x, ẋ, u[k], u[k+1]
        rows = torch.cat([of_state, of_u, of_u])[:, None]
        self._start_step(rows * exact / of_state)
        velocity, displacement, force = linear.weights.split([n, n, m])
        rows = torch.cat([of_state, of_u])[:, None]
        weights = rows * torch.cat([displacement, velocity, force]) / of_a
        self.output.linear.weight.zero_()
        self.output.linear.weight[:, : 2 * n] = weights[: 2 * n].T
        self.output.linear.weight[:, 2 * n + self.memory :] = weights[2 * n :].T
        return solution

    def _start_step(self, exact: Tensor) -> None:
        """Start the memory as low-pass filters of the motion, fast and slow, without any effect."""
        n = self.dofs
        weight = self.step.linear.weight  # (2n + r, 2n + r + 2m)
        mixture = weight[2 * n :, : 2 * n].sign() / (2.0 * n) ** 0.5
        weight.zero_()
        weight[: 2 * n, : 2 * n] = exact[: 2 * n].T
        weight[: 2 * n, 2 * n + self.memory :] = exact[2 * n :].T
        for i, share in enumerate(torch.linspace(0.0, 1.0, self.memory).tolist()):
            constant = SLOWEST * (FASTEST / SLOWEST) ** share
            kept = math.exp(-self.dt / constant)
            weight[2 * n + i, 2 * n + i] = kept
            weight[2 * n + i, : 2 * n] = (1.0 - kept) * mixture[i]

    def restart(self, generator: torch.Generator) -> None:
        """Draw the networks again; the linear system stays."""
        self.step.draw(generator)
        self.output.draw(generator)

    def forward(self, record: Record) -> Tensor:
        return self.free_run(record.drive()).a

    def free_run(self, drive: Drive) -> Response:
        """The motion from the initial state; the encoder takes the time before it for rest."""
        now = torch.cat([drive.x0, drive.v0, drive.u[..., 0, :]], dim=-1)[..., None, :]
        before = now.new_zeros(*now.shape[:-2], self.past - 1, now.shape[-1])
        return self._run(drive, torch.cat([before, now], dim=-2))

    def restarted_run(self, record: Record, horizon: int | None) -> Tensor:
        """Acceleration (…, T, n); the encoder reads the measured samples before each window."""
        if horizon is None or horizon >= record.samples:
            return self.free_run(record.drive()).a
        drive, window, place = windows_of(record, horizon)
        past = self._past(record, horizon)
        return self._run(drive, past).a[..., window, place, :]

    def _past(self, record: Record, horizon: int) -> Tensor:
        """[x, ẋ, u] (…, windows, past, 2n + m) up to the first sample of every window."""
        starts = torch.arange(0, record.samples, horizon, device=record.a.device)
        signals = torch.cat([_state(record), record.excitation], dim=-1)
        padded = torch.nn.functional.pad(signals, (0, 0, self.past - 1, 0))
        reach = torch.arange(self.past, device=record.a.device)
        return padded[..., starts[:, None] + reach, :]

    def _run(self, drive: Drive, past: Tensor) -> Response:
        z0, w, u = self._scaled(drive, past)
        z = trajectory(z0, w, *self.step.theta())  # (T, B, q)
        a = self.output(z, u) * self.sizes[-self.dofs :]
        state = z[..., : 2 * self.dofs] * self.sizes[: 2 * self.dofs]
        shape = drive.u.shape[:-1]
        x, v = state.transpose(0, 1).reshape(*shape, -1).chunk(2, dim=-1)
        return Response(x, v, a.transpose(0, 1).reshape(*shape, -1))

    def _scaled(self, drive: Drive, past: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """z[0] (B, q), w (T − 1, B, 2m) and u (T, B, m) of B runs."""
        self.require_identified(self.sizes)
        of_state, of_u, _ = self.sizes.split([2 * self.dofs, self.inputs, self.dofs])
        state = torch.cat([drive.x0, drive.v0], dim=-1).reshape(-1, 2 * self.dofs) / of_state
        past = past / torch.cat([of_state, of_u])
        q = self.encoder(past.flatten(-2)).reshape(len(state), self.memory)
        last = between(drive.u, drive.hold, 1).squeeze(-2)
        w = torch.cat([drive.u[..., :-1, :] / of_u, last / of_u], dim=-1)
        w = w.reshape(len(q), drive.samples - 1, 2 * self.inputs)
        u = (drive.u / of_u).reshape(len(q), -1, self.inputs)
        return torch.cat([state, q], dim=-1), w.transpose(0, 1), u.transpose(0, 1)


def _state(record: Record) -> Tensor:
    if record.x is None or record.v is None:
        raise ValueError(
            "a neural state space is identified from x and v, which the record lacks; "
            f"{record.remedy_of_state}"
        )
    return torch.cat([record.x, record.v], dim=-1)


# A simulation and its derivatives: every step linearised at once, then one short recursion.
#
# z[k+1] = s(z[k], w[k]; θ),   A[k] = ∂s/∂z along the trajectory
# forward:   ż[k+1] = A[k] ż[k] + ∂s/∂θ θ̇           (tangents)
# backward:  λ[k] = A[k]ᵀ λ[k+1] + ∂L/∂z[k],   ∂L/∂θ = Σ (∂s/∂θ)ᵀ λ[k+1]
#
# Only the recursions go step by step; the steps are differentiated as one batch. So a gradient
# costs little more than the run.   B runs, T samples, q states.


def trajectory(first: Tensor, w: Tensor, *theta: Tensor) -> Tensor:
    """z (T, B, q) from z[0] (B, q) under w (T − 1, B, ·), as `latent_run` gives it.

    Differentiable in z[0] and θ, once, in both modes.
    """
    return _Trajectory.apply(first, w, *theta)


class _Trajectory(torch.autograd.Function):
    generate_vmap_rule = True

    @staticmethod
    def forward(first: Tensor, w: Tensor, *theta: Tensor) -> Tensor:
        return latent_run(first, w, *theta)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
        _, w, *theta = inputs
        ctx.save_for_backward(output, w, *theta)
        ctx.save_for_forward(output, w, *theta)

    @staticmethod
    def backward(ctx: Any, *slopes: Tensor) -> tuple[Tensor | None, ...]:
        z, w, *theta = ctx.saved_tensors
        (slope,) = slopes
        A = _by_state(z[:-1], w, theta)
        adjoint, history = slope[-1][:, None], []  # λ as rows (B, 1, q)
        for a, s in zip(A.flip(0), slope[:-1].flip(0), strict=True):
            history.append(adjoint)
            adjoint = torch.baddbmm(s[:, None], adjoint, a)
        pull = vjp(lambda *t: latent_step(z[:-1], w, *t), *theta)[1]
        return adjoint[:, 0], None, *pull(torch.cat(history[::-1], dim=1).transpose(0, 1))

    @staticmethod
    def jvp(ctx: Any, *tangents: Any) -> Tensor:
        z, w, *theta = ctx.saved_tensors
        first, _, *along = tangents
        A = _by_state(z[:-1], w, theta)
        added = jvp(lambda *t: latent_step(z[:-1], w, *t), tuple(theta), tuple(along))[1]
        moved = first[..., None]  # ż as columns (B, q, 1)
        history = [moved]
        for a, s in zip(A, added, strict=True):
            moved = torch.baddbmm(s[..., None], a, moved)
            history.append(moved)
        return torch.stack([column[..., 0] for column in history])


def _by_state(z: Tensor, w: Tensor, theta: list[Tensor]) -> Tensor:
    """A (T, B, q, q), by one reverse differentiation for each state."""
    pull = vjp(lambda z: latent_step(z, w, *theta), z)[1]
    unit = torch.eye(z.shape[-1], dtype=z.dtype, device=z.device)
    return torch.stack([pull(e.expand_as(z))[0] for e in unit], dim=-2)
