"""Imposed motions: random ones and the response of an oscillator to a filtered, enveloped noise.

Deformations are sums of harmonics, so that y and ẏ are known between samples too: laws are followed
at FINE steps of a sample.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from data.record import Record

DT, SAMPLES, FINE = 0.01, 3000, 8
TRAINED = (1.0, 0.8, 0.6, 0.9, 0.5, 0.7)  # of the largest deformation
UNSEEN = (0.95, 0.75, 0.85, 0.6)


def motion(rng: np.random.Generator, earthquake: bool) -> tuple[np.ndarray, np.ndarray]:
    """y and ẏ (N,) of unit size at fine steps, at rest in the beginning."""
    dt, count = DT / FINE, SAMPLES * FINE
    frequencies = np.fft.rfftfreq(2 * count, dt)
    if earthquake:
        ratio = frequencies / rng.uniform(0.6, 1.2)  # of an oscillator with 8 % damping
        ground = frequencies / rng.uniform(1.5, 3.0)
        shape = 1.0 / ((1.0 - ratio**2) ** 2 + (0.16 * ratio) ** 2)
        shape = shape * (1.0 + ground**2) / ((1.0 - ground**2) ** 2 + 1.44 * ground**2)
    else:
        low, high = rng.uniform(0.15, 0.4), rng.uniform(1.2, 2.0)
        shape = np.where((frequencies > low) & (frequencies < high), 1.0, 0.0)
    shape = np.where((frequencies > 0.1) & (frequencies < 5.0), np.sqrt(shape), 0.0)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(frequencies))
    wave = np.fft.irfft(shape * np.exp(1j * phases))[:count]
    t = dt * np.arange(count)
    rise = np.minimum(t / 3.0, 1.0) ** 2
    if earthquake:
        rise = rise * np.exp(-0.08 * np.maximum(t - 10.0, 0.0))
    y = wave * rise
    y = y / np.abs(y).max()
    return y, np.gradient(y, dt)


def record(
    law: Callable[[np.ndarray, np.ndarray], np.ndarray],
    size: float,
    seed: int,
    noise: float = 0.0,
) -> Record:
    """An element test of `law`; even seeds are random motions, odd ones earthquakes.

    noise: standard deviation of that of the force, as a share of the force's.
    """
    rng = np.random.default_rng(seed)
    y, rate = motion(rng, seed % 2 == 1)
    y, rate = size * y, size * rate
    r = law(y, rate)[::FINE]
    r = r + noise * r.std() * rng.standard_normal(len(r))
    s, s_dot, force = (torch.from_numpy(u.copy())[:, None] for u in (y[::FINE], rate[::FINE], r))
    return Record(DT, force, force.new_zeros(len(r), 0), s=s, s_dot=s_dot, quantity="force")


def training(
    law: Callable[[np.ndarray, np.ndarray], np.ndarray], size: float, noise: float = 0.0
) -> list[Record]:
    return [record(law, size * share, 100 + i, noise) for i, share in enumerate(TRAINED)]


def unseen(
    law: Callable[[np.ndarray, np.ndarray], np.ndarray], size: float, times: float = 1.0
) -> list[Record]:
    return [record(law, times * size * share, 200 + i) for i, share in enumerate(UNSEEN)]
