"""What the translator knows of an expression: its kind, its C text, and its value where known."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np

DOUBLE, INT = "double", "int"


class Binds(IntEnum):
    """How tightly the outermost sign of a C text binds, from ?: to a name or a bracket."""

    CHOSEN, OR, AND, COMPARED, PLUS, TIMES, UNARY, ATOM = range(8)


@dataclass(frozen=True)
class Value:
    """A number, array, tuple, function or module; `known` holds its value where that is fixed.

    kind: "double", "int", "array", "tuple", "function", "module", "type" or "none".
    Arrays: shape, dtype ("double" or "int") and root, the name whose elements they are.
    Tuples that are records: fields, the names of their items.
    """

    kind: str
    code: str = ""
    binds: int = Binds.ATOM
    known: Any = None
    fixed: bool = False
    shape: tuple[int, ...] = ()
    dtype: str = DOUBLE
    root: str = ""
    items: tuple[Value, ...] = field(default=())
    fields: tuple[str, ...] = ()

    def parts(self, name: str) -> list[str]:
        """Variables that hold the items of a tuple called so."""
        keys = self.fields or [str(i) for i in range(len(self.items))]
        return [f"{name}_{key}" for key in keys]

    def within(self, binds: int) -> str:
        """Its text as part of an expression that binds so tightly."""
        return self.code if self.binds >= binds else f"({self.code})"

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    @property
    def is_number(self) -> bool:
        return self.kind in (DOUBLE, INT)

    def as_double(self) -> Value:
        if self.kind == DOUBLE:
            return self
        if self.fixed:
            return number(float(self.known))
        return Value(DOUBLE, f"(double){self.within(Binds.UNARY)}", Binds.UNARY)


def number(value: Any) -> Value:
    """A number that is known."""
    if isinstance(value, bool | int):
        text = str(int(value))
        return Value(INT, text, Binds.UNARY if value < 0 else Binds.ATOM, value, True)
    value = float(value)
    text = {"nan": "NAN", "inf": "INFINITY", "-inf": "-INFINITY"}.get(repr(value), repr(value))
    return Value(DOUBLE, text, Binds.UNARY if value < 0.0 else Binds.ATOM, value, True)


def tuple_of(items: Sequence[Value], fields: tuple[str, ...] = ()) -> Value:
    fixed = all(item.fixed for item in items)
    known = tuple(item.known for item in items) if fixed else None
    return Value("tuple", known=known, fixed=fixed, items=tuple(items), fields=fields)


def known_value(value: Any) -> Value | None:
    """The value of a name of a module; None where it is of no use here."""
    if isinstance(value, Value):
        return value
    if value is None:
        return Value("none", fixed=True)
    if isinstance(value, bool | int | float):
        return number(value)
    if isinstance(value, tuple):
        items = [known_value(item) for item in value]
        fields = getattr(value, "_fields", ())
        return None if any(i is None for i in items) else tuple_of([i for i in items if i], fields)
    if isinstance(value, type) and value in (int, float, bool):
        return Value("type", known=value, fixed=True)
    if type(value).__name__ == "module":
        return Value("module", known=value, fixed=True)
    if callable(value):
        return Value("function", known=value, fixed=True)
    return None


def flat(value: Value) -> list[Value]:
    """A value, or the numbers of a tuple and of tuples in it."""
    if value.kind != "tuple":
        return [value]
    return [one for item in value.items for one in flat(item)]


def common_value(one: Value | None, other: Value) -> Value:
    """What a variable is that is given both values, without their text.

    Raises ValueError where no variable of C can be both.
    """
    if one is None:
        return other
    if one.fixed and other.fixed and one.kind == other.kind and _same(one.known, other.known):
        return one
    if one.is_number and other.is_number:
        return Value(DOUBLE if DOUBLE in (one.kind, other.kind) else INT)
    if one.kind == other.kind == "array" and (one.shape, one.dtype) == (other.shape, other.dtype):
        return one
    if one.kind == other.kind == "tuple" and len(one.items) == len(other.items):
        both = zip(one.items, other.items, strict=True)
        return tuple_of([common_value(a, b) for a, b in both], one.fields)
    raise ValueError(f"is a {one.kind} and a {other.kind} of another shape")


def _same(one: Any, other: Any) -> bool:
    return type(one) is type(other) and (one == other or (one != one and other != other))


# Arrays of numbers that a module holds, as constants of C.

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
