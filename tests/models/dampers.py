"""Controlled dampers under imposed motions, by laws that no model here has.

Spencer et al. (1997), Phenomenological model for magnetorheological dampers: a Bouc–Wen element
(z), a dashpot c₀ and a spring in parallel, in series with a dashpot c₁; α, c₀ and c₁ are linear in
the voltage that reaches the coil, w, a lag behind the voltage that is applied.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

Test = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # s, ṡ, other inputs, force


def imposed_motion(
    rng: np.random.Generator, samples: int, dt: float, size: float, top: float
) -> tuple[np.ndarray, np.ndarray]:
    """A random motion of that RMS [m] between 0.1 and `top` Hz, and its rate."""
    frequency = np.fft.rfftfreq(samples, dt)
    phases = np.exp(2j * np.pi * rng.random(len(frequency)))
    spectrum = ((frequency > 0.1) & (frequency < top)) * phases
    s = np.fft.irfft(spectrum, samples)
    rate = np.fft.irfft(2j * np.pi * frequency * spectrum, samples)
    return size / s.std() * s, size / s.std() * rate


def voltage(
    rng: np.random.Generator, samples: int, dt: float, top: float, fastest: float = 4.0
) -> np.ndarray:
    """A random voltage between 0 and `top`; half of them in steps."""
    if rng.random() < 0.5:
        length = round(0.4 / dt)
        levels = top * rng.random(samples // length + 1)
        return np.repeat(levels, length)[:samples]
    smooth, _ = imposed_motion(rng, samples, dt, 0.35, fastest)
    return np.clip(top * (0.5 + smooth), 0.0, top)


def magnetorheological(
    records: int,
    samples: int,
    dt: float,
    noise: float,
    factors: Sequence[float] | None = None,
    substeps: int = 20,
    seed: int = 0,
) -> Iterator[Test]:
    """Tests of a damper of 3 kN, with its published parameters (Spencer et al. 1997).

    factors: of the voltage of each record, which is 2.25 V at most.
    """
    rng = np.random.default_rng(seed)
    motions = [imposed_motion(rng, samples, dt, 0.006, 3.0) for _ in range(records)]
    s, rate = (np.stack(u, axis=1) for u in zip(*motions, strict=True))  # (T, records)
    volts = np.stack([voltage(rng, samples, dt, 2.25) for _ in range(records)], axis=1)
    volts *= np.ones(records) if factors is None else np.array(factors)
    force = _force(s, rate, volts, dt, substeps)
    for i in range(records):
        measured = force[:, i] + noise * force[:, i].std() * rng.standard_normal(samples)
        yield s[:, i], rate[:, i], volts[:, i : i + 1], measured


def _force(
    s: np.ndarray, rate: np.ndarray, volts: np.ndarray, dt: float, substeps: int
) -> np.ndarray:
    """Forces (T, records) [N] by the classical Runge–Kutta scheme, signals linear in between."""

    def law(at: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        (x, v, applied), (y, z, w) = at, state
        alpha, c0, c1 = 14000.0 + 69500.0 * w, 2100.0 + 350.0 * w, 28300.0 + 295.0 * w
        inner = (alpha * z + c0 * v + 4690.0 * (x - y)) / (c0 + c1)
        slip = v - inner
        memory = 301.0 * slip - 3.63e6 * (np.abs(slip) * np.abs(z) * z + slip * z * z)
        force = c1 * inner + 500.0 * (x - 0.143)
        return np.stack([inner, memory, 190.0 * (applied - w)]), force

    signals = np.stack([s, rate, volts], axis=1)  # (T, 3, records)
    state, h = np.stack([s[0], 0.0 * s[0], volts[0]]), dt / substeps
    forces = [law(signals[0], state)[1]]
    for before, after in pairwise(signals):
        for part in range(substeps):
            ends = [before + (part + share) / substeps * (after - before) for share in (0, 0.5, 1)]
            k1 = law(ends[0], state)[0]
            k2 = law(ends[1], state + 0.5 * h * k1)[0]
            k3 = law(ends[1], state + 0.5 * h * k2)[0]
            k4 = law(ends[2], state + h * k3)[0]
            state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        forces.append(law(after, state)[1])
    return np.stack(forces)
