"""Lines of text → samples, as lines arrive: CSV below a header, or one JSON object a line.

    t,s_ddot1,a1,a2,a3                       {"t": 0.00, "f": [0.1], "a": [0.0, 0.0, 0.1]}
    0.0000,0.11,0.02,0.01,0.03               {"t": 0.01, "f": [0.2], "a": [0.1, null, 0.1]}

Channels are named as in data/measured/channels.py; other columns are omitted. Nothing in a line is
executed; a line that is no sample is counted, reported and left out.   n DOFs.
"""

from __future__ import annotations

import json
import math
import socket
import sys
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain, pairwise
from math import isfinite, nan
from statistics import median
from time import perf_counter
from typing import BinaryIO

import torch

from data.measured.channels import CHANNEL, CLOCKS, beside, numbered, require_from_one, signal_of
from data.measured.files.columns import shorten
from data.measured.files.text_cells import LONGEST as LONGEST_NUMBER
from data.measured.files.text_cells import MISSING, NUMBER
from data.measured.units import DIMENSIONS, split_brackets, to_si, unit_in_name
from data.record import Record
from data.sample import Sample, Sensors, samples_of

LONGEST = 1 << 16  # bytes of a line
FAULTS = 1000  # newest faults and events that are kept: a stream may last for months
CHANNELS = 256  # of a line: the weights of a VWNN grow with their square, its time with the fourth
DELIMITERS = (",", ";", "\t")


class SampleLines:
    """Samples of a stream of lines, each with the moment at which its line arrived.

    dt [s]: of the samples; channels: {"a1": column, …} where columns have other names; units: of a
    signal ("a": "g") or a channel, SI where neither this nor the header says.
    Waits for the first line. Raises ValueError where that line names no accelerations, or nothing
    that drives them, and later for a line that is too long.
    """

    def __init__(
        self,
        file: BinaryIO,
        dt: float,
        channels: Mapping[str, str] | None = None,
        units: Mapping[str, str] | None = None,
    ) -> None:
        self.lines, self.dt = _lines(file), dt
        self.bad = 0  # lines that were left out
        self.mistimed = 0  # lines whose time stamp was changed
        self.faults: deque[str] = deque(maxlen=FAULTS)
        self.stamps = TimeStamps(dt)
        filled = (numbered_line for numbered_line in self.lines if numbered_line[1].strip())
        self.number, self.first = next(filled, (0, b""))
        if not self.first:
            raise ValueError("the input ended before its first line")
        self.json = self.first.lstrip()[:1] == b"{"
        self._name_channels(channels or {}, units or {})
        self._find_signals()

    def __iter__(self) -> Iterator[tuple[float, Sample]]:
        """Moments [s] of `time.perf_counter`, and samples."""
        first = [(self.number, self.first)] if self.json else []  # of CSV it is the header
        for number, line in chain(first, self.lines):
            if line.strip():
                yield from self._sample(number, line)

    def _sample(self, number: int, line: bytes) -> Iterator[tuple[float, Sample]]:
        came = perf_counter()
        try:
            values = self._json_values(line) if self.json else self._csv_values(line)
        except (ValueError, OverflowError, RecursionError) as fault:
            self.bad += 1
            self.faults.append(f"line {number}: {str(fault) or type(fault).__name__}")
            if not self.timed:
                self.stamps(None)  # a sample that was lost
            return
        time = self.stamps(values[0] if self.timed else None)
        if self.stamps.note:
            self.mistimed += 1
            self.faults.append(f"line {number}: {self.stamps.note}")
        yield came, self._assembled(values, time)

    def _csv_values(self, line: bytes) -> list[float]:
        cells = line.decode().strip("\r\n").split(self.delimiter)
        if len(cells) != self.width:
            raise ValueError(f"{len(cells)} cells, expected {self.width}")
        pairs = zip(self.columns, self.factors, strict=True)
        return [factor * _number(cells[k]) for k, factor in pairs]

    def _json_values(self, line: bytes) -> list[float]:
        values = _flat(json.loads(line))
        return [
            factor * values.get(name, nan)
            for name, factor in zip(self.keys, self.factors, strict=True)
        ]

    def _name_channels(self, channels: Mapping[str, str], units: Mapping[str, str]) -> None:
        """Choose the columns or keys that are read, with their channels and factors to SI."""
        heads = self._heads()
        places: dict[str, int] = {}
        factors: dict[str, float] = {}
        called = {column: channel for channel, column in channels.items()}
        require_from_one(_bare(head) for head in heads if _bare(head) not in called)
        for k, head in enumerate(heads):
            bare, unit = split_brackets(head)
            name = called.get(bare, "" if bare in channels else bare)
            name = "time" if name in CLOCKS else name
            if name != "time" and not CHANNEL.fullmatch(name):
                continue
            if name in places:
                raise ValueError(f"two columns of the input are both {name}; rename one of them")
            places[name] = k
            signal = signal_of(name)
            unit = units.get(name) or units.get(signal) or unit or unit_in_name(bare, signal)
            if not (unit or name in (bare, "time") or signal == "u"):
                raise ValueError(
                    f"no unit is understood in {shorten(bare)}; say --units "
                    f"{signal}={DIMENSIONS[signal][1]}, or what it is"
                )
            factors[name] = 1.0 if unit is None else to_si(unit, signal)
        missing = [column for column in channels.values() if column not in map(_bare, heads)]
        if missing:
            raise ValueError(f"the input has no column {missing[0]!r}; it has {', '.join(heads)}")
        self.timed = "time" in places
        self.names = sorted(places, key=lambda name: name != "time")  # time first
        self.columns = [places[name] for name in self.names]
        self.keys, self.width = [heads[k] for k in self.columns], len(heads)
        self.factors = [factors[name] for name in self.names]

    def _heads(self) -> list[str]:
        if self.json:
            try:
                return list(_flat(json.loads(self.first)))
            except (ValueError, OverflowError, RecursionError) as fault:
                raise ValueError(f"the first line is no JSON object of samples: {fault}") from None
        text = self.first.decode(errors="replace").lstrip("\ufeff").strip()
        self.delimiter = next((d for d in DELIMITERS if d in text), ",")
        heads = [cell.strip().strip('"') for cell in text.split(self.delimiter)]
        if any(map(_is_number, heads)):
            raise ValueError(
                f"the first line holds numbers, {shorten(text)}; expected a header that names the "
                "channels, such as t,f1,a1,a2"
            )
        return heads

    def _find_signals(self) -> None:
        """Find each signal among the values. Raises ValueError for signals that do not fit."""
        read = ", ".join(self.keys) or "no channel that is known here"
        places = {
            signal: [self.names.index(f"{signal}{i}") for i in numbered(self.names, signal)]
            for signal in ("f", "x", "v", "a", "s", "s_dot", "s_ddot")
        }
        n = len(places["a"])
        if len(self.names) > CHANNELS:
            raise ValueError(
                f"the input names {len(self.names):,} channels; expected at most {CHANNELS}; send "
                "only the model's"
            )
        for signal in ("s", "s_dot"):
            if places[signal] and f"{signal}{len(places[signal])}" not in self.names:
                raise ValueError(f"the input names {read}; expected {signal}1, … without a gap")
        self.base, driven = bool(places["s_ddot"]), [*places["f"], *places["s"], *places["s_dot"]]
        if n == 0 or not (driven or self.base):
            lacks = "accelerations a1, …" if n == 0 else "forces f1, … or a support's s_ddot1"
            raise ValueError(
                f"the input names {read}; expected {lacks} too; columns with other names: "
                "--channels a1=COLUMN"
            )
        others = beside(self.names, "acceleration")
        states = places["v"] or (places["x"] and not others)
        if self.base and (driven or len(places["s_ddot"]) > 1 or states):
            raise ValueError(
                f"the input names {read}; base excitation takes s_ddot1 and absolute "
                "accelerations a1, … alone, and where floors have no sensor x1, … and drift1, …"
            )
        if any(numbered(self.names, signal) != numbered(self.names, "a") for signal in "xv"):
            places["x"] = places["v"] = []
        places["o"] = [self.names.index(c) for c in others]
        if self.base:
            places["x"] = []
        self.places = {signal: at for signal, at in places.items() if at}
        forced = "base" if self.base else numbered(self.names, "f")
        inputs = 1 if self.base else len(driven)
        own = [c for c in self.names if signal_of(c) == "a"]
        self.sensors = Sensors(self.dt, n, inputs, forced, channels=[*own, *others])

    def _assembled(self, values: Sequence[float], time: float) -> Sample:
        """One sample; motions are relative to a support whose acceleration drives them."""
        signals = {
            signal: torch.tensor([values[k] for k in at], dtype=torch.float64)
            for signal, at in self.places.items()
        }
        if self.base:
            ground = signals.pop("s_ddot")
            return Sample(f=-ground, a=signals["a"] - ground, time=time, o=signals.get("o"))
        nothing = torch.zeros(0, dtype=torch.float64)
        return Sample(**{"f": nothing, **signals}, time=time)


def _lines(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    number = 0
    while line := file.readline(LONGEST + 1):
        number += 1
        if len(line) > LONGEST:
            raise ValueError(f"line {number} of the input is longer than {LONGEST} bytes")
        yield number, line


def _number(cell: str) -> float:
    cell = cell.strip()
    if cell in MISSING:
        return nan
    if not _is_number(cell):
        raise ValueError(f"{shorten(cell)} is no number")
    return float(cell)


def _is_number(cell: str) -> bool:
    return len(cell) <= LONGEST_NUMBER and NUMBER.fullmatch(cell) is not None


def _flat(line: object) -> dict[str, float]:
    """{"a": [0.1, null], "t": 0} → {"a1": 0.1, "a2": nan, "t": 0.0}."""
    if not isinstance(line, dict):
        raise ValueError("no JSON object")
    flat: dict[str, float] = {}
    for key, value in line.items():
        if isinstance(value, list):
            flat |= {f"{key}{i}": _json_number(u) for i, u in enumerate(value, start=1)}
        elif not isinstance(value, str | dict | bool):  # such as the name of a sensor
            flat[key] = _json_number(value)
    return flat


def _json_number(value: object) -> float:
    if value is None:
        return nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{shorten(value)} is no number")
    return float(value)


def _bare(head: str) -> str:
    return split_brackets(head)[0]


# Sources of live samples: a record at the pace of its sensors, a pipe, a socket.

LOOPBACK = "127.0.0.1"


def paced(record: Record, speed: float = 1.0) -> Iterator[tuple[float, Sample]]:
    """The samples of one record (T, ·), each with the moment at which it was due.

    speed: 1 is the pace of the sensors, inf does not wait. Moments [s] are of
    `time.perf_counter`. Raises ValueError for a speed that is not positive.
    """
    if not speed > 0.0:
        raise ValueError(f"--speed {speed:g} must be positive; inf does not wait")
    return _paced(record, speed)


def _paced(record: Record, speed: float) -> Iterator[tuple[float, Sample]]:
    start = time.perf_counter()
    for k, sample in enumerate(samples_of(record)):
        now = time.perf_counter()
        due = now if math.isinf(speed) else start + k * record.dt / speed
        if due > now:
            time.sleep(due - now)
        yield due, sample


def standard_input() -> BinaryIO:
    """Standard input, as bytes."""
    return sys.stdin.buffer


@contextmanager
def one_client(port: int) -> Iterator[BinaryIO]:
    """Lines that the first client of a port of this computer sends; no other client is let in.

    Waits for the client. Port 0 takes a free port; its number is printed to standard error.
    Raises ValueError for a number that is no port, OSError for a port in use.
    """
    if not 0 <= port < 1 << 16:
        raise ValueError(f"--listen {port}: expected a port from 0 to 65535")
    with socket.create_server((LOOPBACK, port), backlog=1) as server:
        address, number = server.getsockname()
        print(f"waiting for a client on {address}:{number}", file=sys.stderr, flush=True)
        connection, _ = server.accept()
    with connection, connection.makefile("rb") as lines:
        yield lines


# Time stamps of live samples → seconds since the first sample.

AGREEING = 3  # stamps in a row that are off alike, then a gap or a new clock is believed
NEAR = 3.5  # steps that a stamp may be ahead without being doubted
PATIENCE = 100  # samples; a stamp no further behind may be that of a sample sent again
LEAP = 3600.0  # [s]; a longer step is a clock set ahead, not a silent sensor
CHECKED = 20  # first steps that are compared with the stated rate


class TimeStamps:
    """Seconds since the first sample; a missing stamp is one step after its predecessor.

    So is a stamp that does not fit, ahead or far behind. Where the stamps after it agree with it,
    it was a gap, and time is theirs; or the sensors' clock was set, by more than LEAP ahead or
    back, and time goes on from its newest value. Stamps that repeat or lie a little behind the
    newest are passed on unchanged, for the stream to report, unless they stay behind. Raises
    ValueError where the first steps differ from dt [s] by half of it.
    """

    def __init__(self, dt: float) -> None:
        self.dt = dt
        self.time = -dt  # [s] of the newest sample
        self.origin: float | None = None  # stamp at time 0
        self.behind = 0
        self.note = ""  # how the newest stamp was changed, "" if it was not
        self._doubted: list[float] = []  # the newest stamps, which agree with one another alone
        self._stamps: list[float] = []  # the first stamps

    def __call__(self, stamp: float | None) -> float:
        """Time [s] of the next sample, whose stamp [s] may be missing."""
        self.note = ""
        if stamp is None or not isfinite(stamp):
            if stamp is not None:
                self.note = "the time stamp is missing; one step after the one before"
            return self._advance(self.time + self.dt)
        if self.origin is None:
            self.origin = stamp - (self.time + self.dt)
        time = stamp - self.origin
        self._check_rate(stamp)
        steps = (time - self.time) / self.dt
        if 0.0 < steps < NEAR:
            self._doubted.clear()
            return self._advance(time)
        if -PATIENCE <= steps <= 0.0 and self.behind < PATIENCE:
            self.behind += 1
            return time
        return self._doubt(stamp, time)

    def _doubt(self, stamp: float, time: float) -> float:
        """Time of a sample whose stamp does not follow from those before."""
        before = self._doubted[-1] if self._doubted else stamp
        if not 0.0 < (stamp - before) / self.dt < NEAR:
            self._doubted.clear()
        self._doubted.append(stamp)
        if self.behind < PATIENCE and len(self._doubted) < AGREEING:
            self.note = f"the time stamp {stamp:g} s does not fit; one step after the one before"
            return self._advance(self.time + self.dt, self.behind)
        self._doubted.clear()
        if self.time < time < self.time + LEAP:
            self.note = f"a gap of {time - self.time:g} s"
            return self._advance(time)
        self.note = f"the clock was set, by {time - self.time:g} s; time continues from there"
        self.origin = stamp - (self.time + self.dt)
        return self._advance(self.time + self.dt)

    def _advance(self, time: float, behind: int = 0) -> float:
        self.time, self.behind = time, behind
        return time

    def _check_rate(self, stamp: float) -> None:
        if len(self._stamps) > CHECKED:
            return
        self._stamps.append(stamp)
        if len(self._stamps) > CHECKED:
            step = median(later - sooner for sooner, later in pairwise(self._stamps))
            if not 0.5 * self.dt < step < 1.5 * self.dt:
                raise ValueError(
                    f"the time stamps are {step:g} s apart; expected {self.dt:g} s; "
                    "say their unit (--units time=ms) or the rate (--rate)"
                )
