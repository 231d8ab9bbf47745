"""Layout of a text file, judged by its first lines: delimiter, header, kinds of columns.

An ambiguous layout is an error with its remedy, never a guess.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from data.measured.files.columns import FileError, Request, shorten
from data.measured.files.text_cells import ISO_TIME, MISSING, is_number, kind_of_column, split
from data.measured.units import is_unit

SAMPLE_BYTES = 2**20
SAMPLE_ROWS = 200
TAIL_BYTES = 2**16
DELIMITERS = ("\t", ";", ",", " ")  # in this order of trust; " " stands for any white space
CALLED = {"\t": "tab", " ": "white space"}
COMMENT = ("#", "%")


@dataclass
class Layout:
    """Where the rows begin and what their cells are."""

    delimiter: str
    headers: list[str]  # as written, units included; c1 … ck where the file has none
    kinds: list[str]  # of each column: "number", "integer" (beyond 2^53), "time" or "text"
    line: int  # line number of the first row, counted from 1
    offset: int  # of that line in the file [bytes]
    notes: list[str]
    units: dict[int, str] = field(default_factory=dict)  # by column, from a row of units
    end: int | None = None  # where comments follow the last row [bytes]


@dataclass(frozen=True)
class Line:
    """One of the first lines of a text file."""

    number: int  # counted from 1
    offset: int  # [bytes]
    text: str


def layout_of(path: Path, request: Request) -> Layout:
    """Layout of a text file. Raises FileError where its first lines can be read in two ways."""
    notes: list[str] = []
    lines = _first_lines(path, notes)
    announced = re.fullmatch(r"sep=(.)", lines[0].text) if lines else None
    if announced:
        notes.append(f"first line announces the delimiter {announced[1]!r}")
    skipped = max(request.skip_rows, 1 if announced else 0)
    if skipped > (1 if announced else 0):
        notes.append(f"{skipped} preamble lines skipped")
    kept = [line for line in lines if line.number > skipped and line.text.strip()]
    if not kept:
        raise FileError(
            f"{path.name} has {len(lines)} lines, and none is left after data.skip_rows={skipped}"
        )
    delimiter = _delimiter(path, kept, request, announced[1] if announced else None, notes)
    layout = _layout(path, kept, delimiter, request, notes)
    rows = [split(line.text, delimiter) for line in kept if line.number >= layout.line]
    rows = [row for row in rows[:SAMPLE_ROWS] if len(row) == len(layout.headers)]
    cells = zip(*rows, strict=True) if rows else [()] * len(layout.headers)
    layout.end = _comments_at_end(path, layout)
    layout.kinds = [kind_of_column(column, request.decimal) for column in cells]
    return layout


def _comments_at_end(path: Path, layout: Layout) -> int | None:
    """Offset of the comments that follow the last row; None without any."""
    size = path.stat().st_size
    start = max(layout.offset, size - TAIL_BYTES)
    with path.open("rb") as file:
        file.seek(start)
        tail = file.read(TAIL_BYTES)
    found = re.search(rb"((?:\r\n|\n|\r)[ \t]*[#%][^\r\n]*)+\s*\Z", tail)
    if found is None or found.start() == 0:
        return None
    layout.notes.append("comments at the end left out")
    return start + found.start() + 1


def _first_lines(path: Path, notes: list[str]) -> list[Line]:
    with path.open("rb") as file:
        head = file.read(SAMPLE_BYTES)
        whole = not file.read(1)
    if head.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\0" in head[:2]:
        raise FileError(f"{path.name} is UTF-16 text; expected UTF-8; save it as UTF-8 CSV")
    start = 3 if head.startswith(b"\xef\xbb\xbf") else 0
    if start:
        notes.append("byte-order mark")
    pieces = list(re.finditer(rb"([^\r\n]*)(\r\n|\r|\n|\Z)", head[start:]))
    if pieces and not pieces[-1][0]:
        pieces.pop()
    if not whole:
        pieces.pop()  # incomplete
    if not pieces:
        raise FileError(
            f"{path.name}: line 1 is longer than {SAMPLE_BYTES} bytes; expected a header or a row; "
            "is it a text table?"
        )
    lines = [
        Line(number, start + piece.start(), _decode(piece[1], notes))
        for number, piece in enumerate(pieces, start=1)
    ]
    for line in lines:
        if "\0" in line.text:
            raise FileError(
                f"{path.name}: line {line.number} holds a NUL byte; expected text; "
                "was the logger cut off? delete that line"
            )
    return lines


def _decode(line: bytes, notes: list[str]) -> str:
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        notes.append("not UTF-8, taken for Windows-1252")
        return line.decode("cp1252", errors="replace")


def _delimiter(
    path: Path, kept: Sequence[Line], request: Request, announced: str | None, notes: list[str]
) -> str:
    stated = request.delimiter or announced
    detected = _detect([line.text for line in kept[1 : SAMPLE_ROWS + 1]] or [kept[0].text], request)
    if stated is None:
        delimiter = detected or ","
        if detected and detected != ",":
            notes.append(f"delimiter {CALLED.get(delimiter, repr(delimiter))}")
        return delimiter
    if detected and not any(len(split(line.text, stated)) > 1 for line in kept):
        raise FileError(
            f"{path.name}: delimiter {stated!r} occurs in no row, but the rows look delimited by "
            f"{CALLED.get(detected, repr(detected))}; set data.delimiter={detected!r}"
        )
    return stated


def _detect(rows: Sequence[str], request: Request) -> str | None:
    """The first delimiter that cuts almost all rows into equally many cells, more than one."""
    for delimiter in DELIMITERS:
        if delimiter == request.decimal:
            continue
        counts = Counter(len(split(row, delimiter)) for row in rows)
        width, times = counts.most_common(1)[0]
        if width > 1 and times >= 0.8 * len(rows):
            return delimiter
    widest = {d: sum(len(split(row, d)) > 1 for row in rows) for d in DELIMITERS}
    widest.pop(request.decimal, None)
    best = max(widest, key=lambda d: widest[d])
    return best if widest[best] > 0.5 * len(rows) else None


def _layout(
    path: Path, kept: Sequence[Line], delimiter: str, request: Request, notes: list[str]
) -> Layout:
    """Layout below the header. Raises FileError where the first line is no header."""
    first, rest = kept[0], kept[1:]
    counts = Counter(len(split(line.text, delimiter)) for line in rest[:SAMPLE_ROWS])
    width = counts.most_common(1)[0][0] if counts else len(split(first.text, delimiter))
    if not request.header:
        return _without_header(path, kept, width, delimiter, request, notes)
    bare = first.text.lstrip("".join(COMMENT) + " ") if first.text[0] in COMMENT else first.text
    if _is_header(bare, rest, width, delimiter, request.decimal):
        if bare != first.text:
            notes.append(f"{first.text[0]!r} before the header left out")
        return _with_header(path, bare, rest, delimiter, request, notes)
    start = 0 if request.skip_rows else _after_preamble(kept, width, delimiter, request.decimal)
    if start:
        notes.append(f"header found in line {kept[start].number}")
        return _layout(path, kept[start:], delimiter, request, notes)
    _complain(path, kept, width, delimiter, request)
    return _with_header(path, first.text, rest, delimiter, request, notes)


def _after_preamble(kept: Sequence[Line], width: int, delimiter: str, decimal: str) -> int:
    """Place of the one header below lines of another kind; 0 without one."""
    if len(split(kept[0].text, delimiter)) == width and _row_like(
        split(kept[0].text, delimiter), decimal
    ):
        return 0
    for k, line in enumerate(kept[1 : SAMPLE_ROWS + 1], start=1):
        cells = split(line.text, delimiter)
        if len(cells) == width and _row_like(cells, decimal):
            return 0
        bare = line.text.lstrip("".join(COMMENT) + " ")
        if kept[k + 2 :] and _is_header(bare, kept[k + 1 :], width, delimiter, decimal):
            return k
    return 0


def _with_header(
    path: Path, text: str, rest: Sequence[Line], delimiter: str, request: Request, notes: list[str]
) -> Layout:
    if not rest:
        raise FileError(f"{path.name} holds a header and no rows; expected at least 2 rows")
    headers = [cell.strip() for cell in split(text, delimiter)]
    layout = Layout(delimiter, headers, [], rest[0].number, rest[0].offset, notes)
    units = [cell.strip().strip("[]()") for cell in split(rest[0].text, delimiter)]
    if len(rest) > 1 and len(units) == len(headers) and _are_units(units):
        layout.line, layout.offset = rest[1].number, rest[1].offset
        layout.units = {k: unit for k, unit in enumerate(units) if unit}
        notes.append(f"line {rest[0].number} holds units")
    return layout


def _are_units(cells: Sequence[str]) -> bool:
    named = [cell for cell in cells if cell not in ("", "-")]
    return bool(named) and all(is_unit(cell) for cell in named)


def _without_header(
    path: Path,
    kept: Sequence[Line],
    width: int,
    delimiter: str,
    request: Request,
    notes: list[str],
) -> Layout:
    cells = split(kept[0].text, delimiter)
    if len(cells) != width or not _row_like(cells, request.decimal):
        if not _is_header(kept[0].text, kept[1:], width, delimiter, request.decimal):
            _complain(path, kept, width, delimiter, request)
        raise FileError(
            f"{path.name}: line {kept[0].number} is no row of numbers: {shorten(kept[0].text)}; "
            "is it a header? then leave data.header=false out"
        )
    headers = [f"c{k + 1}" for k in range(len(cells))]
    notes.append(f"no header, columns named c1 … c{len(cells)}")
    return Layout(delimiter, headers, [], kept[0].number, kept[0].offset, notes)


def _row_like(cells: Sequence[str], decimal: str) -> bool:
    """Whether the cells can be a row: they hold a number or a time, or are all empty."""
    filled = [cell.strip() for cell in cells if cell.strip() not in MISSING]
    return not filled or any(is_number(c, decimal) or ISO_TIME.fullmatch(c) for c in filled)


def _is_header(text: str, rest: Sequence[Line], width: int, delimiter: str, decimal: str) -> bool:
    cells = split(text, delimiter)
    if len(cells) != width or _row_like(cells, decimal):
        return False
    following = [split(line.text, delimiter) for line in rest[:2]]
    if following and _are_units([cell.strip().strip("[]()") for cell in following[0]]):
        following = following[1:]
    return not following or _row_like(following[0], decimal)


def _complain(
    path: Path, kept: Sequence[Line], width: int, delimiter: str, request: Request
) -> None:
    """Raise FileError saying what the first line is, unless it may be a header after all."""
    first, cells = kept[0], split(kept[0].text, delimiter)
    if request.header and len(cells) == width and _row_like(cells, request.decimal):
        names = [cell for cell in cells if not _row_like([cell], request.decimal)]
        if names:
            raise FileError(
                f"{path.name}: line {first.number} mixes names such as {shorten(names[0])} with "
                "numbers; expected a header; rename its columns, or set data.header=false"
            )
        raise FileError(
            f"{path.name}: line {first.number} holds numbers, not names; "
            "set data.header=false, or write a header"
        )
    _point_at_start(path, kept, width, delimiter, request)
    if len(cells) != width:
        row = next(line for line in kept[1:] if len(split(line.text, delimiter)) == width)
        hint = "give each column one name, or skip that line (data.skip_rows)"
        if delimiter == "," and width == 2 * len(cells):
            hint = 'if the commas are decimal, set data.decimal="," and data.delimiter'
        elif width == len(cells) + 1 and row.text.rstrip(" ").endswith(delimiter):
            hint = "rows end with a delimiter; end the header with one, too"
        raise FileError(
            f"{path.name}: line {first.number} has {len(cells)} cells, line {row.number} has "
            f"{width}; expected as many; {hint}"
        )


def _point_at_start(
    path: Path, kept: Sequence[Line], width: int, delimiter: str, request: Request
) -> None:
    """Raise FileError where a later line looks like the header, or like the first row."""
    for k, line in enumerate(kept[1 : SAMPLE_ROWS + 1], start=1):
        bare = line.text.lstrip("".join(COMMENT) + " ")
        skip = f"set data.skip_rows={line.number - 1}"
        if _is_header(bare, kept[k + 1 :], width, delimiter, request.decimal) and kept[k + 1 :]:
            other = "" if request.header else " and leave data.header=false out"
            raise FileError(
                f"{path.name}: line {line.number} looks like the header "
                f"({shorten(line.text)}); {skip}{other}"
            )
        cells = split(line.text, delimiter)
        if len(cells) == width and _row_like(cells, request.decimal):
            short = width == 2 or len(split(kept[0].text, delimiter)) > 1
            if k == 1 and request.header and short:
                return  # that line 1 is a header of the wrong length says more
            raise FileError(
                f"{path.name}: line {line.number} looks like the first row of numbers, with no "
                f"header before it; {skip} and data.header=false"
            )
