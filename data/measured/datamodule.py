"""Measured records: files → channels → mended → Records, split for training and testing.

The split comes first: no step of a training motion's mending sees a sample of a test motion.
T samples, n DOFs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from glob import escape
from typing import Any, Literal

import numpy as np
from torch import Tensor

from data.datamodule import EACH, Data, matching
from data.measured.assembly import REFERENCES, Meaning, based, record_of_channels, with_rates
from data.measured.channels import numbered, signal_of
from data.measured.clocks import ALIGNMENTS, require_common_time
from data.measured.cycles import end_of_a_cycle, is_quasi_static, without_rates
from data.measured.delays import settle_delays
from data.measured.mend import Mending
from data.measured.onset import from_release, without_quiet_start
from data.measured.places import named_records, require_read
from data.measured.raw_record import RawRecord, between, has_samples_of
from data.measured.signal_faults import doubts
from data.measured.units import DIMENSIONS
from data.record import SHORTEST as SHORTEST_PART
from data.record import Record, same_step
from data.sample import OUTPUTS
from data.simulation.scenario import Scenario

SHORTEST, LONGEST = 1e-12, 1e9  # time step [s]
Estimate = Literal["estimate"]
TELLING = 0.1  # of a record whose beginning is unknown, its samples and its energy: tells of it,


class MeasuredData(Data):
    """Records of one structure from files.

    path: files, or folders, or patterns of both. A folder is one record where channels name files
    (file.csv:column), else each of its files is one. train, test: names of the records, or patterns
    of names; one of both may be left out. Of neither, the last fifth of several records is tested
    on, one at least, and the run says so; a single record is cut at `split` of its time, a
    quasi-static test of an element where a cycle ends near it.
    quasi_static: forces of an element do not depend on rates, which are left out; None: where
    neither the files nor dt tell of time.
    calibration: likewise, whole records that nothing but bands is made from.
    channels, units, skip_rows, delimiter, decimal, group, header: see data/measured/channels.py and
    data/measured/files/table.py. dt [s]: where the files have no clock. start, stop [s]: of every
    record.
    quantity: what is estimated; None takes accelerations, else the force of an element, else
    displacements. initial_state: None begins as measured where x and v are, else at rest; an
    element test, and a record that was cut in motion or shows motion at its first samples, in an
    unknown state. Of such a record the first `warmup` samples, or a tenth of its time or energy,
    tell of the state, and are not scored; the rest of an element test that was cut is run from the
    beginning of its file, and with run_in, or from rest, that of any record.
    With a support's acceleration s_ddot1, motions are relative to it and f = −s̈ drives them;
    accelerations says how a1, … were measured, "absolute" or "relative" to that support.
    align: sensors whose counters have no common zero begin at once ("start"), or are shifted onto
    the first by their likeness ("motion"). onset: a quiet start is cut off, unless `start` is said.
    delay [s]: by which sensors come late, by channel or signal; estimate: what the training records
    tell of accelerations beside s_ddot1. mend: repairs of the signals (data/measured/mend.py).
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
        decimal: str | None = None,
        group: str | None = None,
        header: bool = True,
        align: str | None = None,
        onset: bool = True,
        accelerations: str = "absolute",
        window: int | None = None,
        stride: int | None = None,
        warmup: int = 0,
        batch: int | None = None,
        validation: float = 0.0,
        calibration: str | Sequence[str] | None = None,
        quasi_static: bool | None = None,
        delay: Mapping[str, float | Estimate] | Estimate | None = None,
        run_in: bool | None = None,
    ) -> None:
        super().__init__(window, stride, warmup, batch, validation)
        if quantity is not None and quantity not in OUTPUTS:
            raise ValueError(f"data.quantity={quantity!r}: choose {', '.join(OUTPUTS)}, or null")
        for key, value, choices in (
            ("accelerations", accelerations, REFERENCES), ("align", align, (None, *ALIGNMENTS)),
        ):  # fmt: skip
            if value not in choices:
                words = ", ".join(c or "null" for c in choices)
                raise ValueError(f"data.{key}={value!r}: choose {words}")
        if not 0.0 < split < 1.0:
            raise ValueError(f"data.split={split} must lie between 0 and 1")
        if dt is not None and not SHORTEST <= dt <= LONGEST:
            raise ValueError(
                f"data.dt={dt} s must be a time step from {SHORTEST:g} to {LONGEST:g} s, or null "
                "where the files have a clock"
            )
        self.name, self.seed, self.scenario, self.mend = name, seed, scenario, mend
        self.initial_state, self.hold, self.run_in = initial_state, hold, run_in
        self.stated_quantity = quantity
        self.accelerations, self.stated_units = accelerations, dict(units or {})
        reader: dict[str, Any] = {"skip_rows": skip_rows, "delimiter": delimiter, "dt": dt}
        reader |= {"decimal": decimal, "group": group, "header": header, "align": align}
        reader |= {"start": start, "stop": stop, "onset": onset, "quasi_static": quasi_static}
        raws, left_out = whole_records(path, channels, units, **reader)
        require_read(left_out, {"train": train, "test": test, "calibration": calibration})
        self.notes = {f"left out {record}": [why] for record, why in left_out.items()}
        self.parts = self._parts(raws, train, test, split, calibration)
        del raws
        self.delay = self._settled(delay)
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
        calibration: str | Sequence[str] | None,
    ) -> dict[str, dict[str, RawRecord]]:
        held, others = held_back(raws, calibration, {"train": train, "test": test})
        if train is None and test is None:
            for name, other in list(_copies(others, others)):
                self.notes[f"left out {name}"] = [f"it has the samples of {other}"]
                del others[name]
        parts = split_records(others, train, test, split)
        for name, other in _copies(held | parts["test"], parts["train"] if len(others) > 1 else {}):
            self.notes[f"doubtful: {name} has the samples of {other}"] = [
                "its motion is not unseen: test on another record (data.test=[…])"
            ]
        if train is None and test is None and len(others) > 1:
            self.notes[f"tested on {_few(list(parts['test']))} of {len(others)} records"] = [
                "the last of them; data.test=[…] chooses others"
            ]
        return parts | {"calibration": held} if held else parts

    def _settled(self, delay: Mapping[str, float | Estimate] | Estimate | None) -> dict[str, float]:
        """Seconds of `data.delay`, and the notes and settings of what training records tell."""
        training = list(self.parts["train"].values())
        asked = {"a": delay} if isinstance(delay, str) else dict(delay or {})
        seconds, told = settle_delays(asked, training, self.mend, self.accelerations)
        if told:
            self.notes["delays, by the training records"] = told
            self.settled = {"delay": seconds}
        return seconds

    def make_records(self) -> dict[str, list[Record]]:
        """Records of all splits, each part mended on its own; the files' contents are released."""
        records: dict[str, list[Record]] = {}
        meaning = Meaning(self.stated_quantity, self.accelerations, self.initial_state, self.hold)
        notes: dict[tuple[str, ...], list[str]] = {}
        stated = self.cut["warmup"]
        for number, split in enumerate(self.parts):
            records[split], self.names[split] = [], list(self.parts[split])
            for i, (name, raw) in enumerate(self.parts[split].items()):
                dt, channels, done = self.mend(raw, self.delay)
                channels = with_rates(channels, dt, done)
                unsensed = {c for c in channels if raw.static and signal_of(c) == "s_dot"}
                sensed = {c: u for c, u in channels.items() if c not in unsensed}
                found = doubts(sensed, dt, self.accelerations)
                done += [f"doubtful: {finding}" for finding in found]
                record = record_of_channels(self.name, dt, channels, meaning, raw.whole)
                notes.setdefault((split, *raw.notes, *done), []).append(name)
                rng = np.random.default_rng((self.seed, number, i))
                records[split].append(self.scenario(record, rng))
                self._describe(channels, record.quantity)
            records[split] = self._telling(split, records[split], stated)
        cut = [name for name, raw in self.parts.get("test", {}).items() if not raw.whole]
        self.notes |= {f"{said[0]}: {_few(names)}": list(said[1:]) for said, names in notes.items()}
        self.parts = {}
        records = self._on_one_step(records)
        return self._behind_what_it_remembers(records) if cut else records

    def _behind_what_it_remembers(
        self, records: dict[str, list[Record]]
    ) -> dict[str, list[Record]]:
        """The rest of a record that was cut, run from the start of its file, if that tells more.

        Slack, damage and the largest excursions of the first part decide the force of the rest of
        an element test, and the motion that made them was imposed. A structure's state at the cut,
        of which nobody measures what yielded, follows from what drove it until then. The first part
        determines an unknown initial state; a stated one is that of the file.
        """
        (first,), (rest,) = records["train"], records["test"]
        driven = rest.excitation.shape[-1] > 0
        stated = self.initial_state == "rest" if self.run_in is None else self.run_in
        wanted = rest.quantity == "force" or (stated and driven)
        if rest.initial_state == "periodic" or not wanted:
            return records
        self.notes[f"test: {EACH}"] = [
            "simulated from the start of its file; only the part after the training part is scored"
        ]
        return {**records, "test": [rest.behind(first)]}

    def make_calibration(self) -> list[Record]:
        raise ValueError(
            "name whole records that are neither trained on nor tested: data.calibration=[…]"
        )

    def _telling(self, split: str, records: list[Record], stated: int) -> list[Record]:
        """Records whose beginning is unknown with first samples that tell of it, equally many."""
        unknown = [r for r in records if r.initial_state == "unknown"]
        if not unknown:
            return records
        if self.initial_state is None and all(r.x is not None and r.v is not None for r in records):
            return [replace(r, initial_state="given") for r in records]  # by a scenario
        if split == "train":  # windows of one batch begin alike; rest is one of the unknown states
            records = [replace(r, initial_state="unknown") for r in records]
            unknown = records
        length = min(r.samples for r in unknown)
        if split == "train" and self.cut["length"]:
            length = min(length, self.cut["length"])
        count = stated or _telling([r.a[:length] for r in unknown])
        if split == "train":
            self.cut["warmup"] = count  # of every window of them
        energy = [float(r.a[:end].square().sum()) for end in (count, None) for r in unknown]
        share = sum(energy[: len(unknown)]) / max(sum(energy[len(unknown) :]), 1e-300)
        first = f"the first {count * unknown[0].dt:.4g} s, with {share:.0%} of the motion's energy,"
        self.notes[f"{split}: {EACH}"] = [
            f"unknown initial state: {first} are used to estimate it and are not scored"
        ]
        marked = [replace(r, warmup=count) for r in unknown]
        return [marked.pop(0) if r.initial_state == "unknown" else r for r in records]

    def _describe(self, channels: dict[str, np.ndarray], quantity: str) -> None:
        self.forced = "base" if based(channels, quantity) else numbered(channels, "f")
        units = {c: DIMENSIONS[signal_of(c)][1] for c in channels}
        others = {c: self.stated_units.get(c) or self.stated_units.get("u") or "" for c in units}
        self.units = {c: others[c] if signal_of(c) == "u" else unit for c, unit in units.items()}

    def _on_one_step(self, records: dict[str, list[Record]]) -> dict[str, list[Record]]:
        """The records with the time step of the first, where theirs are the same to rounding."""
        dt = records["train"][0].dt
        for record in (r for split in records.values() for r in split):
            if not same_step(record.dt, dt):
                raise ValueError(
                    f"the records of {self.name} are sampled every {dt:g} s and every "
                    f"{record.dt:g} s; set data.mend.resample={1.0 / dt:g} (Hz)"
                )
        return {split: [replace(r, dt=dt) for r in rs] for split, rs in records.items()}

    def _check_alike(self) -> None:
        first = self.records["train"][0]
        for split, records in self.records.items():
            for record in records:
                own = record.dof_numbers, record.excitation.shape[-1], record.others
                same = own == (self.numbers, self.inputs, first.others)
                if not same or record.quantity != first.quantity:
                    raise ValueError(f"the {split} records of {self.name} differ in their channels")


def _few(names: list[str]) -> str:
    shown = ", ".join(names[:4])
    return shown if len(names) <= 4 else f"{shown} … ({len(names)} records)"


class WholeRecords(MeasuredData):
    """Every record whole, under "train", to be replayed and not to be trained on."""

    def _parts(self, raws: dict[str, RawRecord], *_: object) -> dict[str, dict[str, RawRecord]]:
        return {"train": raws, "test": {}}

    def _settled(self, delay: Mapping[str, float | Estimate] | Estimate | None) -> dict[str, float]:
        if "estimate" in (delay, *(delay.values() if isinstance(delay, Mapping) else ())):
            raise ValueError(
                "data.delay: estimate is by training records; of others say seconds, as in "
                "data.delay.a1=0.019"
            )
        return super()._settled(delay)


def whole_records(
    path: str | Sequence[str],
    channels: Mapping[str, str] | None,
    units: Mapping[str, str | None] | None,
    *,
    align: str | None = None,
    dt: float | None = None,
    start: float = 0.0,
    stop: float | None = None,
    onset: bool = True,
    quasi_static: bool | None = None,
    **reader: Any,
) -> tuple[dict[str, RawRecord], dict[str, str]]:
    """Records of files as they are trained on, scored and predicted from, and those left out.

    Arguments as of `MeasuredData`; reader: of `data.measured.places.named_records`. The clock is
    the stated one, `start` to `stop` is kept, and of a quiet start offsets and time are taken off.
    """
    raws, left_out = named_records(path, channels, units, align, **reader)
    for name, raw in raws.items():
        require_common_time(raw)
        timed = raw if dt is None else replace(raw, time=None, clocks={}, dt=dt)
        timed = without_rates(timed, quasi_static)
        part = between(timed, start, stop)
        own = onset and start == 0.0
        raws[name] = from_release(without_quiet_start(part)) if own else part
    return raws, left_out


# Which records train and which test: never a sample in both.

LAST = 0.2  # of several records, one at least: what is tested on where nobody says


def split_records(
    raws: dict[str, RawRecord],
    train: str | Sequence[str] | None,
    test: str | Sequence[str] | None,
    split: float,
) -> dict[str, dict[str, RawRecord]]:
    """Records of both splits by name, no sample in both. Raises ValueError for other choices.

    Where nothing is said, the last of several records are tested on, LAST of them.
    """
    names = list(raws)
    if train is None and test is None and len(raws) > 1:
        test = [escape(name) for name in names[-max(1, round(LAST * len(names))) :]]
    if train is None and test is None:
        ((name, raw),) = raws.items()
        first, last = raw.span
        middle = first + split * (last - first)
        if is_quasi_static(raw.channels):
            end = end_of_a_cycle(raw.channels["s1"], split)
            middle = middle if end is None else float(raw.own_time()[end])
        return {
            "train": {f"{name} (first part)": between(raw, 0.0, middle, closed=False)},
            "test": {f"{name} (rest)": replace(between(raw, middle, None), whole=False)},
        }
    chosen = {"train": matching(names, train, "train"), "test": matching(names, test, "test")}
    for split_, other in (("train", "test"), ("test", "train")):
        if (train if split_ == "train" else test) is None:
            chosen[split_] = [name for name in names if name not in chosen[other]]
    both = set(chosen["train"]) & set(chosen["test"])
    if both or not all(chosen.values()):
        raise ValueError(
            f"data.train={train} and data.test={test} put {', '.join(sorted(both)) or 'nothing'} "
            f"into {'both' if both else 'one of them'}; the records are {', '.join(names)}"
        )
    return {s: {name: raws[name] for name in chosen[s]} for s in chosen}


def _copies(
    records: Mapping[str, RawRecord], originals: Mapping[str, RawRecord]
) -> Iterator[tuple[str, str]]:
    """Names of records whose samples are those of an original, one before them in the same list."""
    for name, record in records.items():
        names = list(originals)
        for other in names[: names.index(name)] if name in originals else names:
            if has_samples_of(record.channels, originals[other].channels):
                yield name, other
                break


def _telling(motions: Sequence[Tensor]) -> int:
    """Number of first samples of motions (T, n) of one length that tell of their beginning.

    No more than a share of the time and, of every motion, of the energy: the rest is scored.
    """
    most = max(1, round(TELLING * len(motions[0])))
    sums = [a.square().sum(dim=1).cumsum(dim=0) for a in motions]
    early = min(int((energy < TELLING * energy[-1]).sum()) for energy in sums)
    return min(most, max(early, SHORTEST_PART))


def held_back(
    raws: dict[str, RawRecord],
    calibration: str | Sequence[str] | None,
    named: Mapping[str, str | Sequence[str] | None],
) -> tuple[dict[str, RawRecord], dict[str, RawRecord]]:
    """The records that bands are made from, and all others. None: no records are held back.

    named: those that were asked for by name, by split. Raises ValueError for one that is both.
    """
    chosen = matching(list(raws), calibration, "calibration")
    if len(chosen) == len(raws):
        raise ValueError(f"data.calibration={calibration} leaves no record to train on and to test")
    for split, patterns in named.items():
        if both := set(chosen) & set(matching(list(raws), patterns, split)):
            raise ValueError(
                f"data.calibration={calibration} and data.{split}={patterns} share "
                f"{', '.join(sorted(both))}; a band needs records of its own"
            )
    return (
        {name: raws[name] for name in chosen},
        {name: raw for name, raw in raws.items() if name not in chosen},
    )
