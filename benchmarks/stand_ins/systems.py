"""Simulated systems that the stand-ins are made of: equations of their own, and no model's code.

A classical Runge–Kutta method of fourth order with many steps a sample; the excitation is known
between samples, for it is a sum of sines, or held.   J modes, T samples, R steps a sample.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data.numba_cache import compilers

compiled, inlined = compilers(Path(__file__))

STEPS = 12  # a sample


@dataclass(frozen=True)
class Structure:
    """Modes with one joint between two of their places: masses of one, real shapes.

    joint: its shape (J,), linear and cubic stiffness, that of its hysteretic part, its limit and
    the exponent n; circuits have a quadratic stiffness in place of a hysteretic part.
    """

    hertz: np.ndarray  # (J,)
    ratios: np.ndarray  # (J,) of critical damping
    force: np.ndarray  # (J,)
    sensors: np.ndarray  # (o, J)
    joint: np.ndarray  # (J,)
    cubic: float = 0.0
    quadratic: float = 0.0
    hysteretic: float = 0.0
    limit: float = 1.0
    exponent: float = 1.0
    gap: float = 0.0  # of a spring, on one side
    stop: float = 0.0  # its stiffness


@inlined
def _slopes(state, u, k, c, force, joint, law, slopes):
    J = k.size
    y, rate, z = 0.0, 0.0, state[2 * J]
    for j in range(J):
        y += joint[j] * state[j]
        rate += joint[j] * state[J + j]
    cubic, quadratic, hysteretic, limit, n, gap, stop = law
    r = cubic * y * y * y + quadratic * y * y + hysteretic * z
    if y > gap:
        r += stop * (y - gap)
    for j in range(J):
        slopes[j] = state[J + j]
        slopes[J + j] = -k[j] * state[j] - c[j] * state[J + j] + force[j] * u - joint[j] * r
    away = abs(z / limit) ** n
    slopes[2 * J] = rate - 0.5 * away * (abs(rate) * np.sign(z) + rate)


@compiled
def _simulated(u, steps, dt, k, c, force, joint, law, out, rates):
    """u (T · steps · 2 + 1,) at the steps and their middles; out (T, J) and rates of q̇ (T, J)."""
    J, h = k.size, dt / steps
    state, try_ = np.zeros(2 * J + 1), np.zeros(2 * J + 1)
    s1, s2, s3, s4 = np.zeros((4, 2 * J + 1))
    for t in range(out.shape[0]):
        _slopes(state, u[2 * t * steps], k, c, force, joint, law, s1)
        out[t], rates[t] = state[:J], s1[J : 2 * J]
        for s in range(steps):
            at = 2 * (t * steps + s)
            _slopes(state, u[at], k, c, force, joint, law, s1)
            try_[:] = state + 0.5 * h * s1
            _slopes(try_, u[at + 1], k, c, force, joint, law, s2)
            try_[:] = state + 0.5 * h * s2
            _slopes(try_, u[at + 1], k, c, force, joint, law, s3)
            try_[:] = state + h * s3
            _slopes(try_, u[at + 2], k, c, force, joint, law, s4)
            state += h / 6.0 * (s1 + 2.0 * s2 + 2.0 * s3 + s4)


def respond(system: Structure, fine: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Modal displacements, accelerations (T, J) from rest; fine: u at half steps, 2 STEPS each."""
    T, J = (len(fine) - 1) // (2 * STEPS), len(system.hertz)
    k = (2.0 * np.pi * system.hertz) ** 2
    c = 2.0 * system.ratios * np.sqrt(k)
    law = (
        system.cubic, system.quadratic, system.hysteretic, system.limit, system.exponent,
        system.gap, system.stop,
    )  # fmt: skip
    out, rates = np.empty((T, J)), np.empty((T, J))
    _simulated(fine, STEPS, dt, k, c, system.force, system.joint, law, out, rates)
    return out, rates


def multisine(
    samples: int,
    dt: float,
    band: tuple[float, float],
    rng: np.random.Generator,
    odd: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Random-phase multisine of RMS 1: one period (T,), and at half steps (2 STEPS T + 1,)."""
    lines = np.arange(1, samples // 2)
    f = lines / (samples * dt)
    inside = (f >= band[0]) & (f <= band[1]) & ((lines % 2 == 1) | (not odd))
    spectrum = np.zeros(samples // 2 + 1, dtype=complex)
    spectrum[1:-1][inside] = np.exp(2j * np.pi * rng.random(inside.sum()))
    fine = _at_half_steps(spectrum, samples)
    fine /= np.sqrt(np.mean(fine**2))
    return fine[:: 2 * STEPS], np.r_[fine, fine[0]]


def band_limited(u: np.ndarray) -> np.ndarray:
    """u (T,) between its samples, as a Fourier series: (2 STEPS T + 1,)."""
    fine = _at_half_steps(np.fft.rfft(u) / len(u), len(u)) * 1.0
    return np.r_[fine, fine[0]]


def _at_half_steps(spectrum: np.ndarray, samples: int) -> np.ndarray:
    wide = np.zeros(samples * STEPS + 1, dtype=complex)
    wide[: len(spectrum)] = spectrum
    return np.fft.irfft(wide, n=2 * STEPS * samples) * 2 * STEPS * samples
