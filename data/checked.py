"""Arguments of public classes, held against their annotations where an object is made.

`@checked` above a class does that for its constructor; with `@dataclass` it is placed above that.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from functools import cache, wraps
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from data.annotations import Range, expectation, fits, has_range, shown

C = TypeVar("C", bound=type)
ANY = Range(-math.inf)
LONGEST = 1_000_000  # items of a list that are looked at one by one


def checked(cls: C, finite: bool = True) -> C:
    """Let the constructor of a class raise ValueError, naming it, for an argument of another type.

    Numbers must be `finite`, and those of NumPy will do. Objects remember what they were built
    with, see `built_with`.
    """
    init = cls.__init__  # type: ignore[misc]

    @wraps(init)
    def construct(self: Any, *args: Any, **kwargs: Any) -> None:
        own = is_dataclass(cls)
        given: Mapping[str, Any] = kwargs
        if args or not own:
            bound = constructor_of(cls).bind(*args, **kwargs)
            given = bound.arguments
        infinite = _checked_types(cls, given, type(self).__name__)
        if not own and "_given" not in vars(self):  # by itself, not by a base
            bound.apply_defaults()
            vars(self)["_given"] = bound.arguments
        try:
            init(self, *args, **kwargs)  # whose own words about NaN come first
        except (TypeError, OverflowError, RuntimeError):
            if infinite:
                raise ValueError(infinite) from None
            raise
        except MemoryError:
            raise ValueError(f"{cls.__name__} of {_largest(given)} fits no memory") from None
        if infinite and finite:
            raise ValueError(infinite)

    cls.__init__ = construct  # type: ignore[misc]
    return cls


def _largest(given: Mapping[str, Any]) -> str:
    """The largest whole number among some arguments, as it would be typed."""
    sizes = {name: value for name, value in given.items() if type(value) is int}
    name = max(sizes, key=sizes.__getitem__, default="such arguments")
    return f"{name}={sizes[name]}" if name in sizes else name


def _checked_types(cls: type, given: Mapping[str, Any], name_of_class: str) -> str:
    """What to say of a number that is not finite, if there is one. Raises ValueError for types."""
    infinite, hints, ranges = "", _hints(cls), _ranges(cls)
    for name, value in given.items():
        usual = type(value) is float and math.isfinite(value) and name in ranges
        if usual and ranges[name].holds(value):
            continue  # searches make laws by the thousand
        annotation = hints.get(name, Any)
        if annotation == Sequence[str] and fits(value, annotation):
            continue
        key = f"{name_of_class}: {name}"
        if get_origin(annotation) is Iterable or (
            isinstance(value, np.ndarray) and fits(value, annotation)
        ):
            continue  # to look at an iterator is to empty it
        value = _plain_numbers(value)
        numbers = value if isinstance(value, list) else [value]
        first = numbers[:LONGEST]
        known = [0.5 if isinstance(u, float) and not math.isfinite(u) else u for u in first]
        if known != first:
            infinite = infinite or f"{key}={shown(value)} is not finite; give a finite number"
            if has_range(annotation):
                raise ValueError(infinite)
            value = known if isinstance(value, list) else known[0]
        if not fits(value, annotation):
            raise ValueError(f"{key}={shown(given[name])} must be {expectation(annotation)}")
    return infinite


def built_with(thing: Any) -> dict[str, Any]:
    """Arguments that an object of a checked class was built with, as far as JSON holds them."""
    given = vars(thing) if is_dataclass(thing) else getattr(thing, "_given", {})
    return {name: _plain(value) for name, value in given.items()}


@cache
def constructor_of(cls: type) -> inspect.Signature:
    """Arguments of a class's constructor, whatever else makes its objects."""
    bare = inspect.signature(cls.__init__)  # type: ignore[misc]
    return bare.replace(parameters=[*bare.parameters.values()][1:])


@cache
def _hints(cls: type) -> Mapping[str, Any]:
    return get_type_hints(cls.__init__, include_extras=True)  # type: ignore[misc]


@cache
def _ranges(cls: type) -> Mapping[str, Range]:
    """Of the arguments that are one number."""
    parts = {name: get_args(hint) or (hint, ANY) for name, hint in _hints(cls).items()}
    pairs = {name: own for name, own in parts.items() if own[0] is float}
    return {name: own[-1] for name, own in pairs.items() if isinstance(own[-1], Range)}


def _plain_numbers(value: Any) -> Any:
    """Numbers of NumPy as Python's, alone or in a list; an array of numbers as a list."""
    if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and value.ndim == 1):
        return value.tolist()
    if type(value) in (list, tuple):
        return type(value)(map(_plain_numbers, value))
    return value


def _plain(value: Any) -> Any:
    """A value as JSON holds it: what else there is, by its class and arguments; None for none."""
    value = _plain_numbers(value)
    if isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, Mapping):
        return {str(name): _plain(one) for name, one in value.items()}
    if is_dataclass(value) or hasattr(value, "_given"):
        return {"class": type(value).__name__, **built_with(value)}
    return None
