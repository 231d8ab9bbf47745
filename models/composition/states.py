"""x and v of a motion: as measured, filtered, integrated or reconstructed, without their noise.

What is not measured comes from accelerations; what is measured is smoothed by what joins it to
these:

    x_{k+1} = x_k + Δt (v_k + v_{k+1}) / 2 + Δt² (a_k − a_{k+1}) / 12,   v_{k+1} = v_k + Δt ā_k

hold but for noise of a. Of all motions, the one is taken that is nearest to what was measured of
these and of x and v, each over its noise: the smoother of Smyth & Wu (2007), Mech. Syst. Signal
Process. 21, 706–723. How strong a noise is, sixth differences tell, in which a smooth signal leaves
next to nothing (Hall, Kay & Titterington 1990, Biometrika 77, 521–528). Without this, laws that
take deformations as they are see turning points and yielding that never were.
T samples, n DOFs or outputs, m channels of excitation, E elements.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from data.record import Record, singles
from models.composition.coefficients import ACCELERATION, DISPLACEMENT, VELOCITY
from models.layers.reconstructed import (
    corner_frequency,
    corner_of,
    filtered_states,
    high_passed,
    passed,
    reconstructed,
)

MEASURES = {"displacement": DISPLACEMENT, "velocity": VELOCITY, "acceleration": ACCELERATION}
BEYOND = 10.0  # times the corner of an acceleration's filter, for displacements and velocities
LOWER, ORDER = 4, 6  # of the differences
AS_MUCH = 1.25  # times what the sixth tell: fourth differences of white noise
ALIKE = 0.01  # of a signal: what is left of one without noise
HALFWAY = 0.6745  # standard deviations, beyond which half of the values of a normal law are
NOISY = 5e-3  # of a deformation: below, states are left as they are
FIRM = 1e-3  # of the noise of x and v: least slack of their steps, so that rounding does no harm
CONTRADICTS = (1.5, 3.0)  # times the noise of x and v, of which v may bend between samples
UNTOLD = 1e6  # times the noise of x over Δt: noise of a v that was not measured
LEAST = 1e-6  # of a signal's size: noise of one that has none


def states_of(
    record: Record, from_accelerations: bool
) -> Iterable[tuple[Tensor, Tensor, Tensor, Tensor]]:
    """x, v, a (T, n), u (T, m) as measured; filtered alike where x or v is missing.

    One after the other of a batch; those that were measured without the warm-up.
    from_accelerations: measured x and v are not used.
    """
    counted, order = slice(record.warmup, None), MEASURES[record.quantity]
    for one in singles([record]):
        a, u, known = one.a, one.excitation, order == ACCELERATION and not from_accelerations
        if known and one.x is not None and one.v is not None:
            yield one.x[counted], one.v[counted], a[counted], u[counted]
            continue
        corner = corner_frequency(a, one.dt)
        if order != ACCELERATION:
            corner *= BEYOND  # the filters' own share is then flat below it
        yield filtered_states(a, u, corner, one.dt, order)


def reconstructed_of(record: Record) -> tuple[Tensor, Tensor]:
    """x and v (…, T, n) from what was measured of a record's motion."""
    order, each = MEASURES[record.quantity], singles([record])
    found = [reconstructed(one.a, one.excitation, one.dt, order) for one in each]
    x, v = (torch.stack(parts).reshape(record.a.shape) for parts in zip(*found, strict=True))
    return x, v


def integrated_states(
    record: Record, forces: int
) -> Iterable[tuple[Tensor, Tensor, Tensor, Tensor]]:
    """x, v, a, u (T, ·) of every motion whose accelerations alone were measured.

    What is slower than the motion is left out of x and v, as of the supports' motions, which stand
    behind so many forces in u.
    """
    for one in singles([record]):
        drive = one.excitation.clone()
        corner = corner_of(one.a, drive, one.dt)
        x, v = passed(one.a, one.dt, corner)
        if drive.shape[1] > forces:
            s, s_dot = drive[:, forces:].chunk(2, dim=1)
            drive[:, forces:] = torch.cat(high_passed(s, s_dot, one.dt, corner), dim=1)
        yield x, v, one.a, drive


def noise_of_deformations(
    x: np.ndarray, v: np.ndarray, a: np.ndarray, dt: float, B: np.ndarray, y: np.ndarray
) -> float:
    """Noise of y (T, E) [m] over its size, that of the noisiest; B (E, n): y moves with B x.

    At most what v and a leave of x, which a motion of few samples a cycle does not look like.
    """
    if len(y) <= ORDER:
        return 0.0
    unexplained = (
        np.diff(x, axis=0) - 0.5 * dt * (v[1:] + v[:-1]) + dt**2 / 12.0 * np.diff(a, axis=0)
    )
    of_steps = np.sqrt(0.5 * ((unexplained @ B.T) ** 2).mean(axis=0))
    size = np.sqrt((y**2).mean(axis=0))
    shares = np.minimum(white_noise(y), of_steps) / np.where(size > 0.0, size, 1.0)
    return float(shares.max(initial=0.0))


def smooth(record: Record) -> Record:
    """The record with x and v smoothed; accelerations stay as they were measured.

    Where v was not measured, x and accelerations tell it.
    """
    assert record.x is not None
    rates = torch.full_like(record.a, torch.nan) if record.v is None else record.v
    motions = zip(*map(_motions, (record.x, rates, record.a)), strict=True)
    found = [_smooth(x, v, a, record.dt) for x, v, a in motions]
    x, v = (torch.from_numpy(np.stack(parts)) for parts in zip(*found, strict=True))
    return replace(record, x=x.reshape(record.a.shape), v=v.reshape(record.a.shape))


def are_of_one_motion(measured: Record, found: Record) -> bool:
    """Whether x and v that were smoothed are off by no more than noise, or by next to nothing.

    A sensor that lags, drifts or is wrongly scaled leaves more.
    """
    pairs = (measured.x, found.x), (measured.v, found.v)
    for (one, other), most in zip(pairs, CONTRADICTS, strict=True):
        if one is None or other is None:
            continue
        for signal, smooth in zip(_motions(one), _motions(other), strict=True):
            left, size = (np.sqrt((u**2).mean(axis=0)) for u in (signal - smooth, signal))
            if (left > np.maximum(most * _by_squares(signal, ORDER), ALIKE * size)).any():
                return False
    return True


def white_noise(signal: np.ndarray) -> np.ndarray:
    """Standard deviation (c,) of white noise in a signal (T, c); zero where it is no such noise.

    Of white noise, fourth differences tell as much as sixth ones; of a motion that has few samples
    a cycle they tell more.
    """
    lower, higher = (by_median(signal, order) for order in (LOWER, ORDER))
    return np.where(lower <= AS_MUCH * higher, np.minimum(higher, _by_squares(signal, ORDER)), 0.0)


def by_median(signal: np.ndarray, order: int) -> np.ndarray:
    """Standard deviation (c,) of white noise in a smooth signal (T, c), by differences.

    By their median: few kinks change it little.
    """
    median = np.median(np.abs(_differences(signal, order)), axis=0)
    return median / (HALFWAY * math.sqrt(math.comb(2 * order, order)))


def _by_squares(signal: np.ndarray, order: int) -> np.ndarray:
    square = (_differences(signal, order) ** 2).mean(axis=0)
    return np.sqrt(square / math.comb(2 * order, order))


def _differences(signal: np.ndarray, order: int) -> np.ndarray:
    return np.diff(signal, n=order, axis=0) if len(signal) > order else 0.0 * signal


def _weighed(signal: np.ndarray) -> np.ndarray:
    """Noise (c,) by which a signal (T, c) counts, white or not."""
    noise = np.minimum(by_median(signal, ORDER), _by_squares(signal, ORDER))
    return np.maximum(noise, LEAST * np.abs(signal).max(axis=0))


def _motions(signal: Tensor) -> np.ndarray:
    """A signal (…, T, n) as motions (B, T, n)."""
    return signal.detach().cpu().numpy().reshape(-1, *signal.shape[-2:])


def _smooth(
    x: np.ndarray, v: np.ndarray, a: np.ndarray, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """x and v (T, n) of a motion; NaN: v was not measured."""
    noise = zip(*map(_weighed, (x, v, a)), strict=True)
    found = [_smooth_channel(x[:, i], v[:, i], a[:, i], dt, *own) for i, own in enumerate(noise)]
    xs, vs = zip(*found, strict=True)
    return np.stack(xs, axis=1), np.stack(vs, axis=1)


def _smooth_channel(
    x: np.ndarray, v: np.ndarray, a: np.ndarray, dt: float, of_x: float, of_v: float, of_a: float
) -> tuple[np.ndarray, np.ndarray]:
    """x and v (T,) by normal equations of z = (x₀, v₀, x₁, v₁, …), which have four diagonals."""
    from scipy.linalg import solveh_banded  # slow to import

    if math.isnan(of_v):
        v, of_v = np.zeros_like(x), UNTOLD * of_x / dt
    if min(of_x, of_v) == 0.0:  # a channel that is zero throughout
        return x, v
    n = 2 * len(x)
    diagonals, side = np.zeros((4, n)), np.zeros(n)
    diagonals[0] = np.tile([of_x**-2, of_v**-2], len(x))
    side[0::2], side[1::2] = x / of_x**2, v / of_v**2
    slack_v = max(dt * of_a / math.sqrt(2.0), FIRM * min(of_v, of_x / dt))
    slack_x = max(dt**2 * of_a / math.sqrt(72.0), FIRM * of_x)
    before, after = a[:-1], a[1:]
    steps = (  # factors of x_k, v_k, x_{k+1} and v_{k+1}, what they make, and its slack
        ((0.0, -1.0, 0.0, 1.0), 0.5 * dt * (before + after), slack_v),
        ((-1.0, -0.5 * dt, 1.0, -0.5 * dt), dt**2 / 12.0 * (before - after), slack_x),
    )
    for factors, made, slack in steps:
        for i, one in enumerate(factors):
            side[i : n - 2 + i : 2] += one * made / slack**2
            for j, other in enumerate(factors[: i + 1]):
                diagonals[i - j, j : n - 2 + j : 2] += one * other / slack**2
    z = solveh_banded(diagonals, side, lower=True)
    return z[0::2], z[1::2]
