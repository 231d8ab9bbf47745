"""JSON: named lists, a list of rows under "data", or a list of objects."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]

from data.measured.files.columns import (
    EXACT,
    GIB,
    Contents,
    FileError,
    Request,
    as_float,
    check_size,
    choose,
    facts_in_common,
    leave_out,
    name_columns,
    require_one_length,
    seconds,
    shorten,
)
from data.measured.files.format import Format
from data.measured.files.text_cells import BLANKS, OBJECT, to_times

NAMES = ("name", "channel", "label", "sensor", "id")  # of a series, by what a logger calls it
LARGEST = GIB  # bytes; Python needs about ten times as much to hold them


def read_json(path: Path, request: Request) -> Contents:
    """Columns of {"t": […], "a": […]}, {"data": [[…], …]} (c1, c2, …) or [{"t": …, "a": …}, …].

    Lists in objects of objects are named by their path, test.force. Other scalars become facts,
    other text notes. Raises FileError for ragged rows, text among numbers, and lists of lists.
    """
    contents = Contents()
    lists = _lists(path, _parse(path), contents)
    lists = _without_stubs(lists, request, contents.notes)
    names, units = name_columns(path, list(lists))
    contents.units |= units
    chosen = choose(path, names, request.columns)
    by_name = dict(zip(names, lists.values(), strict=True))
    require_one_length(path, {name: len(by_name[name]) for name in chosen})
    for name in chosen:
        column = _column(path, name, by_name[name], contents)
        if column is not None:
            contents.columns[name] = column
        else:
            leave_out(path, name, "text", request.columns, contents.notes)
    known = contents.units.items()
    contents.units = {name: unit for name, unit in known if name in contents.columns}
    return contents


JSON = Format(
    "JSON",
    (".json", ".jsonl", ".ndjson"),
    read_json,
    opening=rb"%b|%b\[\s*[\[{](?!.*\0)" % (OBJECT, BLANKS),
    called="JSON",
)


def _parse(path: Path) -> Any:
    if path.stat().st_size > LARGEST:
        raise FileError(
            f"{path.name} has more than {LARGEST // GIB} GiB; expected less of JSON; "
            "save it as Parquet"
        )

    size = path.stat().st_size
    check_size(path, 12 * size, size)

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        values = dict(pairs)
        if len(values) < len(pairs):
            counts = Counter(key for key, _ in pairs)
            twice = next(key for key, count in counts.items() if count > 1)
            raise FileError(f"{path.name}: {shorten(twice)} occurs twice; rename one of them")
        return values

    try:
        text = path.read_text(encoding="utf-8-sig")
        try:
            return json.loads(text, object_pairs_hook=unique)
        except json.JSONDecodeError as error:
            if not error.msg.startswith("Extra data"):
                raise
            lines = [line for line in text.splitlines() if line.strip()]  # an object a line
            return [json.loads(line, object_pairs_hook=unique) for line in lines]
    except FileError:
        raise
    except RecursionError:
        raise FileError(f"{path.name} is nested too deeply; expected lists of numbers") from None
    except UnicodeDecodeError:
        raise FileError(f"{path.name} is not UTF-8 text; expected JSON; save it again") from None
    except ValueError as error:
        raise FileError(f"{path.name} is no JSON: {error}; save it again") from None


def _lists(path: Path, parsed: Any, contents: Contents, within: str = "") -> dict[str, list[Any]]:
    """The columns as lists; other scalars and text go into `contents`."""
    parsed = _unnumbered(parsed)
    if isinstance(parsed, list):
        return _sensors(parsed, contents) or _rows(path, parsed)
    if not isinstance(parsed, dict):
        raise FileError(f"{path.name} holds {shorten(parsed)}; expected named lists of numbers")
    lists: dict[str, list[Any]] = {}
    for word, value in parsed.items():
        key, value = f"{within}{word}", _unnumbered(value)
        if isinstance(value, dict) and word.lower() in ("unit", "units"):
            contents.units |= {f"{within}{k}": u for k, u in value.items() if isinstance(u, str)}
        elif isinstance(value, dict):
            lists |= _lists(path, value, contents, f"{key}.")
        elif isinstance(value, list) and (sensors := _sensors(value, contents)):
            lists |= sensors
        elif isinstance(value, list) and value and _are_rows(word, value):
            rows = _names_apart(parsed.get("columns"), _rows(path, value))
            lists |= {f"{within}{name}": column for name, column in rows.items()}
        elif isinstance(value, list) and value and _is_table(value):
            lists |= {f"{key}.{name}": column for name, column in _rows(path, value).items()}
        elif isinstance(value, list) and value and not isinstance(value[0], dict):
            lists[key] = value
        elif isinstance(value, bool) or not isinstance(value, int | float):
            contents.notes.append(f"{key}: {shorten(value)}")
        else:
            contents.facts[key] = _number(path, key, value)
    return lists


def _sensors(objects: list[Any], contents: Contents) -> dict[str, list[Any]]:
    """Series by name of objects that hold one each: {"name": "roof", "unit": "g", "data": […]}."""
    found: dict[str, list[Any]] = {}
    units: dict[str, str] = {}
    beside: dict[str, set[float | str]] = {}
    for one in objects:
        said = {k.lower(): v for k, v in one.items()} if isinstance(one, dict) else {}
        series = [value for value in said.values() if isinstance(value, list)]
        texts = [said[key] for key in NAMES if isinstance(said.get(key), str)]
        if len(series) != 1 or not texts or texts[0] in found:
            return {}
        found[texts[0]] = series[0]
        if isinstance(unit := said.get("unit", said.get("units")), str):
            units[texts[0]] = unit
        for key in said.keys() - {*NAMES, "unit", "units"}:
            if isinstance(said[key], int | float | str):
                beside.setdefault(key, set()).add(said[key])
    contents.units |= units
    contents.facts |= facts_in_common(beside, contents.notes)
    return found


def _unnumbered(value: Any) -> Any:
    """Rows or cells that pandas numbers, {"0": …, "1": …}, as a list; else the value itself."""
    if not isinstance(value, dict) or len(value) < 2 or not all(map(str.isdecimal, value)):
        return value
    return value if any(isinstance(one, list) for one in value.values()) else list(value.values())


def _names_apart(names: Any, rows: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """Columns by a list of names beside them, as pandas splits a table; else as they are."""
    texts = isinstance(names, list) and all(isinstance(name, str) for name in names)
    if not texts or not len(names) == len(set(names)) == len(rows):
        return rows
    return dict(zip(names, rows.values(), strict=True))


def _is_table(value: list[Any]) -> bool:
    """Whether a list is rows as objects of one shape that hold numbers."""
    first = value[0]
    return (
        isinstance(first, dict)
        and len(value) > 1
        and all(isinstance(row, dict) and row.keys() == first.keys() for row in value)
        and any(isinstance(one, int | float) for one in first.values())
    )


def _without_stubs(
    lists: dict[str, list[Any]], request: Request, notes: list[str]
) -> dict[str, list[Any]]:
    """The lists that may be columns of one table: others are less than half as long."""
    longest = max(map(len, lists.values()), default=0)
    stubs = [name for name, values in lists.items() if 2 * len(values) < longest]
    if request.columns is not None:
        return lists
    notes += [f"{name!r} left out: {len(lists[name])} of {longest} rows" for name in stubs]
    return {name: values for name, values in lists.items() if name not in stubs}


def _are_rows(key: str, value: list[Any]) -> bool:
    return key == "data" and isinstance(value[0], list | dict)


def _number(path: Path, key: str, value: float) -> float:
    try:
        return float(value)
    except OverflowError:
        raise FileError(f"{path.name}: {key} is an integer too large for float64") from None


def _rows(path: Path, rows: list[Any]) -> dict[str, list[Any]]:
    """Rows turned into columns; lists name them c1, c2, …, objects by their keys."""
    if not rows or not isinstance(rows[0], list | dict):
        raise FileError(
            f"{path.name}: expected rows as lists or objects, or named lists; "
            f"got {shorten(rows[:3])}"
        )
    rows = [_flat(row) if isinstance(row, dict) else row for row in rows]
    first = rows[0]
    for number, row in enumerate(rows, start=1):
        if type(row) is not type(first) or len(row) != len(first):
            counts = f"{len(row)} values" if isinstance(row, list | dict) else shorten(row)
            raise FileError(
                f"{path.name}: row {number} has {counts}; expected {len(first)} as in row 1"
            )
        if isinstance(first, dict) and any(key not in row for key in first):
            missing = next(key for key in first if key not in row)
            raise FileError(f"{path.name}: row {number} lacks {missing!r}, which row 1 has")
    if isinstance(first, dict):
        return {key: [row[key] for row in rows] for key in first}
    return {f"c{k + 1}": [row[k] for row in rows] for k in range(len(first))}


def _flat(row: dict[str, Any], within: str = "") -> dict[str, Any]:
    """A row whose objects of objects are named by their path, acc.roof."""
    flat: dict[str, Any] = {}
    for key, value in row.items():
        path = f"{within}{key}"
        flat |= _flat(value, f"{path}.") if isinstance(value, dict) else {path: value}
    return flat


def _column(path: Path, name: str, values: list[Any], contents: Contents) -> np.ndarray | None:
    """One list as float64, None for text; null is NaN."""
    filled = [value for value in values if value is not None]
    if filled and all(isinstance(value, str) for value in filled):
        times = to_times(pa.chunked_array([pa.array(values, pa.string())]))
        return None if times is None else seconds(path, name, times, contents)
    for number, value in enumerate(values, start=1):
        if value is not None and not isinstance(value, int | float):
            raise FileError(
                f"{path.name}: {name}, row {number}: {shorten(value)} is no number; "
                "expected a number or null; mend that row"
            )
    numbers = [np.nan if value is None else value for value in values]
    array = np.asarray(numbers)
    if array.dtype.kind == "O" or (array.dtype.kind == "f" and _rounded(filled)):
        raise FileError(
            f"{path.name}: {name!r} mixes integers beyond 2^53 with other values; float64 would "
            "round them; leave it out (data.channels)"
        )
    return as_float(path, name, array, contents)


def _rounded(values: list[Any]) -> bool:
    return any(isinstance(value, int) and abs(value) > EXACT for value in values)
