"""Accelerograms of agencies: CSMIP volumes 1 and 2 (.V1, .V2), COSMOS (.V1c, .V2c), PEER, K-NET.

Text of fixed columns: per channel a text header, whole numbers, real numbers, then blocks of
accelerations, and in volume 2 of velocities and displacements, each announced by a line that says
how many there are, their unit and their Fortran format. The first line of a channel says which
volume it is; the header of volume 2 repeats that of volume 1 below it. Sources: COSMOS Strong
Motion Data Format 1.20 (2001); Shakal & Huang, OSMS 85-03, and files as CESMD distributes them.
T samples.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from data.measured.files.columns import (
    Contents,
    FileError,
    Request,
    check_size,
    choose,
    common_step,
    cut_to_shortest,
    shorten,
)
from data.measured.files.format import Format
from data.simulation.accelerograms import read_at2

CSMIP = re.compile(  # 3000 points of accel data equally spaced at .020 sec, in cm/sec2. (8f10.3)
    r"\s*(?P<count>[0-9]{1,18})\s+points of (?P<kind>accel|veloc|displ)\w* data equally spaced at"
    r"\s*(?P<dt>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e[+-]?[0-9]+)?)\s*sec[.,]*\s*"
    r"(?:\(?in (?P<unit>[\w/^* ]+?)[.,]?\)?[.,]?\s*)?"
    r"(?:\(\s*(?P<format>[^()]*)\))?\s*$",
    re.IGNORECASE,
)
COSMOS = re.compile(  # 12091 acceleration pts, approx 120 secs, units=cm/s^2 (4),Format=(8F10.5)
    r"\s*(?P<count>[0-9]{1,18})\s+(?P<kind>accel|veloc|displ)\w* pts,"
    r"(?:\s*approx\.?\s*(?P<seconds>[0-9]{1,9})\s*sec)?.*?units\s*="
    r"(?P<unit>[^,(=]+)(?:\(\s*\d+\s*\))?\s*,\s*format\s*=\s*\(\s*(?P<format>[^()]*)\)",
    re.IGNORECASE,
)
REALS = re.compile(r"\s*[0-9]+\s+real-header values follow on\s+([0-9]{1,4})\s+lines", re.I)
CHANNEL = re.compile(r"chan(?:nel|\.)?\s*([0-9]{1,9})\s*:\s*(.*)", re.IGNORECASE)
LOCATION = re.compile(r"location:\s*(\S.*)", re.IGNORECASE)
END = re.compile(r"^(/&)?\s*-*\s*end[ -]of[ -]data", re.IGNORECASE)
POINTS = re.compile(r"no\.? of points\s*=\s*([0-9]{1,18})\b", re.IGNORECASE)
SPECTRA = re.compile(r"\s*(response\b.*spectr|fourier\b.*spectr)", re.IGNORECASE)
OPENING = (
    rb"(?i)\s*+.{0,400}?(accelerogram|\(format v ?\d|response (and|spectr)|points of accel data|"
    rb"header values follow)"
)
UNCORRECTED = re.compile(r"units of uncor\w*\.? accel\w* are (?P<what>.*?)(?:\.\s|\s{2,}|$)", re.I)
UNITS = {"cm/sec2": "cm/s^2", "cm/sec/sec": "cm/s^2", "cm/s/s": "cm/s^2", "cm/sec^2": "cm/s^2",
         "cm/sec": "cm/s", "g/10": "0.1*g", "cm": "cm", "g": "g", "cm/s^2": "cm/s^2",
         "cm/s2": "cm/s^2", "cm/s": "cm/s", "mg": "mg", "in": "in"}  # fmt: skip
SHORT = {"accel": "acc", "veloc": "vel", "displ": "disp"}
OF_VOLUME_2 = {"acc": "cm/sec2", "vel": "cm/sec", "disp": "cm"}  # where a file does not say it
HEADER_V1 = 27  # lines of a channel of volume 1: 13 of text, 7 of whole and 7 of real numbers
UNKNOWN = -999.0
WIDEST = 400  # characters of a line that are looked at for words


@dataclass(frozen=True)
class Header:
    """The text before the first series of a channel; read once, however many series follow."""

    number: str  # of the channel
    place: str  # direction and location of its sensor
    unit: str | None  # of what is uncorrected
    reals: tuple[float, ...]  # of COSMOS
    points: int  # of volume 1; 0 where none are said


@dataclass(frozen=True)
class Block:
    """One series of a channel."""

    kind: str  # "acc", "vel" or "disp"
    channel: str  # its number
    place: str  # direction and location of the sensor
    unit: str
    dt: float  # [s]
    values: np.ndarray  # (T,)


def read_strong_motion(path: Path, request: Request) -> Contents:
    """Series of all channels as columns acc1, vel1, disp1, acc2, …, numbered like the channels.

    The place of each sensor is in `labels` and in the notes. Raises FileError for blocks that are
    shorter than announced, counts (raw recorder units), and channels of unequal rates.
    """
    check_size(path, 16.0 * path.stat().st_size, path.stat().st_size)
    lines = path.read_text(encoding="latin-1").splitlines()
    blocks = _named(_blocks(path, lines))
    if not blocks:
        raise FileError(
            f"{path.name} announces no accelerations; expected a line such as '3000 points of accel"
            " data equally spaced at .02 sec' or '3000 acceleration pts, …'"
        )
    chosen = choose(path, list(blocks), request.columns)
    used = {name: blocks[name] for name in chosen}
    contents = Contents()
    steps = {name: block.dt for name, block in used.items()}
    contents.facts["dt"] = common_step(path, steps, "series")
    for name, block in used.items():
        contents.columns[name] = block.values
        contents.units[name] = block.unit
        if block.place:
            contents.labels[name] = block.place
    cut_to_shortest(contents, "series")
    places = {block.channel: block.place for block in used.values() if block.place}
    contents.notes += [f"channel {number}: {place}" for number, place in places.items()]
    return contents


STRONG_MOTION = Format(
    "strong motion",
    (".v2", ".v1", ".v2c", ".v1c", ".raw", ".v3", ".v3c"),
    read_strong_motion,
    opening=OPENING,
    called="strong-motion accelerograms",
    layout=True,
)


def _blocks(path: Path, lines: Sequence[str]) -> list[Block]:
    blocks: list[Block] = []
    start = at = 0  # of the channel's header; the line looked at
    header: Header | None = None  # of this channel, once a series follows
    while at < len(lines):
        line = lines[at][:WIDEST]
        if at == start and SPECTRA.match(line):
            raise FileError(
                f"{path.name} holds response spectra (volume 3), from which no motion comes back; "
                f"take volume 2 of the same channel, such as {path.stem}.V2"
            )
        found = CSMIP.match(line) or COSMOS.match(line)
        if found is not None:
            header = header or _header(lines[start:at])
            block, at = _read_block(path, lines, header, at, found)
            blocks.append(block)
        elif END.match(line.strip()):
            start = at = at + 1
            header = None
        elif at == start + HEADER_V1 and _has_pairs(lines[start:at], line):
            block, at = _read_pairs(path, lines, start, at)
            blocks.append(block)
        else:
            at += 1
    return blocks


def _read_block(
    path: Path, lines: Sequence[str], header: Header, at: int, found: re.Match[str]
) -> tuple[Block, int]:
    """The block that a line announces, and the line after it."""
    said = found.groupdict()
    count, kind = int(said["count"]), SHORT[said["kind"].lower()]
    per_line, width = _format(path, at, said.get("format"))
    rows = -(-count // per_line)
    values = _numbers(path, lines[at + 1 : at + 1 + rows], count, width, at)
    unit = _unit(path, said.get("unit") or header.unit or OF_VOLUME_2[kind], at)
    seconds = float(said.get("seconds") or UNKNOWN)
    dt = float(said["dt"]) if said.get("dt") else _step_of_cosmos(path, header, at, count, seconds)
    return Block(kind, header.number, header.place, unit, dt, values), at + 1 + rows


def _format(path: Path, at: int, text: str | None) -> tuple[int, int]:
    """Numbers in a line and their width, of a Fortran format such as 8f10.3."""
    found = re.search(r"(\d+)\s*[FEIG](\d+)", (text or "8F10.3").upper())
    if found is None or not 1 <= int(found[1]) <= 100 or not 1 <= int(found[2]) <= 40:
        raise FileError(
            f"{path.name}: line {at + 1} has the format {shorten(text)}; expected 8F10.3"
        )
    return int(found[1]), int(found[2])


def _numbers(path: Path, rows: Sequence[str], count: int, width: int, at: int) -> np.ndarray:
    """Numbers of fixed columns, which may touch each other."""
    words = " ".join(rows).split()
    if len(words) != count or any(len(word) > width for word in words):
        words = [
            row[k : k + width] for row in rows for k in range(0, len(row.rstrip()), width)
        ]  # fmt: skip
    try:
        values = np.array([float(word.replace("D", "E")) for word in words[:count]])
    except ValueError as error:
        raise FileError(
            f"{path.name}: below line {at + 1}: {shorten(error, 80, bare=True)}; expected numbers "
            f"of {width} characters; download it again"
        ) from None
    if len(values) != count:
        raise FileError(
            f"{path.name}: line {at + 1} announces {count} values and {len(values)} follow; the "
            "file was cut off: download it again"
        )
    return values


def _unit(path: Path, text: str, at: int) -> str:
    known = UNITS.get(text.strip().lower().rstrip(".").replace("sec**2", "sec2"))
    if known is None:
        raise FileError(
            f"{path.name}: line {at + 1} is in {shorten(text)}; expected cm/sec2, g/10, g, cm/sec "
            "or cm (counts are not converted: download volume 2, the corrected record)"
        )
    return known


def _step_of_cosmos(path: Path, header: Header, at: int, count: int, seconds: float) -> float:
    """Time step [s]: value 62 of the real header in ms, else value 34 in s.

    It fits the length of the record, which is value 63 or, to a second, `seconds` of line `at`.
    """
    values = dict(enumerate(header.reals, start=1))
    series, recorder = values.get(62, UNKNOWN) * 1e-3, values.get(34, UNKNOWN)
    length = values.get(63, UNKNOWN)
    for dt in (series, recorder):
        off = 2.0 * dt if length > 0.0 else 1.0
        said = length if length > 0.0 else seconds
        if dt > 0.0 and (said <= 0.0 or abs(said - count * dt) <= 0.02 * count * dt + off):
            return dt
    raise FileError(
        f"{path.name}: the real header before line {at + 1} says no time step (values 62 and 34) "
        "that fits the length of the record; say data.dt by a copy as CSV"
    )


def _header(lines: Sequence[str]) -> Header:
    lines = [line[:WIDEST] for line in lines]
    said = next((m for m in map(UNCORRECTED.search, lines) if m), None)
    unsaid = "a unit that it does not say" if _is_uncorrected(lines) else None
    unit = unsaid if said is None else said["what"].lower().replace("sec and ", "")
    points = next((int(m[1]) for m in map(POINTS.search, lines) if m), 0)
    return Header(*_channel(lines), unit, _reals(lines), points)


def _reals(lines: Sequence[str]) -> tuple[float, ...]:
    """Values of COSMOS' real header, none where there is none, or a damaged one."""
    for k, line in enumerate(lines):
        if found := REALS.match(line):
            try:
                return tuple(map(float, " ".join(lines[k + 1 : k + 1 + int(found[1])]).split()))
            except ValueError:
                break
    return ()


def _channel(header: Sequence[str]) -> tuple[str, str]:
    """Number of a channel, and its sensor's place and direction."""
    number, place = "", ""
    for line in header:
        found, location = CHANNEL.search(line), LOCATION.search(line)
        if found and not number:
            number = found[1]
            direction = re.split(r"\s{2,}|\(|location:", found[2], flags=re.IGNORECASE)[0].strip()
            place = direction
        if location and not place.endswith(location[1].strip()):
            place = f"{place}, {' '.join(location[1].split())}".strip(", ")
            break
    return number, place


def _is_uncorrected(header: Sequence[str]) -> bool:
    titles = (text.strip().lower() for text in header)
    return next((title for title in titles if title), "").startswith("uncorrected")


def _has_pairs(header: Sequence[str], line: str) -> bool:
    """Whether a channel of volume 1 holds pairs of time and acceleration from this line on."""
    uncorrected = _is_uncorrected(header)
    return uncorrected and re.search(r"[A-Za-z]{2}", line) is None and bool(line.strip())


def _read_pairs(path: Path, lines: Sequence[str], start: int, at: int) -> tuple[Block, int]:
    """Pairs of time [s] and acceleration, ten numbers of seven characters in a line."""
    header = _header(lines[start:at])
    last = next((k for k in range(at, len(lines)) if END.match(lines[k].strip())), len(lines))
    count = 2 * header.points or sum(-(-len(row.rstrip()) // 7) for row in lines[at:last])
    pairs = _numbers(path, lines[at:last], count, 7, at - 1).reshape(-1, 2)
    time = pairs[:, 0]
    steps = np.diff(time)
    dt = float(time[-1] - time[0]) / max(len(steps), 1)
    if len(steps) < 1 or steps.min() <= 0.0:
        raise FileError(f"{path.name}: the times below line {at} do not rise; download it again")
    even = dt * np.arange(len(time))
    values = pairs[:, 1]
    if np.abs(time - time[0] - even).max() > 0.5 * dt:  # digitised by hand
        values = np.interp(even, time - time[0], values)
    unit = _unit(path, header.unit or "", at)
    return Block("acc", header.number, header.place, unit, dt, values), last


def _named(blocks: list[Block]) -> dict[str, Block]:
    """Blocks by kind and channel; channels without a number, or of one number, are counted."""
    named: dict[str, Block] = {}
    order: dict[str, int] = {}
    for block in blocks:
        order[block.kind] = order.get(block.kind, 0) + 1
        number = block.channel or str(order[block.kind])
        name = f"{block.kind}{number}"
        if name in named:
            name = f"{block.kind}{number}_{order[block.kind]}"
        named[name] = replace(block, channel=number)
    return named


# PEER's .AT2 files: one acceleration in g, the time step in the header.


def read_peer(path: Path, request: Request) -> Contents:
    """The column acc [g] and the fact dt [s]. Raises FileError for a header that says neither."""
    check_size(path, 16.0 * path.stat().st_size, path.stat().st_size)
    try:
        record = read_at2(path)
    except ValueError as error:
        raise FileError(str(error)) from None
    choose(path, ["acc"], request.columns)
    return Contents({"acc": record.a}, {"acc": "g"}, {"dt": record.dt})


PEER = Format(
    "PEER",
    (".at2",),
    read_peer,
    opening=rb"(?i)(?=.{0,996}NPTS)(?=.{0,998}DT)",
    called="PEER accelerogram",
    layout=True,
)


# K-NET and KiK-net ASCII: one component of one station, whole counts times a scale factor in gal.
#
# Seventeen lines of header, a name and a value in each, then eight counts in a line. Source: NIED,
# "About K-NET ASCII format".

HEADER, NAME = 17, 18  # lines of the header; characters of a name in it
SCALE = re.compile(r"([0-9.]{1,20})\s*\(gal\)\s*/\s*([0-9.]{1,20})", re.IGNORECASE)
COMPONENTS = ("EW", "NS", "UD")
OF_KIK = {  # value of Dir. → sensor
    **{str(k): f"{way}, borehole" for k, way in enumerate(("N-S", "E-W", "U-D"), start=1)},
    **{str(k): f"{way}, surface" for k, way in enumerate(("N-S", "E-W", "U-D"), start=4)},
}


def read_knet(path: Path, request: Request) -> Contents:
    """The column acc [gal], the fact dt [s], and the station and direction as its label.

    Raises FileError for a header without rate or scale factor, for text among the counts, and for
    fewer counts than the header's duration.
    """
    check_size(path, 16.0 * path.stat().st_size, path.stat().st_size)
    lines = path.read_text(encoding="latin-1").splitlines()
    said = _knet_header(lines)
    rate = _knet_number(path, said, "sampling freq(hz)", r"([0-9.]{1,12})\s*(?:Hz)?")
    scale = SCALE.search(said.get("scale factor", ""))
    if scale is None or float(scale[2]) == 0.0:
        raise FileError(
            f"{path.name}: the header says 'Scale Factor' {shorten(said.get('scale factor', ''))}; "
            "expected such as 3920(gal)/6182761; download it again"
        )
    words = " ".join(lines[HEADER:]).split()
    try:
        counts = np.array([int(word) for word in words], dtype=np.float64)
    except ValueError as error:
        raise FileError(
            f"{path.name}: below line {HEADER}: {shorten(error, 80, bare=True)}; expected whole "
            "counts; download it again"
        ) from None
    expected = rate * _knet_number(path, said, "duration time(s)", r"([0-9.]{1,12})")
    if len(counts) < expected:
        raise FileError(
            f"{path.name} announces {expected:.0f} counts and {len(counts)} follow; the file was "
            "cut off: download it again"
        )
    direction = said.get("dir", "")
    place = f"station {said.get('station code', '?')}, {OF_KIK.get(direction, direction)}"
    choose(path, ["acc"], request.columns)
    acc = counts * (float(scale[1]) / float(scale[2]))
    notes = [f"counts times {scale[1]}/{scale[2]} gal, {place}; its offset is still in it"]
    return Contents({"acc": acc}, {"acc": "gal"}, {"dt": 1.0 / rate}, notes, labels={"acc": place})


def _knet_header(lines: list[str]) -> dict[str, str]:
    """What the header says, by names in lower case; some files put a point behind a word."""
    names = (re.sub(r"[. ]+", " ", line[:NAME]).strip().lower() for line in lines[:HEADER])
    return dict(zip(names, (line[NAME:].strip() for line in lines), strict=False))


def _knet_number(path: Path, said: dict[str, str], key: str, pattern: str) -> float:
    found = re.fullmatch(pattern, said.get(key, ""), re.IGNORECASE)
    number = float(found[1]) if found and re.fullmatch(r"\d+\.?\d*", found[1]) else 0.0
    if not number > 0.0:
        raise FileError(
            f"{path.name}: the header says {key!r} {shorten(said.get(key, ''))}; expected a number "
            "above 0; download it again"
        )
    return number


KNET = Format(
    "K-NET",
    tuple(f".{way.lower()}{level}" for level in ("", "1", "2") for way in COMPONENTS),
    read_knet,
    opening=rb"Origin Time .*Lat\.",
    called="K-NET accelerogram",
    layout=True,
)
