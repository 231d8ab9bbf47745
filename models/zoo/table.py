"""The published models as a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from textwrap import shorten
from typing import Any

from data.arguments import plain
from models.zoo.index import ROOT, Entry, entries

COLUMNS = ("name", "free run %", "one step %", "parameters", "kB", "licence", "told")


class Table(list[dict[str, Any]]):
    """Rows {column: value}; printed, a table of text."""

    def __repr__(self) -> str:
        lines = [list(COLUMNS), *([_text(row[c]) for c in COLUMNS] for row in self)]
        widths = [max(len(line[i]) for line in lines) for i in range(len(COLUMNS) - 1)]
        return "\n".join(_aligned(line, widths) for line in lines)


def _aligned(line: Sequence[str], widths: Sequence[int]) -> str:
    """Name and licence to the left, numbers to the right, the given facts at the end."""
    left = {"name", "licence"}
    cells = [
        cell.ljust(width) if column in left else cell.rjust(width)
        for column, cell, width in zip(COLUMNS, line, widths, strict=False)
    ]
    return "  ".join([*cells, line[-1]]).rstrip()


def _text(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else plain(shorten(str(value), width=72))


def list_pretrained(
    system: str | None = None, model: str | None = None, root: Path = ROOT
) -> Table:
    """The newest version of every published model, of one structure or one kind if asked.

    Columns: name; error of the free run on the test motion [%], a word where there is none; error
    one step ahead [%]; parameters; size of its files [kB]; licence of the weights; what the model
    was told of the structure. Raises ValueError for a structure or model of which there is none.
    """
    found = entries(root)
    for key, wanted in (("system", system), ("model", model)):
        known = dict.fromkeys(getattr(entry, key) for entry in found)
        if wanted is not None and wanted not in known:
            raise ValueError(f"{key}={wanted}: there are {', '.join(known)}")
    newest: dict[tuple[str, str], Entry] = {}
    for entry in found:
        if system in (None, entry.system) and model in (None, entry.model):
            newest[entry.model, entry.system] = entry  # versions rise
    return Table(_row(entry) for entry in newest.values())


def _row(entry: Entry) -> dict[str, Any]:
    facts = entry.facts
    values = (
        entry.name,
        facts["free_run_percent"],
        facts["one_step_percent"],
        facts["parameters"],
        round(entry.bytes / 1000.0, 1),
        facts["licence"],
        entry.told,
    )
    return dict(zip(COLUMNS, values, strict=True))
