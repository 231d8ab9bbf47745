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


def held(drive: Drive) -> tuple[Tensor, Tensor, Tensor]:
    """u at the beginning, the middle and the end of every interval, each (…, T − 1, m).

    `band_limited` takes the middle from the Fourier series of the record, which looks ahead.
    """
    first, last = drive.u[..., :-1, :], drive.u[..., 1:, :]
    if drive.hold == "zero_order":
        return first, first, first
    if drive.hold == "linear":
        return first, 0.5 * (first + last), last
    return first, _doubled(drive.u)[..., 1:-1:2, :], last


def _doubled(u: Tensor) -> Tensor:
    """u (…, T, m) at twice the rate (…, 2T, m), by zeros above its spectrum."""
    samples = u.shape[-2]
    spectrum = torch.fft.rfft(u, dim=-2)
    if samples % 2 == 0:  # the Nyquist line is split between both its sides
        spectrum = torch.cat([spectrum[..., :-1, :], 0.5 * spectrum[..., -1:, :]], dim=-2)
    wider = pad(spectrum, (0, 0, 0, samples + 1 - spectrum.shape[-2]))
    return 2.0 * torch.fft.irfft(wider, n=2 * samples, dim=-2)


def runge_kutta(acceleration: Acceleration, drive: Drive) -> Response:
    """x, ẋ, ẍ (…, T, n) from the initial state."""

    def without_past(x: Tensor, v: Tensor, u: Tensor, past: Tensor) -> tuple[Tensor, Tensor]:
        return acceleration(x, v, u), past

    return runge_kutta_delayed(without_past, drive, drive.x0)


def runge_kutta_delayed(law: DelayedAcceleration, drive: Drive, past: Tensor) -> Response:
    """The same for ẍ = g(x, ẋ, u, p), p a signal of the sample before, which `law` returns too.

    Between samples p is linear; `past` is its value before the record.
    """
    _, middle, end = (u.unbind(dim=-2) for u in held(drive))
    at_samples = drive.u.unbind(dim=-2)
    h, x, v = drive.dt, drive.x0, drive.v0
    a, now = law(x, v, at_samples[0], past)
    history = [(x, v, a)]
    for k in range(drive.samples - 1):  # a step begins after any jump of u at its sample
        between = 0.5 * (past + now)
        v2 = v + 0.5 * h * a
        a2 = law(x + 0.5 * h * v, v2, middle[k], between)[0]
        v3 = v + 0.5 * h * a2
        a3 = law(x + 0.5 * h * v2, v3, middle[k], between)[0]
        v4 = v + h * a3
        a4 = law(x + h * v3, v4, end[k], now)[0]
        x = x + h / 6.0 * (v + 2.0 * (v2 + v3) + v4)
        v = v + h / 6.0 * (a + 2.0 * (a2 + a3) + a4)
        past = now
        a, now = law(x, v, at_samples[k + 1], past)
        history.append((x, v, a))
    return Response(*(torch.stack(signal, dim=-2) for signal in zip(*history, strict=True)))
