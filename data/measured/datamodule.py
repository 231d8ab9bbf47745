"""Measured records: files → channels → mended → Records, split for training and testing.

The split comes first: no step of a training motion's mending sees a sample of a test motion.
T samples, n DOFs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from torch import Tensor

from data.datamodule import Data
from data.measured.channels import matrix, numbered, signal_of
from data.measured.mend import Mending
from data.measured.raw_record import RawRecord, between
from data.measured.reading import read_record
from data.measured.splits import record_places, split_records
from data.measured.units import DIMENSIONS
from data.record import Record
from data.simulation.scenario import Scenario

SHORTEST, LONGEST = 1e-12, 1e9  # time step [s]
OUTPUTS = {"acceleration": "a", "velocity": "v", "displacement": "x", "force": "r"}


class MeasuredData(Data):
    """Records of one structure from files.

    path: files, or folders, or patterns of both. A folder is one record where channels name files
    (file.csv:column), else each of its files is one. train, test: names of the records, or patterns
    of names; one of both may be left out. A single record is cut at `split` of its time.
    channels, units, skip_rows, delimiter, decimal, group, header: see data/measured/channels.py and
    data/measured/files/table.py. dt [s]: where the files have no clock. start, stop [s]: of every
    record.
    quantity: what is estimated; None takes accelerations, else the force of an element, else
    displacements. initial_state: None begins as measured where x and v are, else at rest.
    With a support's acceleration s_ddot1, motions are relative to it and f = −s̈ drives them.
    mend: repairs of the signals (data/measured/mend.py).
    Raises ValueError for files, channels and units that do not fit, blocking faults that `mend`
    does not repair, and records that differ in dt or channels.
    """

    measured = True

    def __init__(
        self,
        path: str | Sequence[str],
        scenario: Scenario,
        mend: Mending,
        seed: int = 0,
        name: str = "measured",
        train: str | Sequence[str] | None = None,
        test: str | Sequence[str] | None = None,
        split: float = 0.5,
        channels: Mapping[str, str] | None = None,
        units: Mapping[str, str | None] | None = None,
        dt: float | None = None,
        start: float = 0.0,
        stop: float | None = None,
        quantity: str | None = None,
        initial_state: str | None = None,
        hold: str = "linear",
        skip_rows: int = 0,
        delimiter: str | None = None,
        decimal: str = ".",
        group: str | None = None,
        header: bool = True,
        window: int | None = None,
        stride: int | None = None,
        warmup: int = 0,
        batch: int | None = None,
        validation: float = 0.0,
    ) -> None:
        super().__init__(window, stride, warmup, batch, validation)
        if quantity is not None and quantity not in OUTPUTS:
            raise ValueError(f"data.quantity={quantity!r}: choose {', '.join(OUTPUTS)}, or null")
        if not 0.0 < split < 1.0:
            raise ValueError(f"data.split={split} must lie between 0 and 1")
        if dt is not None and not SHORTEST <= dt <= LONGEST:
            raise ValueError(
                f"data.dt={dt} s must be a time step from {SHORTEST:g} to {LONGEST:g} s, or null "
                "where the files have a clock"
            )
        self.name, self.seed, self.scenario, self.mend = name, seed, scenario, mend
        self.initial_state, self.hold = initial_state, hold
        self.stated_dt, self.stated_quantity = dt, quantity
        text = {"skip_rows": skip_rows, "delimiter": delimiter, "decimal": decimal}
        reader = {**text, "group": group, "header": header}
        raws = {}
        for place in record_places(path, channels):
            raw = read_record(place, channels, units, **reader)
            name_of = place.stem if place.is_file() else place.name
            if name_of in raws:
                name_of = str(place)
            raws[name_of] = between(self._with_clock(raw), start, stop)
        self.parts = self._parts(raws, train, test, split)
        del raws
        self.setup()
        first = self.records["train"][0]
        self.dt, self.dofs, self.inputs = first.dt, first.dofs, first.excitation.shape[-1]
        self.quantity = first.quantity
        self._check_alike()

    def _parts(
        self,
        raws: dict[str, RawRecord],
        train: str | Sequence[str] | None,
        test: str | Sequence[str] | None,
        split: float,
    ) -> dict[str, dict[str, RawRecord]]:
        return split_records(raws, train, test, split)

    def make_records(self) -> dict[str, list[Record]]:
        """Records of both splits, each part mended on its own; the files' contents are released."""
        records: dict[str, list[Record]] = {}
        for number, split in enumerate(("train", "test")):
            records[split] = []
            for i, (name, raw) in enumerate(self.parts[split].items()):
                dt, channels, done = self.mend(raw)
                self.notes[f"{split}: {name}"] = [*raw.notes, *done]
                record = self._record(dt, channels, raw.whole)
                rng = np.random.default_rng((self.seed, number, i))
                records[split].append(self.scenario(record, rng))
        self.parts = {}
        return records

    def _with_clock(self, raw: RawRecord) -> RawRecord:
        if self.stated_dt is None:
            return raw
        return replace(raw, time=None, clocks={}, dt=self.stated_dt)

    def _record(self, dt: float, channels: dict[str, np.ndarray], whole: bool) -> Record:
        usual = ("acceleration", "force", "displacement")
        measured = [q for q in usual if numbered(channels, OUTPUTS[q])]
        quantity = self.stated_quantity or next(iter(measured), None)
        output = None if quantity is None else matrix(channels, OUTPUTS[quantity])
        if quantity is None or output is None:
            raise ValueError(
                f"{self.name}: the channels {', '.join(channels)} hold nothing to estimate; "
                "expected accelerations a1, …, displacements x1, … or forces of an element r1"
            )
        self.forced, f = numbered(channels, "f"), matrix(channels, "f")
        self.units = {c: DIMENSIONS[signal_of(c)][1] for c in channels}
        ground = matrix(channels, "s_ddot")
        if ground is not None:
            output, f = self._relative(output, f, ground, channels)
        empty = output.new_zeros(len(output), 0)
        # beside accelerations only: an estimate of x must not see x
        x, v = (matrix(channels, s) if quantity == "acceleration" else None for s in ("x", "v"))
        x, v = (u if u is not None and u.shape == output.shape else None for u in (x, v))
        known = x is not None and v is not None
        record = Record(
            dt=dt,
            a=output,
            f=empty if f is None else f,
            x=x,
            v=v,
            s=matrix(channels, "s"),
            s_dot=matrix(channels, "s_dot"),
            initial_state=self.initial_state or ("given" if known or not whole else "rest"),
            hold=self.hold,
            quantity=quantity,
        )
        if record.excitation.shape[-1] == 0:
            raise ValueError(
                f"{self.name}: the channels {', '.join(channels)} hold nothing that drives the "
                "motion; expected forces f1, …, a support's acceleration s_ddot1, or s1 and s_dot1"
            )
        record.require_finite()
        return record

    def _relative(
        self, a: Tensor, f: Tensor | None, ground: Tensor, channels: Mapping[str, Any]
    ) -> tuple[Tensor, Tensor]:
        """Motion relative to a support, which drives it by −M ι s̈: f = −s̈ in m/s²."""
        if f is not None or ground.shape[-1] != 1 or numbered(channels, "x"):
            raise ValueError(
                f"{self.name}: the channels {', '.join(channels)} mix a support's acceleration "
                "with forces, displacements or a second one; base excitation takes s_ddot1 and "
                "absolute accelerations a1, … alone"
            )
        self.forced = "base"
        return a - ground, -ground

    def _check_alike(self) -> None:
        for split, records in self.records.items():
            for record in records:
                if abs(record.dt / self.dt - 1.0) > 1e-6:
                    raise ValueError(
                        f"the records of {self.name} are sampled every {self.dt:g} s and every "
                        f"{record.dt:g} s; set data.mend.resample={1.0 / self.dt:g} (Hz)"
                    )
                if (record.dofs, record.excitation.shape[-1]) != (self.dofs, self.inputs):
                    raise ValueError(f"the {split} records of {self.name} differ in their channels")


class WholeRecords(MeasuredData):
    """Every record whole, under "train", to be replayed and not to be trained on."""

    def _parts(self, raws: dict[str, RawRecord], *_: object) -> dict[str, dict[str, RawRecord]]:
        return {"train": raws, "test": {}}
