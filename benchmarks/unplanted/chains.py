"""Whole structures simulated by OpenSees, learned by networks of named laws: other people's code.

    python -m benchmarks.unplanted.chains                       # all, accelerations with 2 % noise
    python -m benchmarks.unplanted.chains --cases "gaps, 2 storeys" --noise 0
    python -m benchmarks.unplanted.chains --cases "fibre frame, 3 floors" --model element_network
    python -m benchmarks.unplanted.chains --cases "fibre frame, 2 floors" \
        --model element_network_branch --elements frame --noise 0

Shear chains of OpenSees' own materials, and a frame of fibre elements, under a shaken base,
Rayleigh damping, Newmark's method with some steps a sample. Models are given six records of 30 s
with accelerations against the base alone, with --noise 0 exact displacements and velocities too,
and, if they ask, the masses and which floors are joined (a chain; in frames all, or what
--elements says). They simulate
four unseen motions from rest, and the same with 1.5 times the ground motion. Errors are
relative to the absolute accelerations without noise [%]. The column `itself` is how far OpenSees
is from these with steps twice as long: no model can be told from one that is as near as that.
Needs openseespy.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from benchmarks.unplanted.fits import fitted
from benchmarks.unplanted.frame import Frame
from benchmarks.unplanted.opensees import opensees
from benchmarks.unplanted.structures import DT, FARTHER, SAMPLES, TRAINED, UNSEEN
from data.record import Record, stack
from models.estimator import Estimator
from runner.config.command_line import command_errors
from runner.config.compose import prepare_hydra

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
    eigenvalues = ("-fullGenLapack",)  # of all modes

    @property
    def modes(self) -> int:
        return len(self.masses)

    def built(self, ops: Any) -> list[int]:
        """The chain; the numbers of its nodes."""
        ops.model("basic", "-ndm", 1, "-ndf", 1)
        ops.node(0, 0.0)
        ops.fix(0, 1)
        number = 0
        for i, (mass, materials) in enumerate(zip(self.masses, self.storeys, strict=True), start=1):
            ops.node(i, 0.0)
            ops.mass(i, mass)
            numbers = []
            for kind, *words in materials:
                number += 1
                ops.uniaxialMaterial(kind, number, *words)
                numbers.append(number)
            along = ["-dir", *[1] * len(numbers), "-doRayleigh", 1]
            ops.element("zeroLength", i, i - 1, i, "-mat", *numbers, *along)
        return list(range(1, len(self.masses) + 1))


def steel(k: float, y: float, hardening: float, growth: float) -> list[Material]:
    shape = [hardening, 18.0, 0.925, 0.15, growth, 1.0, growth, 1.0]
    return [["Steel02", k * y, k, *shape]]


def slack(k: float) -> list[Material]:
    sides = [("ElasticPPGap", k, s * k * 0.007, s * 0.0015, 0.05, "damage") for s in (1.0, -1.0)]
    return [*sides, ["Elastic", 1.3 * k]]


def pinching(s: float) -> list[Material]:
    backbone = [9e4 * s, 0.005, 1.6e5 * s, 0.014, 1.9e5 * s, 0.035, 1.4e5 * s, 0.09]
    shape = [0.5, 0.25, 0.05, 0.3, 0.2, 0.3, 0.2, 0.6]
    lost = [0.2, 0.2, 0.2, 0.2, 0.3, 0.1, 0.1, 0.1, 0.1, 0.2, 10.0, "energy"]
    return [["Pinching4", *backbone, *shape, *lost]]


def degrading(s: float) -> list[Material]:
    side = [1.1e5 * s, 0.006, 1.5e5 * s, 0.02, 1.6e5 * s, 0.08]
    return [["Hysteretic", *side, *(-number for number in side), 0.6, 0.4, 0.0, 0.0, 0.2]]


CASES: dict[str, Chain | Frame] = {
    "Steel02, 3 storeys": Chain(
        [2.4e4, 2.2e4, 2.0e4], [steel(1.6e7 * s, 0.009, 0.03, 0.03) for s in (1.0, 0.85, 0.7)], 2.6
    ),
    "Steel02, 5 storeys": Chain(
        [2.4e4] * 5,
        [steel(2.6e7 * s, 0.008, 0.02, 0.02) for s in (1.0, 0.95, 0.85, 0.7, 0.55)],
        2.8,
        0.02,
    ),
    "Steel01, 3 storeys": Chain(
        [2.4e4] * 3, [[["Steel01", 1.3e5 * s, 1.6e7 * s, 0.05]] for s in (1.0, 0.85, 0.7)], 2.6
    ),
    "SelfCentering, 3 storeys": Chain(
        [2.4e4] * 3,
        [[["SelfCentering", 2e7 * s, 1e6 * s, 1.4e5 * s, 0.6]] for s in (1.0, 0.85, 0.7)],
        2.6,
    ),
    "gaps, 2 storeys": Chain([2.4e4] * 2, [slack(1.2e7 * s) for s in (1.0, 0.8)], 2.6),
    "Pinching4, 2 storeys": Chain([2.0e4, 1.5e4], [pinching(s) for s in (1.0, 0.8)], 2.6),
    "Hysteretic, 3 storeys": Chain([2.4e4] * 3, [degrading(s) for s in (1.0, 0.85, 0.7)], 2.2),
    "fibre frame, 3 floors": Frame([4.0e4, 4.0e4, 3.5e4], 4.0),
    "fibre frame, 2 floors": Frame(
        [3.0e4, 2.5e4],
        4.5,
        bays=1,
        height=4.0,
        width=7.0,
        damping=0.03,
        column=(0.28, 0.25, 0.014, 0.009),
        beam=(0.30, 0.15, 0.011, 0.007),
    ),
    "fibre frame, 4 floors": Frame(
        [5.0e4, 5.0e4, 4.5e4, 4.0e4],
        4.0,
        bays=3,
        height=3.3,
        width=5.0,
        damping=0.025,
        column=(0.36, 0.30, 0.020, 0.012),
        beam=(0.30, 0.15, 0.011, 0.007),
    ),
}


def simulated(case: Chain | Frame, ground: np.ndarray, substeps: int = 0) -> np.ndarray:
    """Motion against the base (3, T, n): displacements, velocities, accelerations."""
    ops = opensees()
    assert ops is not None
    ops.wipe()
    nodes, substeps = case.built(ops), substeps or case.substeps
    squares = np.array(ops.eigen(*case.eigenvalues, case.modes))
    first, last = np.sqrt(squares[[0, -1]])
    both = 2.0 * case.damping / (first + last)
    ops.rayleigh(both * first * last, 0.0, both, 0.0)
    ops.timeSeries("Path", 1, "-dt", DT, "-values", *ground.tolist())
    ops.pattern("UniformExcitation", 1, 1, "-accel", 1)
    ops.constraints("Transformation")
    ops.numberer("RCM")
    ops.system("FullGeneral")
    ops.test("NormDispIncr", 1e-10, 50)
    ops.algorithm("Newton")
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")
    motion = np.zeros((3, len(ground), len(nodes)))
    for sample in range(1, len(ground)):
        if ops.analyze(substeps, DT / substeps):
            raise ValueError("OpenSees does not converge; lower the ground motion")
        for i, node in enumerate(nodes):
            motion[0, sample, i] = ops.nodeDisp(node, 1)
            motion[1, sample, i] = ops.nodeVel(node, 1)
            motion[2, sample, i] = ops.nodeAccel(node, 1)
    return motion


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


def main() -> None:
    parser = argparse.ArgumentParser(
        "python -m benchmarks.unplanted.chains", description=(__doc__ or "").splitlines()[0]
    )
    add = parser.add_argument
    add("--cases", nargs="+", default=list(CASES), choices=list(CASES))
    add("--model", default="element_network_named")
    add("--noise", type=float, default=0.02, help="of the standard deviation of accelerations")
    add("--seed", type=int, default=0)
    add("--settings", nargs="+", default=[], help="of the model, such as model.prior=1e-3")
    add("--elements", help="chain, all or frame, in place of what suits the case")
    options = parser.parse_args()
    if opensees() is None:
        raise ValueError("openseespy is not installed: pip install openseespy")
    torch.set_num_threads(1)
    prepare_hydra()
    print("| structure | unseen | itself | 1.5 times | itself | s | laws |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | --- |")
    for name in options.cases:
        case = CASES[name]
        train = [record(case, 300 + i, s, options.noise) for i, s in enumerate(TRAINED)]
        unseen, farther = (
            [record(case, 400 + i, times * s) for i, s in enumerate(UNSEEN)]
            for times in (1.0, FARTHER)
        )
        words = [f"model={options.model}", f"seed={options.seed}", *options.settings]
        topology = options.elements or case.topology
        if options.model.startswith("element_network"):
            words += ["model.forced=base", f"model.elements={topology}"]
            words += [f"model.masses={list(map(float, case.masses))}"]
        begin = time.process_time()
        model, facts = fitted(words, stack(train))
        seconds = time.process_time() - begin
        numbers = (of for r in (unseen, farther) for of in (error(model, r), itself(case, r)))
        errors = " | ".join(f"{number:.2f}" for number in numbers)
        print(f"| {name} | {errors} | {seconds:.0f} | {facts.get('laws', '')} |", flush=True)


if __name__ == "__main__":
    with command_errors():
        main()
