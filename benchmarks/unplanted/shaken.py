"""Chains and frames that OpenSees simulates on a shaking ground, as records for models.

Rayleigh damping, Newmark's method with some steps a sample. Chains are in units of their own; those
of fixed cases are N and m.   T samples, n floors
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from benchmarks.unplanted.frame import Frame
from benchmarks.unplanted.opensees import opensees
from benchmarks.unplanted.structures import DT, SAMPLES
from data.record import Record
from models.estimator import Estimator

Material = Sequence[object]  # the words of OpenSees' command, without its number


@dataclass(frozen=True)
class Chain:
    """Masses [kg], materials in parallel of every storey, largest ground acceleration [m/s²]."""

    masses: Sequence[float]
    storeys: Sequence[Sequence[Material]]
    peak: float
    damping: float = 0.03  # ratio of the first and last mode
    substeps: int = 32  # of a sample; SelfCentering is of first order, 10 % away with 4
    topology: str = "chain"
    motions: int = 0  # added to the seeds of ground motions
    eigenvalues = ("-fullGenLapack",)  # of all modes

    @property
    def modes(self) -> int:
        return len(self.masses)

    def built(self, ops: Any) -> list[int]:
        """The chain; the numbers of its nodes."""
        ops.model("basic", "-ndm", 1, "-ndf", 1)
        ops.node(0, 0.0)
        ops.fix(0, 1)
        for i, (mass, materials) in enumerate(zip(self.masses, self.storeys, strict=True), start=1):
            ops.node(i, 0.0)
            ops.mass(i, mass)
            joined(ops, i - 1, i, materials)
        return list(range(1, len(self.masses) + 1))


def joined(ops: Any, low: int, high: int, materials: Sequence[Material]) -> None:
    """Two nodes at one place, along the first axis; the element has the number of the higher."""
    numbers = [100 * high + i for i in range(len(materials))]
    for number, (kind, *words) in zip(numbers, materials, strict=True):
        ops.uniaxialMaterial(kind, number, *words)
    along = ["-dir", *[1] * len(numbers), "-doRayleigh", 1]
    ops.element("zeroLength", high, low, high, "-mat", *numbers, *along)


def _built(case: Chain | Frame) -> tuple[Any, list[int], np.ndarray]:
    """OpenSees with the structure, the numbers of its nodes, and natural rates [rad/s]."""
    ops = opensees()
    assert ops is not None
    ops.wipe()
    nodes = case.built(ops)
    return ops, nodes, np.sqrt(ops.eigen(*case.eigenvalues, case.modes))


def natural_rates(case: Chain | Frame) -> np.ndarray:
    """Of small motions [rad/s], the slowest first."""
    return _built(case)[2]


def simulated(case: Chain | Frame, ground: np.ndarray, substeps: int = 0) -> np.ndarray:
    """Motion against the base (3, T, n): displacements, velocities, accelerations."""
    ops, nodes, rates = _built(case)
    first, last, substeps = rates[0], rates[-1], substeps or case.substeps
    both = 2.0 * case.damping / (first + last)
    ops.rayleigh(both * first * last, 0.0, both, 0.0)
    # the last instant may lie beyond the last value, by rounding; without useLast that is none
    ops.timeSeries("Path", 1, "-dt", DT, "-values", *ground.tolist(), "-useLast")
    ops.pattern("UniformExcitation", 1, 1, "-accel", 1)
    prepare_steps(ops, 1e-10)
    motion = np.zeros((3, len(ground), len(nodes)))
    for sample in range(1, len(ground)):
        if ops.analyze(substeps, DT / substeps):
            raise ValueError("OpenSees does not converge; lower the ground motion")
        for i, node in enumerate(nodes):
            motion[0, sample, i] = ops.nodeDisp(node, 1)
            motion[1, sample, i] = ops.nodeVel(node, 1)
            motion[2, sample, i] = ops.nodeAccel(node, 1)
    return motion


def prepare_steps(ops: Any, near: float) -> None:
    """Newmark's method, each step in equilibrium but for displacements of less than `near`."""
    ops.constraints("Transformation")
    ops.numberer("RCM")
    ops.system("FullGeneral")
    ops.test("NormDispIncr", near, 50)
    ops.algorithm("Newton")
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")


def ground_motion(seed: int, size: float) -> np.ndarray:
    """Ground acceleration (T,) [m/s²] from rest: even seeds random, odd ones like earthquakes."""
    rng = np.random.default_rng(seed)
    frequencies, t = np.fft.rfftfreq(2 * SAMPLES, DT), DT * np.arange(SAMPLES)
    ratio, rise = frequencies / rng.uniform(1.5, 3.0), np.minimum(t / 3.0, 1.0) ** 2
    if seed % 2:
        shape = np.sqrt((1.0 + 1.44 * ratio**2) / ((1.0 - ratio**2) ** 2 + 1.44 * ratio**2))
        shape = shape * ((frequencies > 0.1) & (frequencies < 12.0))
        rise = rise * np.exp(-0.1 * np.maximum(t - 10.0, 0.0))
    else:
        shape = 1.0 * ((frequencies > 0.2) & (frequencies < rng.uniform(3.0, 6.0)))
    phases = rng.uniform(0.0, 2.0 * np.pi, len(frequencies))
    wave = rise * np.fft.irfft(shape * np.exp(1j * phases))[:SAMPLES]
    return size * wave / np.abs(wave).max()


def record(case: Chain | Frame, seed: int, size: float, noise: float = 0.0) -> Record:
    """Accelerations alone where there is noise, x and v too where there is none."""
    seed = case.motions + seed
    ground = ground_motion(seed, size * case.peak)
    x, v, a = (torch.from_numpy(u.copy()) for u in simulated(case, ground))
    force = torch.from_numpy(-ground)[:, None]
    if noise == 0.0:
        return Record(DT, a, force, x, v)
    drawn = torch.randn(a.shape, generator=torch.Generator().manual_seed(seed)).double()
    return Record(DT, a + noise * (a - force).std(dim=0) * drawn, force)


def itself(case: Chain | Frame, records: Sequence[Record]) -> float:
    """How far OpenSees is from records without noise with steps twice as long [%]."""
    others = [simulated(case, -r.excitation[:, 0].numpy(), case.substeps // 2)[2] for r in records]
    pairs = zip(records, others, strict=True)
    return _relative([(r, torch.from_numpy(a)) for r, a in pairs])


@torch.no_grad()
def error(model: Estimator, records: Sequence[Record]) -> float:
    """Relative RMS error of the absolute accelerations over all records [%]."""
    return _relative([(r, model.free_run(r.drive()).a) for r in records])


def _relative(pairs: Sequence[tuple[Record, torch.Tensor]]) -> float:
    squares = sum(float(((a - r.a) ** 2).sum()) for r, a in pairs)
    return 100.0 * (squares / sum(float(((r.a - r.f) ** 2).sum()) for r, _ in pairs)) ** 0.5
