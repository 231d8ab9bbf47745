"""A choice of a run: a public class and its arguments, built without running anybody's code.

A config may come from somebody else. Its values are plain; its `_target_`s name classes that a
front lists, nothing else; what stands beside them is held against the names and annotations of
their arguments before the first object is made.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Self, get_type_hints

import data
import models
from data.annotations import require, shown
from data.checked import constructor_of
from data.plain_data import require_given

FRONTS = {"data": data, "models": models}
LABELS = ("name", "about")  # of a choice: what tables call it, and what they say of it


@dataclass(frozen=True)
class Choice:
    """What a config says of one part of a run. key: its place there, such as "model"."""

    key: str
    values: Mapping[str, Any]

    @property
    def name(self) -> str:
        """What tables and folders call it."""
        return str(self.values.get("name", ""))

    @property
    def target(self) -> str:
        """The class, as the config names it; "" where there is none."""
        return str(self.values.get("_target_", ""))

    def with_values(self, changes: Mapping[str, Any]) -> Self:
        """The same with some values changed."""
        return replace(self, values=overlay(self.values, changes))

    def build(self, kind: type, **more: Any) -> Any:
        """The object of this kind that the choice describes.

        `more` comes before what the config says. Raises ValueError for a class that no front lists
        or that is of another kind, for an argument that the class does not know, lacks or cannot
        use, for a value that was never given, and for what the class itself refuses.
        """
        if not isinstance(self.values, Mapping):
            raise ValueError(f"{shown(self.values)!r} is not a {kind.__name__}; see --help")
        key = self.key
        require_given(self.values, key)
        if "_target_" not in self.values:
            raise ValueError(f"{key}={shown(self.values)} has no _target_; {_remedy(key)}")
        if not issubclass(class_of(self.values), kind):
            raise ValueError(
                f"{_below(key, '_target_')}={self.target} is no {kind.__name__}; {_remedy(key)}"
            )
        content = {k: v for k, v in self.values.items() if k not in (*LABELS, *more)}
        _check_targets(content, key, more)
        return _object(content, key, more)

    def arguments(self) -> dict[str, Any]:
        """What its class would be given. Raises ValueError for what the class cannot use."""
        return _arguments({k: v for k, v in self.values.items() if k not in LABELS}, self.key)


def overlay(values: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Values with some of them changed; a mapping in a mapping's place changes what it names."""
    found = dict(values)
    for name, new in changes.items():
        old = found.get(name)
        both = isinstance(old, Mapping) and isinstance(new, Mapping)
        found[name] = overlay(old, new) if both else new  # type: ignore[arg-type]
    return found


def class_of(values: Mapping[str, Any]) -> type:
    """The class that `_target_` and `laws` name. Raises ValueError unless a front lists it."""
    target = values.get("_target_")
    room, _, name = target.partition(".") if isinstance(target, str) else ("", "", "")
    if room in FRONTS and name in FRONTS[room].PUBLIC:
        if room == "models":
            name = models.class_name(name, values.get("laws"))
        return getattr(FRONTS[room], name)
    raise ValueError(
        f"_target_={shown(target)} is not a public class of this project's data or models; "
        "see PUBLIC in data/__init__.py and models/__init__.py"
    )


@cache
def arguments_of(target: type) -> Mapping[str, tuple[Any, bool]]:
    """{name: annotation, whether it must be given} of a class's arguments."""
    hints = get_type_hints(target.__init__, include_extras=True)  # type: ignore[misc]
    parameters = constructor_of(target).parameters.values()
    return {
        one.name: (hints.get(one.name, Any), one.default is one.empty)
        for one in parameters
        if one.kind not in (one.VAR_POSITIONAL, one.VAR_KEYWORD)  # of a class without a constructor
    }


def _check_targets(node: Any, key: str, more: Mapping[str, Any]) -> None:
    """Every class below a node is public and knows the arguments that stand beside its name."""
    if isinstance(node, list):
        for place, value in enumerate(node):
            _check_targets(value, f"{key}[{place}]", {})
    if not isinstance(node, dict):
        return
    for name, value in node.items():
        _check_targets(value, _below(key, name), {})
    if "_target_" not in node:
        return
    known = arguments_of(class_of(node))
    for name in (name for name in node if name not in ("_target_", *LABELS, *known)):
        near = difflib.get_close_matches(str(name), known, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else f"; it has {', '.join(known)}"
        where = f"{key}: " if key else ""
        raise ValueError(f"{where}{node['_target_']} has no argument {shown(name)!r}{hint}")
    for name, (_, needed) in known.items():
        if needed and name not in node and name not in more:
            raise ValueError(f"{key} lacks {name!r}, which its class needs; {_remedy(key)}")


def _object(node: Any, key: str, more: Mapping[str, Any]) -> Any:
    """The values of a checked node, with an object wherever there is a `_target_`."""
    if isinstance(node, list):
        return [_object(value, f"{key}[{place}]", {}) for place, value in enumerate(node)]
    if not isinstance(node, dict):
        return node
    if "_target_" not in node:
        return {name: _object(value, _below(key, name), {}) for name, value in node.items()}
    values = _arguments(node, key)
    try:
        return class_of(node)(**values, **more)
    except ValueError as error:
        nested = not more and "." in key
        raise (ValueError(f"{key}: {error}") if nested else error) from None


def _arguments(node: Mapping[str, Any], key: str) -> dict[str, Any]:
    """The values of a node that its class knows."""
    known = arguments_of(class_of(node))
    values = {name: _object(value, _below(key, name), {}) for name, value in node.items()}
    values = {name: value for name, value in values.items() if name in known}
    for name, value in values.items():
        require(_below(key, name), value, known[name][0], _remedy(key))
    return values


def _below(key: str, name: Any) -> str:
    return f"{key}.{name}" if key else str(name)


def _remedy(key: str) -> str:
    group = key.partition(".")[0]
    return f"conf/{group}/ has examples" if group else "conf/ has examples"
