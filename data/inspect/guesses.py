"""Cautious guesses of the channels in a file, by the units and names of its columns."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from data.measured.units import to_si

NAMES = (  # in a column's name → signal
    (r"(ground|table|base|shaker?).*acc|acc.*(ground|table|base)|üg|ag\b", "s_ddot"),
    (r"acc|^a[_ ]?[xyz]?\d*$", "a"),
    (r"(ground|table|base).*disp", "s"),
    (r"disp|lvdt|stroke|laser|deflection|position", "x"),
    (r"vel(o|\b|_|$)|^v[_ ]?\d*$", "v"),
    (r"force|load|hammer|^f[_ ]?\d*$", "f"),
)
CLOCK = r"time|zeit|temps|^t$|^t[_ ]?\[?s\]?$"
UNITS = (("m/s^2", "a"), ("m/s", "v"), ("m", "x"), ("N", "f"))


def is_clock(column: str) -> bool:
    """Whether a column's name sounds like a clock."""
    return re.search(CLOCK, column.lower()) is not None


def suggest(columns: Sequence[str], units: Mapping[str, str]) -> dict[str, str]:
    """{column: channel} by units and names of columns; columns that say nothing are left out."""
    guesses: dict[str, str] = {}
    count: dict[str, int] = {}
    for column in columns:
        signal = _signal(column, units.get(column))
        if signal == "time" and "time" not in guesses.values():
            guesses[column] = "time"
        elif signal is not None and signal != "time":
            count[signal] = count.get(signal, 0) + 1
            guesses[column] = f"{signal}{count[signal]}"
    return guesses


def _signal(column: str, unit: str | None) -> str | None:
    if is_clock(column) and (unit is None or _has_dimension(unit, "time")):
        return "time"
    named = next((s for pattern, s in NAMES if re.search(pattern, column.lower())), None)
    if unit is None:
        return named
    fits = [signal for _, signal in UNITS if _has_dimension(unit, signal)]
    if named in ("s_ddot", "s") and {"s_ddot": "a", "s": "x"}[named] in fits:
        return named
    return fits[0] if fits else None


def _has_dimension(unit: str, signal: str) -> bool:
    try:
        to_si(unit, signal)
    except ValueError:
        return False
    return True
