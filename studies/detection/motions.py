"""The study of change detectors: test motions, watches, and the levels that they give.

Records of DURATION with noise on x, v and a. Training motions of the sound structure calibrate a
watch: the first one the estimator, LEARNT others the detector's scale, HELD further ones its
threshold, for one false alarm an hour. Each seed is one test motion, watched twice: of the sound
structure, and with a loss of FRACTION of the stiffness of one element at TIME, of each element in
turn. Cutoff, memories and slacks were chosen on seeds below FIRST_SEED.

B records, K blocks, n DOFs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from torch import Tensor

from data.record import Record, stack
from data.simulation.damage import StiffnessLoss
from data.simulation.datamodule import SimulatedData
from data.simulation.motion import EscapedMotionError
from data.simulation.records import Simulation
from data.simulation.structure import Structure
from models.detection.blocks import residual_blocks, weight_blocks
from models.detection.cumulative_sum import CumulativeSum
from models.detection.detector import Detector, first_alarm
from models.detection.high_pass import HighPass
from models.detection.residual_level import ResidualLevel
from models.detection.weight_distance import WeightDistance
from models.detection.weight_drift import WeightDrift
from models.estimator import Estimator
from models.online.adaptive import Online
from models.training.assemble import estimator_from, simulated_from
from runner.config.compose import composed

SYSTEMS = ("shear_frame", "bouc_wen", "bilinear", "polynomial")
FIRST_SEED, SEEDS = 100, 50
DURATION, TIME, FRACTION = 120.0, 60.0, 0.2  # [s], [s], of the stiffness
NOISE = 0.02  # of each signal's standard deviation
LEARNT, HELD = 20, 179  # training records beside the first
RATE = DURATION / 3600.0  # false alarms per record: one an hour
BLOCK, SETTLE = 1.0, 20.0  # [s]


@dataclass(frozen=True)
class Watch:
    """An estimator and a detector that watches it.

    memory: of an adapting estimator [s]. cutoff: of a high-pass filter of all signals [Hz].
    """

    name: str
    model: str
    detector: type[Detector]
    memory: float | None = None
    cutoff: float | None = None


WATCHES = (
    Watch("frozen VWNN, level (baseline)", "vwnn", ResidualLevel),
    Watch("frozen VWNN, CUSUM", "vwnn", CumulativeSum),
    Watch("frozen linear, CUSUM", "linear", CumulativeSum),
    Watch("frozen linear, CUSUM, 1 Hz", "linear", CumulativeSum, cutoff=1.0),
    Watch("adaptive VWNN, distance", "online_vwnn", WeightDistance, memory=20.0),
    Watch("adaptive linear, distance", "online_linear", WeightDistance, memory=20.0),
    Watch("adaptive linear, distance, 1 Hz", "online_linear", WeightDistance, 20.0, 1.0),
    Watch("adaptive linear, drift, 1 Hz", "online_linear", WeightDrift, 5.0, 1.0),
)


@dataclass(frozen=True)
class Motions:
    """Training and test motions; damaged[i] is sound[i] with a loss in the element lost[i]."""

    structure: Structure
    train: list[Record]
    sound: list[Record]
    damaged: list[Record]
    lost: list[str]
    escaped: list[int]  # seeds


@dataclass(frozen=True)
class Outcome:
    """Levels (B, K, n) of one watch, above 1 an alarm, of sound and of damaged motions."""

    sound: Tensor
    damaged: Tensor


def data_of(system: str, model: str, seed: int, *words: str) -> tuple[Any, SimulatedData]:
    """The config of a system and model under this study's settings, and its data."""
    records = f"data.train_records={1 + LEARNT + HELD}"
    settings = (f"data.duration={DURATION}", "scenario=noisy", f"scenario.level={NOISE}", records)
    cfg = composed(f"system={system}", f"model={model}", f"seed={seed}", *settings, *words)
    return cfg, simulated_from(cfg)


def motions_of(system: str, seeds: Sequence[int]) -> Motions:
    """Motions of a system. Where one of a seed escapes, sound or damaged, the seed is left out."""
    _, data = data_of(system, "linear", seeds[0])
    simulation = data.simulation
    names = list(simulation.structure.elements)
    train = sound_motions(simulation, 1 + LEARNT + HELD, seeds[0])
    motions = Motions(simulation.structure, train, [], [], [], [])
    for seed in seeds:
        element = names[seed % len(names)]
        hurt = replace(simulation, damage=StiffnessLoss(element, TIME, FRACTION))
        try:
            pair = [s.records("test", 1, seed)[0][0] for s in (simulation, hurt)]
        except EscapedMotionError:
            motions.escaped.append(seed)
            continue
        motions.sound.append(pair[0])
        motions.damaged.append(pair[1])
        motions.lost.append(element)
    return motions


def sound_motions(simulation: Simulation, count: int, seed: int) -> list[Record]:
    """The first `count` training motions that do not escape."""
    records, escapes = simulation.records("train", count, seed)
    while len(records) < count:
        records, escapes = simulation.records("train", count + 2 * len(escapes), seed)
    return records[:count]


def identified(watch: Watch, system: str, train: Record) -> Estimator:
    """The estimator of a watch, identified on one record."""
    words = []
    if watch.memory is not None:
        words = [f"adaptation.forgetting={1.0 - train.dt / watch.memory}"]
    cfg, data = data_of(system, watch.model, FIRST_SEED, *words)
    estimator = estimator_from(cfg.model, data)
    estimator.identify([stack([train])])
    return estimator.eval()


def watched(watch: Watch, system: str, motions: Motions) -> Outcome:
    """Calibrate a watch on the training motions; its levels on the test motions."""

    def signals(records: Sequence[Record]) -> list[Record]:
        if watch.cutoff is None:
            return [record.measured() for record in records]
        return [HighPass(watch.cutoff, r.dt).record(r) for r in records]

    train, sound, damaged = (signals(r) for r in (motions.train, motions.sound, motions.damaged))
    every = round(BLOCK / train[0].dt)
    estimator = identified(watch, system, train[0])

    def blocks(records: Sequence[Record]) -> Tensor:
        if isinstance(estimator, Online):
            return weight_blocks(estimator, records, every)
        return residual_blocks(estimator, records, every)

    detector = watch.detector(settle=round(SETTLE / BLOCK))
    learnt = blocks(train[1:])
    detector.calibrate(learnt[:LEARNT], learnt[LEARNT:], RATE)
    return Outcome(detector.levels(blocks(sound)), detector.levels(blocks(damaged)))


def delays_of(levels: Tensor) -> list[float]:
    """Time [s] from the damage to the first alarm of each record (B, K, n).

    Not positive: an alarm before the damage. Infinite: none.
    """
    alarms = [first_alarm(record) for record in levels]
    return [math.inf if a is None else (a.block + 1) * BLOCK - TIME for a in alarms]


def joins(structure: Structure, element: str) -> set[int]:
    """The DOFs, 1 … n, that an element is fixed to."""
    between = structure.elements[element].between
    return {int(node[1:]) for node in between if node.startswith("x")}


def pointed_at(structure: Structure, level: Tensor) -> set[int]:
    """DOFs of the element that levels (n,) point to: the largest, and the next if it rose along.

    Two DOFs that no element joins cannot both be meant: then the largest alone.
    """
    first, second = (int(i) for i in level.argsort(descending=True)[:2])
    pair = {first + 1, second + 1}
    known = [joins(structure, name) for name in structure.elements]
    both = pair in known and float(level[second]) > 0.5 * float(level[first])
    return pair if both else {first + 1}
