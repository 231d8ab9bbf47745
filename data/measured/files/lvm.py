"""LabVIEW measurement files (.lvm): text whose header says separator, decimal sign, units and step.

A header, then segments, each with a header of its own or, by `Multi_Headings No`, without. Source:
NI, "Specification for the LabVIEW Measurement File (.lvm)".
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from data.measured.files.columns import Contents, FileError, Request, check_size, shorten
from data.measured.files.format import Format
from data.measured.files.text import read_rows
from data.measured.units import split_brackets

SPECIAL = re.compile(rb"(?s)\*{3}Start_Special\*{3}.*?\*{3}End_Special\*{3}[^\n]*")
SEPARATORS = {"tab": "\t", "comma": ",", "space": " "}
X, COMMENT = "X_Value", b"Comment"


def read_lvm(path: Path, request: Request) -> Contents:
    """The channels of one segment, the clock as X_Value, and dt [s] where the header says it.

    A file of several segments holds several records. Raises FileError for a header without an
    end, several clocks (`X_Columns Multi`) that differ, and rows as a text file does.
    """
    size = path.stat().st_size
    check_size(path, 16.0 * size, size)
    raw = SPECIAL.sub(b"", path.read_bytes())
    head, *bodies = re.split(rb"\*\*\*End_of_Header\*\*\*[^\r\n]*\r?\n?", raw)
    said = {row[0]: row[1:] for row in _rows(head, ",") + _rows(head, "\t") if len(row) > 1}
    separator = SEPARATORS.get(next(iter(said.get("Separator", ["tab"]))).lower(), "\t")
    decimal = next(iter(said.get("Decimal_Separator", ["."]))) or "."
    if not bodies or decimal not in (".", ","):
        raise FileError(
            f"{path.name}: its header does not end, or says the decimal sign {shorten(decimal)}; "
            "expected '***End_of_Header***' and a point or a comma; export it again"
        )
    segments = _segments(bodies)
    if not 1 <= request.record <= len(segments):
        raise FileError(
            f"{path.name} holds {len(segments)} segments, and none is number {request.record}"
        )
    header, body = segments[request.record - 1]
    about = {row[0]: row[1:] for row in _rows(header, separator) if len(row) > 1}
    body = _without_comments(body, separator)
    heads = next(iter(_rows(body.partition(b"\n")[0], separator)), [])
    names = [split_brackets(head)[0] or f"c{k}" for k, head in enumerate(heads, start=1)]
    contents = read_rows(path, body, request, delimiter=separator, decimal=decimal)
    contents.records = len(segments)
    contents.notes.append(f"LabVIEW's header: decimal {decimal!r}")
    return _with_header(path, contents, about, names)


def _without_comments(body: bytes, separator: str) -> bytes:
    """The names and the rows up to the last channel: the comment is the last cell, or none is."""
    names = body.splitlines()[:1] or [b""]
    cut = separator.encode()
    count = len([name for name in names[0].rstrip(cut).split(cut) if name.strip() != COMMENT])
    cell = rb"[^%b\r\n]*" % cut
    wanted = cell if count < 2 else rb"(?:%b%b){%d}%b" % (cell, cut, count - 1, cell)
    body = re.sub(rb"(?m)^(%b)[^\r\n]*" % wanted, rb"\1", body)
    first, line_end, rows = body.partition(b"\n")
    clock = re.compile(rb"(?<![^%b])%b(?![^%b\r])" % (cut, X.encode(), cut))
    for number in range(2, len(clock.findall(first)) + 1):  # of X_Columns Multi
        at = [found.end() for found in clock.finditer(first)][1]
        first = first[:at] + b" %d" % number + first[at:]
    return first + line_end + rows


def _segments(bodies: Sequence[bytes]) -> list[tuple[bytes, bytes]]:
    """(header, rows) of each segment; the header of the next one ends what belongs to this."""
    if len(bodies) == 1:  # segments without headers of their own: the rows follow at once
        return [(b"", bodies[0].lstrip(b"\r\n\t "))]
    segments, header = [], bodies[0]
    for body in bodies[1:]:
        rows, found, following = body.partition(b"\nChannels")
        segments.append((header, rows.lstrip(b"\r\n")))
        header = found + following
    return segments


def _rows(text: bytes, separator: str) -> list[list[str]]:
    lines = text.decode("utf-8", errors="replace").splitlines()
    return [[cell.strip() for cell in line.split(separator)] for line in lines]


def _with_header(
    path: Path, contents: Contents, about: dict[str, list[str]], names: Sequence[str]
) -> Contents:
    """The columns with what the segment's header says of them: units, and the step of the clock.

    names: of all columns of the segment, whose units are in their order.
    """
    columns = contents.columns
    clocks = [name for name in columns if name.startswith(X)]
    signals = [name for name in names if not name.startswith(X)]
    steps = {
        float(text.replace(",", "."))
        for text in about.get("Delta_X", [])
        if re.fullmatch(r"[0-9]{1,30}[.,]?[0-9]{0,30}([Ee][+-]?[0-9]{1,3})?", text)
    }
    timed = all(text in ("Time", "") for text in about.get("X_Dimension", []))
    if timed and len(steps) == 1 and 0.0 < (step := next(iter(steps))) < np.inf:
        contents.facts["dt"] = step
    units = about.get("Y_Unit_Label", [])
    several = len(names) - len(signals) > 1
    every = 2 if several and len(units) >= 2 * len(signals) - 1 else 1
    for name, unit in zip(signals, units[::every], strict=False):
        if unit and name in columns:
            contents.units.setdefault(name, unit)
    first = next(iter(clocks), "")
    for clock in clocks[1:]:
        if not np.array_equal(columns[clock], columns[first], equal_nan=True):
            raise FileError(
                f"{path.name}: its channels have clocks of their own, and {clock!r} differs from "
                f"{first!r}; export it from LabVIEW with one X column"
            )
    for clock in clocks:
        if clock != first or np.isnan(columns[clock]).all():
            del columns[clock]
    if first in columns and timed:
        contents.units.setdefault(first, "s")
    contents.notes = [note for note in contents.notes if X not in note]
    return contents


LVM = Format(
    "LabVIEW",
    (".lvm",),
    read_lvm,
    opening=b"LabVIEW Measurement",
    called="a LabVIEW measurement",
    layout=True,
)
