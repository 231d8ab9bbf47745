"""YAML and JSON of a run's folder, read as plain data: all of it is text or a number.

Nothing is resolved, built or fetched because a file says so, and what no run writes is refused:
pipes, files of any size, trees of any depth, aliases that unfold to billions of values.
"""

from __future__ import annotations

import json
import math
import re
import sys
from pathlib import Path
from typing import Any, NoReturn

import yaml

from data.whole_file import read_regular

LARGEST = 16 * 2**20  # bytes of a file
YAML, LINE = 2**21, 100_000  # characters of a YAML text, which is slow to read, and of a line of it
VALUES, DEPTH = 200_000, 40  # of all values, and their nesting
MISSING = "???"  # OmegaConf's, for a value that was never given
PARSER_ERRORS = (  # of json and yaml, on damaged text
    yaml.YAMLError, ValueError, TypeError, KeyError, IndexError, AttributeError, OverflowError,
    RecursionError,
)  # fmt: skip
CSafeLoader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class Loader(CSafeLoader):
    """Numbers as OmegaConf reads them: 1e-3 is one, and a date is text. No `<<`, which unfolds."""

    def flatten_mapping(self, node: Any) -> None:
        for key, _ in node.value:
            if key.tag == "tag:yaml.org,2002:merge":
                raise ValueError("the key << is not allowed")


Loader.yaml_implicit_resolvers = {
    sign: [(tag, pattern) for tag, pattern in resolvers if not tag.endswith(":timestamp")]
    for sign, resolvers in CSafeLoader.yaml_implicit_resolvers.items()
}
Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+$"), list("-+0123456789")
)


def read_text(path: Path) -> str:
    """Raises OSError where there is no file, ValueError where it is no text."""
    return read_regular(path, LARGEST).decode("utf-8")


def read_yaml(text: str) -> Any:
    """Values of a YAML text. Raises ValueError where it is none, or not of plain values."""
    if len(text) > YAML or max(map(len, text.splitlines()), default=0) > LINE:
        raise ValueError(f"it has more than {YAML} characters, or {LINE} in a line")
    try:
        _require_shallow(text)
        content = yaml.load(text, Loader)
    except PARSER_ERRORS as error:
        raise ValueError(_first_line(error)) from None
    require_plain(content)
    return content


def _require_shallow(text: str) -> None:
    """Raise ValueError for YAML of many levels: libyaml composes by recursion, without a limit."""
    depth = 0
    for event in yaml.parse(text, Loader):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > DEPTH:
            raise ValueError(f"it has more than {DEPTH} levels")


def read_json(path: Path) -> Any:
    """Values of a JSON file. Raises OSError where there is none, ValueError where it is damaged."""
    try:
        return loads(read_text(path))
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from None


def loads(text: str) -> Any:
    """Values of a JSON text. Raises ValueError where it is none, or not of plain values."""
    try:
        content = json.loads(
            text, parse_constant=_no_number, parse_float=_finite, object_pairs_hook=_each_once
        )
    except PARSER_ERRORS as error:
        raise ValueError(_first_line(error)) from None
    require_plain(content)
    return content


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A mapping whose keys differ: of two alike, a person reads one and a program the other."""
    content = dict(pairs)
    if len(content) < len(pairs):
        raise ValueError("it has a key twice in one mapping")
    return content


def _first_line(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if isinstance(error, ValueError | yaml.YAMLError) else f"it cannot be read ({text})"


def _no_number(word: str) -> NoReturn:
    raise ValueError(f"{word} is no number")


def _finite(word: str) -> float:
    return value if math.isfinite(value := float(word)) else _no_number(word)


def require_plain(content: Any) -> None:
    """Raise ValueError unless all is mappings, lists, texts, numbers and nothing, in some measure.

    An alias in YAML is a value at many places: it counts at each of them.
    """
    level: list[Any] = [content]
    count, depth = 1, 0
    while level:
        inner: list[Any] = []
        for value in level:
            if isinstance(value, dict):
                for key in value:
                    _require_scalar(key)
                inner.extend(value.values())
            elif isinstance(value, list):
                inner.extend(value)
            else:
                _require_scalar(value)
            if count + len(inner) > VALUES or depth >= DEPTH:
                raise ValueError(f"it has more than {VALUES} values, or more than {DEPTH} levels")
        level, count, depth = inner, count + len(inner), depth + 1


def _require_scalar(value: Any) -> None:
    if isinstance(value, str):
        value.encode("utf-8")  # half of a surrogate pair could be written nowhere
    elif isinstance(value, int) and abs(value) > sys.maxsize:
        raise ValueError("it has a whole number of more than 18 digits")
    elif value is not None and not isinstance(value, int | float):
        raise ValueError(f"it has a value of the kind {type(value).__name__}")


def require_given(value: Any, place: str = "") -> None:
    """Raise ValueError for a value that was never given (???)."""
    if isinstance(value, dict):
        for key, inner in value.items():
            require_given(inner, f"{place}.{key}".lstrip("."))
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            require_given(inner, f"{place}.{i}")
    elif value == MISSING:
        raise ValueError(f"{place}={MISSING}, a value that was never given")
