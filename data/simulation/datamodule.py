"""Simulated measurements of a structure: training and test motions from seeds of their own."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

from data.annotations import Count, Fraction, Positive, Whole
from data.checked import checked
from data.datamodule import Data
from data.record import Record
from data.simulation.damage import Damage
from data.simulation.excitation import Excitation
from data.simulation.records import Escaped, Simulation, Tolerance
from data.simulation.scenario import Scenario
from data.simulation.structure import Structure


@checked
class SimulatedData(Data):
    """Training and test motions of one structure, each `duration` [s] long, sampled every `dt` [s].

    `damage` befalls the test motions; training motions are of the sound structure, and so are the
    `calibration_records`, further motions from streams of their own that bands are made from.
    `escape`: what a motion that escapes is, an `error` (or left out of several) or a `redraw`.
    `sensors`: numbers of the DOFs that are measured, all unless said; the forces on all are known.
    `tolerance` is the integrator's (data/simulation/motion.py). Other arguments: `Data`.
    """

    def __init__(
        self,
        structure: Structure,
        excitation: Excitation,
        scenario: Scenario,
        seed: Whole,
        name: str = "structure",
        dt: Positive = 0.01,
        duration: Positive = 50.0,
        train_records: Count = 1,
        test_records: Count = 1,
        tolerance: Tolerance = 1e-7,
        window: int | None = None,
        stride: int | None = None,
        warmup: int = 0,
        batch: Count | None = None,
        validation: Fraction = 0.0,
        damage: Damage | None = None,
        calibration_records: Whole = 5,
        escape: Escaped = "error",
        sensors: Sequence[int] | None = None,
    ) -> None:
        super().__init__(window, stride, warmup, batch, validation)
        self.simulation = Simulation(
            structure, excitation, scenario, dt, duration, name, tolerance, damage, escape, sensors
        )
        self.calibration_records = calibration_records
        self.simulation.require_room(train_records + test_records + calibration_records)
        samples = self.simulation.samples
        kept = round((1.0 - validation) * samples) if validation > 0.0 else samples
        if validation > 0.0 and samples - kept < 2:
            raise ValueError(
                f"data.validation={validation} holds {samples - kept} of {samples} samples back; "
                "at least 2 are needed: raise it, or 0 for none"
            )
        channels = 7 * structure.dofs + 2 * (structure.supports + len(structure.elements))
        self.check_windows([kept] * min(train_records, 1000), channels)
        for waveform in (excitation.force, excitation.support):
            if waveform is not None:
                waveform.check(train_records)
        self.seed, self.train_records, self.test_records = seed, train_records, test_records
        self.name, self.dt, self.dofs = name, dt, len(self.simulation.numbers)
        if sensors is not None:
            self.units = {f"a{i}": "m/s^2" for i in self.simulation.numbers}
        self._own_error: float | None = None
        self._redrawn = 0  # motions drawn in the place of the first test motion
        self.elements = tuple(structure.elements)
        self.forced = [column + 1 for column in excitation.driven(structure)]
        # forces, then displacements and velocities of the supports where they move
        self.inputs = len(self.forced) + (2 * structure.supports if excitation.support else 0)

    def of_seed(self, seed: int) -> SimulatedData:
        """These data with the motions of another seed."""
        other = copy(self)
        other.seed, other.records, other.escapes, other.notes = seed, {}, [], {}
        other._own_error, other._redrawn = None, 0
        return other

    def make_records(self) -> dict[str, list[Record]]:
        counts = {"train": self.train_records, "test": self.test_records}
        records = {}
        for split, first in (("train", 0), ("test", self.train_records)):
            records[split], escapes = self.simulation.records(
                split, counts[split], self.seed, first
            )
            self.escapes += [one for one in escapes if not one.redrawn]
            if split == "test":
                self._redrawn = sum(one.redrawn for one in escapes if one.record == 0)
            self.notes |= {
                f"{split}: record {one.record + 1}": [
                    f"escaped at t = {one.time:.2f} s; the motion drawn after it "
                    f"({one.redrawn} of this seed) replaces it (data.escape=redraw)"
                ]
                for one in escapes
                if one.redrawn
            }
        return records

    def make_calibration(self) -> list[Record]:
        """Motions that did not escape, after those of training and testing where they are given."""
        if self.calibration_records == 0:
            raise ValueError("data.calibration_records=0")
        first = self.train_records + self.test_records
        wanted = (self.calibration_records, self.seed, first)
        count = self.simulation.drawable("calibration", *wanted)
        if count == 0:
            raise ValueError(
                "the excitation has no motion left beside those of training and testing; give more "
                "of it"
            )
        return self.simulation.records("calibration", count, self.seed, first)[0]

    def own_error(self) -> float:
        """Relative error of the simulation, on the first test motion."""
        if self._own_error is None:
            at_hand = self.records.get("test", []) if not self.escapes else []
            truth = at_hand[0].truth if at_hand else None
            whole = truth is not None and self.dofs == self.simulation.structure.dofs
            coarse = truth.a.numpy() if truth is not None and whole else None
            first = self.train_records
            redrawn = self._redrawn if at_hand else 0
            self._own_error = self.simulation.error("test", self.seed, first, coarse, redrawn)
        return self._own_error

    def share_own_error(self, error: float) -> None:
        """Take that of the same data with the motions of another seed."""
        self._own_error = error
