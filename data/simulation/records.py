"""Structure + excitation + scenario + seed → records. No Lightning here.

Every record has its own random streams, named by (seed, split, record, purpose): training, test and
calibration motions are independent, and asking for more records leaves the first ones as they were.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Annotated, Any, Literal

import numpy as np
import torch

from data.annotations import Positive, Range, shown
from data.checked import checked
from data.memory import require_memory
from data.parallel import in_threads
from data.record import Escape, Record, Truth
from data.simulation.damage import Changes, Damage
from data.simulation.excitation import Excitation
from data.simulation.motion import (
    REMEDY,
    EscapedMotionError,
    Motion,
    least_steps,
    most_steps,
    simulate,
)
from data.simulation.scenario import Scenario
from data.simulation.structure import Structure

SPLITS = {"train": 0, "test": 1, "calibration": 2}
MOST_REDRAWN = 20  # motions in a record's place


class Purpose(IntEnum):
    """Of a stream of random numbers, none of which has another's."""

    EXCITATION, SENSORS = range(2)


def stream(
    seed: int, split: str, record: int, purpose: Purpose, redrawn: int = 0
) -> np.random.Generator:
    """The generator of one purpose of one record, and of the motions drawn in its place."""
    if seed < 0:
        raise ValueError(f"seed={seed} must not be negative")
    key = (SPLITS[split], record, purpose, *([redrawn] if redrawn else []))
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def measured_at(record: Record, numbers: Sequence[int]) -> Record:
    """What sensors on some DOFs have of a record of all; what drives it stays as it is."""
    at = [number - 1 for number in numbers]
    own: dict[str, Any] = {
        name: u[..., at] for name, u in record.signals().items() if name in "xva"
    }
    true = record.truth
    if true is not None:
        true = replace(true, x=true.x[..., at], v=true.v[..., at], a=true.a[..., at])
    return replace(record, truth=true, numbers=tuple(numbers), **own)


Drawn = tuple[np.ndarray, np.ndarray, np.ndarray]  # forces, supports and their velocities (T, ·)
Escaped = Literal["error", "redraw"]
Tolerance = Annotated[float, Range(0, 1e-3, above=True)]


@checked
@dataclass(frozen=True)
class Simulation:
    """Simulated measurements of a structure."""

    structure: Structure
    excitation: Excitation
    scenario: Scenario
    dt: Positive  # [s]
    duration: Positive  # [s]
    name: str = "structure"  # as the user knows it, for messages
    tolerance: Tolerance = 1e-7  # of the integrator, see data/simulation/motion.py
    damage: Damage | None = None  # of the test motions; training motions are of the sound structure
    escape: Escaped = "error"  # redraw: another motion takes the place of one that escapes
    sensors: Sequence[int] | None = None  # numbers of the DOFs that are measured; None: all

    def __post_init__(self) -> None:
        n, said = self.structure.dofs, self.sensors
        known = set(range(1, n + 1))
        if said is not None and not (said and set(said) <= known and len(set(said)) == len(said)):
            raise ValueError(
                f"data.sensors={shown(said)}: expected numbers of DOFs of {self.name}, "
                f"from 1 to {n}, each once; name others, or null for a sensor on each"
            )
        self.require_room(1)
        if self.samples < 2:
            raise ValueError(
                f"data.duration={self.duration} s holds {self.samples} samples of "
                f"data.dt={self.dt} s; at least 2 are needed"
            )
        steps, cause = least_steps(self.structure, self.duration)
        if steps > most_steps(self.samples):
            raise ValueError(
                f"{self.name}: {cause}, which takes {steps:.3g} steps in data.duration="
                f"{self.duration:g} s; {most_steps(self.samples):.3g} are allowed: {REMEDY}"
            )
        self.excitation.check(self.structure, self.samples, self.dt)
        if self.damage is not None:
            self.damage.check(self.structure, self.samples, self.dt)

    def require_room(self, records: int) -> None:
        """Raise ValueError where so many records, as they are made, would not fit in memory."""
        n, m, E = self.structure.dofs, self.structure.supports, len(self.structure.elements)
        channels = 12 * n + 4 * m + 6 * E  # drawn, integrated, with noise, in a batch
        require_memory(
            8.0 * channels * (self.duration / self.dt) * records,
            f"data.duration={self.duration:g} s at data.dt={self.dt:g} s in {records} records",
            "shorten data.duration, raise data.dt or take fewer data.train_records",
        )

    @property
    def numbers(self) -> list[int]:
        """Numbers of the DOFs that are measured, ascending."""
        return sorted(self.sensors or range(1, self.structure.dofs + 1))

    @property
    def samples(self) -> int:
        """Samples of each record."""
        return round(self.duration / self.dt)

    def records(
        self, split: str, count: int, seed: int, first: int = 0
    ) -> tuple[list[Record], list[Escape]]:
        """`count` records of a split and the motions among them that escaped.

        `first` is the number of records drawn before this split (given histories are cut in
        order). With escape="redraw" others take their place, of streams of their own. Raises
        EscapedMotionError where one record was asked for, or all escaped.
        """
        if count < 1:
            raise ValueError(f"data.{split}_records={count} must be at least 1")
        self.require_room(count)
        drawn = [self._draw(split, seed, i, first) for i in range(count)]
        motions = in_threads(lambda one: self._motion(split, one, self.tolerance), drawn)
        records, escapes = [], []
        for i, motion in enumerate(motions):
            taken, stays, redrawn = drawn[i], motion, 0
            if motion.escape_time is not None and self.escape == "redraw":
                taken, stays, redrawn = self._redrawn(split, seed, i, first)
            if motion.escape_time is not None:
                escapes.append(Escape(split, i, motion.escape_time, redrawn))
            if stays.escape_time is not None:
                continue
            record = self._record(stays, taken, self._kept(split, stays))
            seen = self.scenario(record, stream(seed, split, i, Purpose.SENSORS, redrawn))
            records.append(seen if self.sensors is None else measured_at(seen, self.numbers))
        if not records:
            others = "" if count == 1 else f", and so did all {count}"
            remedy = "data.escape=redraw (another motion of this seed), "
            if self.escape == "redraw":
                others, remedy = f", and so did {MOST_REDRAWN} drawn in its place", ""
            raise EscapedMotionError(
                f"{self.name}, seed {seed}: the {split} motion escaped at "
                f"t = {escapes[0].time:.2f} s{others}; take {remedy}another seed or a smaller "
                "excitation",
                escapes[0].time,
            )
        return records, escapes

    def _redrawn(self, split: str, seed: int, record: int, first: int) -> tuple[Drawn, Motion, int]:
        """The first motion in a record's place that stays, or the last that was tried."""
        for redrawn in range(1, MOST_REDRAWN + 1):
            drawn = self._draw(split, seed, record, first, redrawn)
            motion = self._motion(split, drawn, self.tolerance)
            if motion.escape_time is None:
                break
        return drawn, motion, redrawn

    def drawable(self, split: str, count: int, seed: int, first: int) -> int:
        """How many of `count` records of a split the excitation has: given histories end.

        first: as in `records`.
        """
        for i in range(count):
            try:
                self._draw(split, seed, i, first)
            except ValueError:
                return i
        return count

    def error(
        self,
        split: str,
        seed: int,
        first: int = 0,
        coarse: np.ndarray | None = None,
        redrawn: int = 0,
    ) -> float:
        """Relative error of the simulation itself, on the first record of a split.

        RMS change of its acceleration (T, n) when the tolerance is a hundred times tighter.
        `coarse` is that acceleration at the usual tolerance, where it was computed before, of the
        motion that was drawn `redrawn` times.
        """
        drawn = self._draw(split, seed, 0, first, redrawn)
        if coarse is None:
            coarse = self._motion(split, drawn, self.tolerance).a
        if self.escape == "redraw" and not np.isfinite(coarse).all():
            drawn, motion, _ = self._redrawn(split, seed, 0, first)
            coarse = motion.a
        fine = self._motion(split, drawn, 0.01 * self.tolerance).a
        return float(np.linalg.norm(coarse - fine) / np.linalg.norm(fine))

    def _motion(self, split: str, drawn: Drawn, tolerance: float) -> Motion:
        structure, changes = self._damaged(split)
        force, s, s_dot = drawn
        return simulate(structure, force, self.dt, s, s_dot, tolerance, changes)

    def _draw(self, split: str, seed: int, record: int, first: int, redrawn: int = 0) -> Drawn:
        rng = stream(seed, split, record, Purpose.EXCITATION, redrawn)
        return self.excitation.draw(self.structure, self.samples, self.dt, first + record, rng)

    def _damaged(self, split: str) -> tuple[Structure, Changes | None]:
        """The structure of a split at rest, and its changes during a record."""
        if self.damage is None or split != "test":
            return self.structure, None
        changes = self.damage.changes(self.structure, self.samples, self.dt)
        return self.damage.at_rest(self.structure), changes

    def _kept(self, split: str, motion: Motion) -> torch.Tensor | None:
        """Share of its stiffness that each element has kept (T, E), where one is damaged."""
        if self.damage is None or split != "test":
            return None
        return torch.from_numpy(self.damage.kept(self.structure, motion.work, self.dt))

    def _record(self, motion: Motion, drawn: Drawn, kept: torch.Tensor | None) -> Record:
        x, v, a, y, r = (torch.from_numpy(getattr(motion, name)) for name in "xvayr")
        force, *supports = drawn
        f = torch.from_numpy(force[:, self.excitation.driven(self.structure)])
        moving = self.excitation.support is not None
        s, s_dot = map(torch.from_numpy, supports) if moving else (None, None)
        return Record(self.dt, a, f, x, v, s, s_dot, Truth(x, v, a, y, r, kept=kept))
