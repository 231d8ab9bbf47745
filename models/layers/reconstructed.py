"""Displacement and velocity of a motion from what was measured of it, off line: for training alone.

A(f)/(iω)ⁿ, high-passed, or iω X(f), low-passed, without phase: x and v at a sample depend on what
follows it, so no estimate may see them. They are where a run in training begins again.
T samples, n outputs, m channels of excitation.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

SHARES = (0.5, 0.25, 0.12, 0.06, 0.03, 0.015)  # of the median frequency: corners that are tried
ALIKE = 3.0  # times the least share of a that is untold
QUIET = 0.5  # of the frequencies, the upper part: what is there is taken for noise
CHANCE = 2.0  # times the noise: where there is no signal, the average rarely exceeds it
ALONG = 100  # parts of a spectrum over which each is averaged


def reconstructed(y: Tensor, u: Tensor, dt: float, order: int = 2) -> tuple[Tensor, Tensor]:
    """x and v of a motion of which y (T, n) was measured, under an excitation u (T, m).

    order: of y as a derivative of x: 0 for displacements, 1 for velocities, 2 for accelerations.
    """
    if order == 0:
        return differentiated(y, dt)
    if order == 1:
        v, a = differentiated(y, dt)
        return integrated(a, u, dt)[0], v
    return integrated(y, u, dt)


def integrated(a: Tensor, u: Tensor, dt: float) -> tuple[Tensor, Tensor]:
    """x and v of a motion a (T, n) under an excitation u (T, m), high-passed at `corner_of`."""
    return passed(a, dt, corner_of(a, u, dt))


def corner_of(a: Tensor, u: Tensor, dt: float) -> float:
    """The corner [rad/s] from which a motion a (T, n) under an excitation u (T, m) is integrated.

    Above the right one too much of the motion is lost, below it the noise of the sensors is
    integrated into a drift, and x, v and u tell less of a: the lowest is taken that leaves little
    more than the best untold.
    """
    median = median_line(a) / (dt * len(a))
    corners = [2.0 * torch.pi * share * median for share in SHARES]
    untold = [_untold(a, torch.cat([*passed(a, dt, corner), u], dim=1)) for corner in corners]
    good = [c for c, left in zip(corners, untold, strict=True) if left <= ALIKE * min(untold)]
    return good[-1]


def differentiated(x: Tensor, dt: float) -> tuple[Tensor, Tensor]:
    """A signal x (T, n) without the noise of its sensors, and its rate.

    Each frequency keeps the share of its power that noise, white as at the highest, does not have
    (Wiener 1949). The signal goes on beyond both ends mirrored at them.
    """
    T = len(x)
    slope = (x[-1:] - x[:1]) / (T - 1)
    line = x[:1] + slope * torch.arange(T).to(x)[:, None]
    y = x - line
    Y = torch.fft.rfft(torch.cat([y, -y[1:-1].flip(0)]), dim=0)
    power, width = Y.abs().square(), 2 * (T // ALONG // 2) + 1
    noise = power[round(QUIET * T) :].median(dim=0).values / math.log(2.0)
    near = torch.nn.functional.avg_pool1d(
        power.T[:, None], width, 1, width // 2, count_include_pad=False
    )[:, 0].T
    Y = Y * (1.0 - CHANCE * noise / near.clamp_min(1e-300)).clamp_min(0.0)
    omega = 2.0 * torch.pi * torch.fft.rfftfreq(2 * T - 2, dt).to(x)[:, None]
    smooth, rate = (torch.fft.irfft(s, 2 * T - 2, dim=0)[:T] for s in (Y, 1j * omega * Y))
    return line + smooth, rate + slope / dt


def passed(a: Tensor, dt: float, corner: float) -> tuple[Tensor, Tensor]:
    """x and v (T, n) of accelerations a, high-passed at a corner [rad/s].

    Both ends go on mirrored, with the other sign: so v comes back and x stays near.
    """
    T, a = len(a), a - a.mean(dim=0)
    A = torch.fft.rfft(torch.cat([-a.flip(0), a, -a.flip(0)]), dim=0)
    omega, share = _share(3 * T, dt, corner, a)
    low = omega.clamp_min(omega[1])  # there the share is nil
    x, v = (torch.fft.irfft(share * s, 3 * T, dim=0) for s in (-A / low**2, -1j * A / low))
    return x[T : 2 * T], v[T : 2 * T]


def high_passed(s: Tensor, s_dot: Tensor, dt: float, corner: float) -> tuple[Tensor, Tensor]:
    """s and ṡ (T, p) of supports as `passed` has those of a motion that was integrated."""
    T, before, after = len(s), 2.0 * s[:1] - s.flip(0), 2.0 * s[-1:] - s.flip(0)
    onwards = torch.cat([before, s, after]), torch.cat([s_dot.flip(0), s_dot, s_dot.flip(0)])
    _, share = _share(3 * T, dt, corner, s)
    found = (torch.fft.irfft(share * torch.fft.rfft(u, dim=0), 3 * T, dim=0) for u in onwards)
    x, v = (u[T : 2 * T] for u in found)
    return x, v


def _share(T: int, dt: float, corner: float, like: Tensor) -> tuple[Tensor, Tensor]:
    """Frequencies (K, 1) [rad/s] of T samples, and the share of each that passes a corner."""
    omega = torch.fft.rfftfreq(T, dt, dtype=like.dtype, device=like.device)[:, None]
    omega = 2.0 * torch.pi * omega
    return omega, (omega**2 / (omega**2 + corner**2)) ** 2


def _untold(target: Tensor, rows: Tensor) -> float:
    """Share of the power of the target (T, n) that no linear combination of rows (T, k) tells."""
    scaled = rows / rows.square().sum(dim=0).sqrt().clamp_min(1e-300)
    fit = torch.linalg.lstsq(scaled, target, driver="gelsd").solution
    return float((target - scaled @ fit).square().sum() / target.square().sum().clamp_min(1e-300))


# State-variable filters: a motion's displacement and velocity, filtered, from its acceleration.
#
# All terms of a linear equation of motion may be filtered alike. With F = s²/(s + ω₀)² the filtered
# displacement is a/(s + ω₀)², which needs no integration that drifts.   Young (1981), Automatica 17
# T samples, C channels.

SHARE = 0.3  # of the median frequency of the motion


def median_line(a: Tensor) -> int:
    """The line of the spectrum of a motion, or of a batch (…, T, C), up to which half its power is.

    It is the first above zero at least: a share of it is a frequency.
    """
    power = torch.fft.rfft(a, dim=-2).abs().square().sum(dim=-1)
    power = power.reshape(-1, power.shape[-1]).sum(dim=0).cumsum(dim=0)
    return max(1, int(torch.searchsorted(power, 0.5 * power[-1:])))


def corner_frequency(a: Tensor, dt: float) -> float:
    """Corner ω₀ [rad/s]: a share of the median frequency of the power of a (T, C)."""
    return SHARE * 2.0 * np.pi * median_line(a) / (dt * a.shape[0])


def filtered_states(
    y: Tensor, u: Tensor, corner: float, dt: float, order: int
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """x, v, a (T, n) and u (T, m), filtered alike at a corner [rad/s], from what was measured.

    order: of y (T, n) as a derivative of x: 0 for displacements, 1 for velocities, 2 for
    accelerations.
    """
    size = corner ** (2 - order)
    x, v, a = (size * s for s in state_variables(y, corner, dt))
    return x, v, a, size * state_variables(u, corner, dt)[order]


def state_variables(a: Tensor, corner: float, dt: float) -> tuple[Tensor, Tensor, Tensor]:
    """Filtered displacement, velocity and acceleration (T, C) of a motion that begins at rest.

    The filters are those of the trapezoidal rule.
    """
    from scipy.signal import lfilter  # slow to import

    rise, decay = [dt, dt], [2.0 + corner * dt, corner * dt - 2.0]
    signal = a.cpu().numpy()
    once = lfilter(rise, decay, signal, axis=0)
    twice = lfilter(rise, decay, once, axis=0)
    filtered = (twice, once - corner * twice, signal - 2.0 * corner * once + corner**2 * twice)
    x, v, rest = (torch.from_numpy(np.ascontiguousarray(s)).to(a.device) for s in filtered)
    return x, v, rest
