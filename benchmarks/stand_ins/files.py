"""Stand-ins as files, each where and as the real benchmark has them (data/public/splits.py).

Every function makes the files of one benchmark from a seed and returns the RMS of the noise in its
outputs, in their unit, which is the best that a model can do.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat
from scipy.signal import butter, cheby1, cheby2, ellip, sosfilt, sosfiltfilt
from scipy.special import wrightomega

from benchmarks.stand_ins.drives import Coupled, Positioner, counted, moves, positioned
from benchmarks.stand_ins.systems import (
    STEPS,
    Structure,
    Tanks,
    band_limited,
    filled,
    multisine,
    respond,
)
from data.public.splits import CED, EMPS, F16, SILVERBOX, TANKS, WIENER_HAMMERSTEIN


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


FILTERS: dict[
    str, Callable[[int, float], np.ndarray]
] = {  # by kind and order at the rate `fs`; kHz of the benchmark's sampling rate
    "chebyshev": lambda n, fs: cheby1(n, 0.5, 4.4e3, fs=fs, output="sos"),
    "inverse": lambda n, fs: cheby2(n, 40.0, 5.0e3, fs=fs, output="sos"),
    "butterworth": lambda n, fs: butter(n, 3.0e3, fs=fs, output="sos"),
    "elliptic": lambda n, fs: ellip(n, 1.0, 30.0, 3.6e3, fs=fs, output="sos"),
    "high_pass": lambda n, fs: butter(n, 4.0e2, "highpass", fs=fs, output="sos"),
    "resonant": lambda n, fs: np.tile(_resonance(2.2e3, 0.1, fs), (n // 2, 1)),
}
CURVES: dict[str, Callable[[np.ndarray], np.ndarray]] = {  # of a signal of RMS 0.4 V or so
    "diode": lambda x: x + 0.05 - 0.09 * wrightomega(np.log(0.05 / 0.09) + (x + 0.05) / 0.09),
    "saturation": lambda x: 0.3 * np.tanh(x / 0.3),
    "dead_zone": lambda x: x - 0.15 * np.tanh(x / 0.1),
    "parabola": lambda x: 0.6 * x + 0.5 * x * x,
}


def _resonance(hertz: float, ratio: float, fs: float) -> np.ndarray:
    """A pair of poles with a gain of 1 at rest, as a second-order section (1, 6)."""
    poles = np.exp(2.0 * np.pi * hertz / fs * (-ratio + 1j * np.sqrt(1.0 - ratio**2)))
    a = np.array([1.0, -2.0 * poles.real, abs(poles) ** 2])
    return np.r_[a.sum(), 0.0, 0.0, a][None]


def chain(
    folder: Path,
    seed: int = 0,
    before: tuple[str, int] = ("chebyshev", 3),
    curve: str = "diode",
    after: tuple[str, int] = ("inverse", 3),
    noise: float = 2e-4,
) -> np.ndarray:
    """Filter, static curve, filter as `wiener_hammerstein` [V]: filtered noise from rest to rest.

    Analogue filters: they work at 24 times the sampling rate, as does the curve.
    """
    rng, rate, samples = np.random.default_rng(seed), 51200.0, 188000
    fs = 2 * STEPS * rate
    u = np.zeros(samples)
    sos = butter(6, 1e4, fs=rate, output="sos")
    u[5000:-3000] = sosfiltfilt(sos, rng.standard_normal(samples))[5000:-3000]
    u *= 0.6 / u[5000:-3000].std()
    x = sosfilt(FILTERS[before[0]](before[1], fs), band_limited(u)[:-1])
    w = CURVES[curve](x)
    rest = CURVES[curve](np.zeros(1))[0]
    y = sosfilt(FILTERS[after[0]](after[1], fs), w - rest)[:: 2 * STEPS]
    y = y + 0.01 + noise * rng.standard_normal(samples)
    signals = {"uBenchMark": u[:, None], "yBenchMark": y[:, None], "fs": np.array([[rate]])}
    _save(folder, WIENER_HAMMERSTEIN, signals)
    return np.array([noise])


def tanks(folder: Path, seed: int = 0, noise: float = 0.02, **law: Any) -> np.ndarray:
    """Two tanks as `cascaded_tanks`: pump [V] to level [V], 4 s a sample, both run over at times.

    Both records begin at the same levels, which nobody knows.
    """
    rng, dt, samples = np.random.default_rng(seed), 4.0, 1024
    system = Tanks(**law)
    signals = {"Ts": np.array([[dt]])}
    for name in ("Est", "Val"):
        u = multisine(samples, dt, (0.0, 0.0144), rng)[0]
        u = 3.3 + 1.1 * u / u.std()
        y = filled(system, u, dt)
        signals |= {f"u{name}": u[:, None], f"y{name}": y[:, None]}
        signals[f"y{name}"] = y[:, None] + noise * rng.standard_normal((samples, 1))
    _save(folder, TANKS, signals)
    return np.array([noise])


def positioner(folder: Path, seed: int = 0, noise: float = 1e-4, **law: Any) -> np.ndarray:
    """A mass with friction under a controller as `emps`: voltage [V] to position [m], 24.8 s.

    Both records follow the same wanted motion; in the test the voltage has pulses besides. The
    controller reads the position without the noise.
    """
    rng, dt, samples = np.random.default_rng(seed), 1e-3, 24841
    wanted, pushes = moves(samples, dt, rng), np.zeros(samples)
    for number, path in enumerate(EMPS):
        for _ in range(12 * number):
            start = rng.integers(500, samples - 500)
            push = rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 0.8)
            pushes[start : start + rng.integers(20, 80)] += push
        u, q = positioned(Positioner(**law), wanted, pushes, dt)
        measured = q + noise * rng.standard_normal(samples)
        signals = {"vir": u, "qm": measured, "qg": wanted, "t": dt * np.arange(samples)}
        _save(folder, path, {name: signal[:, None] for name, signal in signals.items()})
    return np.array([noise])


def drives(folder: Path, seed: int = 0, noise: float = 0.02, **law: Any) -> np.ndarray:
    """Two coupled drives as `ced`: voltage [V] to speed without direction [ticks/s], 50 Hz.

    The voltage is held for a tenth of a second each; about no mean, so that nothing linear follows.
    """
    rng, dt = np.random.default_rng(seed), 0.02
    signals: dict[str, np.ndarray] = {}
    for number, level in (("11", 1.0), ("12", 2.0)):
        u = np.repeat(rng.uniform(-level, level, 110), 5)
        y = counted(Coupled(**law), u, dt) + noise * rng.standard_normal(len(u))
        signals |= {f"u{number}": u[50:, None], f"z{number}": y[50:, None]}  # it turns already
    _save(folder, CED, signals)
    return np.array([noise])


STAND_INS: dict[str, Callable[..., np.ndarray]] = {
    "silverbox": circuit,
    "f16": aircraft,
    "wiener_hammerstein": chain,
    "cascaded_tanks": tanks,
    "emps": positioner,
    "ced": drives,
}
