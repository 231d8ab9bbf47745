"""Stand-ins as files, each where and as the real benchmark has them (data/public/splits.py).

Every function makes the files of one benchmark from a seed and returns the RMS of the noise in its
outputs, in their unit, which is the best that a model can do.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.io import savemat
from scipy.signal import butter, sosfiltfilt

from benchmarks.stand_ins.systems import (
    Structure,
    band_limited,
    multisine,
    respond,
)
from data.public.splits import F16, SILVERBOX


def _save(folder: Path, path: str, variables: dict[str, np.ndarray]) -> None:
    place = folder / path
    place.parent.mkdir(parents=True, exist_ok=True)
    savemat(place, variables, do_compression=True)


def circuit(folder: Path, seed: int = 0, noise: float = 2e-4, **law: float) -> np.ndarray:
    """A Duffing circuit as `silverbox`: one mode at 68 Hz, offsets, an arrow, ten multisines [V].

    The arrow grows until the circuit moves half as far again as under the multisines.
    """
    rng, dt = np.random.default_rng(seed), 1.0 / 610.35
    w = 2.0 * np.pi * 68.0
    stiff = {"cubic": 2.6 * w * w, "quadratic": -0.5 * w * w} | {
        k: v * w * w for k, v in law.items()
    }
    one = np.ones(1)
    system = Structure(
        np.array([68.0]), np.array([0.045]), 0.65 * w * w * one, one[None], one, **stiff
    )
    parts = [np.zeros(110)]
    sos = butter(4, 200.0, fs=1.0 / dt, output="sos")
    arrow = sosfiltfilt(sos, rng.standard_normal(40500 - 110))
    parts.append(arrow / arrow.std() * 0.055 * np.linspace(0.0, 1.1, len(arrow)))
    parts.append(np.zeros(100))
    for _ in range(10):
        parts += [np.zeros(40), multisine(8192, dt, (0.05, 200.0), rng, odd=True)[0] * 0.0225]
    u = np.concatenate(parts)[:127500]
    u = np.r_[u, np.zeros(127500 - len(u))]
    q, _ = respond(system, band_limited(u) + 1e-3, dt)
    y = q[:, 0] + 3e-3 + noise * rng.standard_normal(len(q))
    _save(folder, SILVERBOX, {"V1": u[None], "V2": y[None]})
    return np.array([noise])


def aircraft(
    folder: Path,
    seed: int = 0,
    modes: int = 14,
    outputs: int = 3,
    samples: int = 8192,
    periods: int = 3,
    noise: float = 0.01,
    exponent: float = 1.0,
    gap: float = 0.0,
) -> np.ndarray:
    """A structure with a hysteretic joint as `f16`: force [N] to accelerations [m/s²], 7 levels.

    noise: share of the RMS of each output at the fourth level, alike at all levels. gap: in units
    of the joint's limit, of a spring that is added on one side; 0: none.
    """
    rng, dt = np.random.default_rng(seed), 1.0 / 400.0
    hertz = np.sort(np.linspace(3.0, 14.5, modes) + rng.uniform(-0.25, 0.25, modes))
    joint = rng.standard_normal(modes) / np.sqrt(modes)
    limit = 1e-4
    stiffness = (2.0 * np.pi * 7.0) ** 2
    system = Structure(
        hertz, rng.uniform(0.008, 0.025, modes), 5e-4 * rng.standard_normal(modes),
        rng.standard_normal((outputs, modes)), joint, cubic=0.1 * stiffness / limit**2 / 16.0,
        hysteretic=0.4 * stiffness, limit=limit, exponent=exponent,
        gap=gap * limit if gap else 1.0, stop=0.3 * stiffness if gap else 0.0,
    )  # fmt: skip
    levels = np.array([12.2, 24.6, 36.8, 49.0, 61.4, 73.6, 97.8])  # N, RMS
    clean: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for path in F16:
        level = levels[int(path.rpartition("Level")[2][0]) - 1]
        if "FullMSine" in path:
            u, fine = multisine(samples, dt, (2.0, 15.0), np.random.default_rng([seed, int(level)]))
            u, fine = np.tile(u, periods), np.r_[np.tile(fine[:-1], periods), fine[0]]
        else:
            t = np.arange(samples) * dt
            u = np.sqrt(2.0) * np.sin(2.0 * np.pi * (2.0 * t + 6.5 * t * t / (samples * dt)))
            fine = band_limited(u)
        _, accelerations = respond(system, level * fine, dt)
        clean[path] = level * u, accelerations @ system.sensors.T
    middle = next(y for path, (_, y) in clean.items() if "FullMSine_Level4" in path)
    std = noise * middle.std(axis=0)
    for path, (u, y) in clean.items():
        y = y + std * rng.standard_normal(y.shape)
        both = {
            "Force": u[None] + 1e-3 * u.std() * rng.standard_normal(len(u)),
            "Voltage": u[None] / 60.0,
        }
        _save(folder, path, {**both, "Acceleration": y.T, "Fs": np.array([[400.0]])})
    return std


STAND_INS: dict[str, Callable[..., np.ndarray]] = {
    "silverbox": circuit,
    "f16": aircraft,
}
