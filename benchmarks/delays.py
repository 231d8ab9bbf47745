"""Delays of sensors: how many are found, how well, and how many are told where there is none.

    python -m benchmarks.delays                 # 600 frames, two minutes

Frames of one to four storeys, 0.5 to 12 Hz, 0.5 to 10 % of damping, linear or
elastoplastic, 0 to 5 % of noise, records of 15 and 60 s.   B frames, T samples, n storeys.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.table import show
from data.arguments import Parser
from data.measured.delays import delays
from runner.config.command_line import command_errors

DT = 0.01  # s


def frames(
    rng: np.random.Generator, count: int, storeys: int, samples: int, yielding: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations of the base (B, T) and the floors, absolute (B, T, n) [m/s²], of B frames."""
    f1 = np.exp(rng.uniform(np.log(0.5), np.log(12.0), (count, 1)))
    zeta = np.exp(rng.uniform(np.log(0.005), np.log(0.1), (count, 1)))
    m = np.exp(0.3 * rng.standard_normal((count, storeys)))
    k = np.exp(0.4 * rng.standard_normal((count, storeys)))
    joints = np.eye(storeys) - np.eye(storeys, k=-1)  # deformations of storeys, by displacements
    s = np.einsum("si,bs,sj->bij", joints, k, joints) / np.sqrt(m[:, :, None] * m[:, None, :])
    w1 = 2.0 * np.pi * f1
    k *= w1**2 / np.linalg.eigvalsh(s)[:, :1]
    share = rng.uniform(size=(count, 1))
    c = 2.0 * zeta / w1 * k * share * np.exp(0.7 * rng.standard_normal((count, storeys)))
    c_base = 2.0 * zeta * w1 * m * (1.0 - share)
    base = np.stack([_earthquake(rng, samples) for _ in range(count)])
    size = 3.0 * base.std(axis=1)[:, None] / w1**2 / np.sqrt(2.0 * zeta) / storeys
    strength = size * np.exp(rng.uniform(np.log(0.3), np.log(3.0), (count, 1)))

    def rates(y: np.ndarray, s_ddot: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of y (3, B, n), x, v and elastic deformations z; and absolute accelerations."""
        rate = y[1] @ joints.T
        flows = yielding & (np.abs(y[2]) >= strength) & (y[2] * rate > 0.0)
        a = -((k * y[2] + c * rate) @ joints + c_base * y[1]) / m
        return np.stack([y[1], a - s_ddot[:, None], np.where(flows, 0.0, rate)]), a

    h, y, floors = DT / 4.0, np.zeros((3, count, storeys)), np.zeros((count, samples, storeys))
    for t in range(samples - 1):
        for j in range(4):
            u = [base[:, t] + (base[:, t + 1] - base[:, t]) * (j + w) / 4.0 for w in (0, 0.5, 1)]
            k1, a = rates(y, u[0])
            floors[:, t] = a if j == 0 else floors[:, t]
            k2, _ = rates(y + 0.5 * h * k1, u[1])
            k3, _ = rates(y + 0.5 * h * k2, u[1])
            k4, _ = rates(y + h * k3, u[2])
            y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return base[:, :-1], floors[:, :-1]


def _earthquake(rng: np.random.Generator, samples: int) -> np.ndarray:
    from scipy.signal import butter, sosfilt

    band = [rng.uniform(0.05, 0.5), rng.uniform(5.0, 25.0)]
    t = np.linspace(0.0, 1.0, samples) / 0.15
    wave = sosfilt(butter(2, band, "band", fs=1.0 / DT, output="sos"), rng.standard_normal(samples))
    return np.asarray(wave / wave.std() * t**2 * np.exp(2.0 * (1.0 - t)))


def late(signal: np.ndarray, seconds: float) -> np.ndarray:
    """A signal (T, …) that comes later, by its whole band."""
    count = len(signal)
    turn = np.exp(-2j * np.pi * np.fft.rfftfreq(2 * count, DT) * seconds)
    spectrum = np.fft.rfft(signal, 2 * count, axis=0)
    return np.fft.irfft((spectrum.T * turn).T, 2 * count, axis=0)[:count]


def channels_of(
    rng: np.random.Generator, base: np.ndarray, floors: np.ndarray, noise: float
) -> dict[str, np.ndarray]:
    """The channels of one record, with noise relative to each."""
    every = {"s_ddot1": base} | {f"a{i}": a for i, a in enumerate(floors.T, start=1)}
    return {c: u + noise * u.std() * rng.standard_normal(len(u)) for c, u in every.items()}


def rows(count: int) -> Iterator[tuple[object, ...]]:
    """Law, delay [ms], frames, of them with an estimate, told, told within its 95 %."""
    rng = np.random.default_rng(0)
    for yielding in (False, True):
        sizes = [(n, samples) for n in (1, 2, 4) for samples in (1500, 6000)]
        drawn = [(frames(rng, count // 12, *size, yielding)) for size in sizes]
        for seconds in (0.0, 0.01, 0.019, 0.0333, 0.05):
            known = told = inside = total = 0
            for base, floors in (pair for both in drawn for pair in zip(*both, strict=True)):
                noise = rng.choice([0.0, 0.002, 0.01, 0.05])
                found = delays([(DT, channels_of(rng, base, late(floors, seconds), noise))])
                sure = [d for d in found.values() if d.sure]
                total, known, told = total + 1, known + bool(found), told + bool(sure)
                inside += bool(sure) and all(abs(d.seconds - seconds) < 2 * d.error for d in sure)
            law = "yielding" if yielding else "linear"
            yield law, round(1e3 * seconds, 1), total, known, told, inside


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="60 frames")
    head = ("frames", "delay [ms]", "number", "estimated", "told", "told within 95 %")
    show("", head, rows(60 if parser.parse_args().quick else 600))


if __name__ == "__main__":
    with command_errors():
        main()
