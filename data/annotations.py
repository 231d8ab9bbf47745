"""What the annotation of an argument asks of a value that was typed or read, in words."""

from __future__ import annotations

import math
import re
import sys
import types
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin
from unicodedata import category

from data.arguments import plain

NUMBERS = {float: "a number", int: "a whole number"}
WORDS = {bool: "true or false", str: "text", type(None): "null", Any: "anything"}
MOST = 10_000  # rows of a square matrix, of which any larger one takes more than 800 MB
SHOWN = 60  # characters of a value in a message


@dataclass(frozen=True)
class Range:
    """Which finite numbers an annotation admits: `Annotated[int, Range(1, 20)]`, 20 among them.

    above, below: without `low`, without `high` itself.
    """

    low: float
    high: float = math.inf
    above: bool = False
    below: bool = False

    def holds(self, value: float) -> bool:
        after = value > self.low if self.above else value >= self.low
        return after and (value < self.high if self.below else value <= self.high)

    @property
    def words(self) -> str:
        if self.high == math.inf:
            return f"{'above' if self.above else 'of at least'} {self.low:g}"
        end = f"{'below ' if self.below else ''}{self.high:g}"
        if self.above:
            return f"above {self.low:g} and {end if self.below else f'at most {end}'}"
        return f"from {self.low:g} to {end}"


Positive = Annotated[float, Range(0, above=True)]
NotNegative = Annotated[float, Range(0)]
Share = Annotated[float, Range(0, 1)]
Fraction = Annotated[float, Range(0, 1, below=True)]
Whole = Annotated[int, Range(0)]
Count = Annotated[int, Range(1)]


def fits(value: Any, annotation: Any) -> bool:
    """Whether a value is of an annotated type; a whole number is a float, true and NaN are none.

    Text must be printable: it will appear in messages, tables and names of files. It may hold
    tabulators (which divide columns) and blanks of any script, as names of columns do.
    """
    if annotation is str:
        return isinstance(value, str) and all(
            c.isprintable() or c == "\t" or category(c) == "Zs" for c in value
        )
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return fits(value, inner[0]) and abs(value) < math.inf and inner[1].holds(value)
    if origin in (Union, types.UnionType):
        return any(fits(value, one) for one in inner)
    if origin is Literal:
        return any(value == one and type(value) is type(one) for one in inner)
    if origin is tuple and Ellipsis not in inner:
        pairs = zip(value, inner, strict=False) if _is_list(value) else ()
        return _is_list(value) and len(value) == len(inner) and all(fits(v, a) for v, a in pairs)
    if origin is not None and issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(
            fits(key, inner[0]) and fits(one, inner[1]) for key, one in value.items()
        )
    if origin in (list, tuple, Sequence, Iterable):
        return _is_list(value) and all(fits(one, inner[0]) for one in value)
    if annotation in NUMBERS:
        return isinstance(value, (int, annotation)) and _is_number(value)
    if annotation is Any or origin is not None:  # a callable, a generic class: nobody types it
        return True
    return isinstance(value, annotation)


def has_range(annotation: Any) -> bool:
    """Whether a range is stated for a value, or for one inside of it."""
    inner = get_args(annotation)
    return get_origin(annotation) is Annotated or any(map(has_range, inner))


def _is_list(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def _is_number(value: float) -> bool:
    if isinstance(value, int):
        return not isinstance(value, bool) and abs(value) <= sys.maxsize  # what PyTorch counts with
    return not math.isnan(value)


def expectation(annotation: Any) -> str:
    """What `annotation` asks for: float | None → "a number or null"."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return f"{expectation(inner[0])} {inner[1].words}"
    if origin in (Union, types.UnionType):
        return " or ".join(expectation(one) for one in inner)
    if origin is Literal:
        return f"one of {', '.join(map(str, inner))}"
    if origin is tuple and Ellipsis not in inner:
        return f"a list of {len(inner)}: {', '.join(expectation(one) for one in inner)}"
    if origin is not None and issubclass(origin, Mapping):
        return f"a mapping of names to {_many(expectation(inner[1]))}"
    if origin in (list, tuple, Sequence, Iterable):
        return f"a list of {_many(expectation(inner[0]))}"
    known = {**NUMBERS, **WORDS}.get(annotation)
    return known or f"a {getattr(annotation, '__name__', str(annotation))} (with its _target_)"


def _many(words: str) -> str:
    """The plural of what an item is: "a whole number above 0" → "whole numbers above 0"."""
    number = re.fullmatch("a ((?:whole )?number)((?: (?:above|of|from) .*)?)", words)
    return f"{number[1]}s{number[2]}" if number else words


def require(key: str, value: Any, annotation: Any, remedy: str) -> None:
    """Raise ValueError, naming `key`, where a value is not of the annotated type."""
    if not fits(value, annotation):
        raise ValueError(f"{key}={shown(value)} must be {expectation(annotation)}; {remedy}")


def shown(value: Any) -> str:
    """A value as it would be typed, cut where it is long."""
    words = {None: "null", True: "true", False: "false"}
    named = isinstance(value, bool) or value is None
    try:
        text = plain(words[value] if named else str(value))
    except ValueError:  # a whole number of more digits than Python prints
        text = "a number of thousands of digits"
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}…"
