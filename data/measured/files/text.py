"""CSV, TSV and other delimited text, read by all cores without a second copy in memory."""

from __future__ import annotations

import contextlib
import csv
import math
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.csv  # type: ignore[import-untyped]

from data.measured.files.columns import (
    Contents,
    FileError,
    Request,
    check_size,
    choose,
    leave_out,
    name_columns,
    one_recording,
    recordings,
    shorten,
)
from data.measured.files.format import Format
from data.measured.files.text_cells import (
    DATE,
    FORTRAN,
    MINUS,
    MISSING,
    OBJECT,
    any_number,
    as_column,
    have_parted_thousands,
    is_number,
    is_time,
    numbers,
    split,
    spoilt_number,
)
from data.measured.files.text_head import unit_of
from data.measured.files.text_layout import COMMENT, SAMPLE_BYTES, Layout, layout_of
from data.measured.units import has_dimension, is_clock, split_brackets

PIECE = 2**26  # bytes read at a time
BLOCK = 2**22  # bytes of it that one thread parses
UTF_16 = (b"\xff\xfe", b"\xfe\xff")  # byte-order marks
# a row of numbers, of which one ends where the minus of the next begins
TOUCHING = re.compile(rb"(?m)^[\d.eEdD+\- \t]*\d-\d*\.\d[\d.eEdD+\- \t]*\r?$")
KINDS = ("acceleration", "velocity", "displacement", "force")  # of one series, by its title
TYPES = {"number": pa.float64(), "integer": pa.int64(), "time": pa.binary(), "text": pa.binary()}


def read_text(path: Path, request: Request) -> Contents:
    """The number columns of a delimited text file; text columns are omitted with a note.

    ISO-8601 times become seconds since the first. Raises FileError naming line, column and text.
    """
    with path.open("rb") as file:
        mark = file.read(2)
    if mark in UTF_16:
        return _from_utf_16(path, request)
    try:
        return _read_table(path, request)
    except FileError:
        parted = _with_blanks(path)
        if parted is None:
            raise
    contents = read_rows(path, parted, request)
    contents.notes.insert(0, "numbers without a blank between them are separated at the minus sign")
    return contents


def _with_blanks(path: Path) -> bytes | None:
    """The text with a blank before a minus that follows a digit; None where no row has one.

    As columns of a fixed width have, 12.345-678.901, whose numbers fill them.
    """
    if path.stat().st_size > PIECE:  # a search would take too long
        return None
    text = path.read_bytes()
    parted = TOUCHING.sub(lambda row: re.sub(rb"(?<=\d)(?=-\d*\.\d)", b" ", row[0]), text)
    return None if parted == text else parted


def _read_table(path: Path, request: Request) -> Contents:
    """The columns of text in UTF-8 or an encoding of one byte; arguments as of `read_text`."""
    layout = layout_of(path, request)
    request = replace(request, decimal=layout.decimal)
    if layout.points:
        return _one_series(path, layout, request)
    unnamed = [k for k, header in enumerate(layout.headers) if not header]
    headers = [header or f"c{k + 1}" for k, header in enumerate(layout.headers)]
    for k, unit in layout.units.items():
        headers[k] += "" if split_brackets(headers[k])[1] else f" [{unit}]"
    names, units = name_columns(path, headers)
    contents = Contents(facts=layout.facts, notes=layout.notes)
    if own := one_recording(path, _blocks(names, request), request, contents):
        units = {own[name]: unit for name, unit in units.items() if name in own}
        names = [own.get(name, "") for name in names]
    chosen = choose(path, list(filter(None, names)), request.columns)
    read = [name if name in chosen else "" for name in names]  # "" for a column that is not read
    table = _parse(path, layout, read, contents.notes)
    labels: dict[str, pa.ChunkedArray] = {}  # columns of text
    for name in chosen:
        k = names.index(name)
        values, kind = table.pop(k), layout.kinds[k]
        column = as_column(path, name, values, kind, layout.decimal, contents)
        if column is None:
            if kind != "text" or any_number(values, layout.decimal):
                find_fault(path, layout, read)
            leave_out(path, name, "text", request.columns, contents.notes)
            labels[name] = values
        elif k in unnamed and np.isnan(column).all():
            contents.notes.append(f"column {k + 1} left out: no name and no values")
        else:
            _require_decimals(path, layout, k, name, column)
            contents.columns[name] = column
            if kind == "time":
                units[name] = "s"  # by now, whatever brackets said: [hh:mm:ss], (UTC)
            if k in unnamed:
                contents.notes.append(f"column {k + 1} has no name, called {name!r}")
    if own:  # the longest of the recordings has more rows
        ends = [np.flatnonzero(np.isfinite(u)).max(initial=0) for u in contents.columns.values()]
        contents.columns = {c: u[: max(ends) + 1] for c, u in contents.columns.items()}
    contents.units = {name: units[name] for name in contents.columns if name in units}
    _require_wide(path, contents, labels)
    return contents


def _require_decimals(path: Path, layout: Layout, k: int, name: str, column: np.ndarray) -> None:
    """Raise FileError where points in column k, read as the numbers (T,), part thousands."""
    parted = np.abs(column[np.isfinite(column) & (column != np.rint(column))])
    if layout.kinds[k] != "number" or layout.decimal != "." or not parted.size:
        return
    if parted.min() < 1.0 or (parted != np.round(parted, 3)).any():
        return  # quickly, of most columns
    if have_parted_thousands(_collect(path, layout, {k: "text"}, len(column))[k]):
        raise FileError(
            f"{path.name}: column {name!r}: {parted[0]:.3f} is a number with separators of "
            "thousands, for others are whole; export it without them"
        )


def _blocks(names: Sequence[str], request: Request) -> dict[str, dict[str, str]]:
    """Columns of recordings side by side, each with its clock: Event 1 Time, …, Event 2 Time, …."""
    cut = {name: re.match(r"\D*\d+[\s_./:-]*(?=\w)", name) for name in names}
    places = {n: (start[0], n[start.end() :]) for n, start in cut.items() if start is not None}
    groups = recordings(places, request.columns)
    return groups if all(any(map(is_clock, each.values())) for each in groups.values()) else {}


def _from_utf_16(path: Path, request: Request) -> Contents:
    size = path.stat().st_size
    check_size(path, 3.0 * size, size)
    try:
        text = path.read_text("utf-16")
    except UnicodeDecodeError:
        raise FileError(f"{path.name} is cut UTF-16 text; expected UTF-8; save it again") from None
    contents = read_rows(path, text.encode(), request)
    contents.notes.insert(0, "UTF-16 text")
    return contents


def read_rows(path: Path, text: bytes, request: Request, **known: Any) -> Contents:
    """Columns of rows of text that are part of a file; `known` settings of Request are the file's.

    Raises FileError as for a text file, with the name of the file they are from.
    """
    with tempfile.TemporaryDirectory(prefix="rows_") as folder:
        place = Path(folder) / path.name
        place.write_bytes(text)
        return read_text(place, replace(request, **known))


def _require_wide(path: Path, contents: Contents, labels: Mapping[str, pa.ChunkedArray]) -> None:
    """Raise FileError for a long table: the same times come for one series after another.

    What says the series is a column of text, or, beside a clock, a column of numbers.
    """
    columns, units = contents.columns, contents.units
    clocks = [n for n in columns if is_clock(n) or has_dimension(units.get(n, ""), "time")]
    pairs = [(label, column) for label in labels for column in columns]
    pairs += [(column, clock) for column in columns if column not in clocks for clock in clocks]
    coded = {name: cells.combine_chunks().dictionary_encode() for name, cells in labels.items()}
    for key, time in pairs:
        codes = coded[key].indices.fill_null(-1).to_numpy() if key in coded else columns[key]
        if not _repeats(codes, columns[time]):
            continue
        if key in coded:
            series = [text.decode("utf-8", "replace") for text in coded[key].dictionary.to_pylist()]
        else:
            series = [f"{number:g}" for number in np.unique(codes)]
        some = ", ".join(shorten(one, bare=True) for one in series[:3])
        raise FileError(
            f"{path.name}: {key!r} says of which series each row is ({some}), and each {time!r} "
            f"comes {len(series)} times; expected a column for each series and a row for each "
            "time; write the table so (a pivot)"
        )


def _repeats(series: np.ndarray, time: np.ndarray) -> bool:
    """Whether the same rising times (N,) come with each series (N,), in blocks or by turns."""
    changes = np.flatnonzero(series[1:] != series[:-1]) + 1
    if not len(changes):
        return False
    by_turns = changes[0] == 1
    count = int(np.argmax(series[1:] == series[0])) + 1 if by_turns else len(series) // changes[0]
    if count < 2 or len(series) % count or 2 * count > len(series):
        return False
    shape = (-1, count) if by_turns else (count, -1)
    of_series, of_time = series.reshape(shape), time.reshape(shape)
    if not by_turns:
        of_series, of_time = of_series.T, of_time.T
    same = (of_series == of_series[0]).all() and (of_time == of_time[:, :1]).all()
    return bool(same and (np.diff(of_time[:, 0]) > 0.0).all())


def _one_series(path: Path, layout: Layout, request: Request) -> Contents:
    """One series that is written several values a row, with the unit that the lines above say."""
    check_size(path, 24.0 * path.stat().st_size, path.stat().st_size)
    content = path.read_bytes()
    head, body = (
        part.decode("utf-8", "replace")
        for part in (content[: layout.offset], content[layout.offset :])
    )
    values = body.replace(layout.delimiter, " ").replace(layout.decimal, ".").split()
    wrong = next((value for value in values if not is_number(value)), None)
    if wrong is not None or len(values) != layout.points:
        raise FileError(
            f"{path.name}: {len(values)} values{f', such as {shorten(wrong)}' if wrong else ''}; "
            f"expected {layout.points} numbers, as the lines above them say; mend the file"
        )
    said = next((word for word in KINDS if word in head.lower()), "values")
    choose(path, [said], request.columns)
    unit = unit_of(head.splitlines())
    notes = [*layout.notes, f"one series of {layout.points} values, {len(layout.headers)} a row"]
    units = {} if unit is None else {said: unit}
    return Contents({said: numbers(values)}, units, layout.facts, notes)


TEXT = Format(
    "text",
    (".csv", ".tsv", ".txt", ".dat", ".asc", ".prn"),
    read_text,
    opening=b"(?!%b)(?!.*\0)" % OBJECT,
    called="text",
    options=("skip_rows", "delimiter", "decimal", "header"),
    plain=True,
)


def read_recorder(path: Path, request: Request) -> Contents:
    """Numbers of OpenSees' recorders (.out): time, where -time was said, and Disp or Disp1, …

    Columns are named after the file, unless it has a row of names, as any text. The first of
    several is the time if it rises throughout. Raises FileError as for text.
    """
    with path.open("rb") as file:
        head = file.read(SAMPLE_BYTES).decode("utf-8", errors="replace")
    first = next((line.split() for line in head.splitlines() if line.strip()), [])
    if not first or not all(is_number(cell) for cell in first):
        return read_text(path, request)
    contents = read_text(path, replace(request, header=False, columns=None))
    columns = list(contents.columns.values())
    names = ["time"] if len(columns) > 1 and bool((np.diff(columns[0]) > 0.0).all()) else []
    left = len(columns) - len(names)
    names += [path.stem] if left == 1 else [f"{path.stem}{k + 1}" for k in range(left)]
    table = dict(zip(names, columns, strict=True))
    contents.columns = {name: table[name] for name in choose(path, names, request.columns)}
    contents.notes = [note for note in contents.notes if not note.startswith("no header")]
    contents.notes.append(f"no header: columns {', '.join(names[:8])}{' …' * (len(names) > 8)}")
    return contents


OPENSEES = Format("OpenSees recorder", (".out",), read_recorder, options=TEXT.options)


def _parse(
    path: Path, layout: Layout, read: list[str], notes: list[str]
) -> dict[int, np.ndarray | pa.ChunkedArray]:
    """Columns by number: arrays of numbers, or text to convert. Raises FileError naming a line."""
    rows = _survey(path, layout, notes)
    kinds = {k: layout.kinds[k] for k, name in enumerate(read) if name}
    check_size(path, 8 * rows * len(kinds), path.stat().st_size)
    with contextlib.suppress(pa.ArrowInvalid):
        return _collect(path, layout, kinds, rows)
    find_fault(path, _narrow(path, layout, kinds), read, 2 * SAMPLE_BYTES)
    try:  # no cell is wrong, but some look odd to Arrow: convert them one by one
        loose = {k: "integer" if kind == "integer" else "text" for k, kind in kinds.items()}
        return _collect(path, layout, loose, rows)
    except pa.ArrowInvalid as error:
        raise FileError(f"{path.name}: {str(error).splitlines()[0]}; mend the file") from None


def _collect(
    path: Path, layout: Layout, kinds: dict[int, str], rows: int
) -> dict[int, np.ndarray | pa.ChunkedArray]:
    """Columns read piece by piece into arrays of full length: no second copy in memory."""
    numbers = {k: np.empty(rows) for k, kind in kinds.items() if kind == "number"}
    others: dict[int, list[pa.Array]] = {k: [] for k in kinds if k not in numbers}
    at = 0
    for piece in _pieces(path, layout, PIECE):
        if not piece.strip():
            continue  # Arrow refuses nothing but blank lines
        table = _read_csv(piece, layout, kinds)
        for k, column in numbers.items():
            column[at : at + table.num_rows] = table.column(str(k)).to_numpy()
        for k, chunks in others.items():
            chunks += table.column(str(k)).chunks
        at += table.num_rows
    whole: dict[int, Any] = {k: column[:at] for k, column in numbers.items()}
    return whole | {k: pa.chunked_array(c, TYPES[kinds[k]]) for k, c in others.items()}


def _narrow(path: Path, layout: Layout, kinds: dict[int, str]) -> Layout:
    """The layout from the first stretch on that Arrow cannot read; a search of all is slow."""
    offset, line = layout.offset, layout.line
    for piece in _pieces(path, layout, SAMPLE_BYTES):
        try:
            _read_csv(piece, layout, kinds)
        except pa.ArrowInvalid:
            break
        offset += len(piece)
        line += len(re.findall(rb"\r\n|\r|\n", piece))
    return replace(layout, offset=offset, line=line)


def _pieces(path: Path, layout: Layout, size: int) -> Iterator[bytes]:
    """The rows of the file, whole lines of some `size` bytes at a time."""
    with path.open("rb") as file:
        file.seek(layout.offset)
        left = math.inf if layout.end is None else layout.end - layout.offset
        while left > 0:
            piece = file.read(size) + file.readline() if left > size else file.read(int(left))
            if not piece:
                return
            piece = piece[: int(left)] if len(piece) > left else piece
            left -= len(piece)
            piece = FORTRAN.sub(b"E", piece) if layout.fortran else piece
            piece = piece.replace(MINUS.encode(), b"-")
            yield _without_remarks(piece, layout) if layout.remarks else piece


def _without_remarks(piece: bytes, layout: Layout) -> bytes:
    """The rows without a word behind their last cell."""
    cut = re.escape(layout.delimiter.encode())
    row = rb"(?m)^((?:[^%b\r\n]*%b){%d}[^%b\r\n]*)%b[^%b\r\n]*(?=\r|\n|$)"
    return re.sub(row % (cut, cut, len(layout.headers) - 1, cut, cut, cut), rb"\1", piece)


def _single(piece: bytes) -> bytes:
    """Every run of blanks and tabs as one blank: Arrow's delimiter is one character."""
    piece = re.sub(rb"[ \t]+", b" ", piece).strip(b" ")
    return re.sub(rb" ?([\r\n]) ?", rb"\1", piece)


def _read_csv(piece: bytes, layout: Layout, kinds: dict[int, str]) -> pa.Table:
    """One piece as an Arrow table. Raises ArrowInvalid, also where a quote runs over lines."""
    quoted = b'"' in piece
    piece = _single(piece) if layout.delimiter == " " else piece
    table = pyarrow.csv.read_csv(
        pa.BufferReader(piece),
        pyarrow.csv.ReadOptions(
            column_names=[str(k) for k in range(len(layout.headers))], block_size=BLOCK
        ),
        pyarrow.csv.ParseOptions(delimiter=layout.delimiter, quote_char='"' if quoted else False),
        pyarrow.csv.ConvertOptions(
            column_types={str(k): TYPES[kind] for k, kind in kinds.items()},
            include_columns=[str(k) for k in kinds],
            null_values=list(MISSING),
            decimal_point=layout.decimal,
        ),
    )
    if quoted and table.num_rows != sum(line != b"" for line in re.split(rb"[\r\n]+", piece)):
        raise pa.ArrowInvalid("a quoted cell runs over the end of its line")
    return table


def _survey(path: Path, layout: Layout, notes: list[str]) -> int:
    """Number of lines below the header, an upper bound of the rows.

    Raises FileError for a NUL byte: a file with holes may seem to be larger than any disk.
    """
    feeds = returns = pairs = 0
    last = b""
    with path.open("rb") as file:
        file.seek(layout.offset)
        while block := file.read(BLOCK):
            feeds += block.count(b"\n")
            returns += block.count(b"\r")
            pairs += block.count(b"\r\n") + (last == b"\r" and block[:1] == b"\n")
            last = block[-1:]
            if b"\0" in block:
                find_fault(path, layout, [""] * len(layout.headers))
    if (pairs > 0) + (feeds > pairs) + (returns > pairs) > 1:
        notes.append("mixed line ends")
    return feeds + returns - pairs + 1


# The line that keeps a text file from being read, and what is wrong with that line.
#
# The search runs only after the fast reader gave up, so it may be slow.

LONGEST_LINE = 2**24  # bytes; longer ones are looked at in pieces
REMEDY = "mend the file, empty the cell, or leave the column out (data.channels)"


def find_fault(path: Path, layout: Layout, names: Sequence[str], length: float = math.inf) -> None:
    """Raise FileError for the first faulty line within `length` bytes; return if all are right.

    `names` are of all columns, "" for a column that is not read.
    """
    for number, text in _lines(path, layout, length):
        if "\0" in text:
            raise FileError(
                f"{path.name}: line {number} holds a NUL byte; expected text; "
                "was the logger cut off? delete that line"
            )
        if not text or (layout.delimiter == " " and not text.strip()):
            continue
        cells = _cells(path, number, text, layout)
        for k, cell in enumerate(cells):
            fault = _cell_fault(cell, layout.kinds[k], layout.decimal) if names[k] else ""
            if fault:
                raise FileError(
                    f"{path.name}: line {number}, column {names[k]!r}: {shorten(cell)} is {fault}"
                )


def _lines(path: Path, layout: Layout, length: float) -> Iterator[tuple[int, str]]:
    with path.open("rb") as file:
        file.seek(layout.offset)
        number, read = layout.line, 0
        while piece := file.readline(LONGEST_LINE):
            bare = piece.removesuffix(b"\n").removesuffix(b"\r")
            if layout.end is not None and layout.offset + read >= layout.end:
                return
            for line in bare.split(b"\r"):  # line ends of old Macs
                yield number, line.decode("utf-8", errors="replace")
                number += 1
            read += len(piece)
            if read >= length:
                return


def _cells(path: Path, number: int, text: str, layout: Layout) -> list[str]:
    width = len(layout.headers)
    try:
        cells = split(text, layout.delimiter, strict=True)
    except csv.Error:
        raise FileError(
            f"{path.name}: line {number} has a quote that is never closed or ends in mid-cell: "
            f"{shorten(text)}; expected pairs of quotes around whole cells; mend that line"
        ) from None
    if len(cells) == width:
        if [cell.strip() for cell in cells] == layout.headers:
            raise FileError(
                f"{path.name}: line {number} repeats the header: another recording begins there; "
                "make two files of it"
            )
        return cells
    if text.lstrip().startswith(COMMENT):
        raise FileError(
            f"{path.name}: line {number} is a comment amid the rows: {shorten(text)}; delete it"
        )
    hint = "mend or delete that line"
    if layout.delimiter == "," and len(cells) == 2 * width:
        hint = "if the commas are decimal, export the file with semicolons between its cells"
    raise FileError(
        f"{path.name}: line {number} has {len(cells)} cells; expected {width} as in the header; "
        f"{hint}"
    )


def _cell_fault(text: str, kind: str, decimal: str) -> str:
    """Fault of a cell with its remedy, "" for a cell without fault."""
    cell = text.strip()
    if cell in MISSING:
        return ""
    numeric = is_number(cell, decimal)
    if kind == "text":
        return f"a number in a column of text; {REMEDY}" if numeric else ""
    if kind == "time":
        return "" if is_time(cell) else f"no time as above it; {REMEDY}"
    if numeric:
        return ""
    if cell.startswith(COMMENT):
        return "a comment amid the rows; expected a number; delete that line"
    if DATE.fullmatch(cell):
        return f"a date; expected a number as above it; {REMEDY}"
    return spoilt_number(cell, decimal) or f"no number; {REMEDY}"
