"""Time integration of a model's equation of motion, batched and differentiable.

ẍ = g(x, ẋ, u), the classical Runge–Kutta method of fourth order, one step per sample.
T samples, n DOFs, m channels of excitation.   Hairer, Nørsett & Wanner (1993), Sect. II.1
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.forward_ad import unpack_dual
from torch.nn.functional import pad

from data.parallel import interruptible
from data.record import Drive, Response

Acceleration = Callable[[Tensor, Tensor, Tensor], Tensor]  # (x, ẋ, u) (…, n), (…, n), (…, m) → ẍ
BLOCK = 1 << 12  # samples of which each is a tensor of its own, a hundred times as large
DelayedAcceleration = Callable[[Tensor, Tensor, Tensor, Tensor], tuple[Tensor, Tensor]]


def one_by_one(u: Tensor) -> Iterator[Tensor]:
    """The samples (…, m) of a signal (…, T, m), in their order."""
    for block in u.split(BLOCK, dim=-2):
        yield from block.unbind(dim=-2)


class History:
    """Signals of one sample after the other, put together along time a block at a time."""

    def __init__(self) -> None:
        self.samples = 0
        self.newest: list[tuple[Tensor, ...]] = []
        self.blocks: list[tuple[Tensor, ...]] = []

    def add(self, *signals: Tensor) -> None:
        """Add a sample (…, m) of each signal."""
        self.newest.append(signals)
        self.samples += 1
        if len(self.newest) == BLOCK:
            self._close()

    def signals(self) -> tuple[Tensor, ...]:
        """Each signal (…, T, m)."""
        if self.newest:
            self._close()
        return tuple(torch.cat(blocks, dim=-2) for blocks in zip(*self.blocks, strict=True))

    def _close(self) -> None:
        stacked = (torch.stack(signal, dim=-2) for signal in zip(*self.newest, strict=True))
        self.blocks.append(tuple(stacked))
        self.newest = []


def between(u: Tensor, hold: str, substeps: int) -> Tensor:
    """u (…, T, m) at the end of each of `substeps` parts of every interval, (…, T − 1, S, m).

    A zero-order hold ends with the value it began with. `band_limited` takes the values from the
    Fourier series of the record, which looks ahead.
    """
    first, last = u[..., :-1, None, :], u[..., 1:, None, :]
    if hold == "zero_order" or u.shape[-1] == 0:
        return first.expand(*first.shape[:-2], substeps, -1)
    if hold == "linear":
        step = last - first
        return torch.cat([first + k / substeps * step for k in range(1, substeps + 1)], dim=-2)
    fine = _upsampled(u, substeps)[..., 1 : (u.shape[-2] - 1) * substeps + 1, :]
    return fine.unflatten(-2, (u.shape[-2] - 1, substeps))


def _upsampled(u: Tensor, factor: int) -> Tensor:
    """u (…, T, m) at `factor` times the rate (…, T·factor, m), by zeros above its spectrum."""
    samples = u.shape[-2]
    spectrum = torch.fft.rfft(u, dim=-2)
    if samples % 2 == 0 and factor > 1:  # the Nyquist line is split between both its sides
        spectrum = torch.cat([spectrum[..., :-1, :], 0.5 * spectrum[..., -1:, :]], dim=-2)
    wider = pad(spectrum, (0, 0, 0, samples * factor // 2 + 1 - spectrum.shape[-2]))
    return factor * torch.fft.irfft(wider, n=samples * factor, dim=-2)


def runge_kutta(acceleration: Acceleration, drive: Drive) -> Response:
    """x, ẋ, ẍ (…, T, n) from the initial state."""

    def without_past(x: Tensor, v: Tensor, u: Tensor, past: Tensor) -> tuple[Tensor, Tensor]:
        return acceleration(x, v, u), past

    return runge_kutta_delayed(without_past, drive, drive.x0)


def runge_kutta_delayed(law: DelayedAcceleration, drive: Drive, past: Tensor) -> Response:
    """x, ẋ, ẍ (…, T, n) of ẍ = g(x, ẋ, u, p), p a signal of the sample before, which `law` returns.

    Between samples p is linear; `past` is its value before the record. A step's velocities are its
    first one and accelerations, which leaves x[k+1] = x + h v + h²/6 (a + a₂ + a₃).
    """
    halves = between(drive.u, drive.hold, 2)
    middle, end = (one_by_one(u) for u in halves.unbind(dim=-2))
    at_samples, history = one_by_one(drive.u), History()
    h, x, v = drive.dt, drive.x0, drive.v0
    a, now = law(x, v, next(at_samples), past)
    history.add(x, v, a)
    # a step begins after any jump of u at its sample
    for k, (at_middle, at_end, at_next) in enumerate(zip(middle, end, at_samples, strict=True)):
        delayed = 0.5 * (past + now)
        v2 = torch.add(v, a, alpha=0.5 * h)
        a2 = law(torch.add(x, v, alpha=0.5 * h), v2, at_middle, delayed)[0]
        v3 = torch.add(v, a2, alpha=0.5 * h)
        a3 = law(torch.add(x, v2, alpha=0.5 * h), v3, at_middle, delayed)[0]
        a4 = law(torch.add(x, v3, alpha=h), torch.add(v, a3, alpha=h), at_end, now)[0]
        halfway = a2 + a3
        x = torch.add(torch.add(x, v, alpha=h), a + halfway, alpha=h * h / 6.0)
        v = torch.add(v, torch.add(a + a4, halfway, alpha=2.0), alpha=h / 6.0)
        past = now
        a, now = law(x, v, at_next, past)
        history.add(x, v, a)
        if k % 100 == 99 and _all_lost(a):
            break
    lost = drive.samples - history.samples
    return Response(*(pad(u, (0, 0, 0, lost), value=torch.nan) for u in history.signals()))


def _all_lost(a: Tensor) -> bool:
    """Whether no run of the batch is finite any more; False where derivatives are taken."""
    return torch.is_inference_mode_enabled() and not bool(torch.isfinite(a).all(dim=-1).any())


def differentiated(*signals: Tensor) -> bool:
    """Whether derivatives by any of them are asked for, which compiled code has none of."""
    backward = torch.is_grad_enabled() and any(u.requires_grad for u in signals)
    return backward or any(unpack_dual(u).tangent is not None for u in signals)


def run_compiled(run: Callable[..., None], parts: Any, drive: Drive, size: int) -> Response:
    """x, ẋ, ẍ (…, T, n) on the processor, by a `run` that integrate_compiled.py describes.

    size: how many numbers its law has, about as many as the inner steps of an evaluation.
    """
    motion = torch.zeros(3, *drive.u.shape[:-1], drive.x0.shape[-1], dtype=torch.float64)
    motion[0, ..., 0, :], motion[1, ..., 0, :] = drive.x0.detach(), drive.v0.detach()
    halves = between(drive.u, drive.hold, 2).unbind(dim=-2)
    signals = [flat(u) for u in (drive.u, *halves, *motion)]
    steps = 4 * size * motion[0, ..., 0].numel()
    interruptible(partial(run, parts, drive.dt, *signals), steps)
    return Response(*motion.to(drive.u.device))


def flat(u: Tensor) -> np.ndarray:
    """A signal (…, T, m) as compiled code takes it, (B, T, m); the same memory where it can be."""
    return u.detach().cpu().reshape(u.shape[:-2].numel(), *u.shape[-2:]).contiguous().numpy()


def integrated(a: Tensor, drive: Drive) -> Response:
    """x, ẋ, ẍ of an acceleration (…, T, n) that is linear between samples."""
    dt, first, last = drive.dt, a[..., :-1, :], a[..., 1:, :]
    gained = pad(0.5 * dt * (first + last), (0, 0, 1, 0)).cumsum(dim=-2)
    v = drive.v0.unsqueeze(-2) + gained
    moved = dt * v[..., :-1, :] + dt**2 * (first / 3.0 + last / 6.0)
    x = drive.x0.unsqueeze(-2) + pad(moved, (0, 0, 1, 0)).cumsum(dim=-2)
    return Response(x, v, a, integrated=True)
