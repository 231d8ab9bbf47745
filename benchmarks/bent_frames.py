"""Frames on a shaking base that nobody planted: columns bend over storeys, joints slip a little.

python -m benchmarks.bent_frames FOLDER                  frames of 2, 3 and 4 storeys, three of each
python -m benchmarks.bent_frames FOLDER --storeys 2 --draws 1

Every joint turns against a spring, and turns are condensed out of the stiffness, so that springs
between floors that are no neighbours are negative. In every storey twenty sliders of spread
strength (Iwan 1966) bear 8 % of the stiffness: frequencies fall and damping grows with the motion.
Trained on three shocks of which the last is the strongest, tested on a motion of a fifth of that,
a triangle wave whose corners ring the higher modes. Accelerations alone, 120 Hz, with noise of
0.01 m/s² in all sensors, the base's too; no mass, no topology and no law is told. A finished fit is
not repeated.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from data.arguments import Parser
from runner.config.command_line import command_errors

RATE, FINER, NOISE = 120, 16, 0.01  # Hz, substeps of a sample, m/s²
SLIDERS, SHARE, DAMPING = 20, 0.08, 0.0015
WORDS = ("model=element_network", "model/reads=accelerations")


def stiffness_of(storeys: int, turning: float) -> np.ndarray:
    """K (n, n) of columns EI = h = 1 whose joints turn against springs; turns condensed out."""
    n = storeys
    whole = np.zeros((2 * n + 2, 2 * n + 2))  # x₀ θ₀ x₁ θ₁ …
    column = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
    for i in range(n):
        whole[2 * i : 2 * i + 4, 2 * i : 2 * i + 4] += column
    whole = whole[2:, 2:]  # clamped at the base
    whole[1::2, 1::2] += turning * np.eye(n)
    x, turn = slice(0, None, 2), slice(1, None, 2)
    condensed: np.ndarray = whole[x, x] - whole[x, turn] @ np.linalg.solve(
        whole[turn, turn], whole[turn, x]
    )
    return condensed


def simulated(storeys: int, draw: int, base: np.ndarray) -> np.ndarray:
    """Absolute accelerations (T, n) under those of the base (T,), at RATE from rest."""
    rng = np.random.default_rng([storeys, draw])
    masses = rng.uniform(0.8, 1.2, storeys)
    K = stiffness_of(storeys, rng.uniform(4.0, 12.0))
    root = 1.0 / np.sqrt(masses)
    lowest = np.sqrt(np.linalg.eigvalsh(root[:, None] * K * root)[0])
    K *= (2.0 * np.pi * rng.uniform(2.5, 4.0) / lowest) ** 2
    C = 2.0 * DAMPING / (2.0 * np.pi * 3.0) * K
    drift = np.eye(storeys) - np.eye(storeys, k=-1)
    each = SHARE / SLIDERS * np.diag(drift @ K @ drift.T)[:, None] / 2.0  # N/m (n, 1)
    limits = 0.03 * np.geomspace(0.01, 1.0, SLIDERS)  # m
    h = 1.0 / (RATE * FINER)
    fine = np.interp(np.arange(len(base) * FINER) * h, np.arange(len(base)) / RATE, base)
    x, v, z = np.zeros(storeys), np.zeros(storeys), np.zeros((storeys, SLIDERS))
    absolute = np.zeros((len(base), storeys))
    for k, ground in enumerate(fine):
        force = K @ x + C @ v + drift.T @ (each * z).sum(axis=1)
        if k % FINER == 0:
            absolute[k // FINER] = -force / masses
        v = v - h * (force / masses + ground)
        step = h * v
        x = x + step
        z = np.clip(z + (drift @ step)[:, None], -limits, limits)
    return absolute


def shocks(rng: np.random.Generator) -> np.ndarray:
    """Three shocks, the last the strongest, and rest at the end [m/s²]."""
    t = np.arange(80 * RATE) / RATE
    spectrum = np.fft.rfft(rng.standard_normal(len(t)))
    f = np.fft.rfftfreq(len(t), 1.0 / RATE)
    noise = np.fft.irfft(spectrum * (f > 0.5) / (1.0 + (f / 4.0) ** 2), len(t))
    bursts = sum(
        size * np.exp(-0.5 * ((t - at) / 2.0) ** 2) for size, at in ((0.8, 8), (0.9, 22), (1, 36))
    )
    base = noise * bursts
    return 6.0 * base / np.abs(base).max()


def triangles(rng: np.random.Generator) -> np.ndarray:
    """A rounded triangle wave of 1.5 Hz with a little noise, and rest at the end [m/s²]."""
    t = np.arange(45 * RATE) / RATE
    wave = sum(
        (-1) ** k / (2 * k + 1) ** 1.3 * np.sin(3.0 * np.pi * (2 * k + 1) * t) for k in range(9)
    )
    moving = np.clip(t, 0.0, 1.0) * (t < 30.0)
    return (0.6 * wave + 0.05 * rng.standard_normal(len(t))) * moving


def written(folder: Path, storeys: int, draw: int) -> list[Path]:
    """The two records as CSV files."""
    rng = np.random.default_rng([1000 + storeys, draw])
    paths = []
    for name, base in (("shocks", shocks(rng)), ("triangles", triangles(rng))):
        signals = np.column_stack([base, simulated(storeys, draw, base)])
        signals += NOISE * rng.standard_normal(signals.shape)
        time = np.arange(len(base)) / RATE
        names = ",".join(["time", "s_ddot1", *(f"a{i + 1}" for i in range(storeys))])
        path = folder / f"{name}.csv"
        np.savetxt(path, np.column_stack([time, signals]), "%.6f", ",", header=names, comments="")
        paths.append(path)
    return paths


def main() -> None:
    parser = Parser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--storeys", type=int, nargs="+", default=[2, 3, 4])
    parser.add_argument("--draws", type=int, default=3)
    asked = parser.parse_args()
    table = Table("frame", "training [%]", "unseen [%]", "linear [%]", "fit [s]")
    for storeys in asked.storeys:
        for draw in range(asked.draws):
            folder = asked.folder / f"{storeys}_storeys_{draw}"
            run = folder / "element_network"
            folder.mkdir(parents=True, exist_ok=True)
            if not (run / "metrics.json").is_file():
                records = ",".join(map(str, written(folder, storeys, draw)))
                words = [f"data.path=[{records}]", "data.test=triangles", *WORDS]
                words += ["data=measured", "figures=false", f"hydra.run.dir={run}"]
                subprocess.run([sys.executable, "train.py", *words], check=False)
            if not (run / "metrics.json").is_file():
                table.add_row(f"{storeys} storeys, {draw}", "failed")
                continue
            metrics = json.loads((run / "metrics.json").read_text())
            linear = metrics["baselines"]["linear"]["free_run"]
            parts = (metrics["free_run_train"], metrics["free_run"], linear)
            errors = (part["relative_rms_percent"] for part in parts)
            shown = ("diverged" if e is None else f"{e:.2f}" for e in errors)
            table.add_row(f"{storeys} storeys, {draw}", *shown, f"{metrics['fit_seconds']:.0f}")
    Console(width=80).print(table)


if __name__ == "__main__":
    with command_errors():
        main()
