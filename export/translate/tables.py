"""Arrays of numbers that a module holds, as constants of C."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from export.translate.values import DOUBLE, INT, Value, number

KINDS = {np.dtype(np.float64): DOUBLE, np.dtype(np.int64): INT}
ON_A_LINE = 6  # numbers of a table


class Tables:
    """Tables of all modules of a program by their names in C, which say nothing of the module."""

    def __init__(self) -> None:
        self.values: dict[str, np.ndarray] = {}

    def opened(self, names: dict[str, Any]) -> dict[str, Any]:
        """Names of a module, with what C knows of its arrays in their place."""
        return {
            name: self._table(name, value) if _is_table(value) else value
            for name, value in names.items()
        }

    def _table(self, name: str, value: np.ndarray) -> Value:
        own = first = f"table_{name.strip('_').lower()}"  # not the name of any variable
        count = 2
        while self.values.setdefault(own, value) is not value:
            own, count = f"{first}_{count}", count + 1
        return Value("array", own, shape=value.shape, dtype=KINDS[value.dtype], root=own)

    def text(self, used: set[str]) -> Iterable[str]:
        for name, value in self.values.items():
            if name in used:
                yield table(name, value)


def _is_table(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype in KINDS and value.size > 0


def table(name: str, value: np.ndarray) -> str:
    kind = "int" if value.dtype.kind == "i" else "double"
    head = f"static const {kind} {name}[{value.size}] = {{"
    return "\n".join([head, *numbers_of(value, 4), "};"])


def numbers_of(value: np.ndarray, indent: int) -> Iterable[str]:
    """Lines with all numbers of an array, row after row."""
    words = [number(one).code for one in value.ravel().tolist()]
    for first in range(0, len(words), ON_A_LINE):
        yield " " * indent + ", ".join(words[first : first + ON_A_LINE]) + ","
