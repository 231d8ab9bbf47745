"""Time integration of a model's equation of motion, batched and differentiable.

ẍ = g(x, ẋ, u), the classical Runge–Kutta method of fourth order, one step per sample.
T samples, n DOFs, m channels of excitation.   Hairer, Nørsett & Wanner (1993), Sect. II.1
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn.functional import pad

from data.record import Drive, Response

Acceleration = Callable[[Tensor, Tensor, Tensor], Tensor]  # (x, ẋ, u) (…, n), (…, n), (…, m) → ẍ
DelayedAcceleration = Callable[[Tensor, Tensor, Tensor, Tensor], tuple[Tensor, Tensor]]


def between(u: Tensor, hold: str, substeps: int) -> Tensor:
    """u (…, T, m) at the end of each of `substeps` parts of every interval, (…, T − 1, S, m).

    A zero-order hold ends with the value it began with. `band_limited` takes the values from the
    Fourier series of the record, which looks ahead.
    """
    first, last = u[..., :-1, None, :], u[..., 1:, None, :]
    if hold == "zero_order":
        return first.expand(*first.shape[:-2], substeps, -1)
    if hold == "linear":
        part = torch.arange(1, substeps + 1, dtype=u.dtype, device=u.device)[:, None] / substeps
        return first + part * (last - first)
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
    middle, end = (u.unbind(dim=-2) for u in halves.unbind(dim=-2))
    at_samples = drive.u.unbind(dim=-2)
    h, x, v = drive.dt, drive.x0, drive.v0
    a, now = law(x, v, at_samples[0], past)
    history = [(x, v, a)]
    for k in range(drive.samples - 1):  # a step begins after any jump of u at its sample
        delayed = 0.5 * (past + now)
        v2 = torch.add(v, a, alpha=0.5 * h)
        a2 = law(torch.add(x, v, alpha=0.5 * h), v2, middle[k], delayed)[0]
        v3 = torch.add(v, a2, alpha=0.5 * h)
        a3 = law(torch.add(x, v2, alpha=0.5 * h), v3, middle[k], delayed)[0]
        a4 = law(torch.add(x, v3, alpha=h), torch.add(v, a3, alpha=h), end[k], now)[0]
        halfway = a2 + a3
        x = torch.add(torch.add(x, v, alpha=h), a + halfway, alpha=h * h / 6.0)
        v = torch.add(v, torch.add(a + a4, halfway, alpha=2.0), alpha=h / 6.0)
        past = now
        a, now = law(x, v, at_samples[k + 1], past)
        history.append((x, v, a))
        if k % 100 == 99 and _all_lost(a):
            break
    x, v, a = (torch.stack(signal, dim=-2) for signal in zip(*history, strict=True))
    lost = drive.samples - len(history)
    return Response(*(pad(signal, (0, 0, 0, lost), value=torch.nan) for signal in (x, v, a)))


def _all_lost(a: Tensor) -> bool:
    """Whether no run of the batch is finite any more; False where derivatives are taken."""
    return torch.is_inference_mode_enabled() and not bool(torch.isfinite(a).all(dim=-1).any())


def integrated(a: Tensor, drive: Drive) -> Response:
    """x, ẋ, ẍ of an acceleration (…, T, n) that is linear between samples."""
    dt, first, last = drive.dt, a[..., :-1, :], a[..., 1:, :]
    gained = pad(0.5 * dt * (first + last), (0, 0, 1, 0)).cumsum(dim=-2)
    v = drive.v0.unsqueeze(-2) + gained
    moved = dt * v[..., :-1, :] + dt**2 * (first / 3.0 + last / 6.0)
    x = drive.x0.unsqueeze(-2) + pad(moved, (0, 0, 1, 0)).cumsum(dim=-2)
    return Response(x, v, a)
