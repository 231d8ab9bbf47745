"""Layout of a text file by what its first rows are: delimiter, decimal sign, names, units, values.

Each row of the head is told by its cells: names, units, numbers, a value with its key, a title. The
rows begin where cells fit the columns below. What can be read in two ways is an error with a remedy
that was tried on the file.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product, takewhile
from pathlib import Path
from typing import Any

from data.measured.files.columns import FileError, Request, shorten
from data.measured.files.text_cells import (
    FORTRAN,
    MISSING,
    is_decimal_comma,
    is_number,
    is_time,
    kind_of_column,
    split,
    spoilt_number,
)
from data.measured.files.text_head import ask_whether_wrapped, facts_of, points_of
from data.measured.units import is_unit, signal_by_words, split_brackets

SAMPLE_BYTES = 2**20  # looked at for the first rows, or for a fault
SAMPLE_ROWS = 200
FEW = 10  # rows, of which half may be damaged
BLANK = 2**16  # bytes looked at in one go for rows without values at the end
DELIMITERS = ("\t", ";", ",", "|", " ")  # in this order of trust; " " stands for any white space
CALLED = {"\t": "tab", " ": "white space"}
COMMENT = ("#", "%")
UNKNOWN = "\N{REPLACEMENT CHARACTER}"  # of another alphabet, in an encoding that no file says
FOREIGN = re.compile(  # not in Western words of Windows-1252; a row of dashes or quotes is no word
    r"(?=[^\0-\x7f]*[À-ÿ][^\0-\x7f]*[À-ÿ])[^\0-\x7f]{3}|[ƒ†‡ˆ‹›˜Ÿ]|[a-z][ŠŒŽ]"
)
PAIR = re.compile(rb"[\x81-\xfe][\x40-\xfe]|[\x80-\xff]")  # a character of one byte or of two


@dataclass
class Layout:
    """Where the rows begin and what their cells are."""

    delimiter: str
    decimal: str
    headers: list[str]  # as written, units included; c1 … ck where the file has none
    kinds: list[str]  # of each column: "number", "integer" (beyond 2^53), "time" or "text"
    line: int  # line number of the first row, counted from 1
    offset: int  # of that line in the file [bytes]
    notes: list[str]
    units: dict[int, str] = field(default_factory=dict)  # by column, from a row of units
    end: int | None = None  # where comments or empty rows follow the last row [bytes]
    facts: dict[str, float] = field(default_factory=dict)  # of the lines before the header
    remarks: bool = False  # some rows have a remark behind their last cell
    fortran: bool = False  # exponents begin with a D
    points: int | None = None  # of one series that is written in several columns


@dataclass(frozen=True)
class Line:
    """One of the first lines of a text file."""

    number: int  # counted from 1
    offset: int  # [bytes]
    text: str

    @property
    def bare(self) -> str:
        """The text without the sign of a comment before it."""
        return re.sub(r"^(?!%\s?g\b)[#%][#% ]*", "", self.text)  # %g is a unit


@dataclass(frozen=True)
class Table:
    """The lines of a file as rows of `width` cells."""

    lines: Sequence[Line]
    delimiter: str
    decimal: str

    def cells(self, line: Line, bare: bool = False) -> list[str]:
        """The cells of a line, stripped."""
        return [cell.strip() for cell in split(line.bare if bare else line.text, self.delimiter)]

    @cached_property
    def tail(self) -> list[list[str]]:
        """The last rows with a digit, which a head does not reach."""
        rows = [line for line in self.lines if re.search(r"\d", line.text)]
        return [self.cells(line) for line in rows[-SAMPLE_ROWS:]]

    @cached_property
    def width(self) -> int:
        """Cells of most of the last rows."""
        rows = self.tail or [self.cells(self.lines[0])]
        return Counter(map(len, rows)).most_common(1)[0][0]

    @cached_property
    def rows(self) -> list[list[str]]:
        """Those of the last rows that have as many cells as most."""
        return [row for row in self.tail if len(row) == self.width]

    def is_value(self, cell: str) -> bool:
        return is_number(cell, self.decimal) or is_time(cell)

    def may_be_row(self, cells: Sequence[str]) -> bool:
        """Whether cells can be a row: they hold a number or a time, or are all empty."""
        filled = [cell for cell in cells if cell not in MISSING]
        return not filled or any(map(self.is_value, filled))

    def fits(self, cells: Sequence[str], kinds: Sequence[str]) -> bool:
        """Whether cells are a row of columns of these kinds."""
        return (
            len(cells) == len(kinds)
            and self.may_be_row(cells)
            and all(
                k == "text" or c in MISSING or self.is_value(c) or spoilt_number(c, self.decimal)
                for c, k in zip(cells, kinds, strict=True)
            )
        )

    def names(self, line: Line, between: bool = False) -> list[str] | None:
        """The cells of a row of words; None for others.

        between: also where other delimiters, or several blanks, part the words. One name more is
        left out where it is blank or its cells are remarks in some rows; one less where rows end
        with a delimiter.
        """
        for cells in self._cut(line.bare) if between else [self.cells(line, bare=True)]:
            if len(cells) == self.width + 1 and (not cells[-1] or self.remarks):
                cells = cells[:-1]
            if len(cells) == self.width - 1 > 0 and self.closed:
                cells = [*cells, ""]
            key = {":", "="} & set(cells) or (self.width == 1 and _is_key(cells[0]))
            key = key or (self.delimiter == " " and any(c.endswith(":") for c in cells[:-1]))
            spoilt = all(spoilt_number(c, self.decimal) for c in cells if c)
            if len(cells) == self.width and not (key or spoilt or self.may_be_row(cells)):
                return cells
        return None

    @cached_property
    def remarks(self) -> bool:
        """Whether some rows have a word behind their last cell."""
        longer = (c for c in map(self.cells, self.lines) if len(c) == self.width + 1)
        return any(self.is_value(c[0]) and c[-1] and not self.is_value(c[-1]) for c in longer)

    @cached_property
    def closed(self) -> bool:
        """Whether all rows end with a delimiter."""
        return self.delimiter != " " and all(not row[-1] for row in self.rows)

    def _cut(self, text: str) -> Iterator[list[str]]:
        yield [cell.strip() for cell in re.split(r"\t+|\s{2,}", text.strip())]
        if self.delimiter == " ":  # Time (s), Acc 1 (g)
            yield [cell.strip() for cell in re.findall(r"[^\s([{]+(?:\s*[([{][^])}]*[])}])?", text)]
        for other in DELIMITERS if self.delimiter == " " or self.delimiter not in text else ():
            yield [cell.strip() for cell in split(text, other)]


def _is_key(text: str) -> bool:
    """Whether a line of a single cell is a key with its value, UNITS: g; no name, as acc: g is."""
    key, colon, value = text.partition(":")
    named = is_unit(value.strip()) and signal_by_words(key) not in (None, "time")  # no lone clock
    return bool(key and colon) and not named


def layout_of(path: Path, request: Request, tried: bool = False) -> Layout:
    """Layout of a text file. Raises FileError where its first lines can be read in two ways.

    tried: whether this is advice that is tried before it is given.
    """
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
    table = _separated(path, kept, request, announced[1] if announced else None, notes)
    layout = _laid_out(path, table, lines, request, notes, tried)
    before = [line.text for line in lines if skipped < line.number < layout.line]
    layout.facts = facts_of(before, notes, table.decimal)
    layout.headers = _readable(layout.headers)
    rows = [table.cells(line) for line in kept if line.number >= layout.line][:SAMPLE_ROWS]
    rows = [row for row in rows if len(row) == len(layout.headers)]
    columns = zip(*rows, strict=True) if rows else [()] * len(layout.headers)
    layout.kinds = [kind_of_column(column, table.decimal) for column in columns]
    layout.fortran = any(FORTRAN.search(cell.encode()) for row in rows for cell in row)
    layout.end = _end(path, layout)
    return layout


def _end(path: Path, layout: Layout) -> int | None:
    """Offset behind the last row, where comments or rows without values follow; None without."""
    empty = b' \t\r\n"' + layout.delimiter.encode()
    start, tail = path.stat().st_size, b""
    with path.open("rb") as file:
        while start > layout.offset and (not tail.strip(empty) or len(tail) < BLANK):
            begin = max(layout.offset, start - BLANK)
            file.seek(begin)
            tail, start = file.read(start - begin) + tail, begin
    last = len(tail.rstrip(empty))
    rest = re.split(rb"\r\n|\r|\n", tail[last:])
    rows = sum(layout.delimiter.encode() in line for line in rest[1:] if layout.delimiter != " ")
    lines = reversed(list(re.finditer(rb"[^\r\n]*[^\s][^\r\n]*", tail[:last])))  # with any text
    words = list(takewhile(lambda line: _is_footer(line, layout), lines))
    if words and words[-1].start() > 0:
        what = f"{len(words)} line{'s' * (len(words) > 1)} without a number"
        if all(line[0].lstrip().startswith((b"#", b"%")) for line in words):
            what = "comments"
        layout.notes.append(f"{what} at the end left out")
        return start + words[-1].start()
    if not rows or not last:
        return None
    layout.notes.append(f"{rows} rows without values at the end left out")
    return start + last + len(rest[0]) + 1


def _is_footer(line: re.Match[bytes], layout: Layout) -> bool:
    """Whether a line behind the rows is a comment, or holds no value and nothing meant as one."""
    text = line[0].decode("utf-8", "replace")
    cells = [cell.strip() for cell in split(text, layout.delimiter)]
    told = (is_number(c, layout.decimal) or is_time(c) or spoilt_number(c, layout.decimal)
            for c in cells)  # fmt: skip
    return text.lstrip().startswith(COMMENT) or not any(told)


def _first_lines(path: Path, notes: list[str]) -> list[Line]:
    with path.open("rb") as file:
        head = file.read(SAMPLE_BYTES)
        whole = not file.read(1)
    if b"\0" in head[:2]:
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
    texts = _decode([piece[1] for piece in pieces], notes)
    lines = [
        Line(number, start + piece.start(), text)
        for number, (piece, text) in enumerate(zip(pieces, texts, strict=True), start=1)
    ]
    for line in lines:
        if "\0" in line.text:
            raise FileError(
                f"{path.name}: line {line.number} holds a NUL byte; expected text; "
                "was the logger cut off? delete that line"
            )
    return lines


def _decode(lines: Sequence[bytes], notes: list[str]) -> list[str]:
    """Lines in UTF-8 or Windows-1252; of other encodings, which numbers have in common, ASCII."""
    with suppress(UnicodeDecodeError):
        return [line.decode("utf-8") for line in lines]
    texts = [line.decode("cp1252", errors="replace") for line in lines]
    if not any(UNKNOWN in text or FOREIGN.search(text) for text in texts):
        notes.append("not UTF-8, taken for Windows-1252")
        return texts
    notes.append("neither UTF-8 nor Windows-1252: of names, letters and digits of ASCII are kept")
    return [PAIR.sub(UNKNOWN.encode(), line).decode() for line in lines]


def _readable(headers: Sequence[str]) -> list[str]:
    """Names without characters that are not known; those that say nothing then, by their column."""
    headers = [re.sub(r"\s", " ", header) for header in headers]  # of any script, \u3000
    headers = ["".join(c if c.isprintable() else UNKNOWN for c in name) for name in headers]
    names = [re.sub(f"{UNKNOWN}+", "_", split_brackets(header)[0]) for header in headers]
    readable = list(headers)
    for k, (header, name) in enumerate(zip(headers, names, strict=True)):
        if UNKNOWN in header:
            unit = split_brackets(header)[1] or ""
            tells = names.count(name) == 1 and re.search(r"[A-Za-z0-9]", name)
            readable[k] = f"{name if tells else f'c{k + 1}'}{f' [{unit}]' if is_unit(unit) else ''}"
    return readable


def _separated(
    path: Path, kept: Sequence[Line], request: Request, announced: str | None, notes: list[str]
) -> Table:
    """The lines with the delimiter and the decimal sign that make most cells values."""
    stated = request.delimiter or announced
    points = (request.decimal,) if request.decimal else (".", ",")
    best, most = None, -1.0
    for delimiter, decimal in product(DELIMITERS, points):
        if delimiter != decimal:
            table = Table(kept, delimiter, decimal)
            share = _share_of_values(table, request)
            if share is not None and share > most + 0.05:  # by more than single cells
                best, most = table, share
    detected = best.delimiter if best else None
    if stated is not None and detected and not any(len(split(k.text, stated)) > 1 for k in kept):
        raise FileError(
            f"{path.name}: delimiter {stated!r} occurs in no row, but the rows look delimited by "
            f"{CALLED.get(detected, repr(detected))}; set data.delimiter={detected!r}"
        )
    if stated is not None:
        table = Table(kept, stated, request.decimal or ".")
        comma = replace(table, decimal=",")
        told = request.decimal or stated == "," or _share_of_values(comma, request) is None
        best = table if told else comma
    best = best or Table(kept, ";" if request.decimal == "," else ",", request.decimal or ".")
    if stated is None and detected and detected != ",":
        notes.append(f"delimiter {CALLED.get(detected, repr(detected))}")
    if best.decimal == "," and request.decimal is None:
        notes.append("decimal commas")
    return best


def _share_of_values(table: Table, request: Request) -> float | None:
    """Share of cells that are values where almost all rows have equally many; None for others.

    Decimal commas count where nothing else can be meant: no cell has a point, and not all of them
    may be thousands.
    """
    rows = table.tail or [table.cells(line) for line in table.lines[1:] or table.lines]
    width, times = Counter(map(len, rows)).most_common(1)[0]
    if width < 2 or times < (0.8 if len(rows) > FEW else 0.5) * len(rows):
        return None
    cells = [cell for row in rows if len(row) == width for cell in row if cell not in MISSING]
    if table.decimal == "," and request.decimal is None and not is_decimal_comma(cells):
        return None
    spoilt = sum(not table.is_value(c) and bool(spoilt_number(c, table.decimal)) for c in cells)
    return (sum(map(table.is_value, cells)) + 0.9 * spoilt) / max(len(cells), 1)


def _laid_out(
    path: Path, table: Table, lines: Sequence[Line], request: Request, notes: list[str], tried: bool
) -> Layout:
    """Layout with the names above the rows. Raises FileError where there are none, or two kinds.

    lines: all of the beginning of the file, blank and skipped ones included.
    """
    kept, width = table.lines, table.width
    first, block = _above(path, table, request, between=False)
    before = [line.text for line in lines if first is None or line.number < kept[first].number]
    points = None if block or first is None else points_of(path, kept[first].offset, width, before)
    if request.header and not block and first != 0 and not points:
        first, block = _above(path, table, request, between=True)
    layout = Layout(table.delimiter, table.decimal, [], [], 0, 0, notes)
    if first is not None:
        layout.line, layout.offset = kept[first].number, kept[first].offset
    if block:
        layout.remarks = table.remarks
        _name(layout, table, block)
        return layout
    layout.points = points
    if first is not None and not points:
        ask_whether_wrapped(path, width, [table.cells(line) for line in kept[first:]])
    if first is None or (not points and (request.header or first > 0)):
        _refuse(path, table, first, request, tried)
    layout.headers = [f"c{k + 1}" for k in range(width)]
    if not points:
        notes.append(f"no header, columns named c1 … c{width}")
    return layout


def _above(
    path: Path, table: Table, request: Request, between: bool
) -> tuple[int | None, list[Line]]:
    """Place of the first row, and the lines of names, units and words above it."""
    kinds = [kind_of_column(column, table.decimal) for column in zip(*table.rows, strict=True)]
    kinds = kinds if set(kinds) - {"text"} else ["number"] * table.width
    kept, uneven = table.lines, None
    for k, line in enumerate(kept[: SAMPLE_ROWS + 1]):
        follow = [table.cells(after) for after in kept[k : k + 2]]
        if all(table.fits(cells, kinds) for cells in follow):
            return (uneven if between else None) or (k, [])
        if request.header and table.names(line, between):
            below = range(k + 1, len(kept))
            keyed = kinds[0] != "text"
            end = next((j for j in below if not _explains(table, kept[j], between, keyed)), None)
            if end is None:
                raise FileError(f"{path.name} holds a header and no rows; expected at least 2 rows")
            count = len(table.cells(kept[end]))
            if _another_begins(table, kept, k, end):
                continue
            if count == table.width or (count == table.width + 1 and table.remarks):
                while k > 0 and table.names(kept[k - 1], between=True):
                    k -= 1  # names with blanks, above rows that blanks part
                return end, list(kept[k:end])
            uneven = uneven or (end, list(kept[k:end]))
    return (uneven if between else None) or (None, [])


def _another_begins(table: Table, kept: Sequence[Line], k: int, end: int) -> bool:
    """Whether below names in line k and rows from `end` on a longer table begins.

    Such are the results of a testing machine, above its samples. A table of the same names is
    another recording, and is refused as such where the rows are read.
    """
    own = table.names(kept[k])
    for j in range(end + 1, min(end + SAMPLE_ROWS, len(kept)) if table.width > 1 else 0):
        names = table.names(kept[j])
        apart = names and names != own and all(names) and len(set(names)) == len(names)
        if names and apart and _telling(names)[1] >= _telling(own or [])[1]:
            return 2 * (j - end) < len(kept) - end
    return False


def _explains(table: Table, line: Line, between: bool, keyed: bool) -> bool:
    """Whether a line below names may explain them: it holds no value, or is of words, too.

    Or it is a key with its values, `Range, 50, 50`. keyed: the first column of the rows has none.
    """
    cells = table.names(line, between) or table.cells(line, bare=True)
    if re.match(rf"[^\W\d]|{UNKNOWN}", cells[0]) and keyed:
        return True
    return not any(table.is_value(c) or spoilt_number(c, table.decimal) for c in cells)


def _name(layout: Layout, table: Table, block: Sequence[Line]) -> None:
    """Names, and units from a row of their own, of the lines above the rows."""
    rows = ((line, table.names(line) or table.names(line, between=True)) for line in block)
    words = {line: cells for line, cells in rows if cells}
    units = {line: cells for line, cells in words.items() if _are_units(cells)}
    names = {line: cells for line, cells in words.items() if line not in units} or words
    chosen = max(names, key=lambda line: (*_telling(names[line]), line.number))
    layout.headers = names.pop(chosen)
    units.pop(chosen, None)
    above = [cells for line, cells in names.items() if line.number < chosen.number]
    below = next((cells for line, cells in names.items() if line.number > chosen.number), [])
    unit = next(iter(units.values()), layout.headers)
    apart = len({*zip(layout.headers, unit, strict=True)}) == len(unit)
    if not _telling(layout.headers)[0] and not apart and above:  # names of groups, and within them
        layout.headers = _within(above[-1], layout.headers)
    elif (
        below and not all(layout.headers) and all(map(max, zip(layout.headers, below, strict=True)))
    ):
        layout.headers = _within(layout.headers, below)
    if chosen is not table.lines[0]:
        layout.notes.append(f"header found in line {chosen.number}")
    if chosen.bare != chosen.text:
        layout.notes.append(f"{chosen.text[0]!r} before the header left out")
    if units:
        line = min(units, key=lambda line: abs(line.number - chosen.number))
        bare = [cell.strip("[](){}") for cell in units[line]]
        layout.units = {k: unit for k, unit in enumerate(bare) if is_unit(unit)}
        layout.notes.append(f"line {line.number} holds units")
    for line in block[block.index(chosen) + 1 :]:
        if line not in units:
            layout.notes.append(f"line {line.number} left out: {shorten(line.text)}")


def _within(groups: Sequence[str], names: Sequence[str]) -> list[str]:
    """Names with that of their group before them, which is written above the first of it."""
    group, found = "", []
    for cell, name in zip(groups, names, strict=True):
        group = cell or group
        found.append(f"{group} {name}".strip())
    return found


def _are_units(cells: Sequence[str]) -> bool:
    """Whether half of the cells are units at least, and no other says a signal, or a key first."""
    named = [cell.strip("[](){}") for cell in cells if cell not in (*MISSING, "-")]
    other = [cell for cell in named if not is_unit(cell)]
    long = [cell for cell in other if len(cell) > 4]
    key = named[0] in long and not re.search(r"(?i)unit|einheit|mm:ss", named[0]) if named else True
    return 2 * len(other) <= len(named) and not key and not any(map(signal_by_words, long))


def _telling(cells: Sequence[str]) -> tuple[bool, int]:
    """Whether cells tell columns apart, and how many sound like a signal or have a unit."""
    filled = [cell for cell in cells if cell]
    apart = len(set(filled)) == len(filled) and 2 * len(filled) > len(cells)
    return apart, sum(bool(signal_by_words(c) or split_brackets(c)[1]) for c in filled)


def _works(path: Path, request: Request, **change: Any) -> bool:
    """Whether a file's layout is understood with a change of the request, which may be advised."""
    try:
        layout_of(path, replace(request, **change), tried=True)
    except FileError:
        return False
    return True


def _refuse(path: Path, table: Table, first: int | None, request: Request, tried: bool) -> None:
    """Raise FileError saying what the lines above the rows are, with advice that works."""
    kept, width = table.lines, table.width
    one, cells = kept[0], table.cells(kept[0])
    other = next((line for line in kept[SAMPLE_ROWS:] if table.names(line)), None)
    if first is None and other is not None:
        raise FileError(
            f"{path.name}: line {other.number}, {shorten(other.text)}, begins another table, "
            "unlike that above it; write a file for each"
        )
    spoilt = (
        f"{shorten(cell)} is {why}"
        for cell in (cell for row in table.rows for cell in row)
        if (why := spoilt_number(cell, table.decimal))
    )
    if first is None and (said := next(spoilt, "")):
        raise FileError(f"{path.name}: {said}")
    if tried or first is None:
        raise FileError(
            f"{path.name}: line {one.number}, {shorten(one.text)}, is no header of the rows below "
            "it, which hold no numbers; write a line of names above rows of numbers"
        )
    row = kept[first]
    settings = {"skip_rows": row.number - 1, "header": False}
    skip = f"set data.skip_rows={row.number - 1}" if first else "set"
    skip += f"{' and' if first else ''} data.header=false" if request.header else ""
    advice = f"{skip}, or write a header" if _works(path, request, **settings) else "write a header"
    words = [cell for cell in cells if not table.may_be_row([cell])]
    if len(cells) == width and table.may_be_row(cells) and first < 2 and request.header:
        mixed = f"mixes names such as {shorten((*words, '')[0])} with numbers; rename its columns"
        said = f"{mixed}, or {advice}" if words else f"holds numbers, not names; {advice}"
        if len(kept) < width and not any(table.may_be_row(table.cells(row)[:1]) for row in kept):
            said = "is a channel, as is each; write a column for each (transpose)"
        said = f"line {one.number} {said}"
    elif not request.header and table.names(one):
        said = f"line {one.number} is no row of numbers: {shorten(one.text)}; is it a header? then "
        said += "leave data.header=false out"
    elif first > 1 or (len(cells) == 1 and width > 2) or not request.header:
        said = f"line {row.number} looks like the first row of numbers, with no header before it; "
        said += advice
    else:
        hint = f"give each column one name, or {advice}"
        if table.delimiter == "," and width == 2 * len(cells):
            known = _works(path, request, decimal=",")
            hint = 'set data.decimal=","' if known else "export it with semicolons between cells"
            hint = f"if the commas are decimal, {hint}"
        said = f"line {one.number} has {len(cells)} cells, line {row.number} has {width}; {hint}"
    raise FileError(f"{path.name}: {said}")
