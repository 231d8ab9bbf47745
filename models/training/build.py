"""A config node → the object that it describes, without running anybody's code.

A config may come from somebody else. It is resolved once, to plain values; its `_target_`s name
classes that a front lists, nothing else; what stands beside them is held against the names and
annotations of their arguments before the first object is made.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from functools import cache
from typing import Any, get_type_hints

from omegaconf import DictConfig, OmegaConf

import data
import models
from data.annotations import require, shown
from data.checked import constructor_of

FRONTS = {"data": data, "models": models}
LABELS = ("name", "about")  # of a choice: what tables call it, and what they say of it


def build(node: Any, kind: type, **more: Any) -> Any:
    """The object of this kind that a config node describes.

    `more` comes before what the config says. Raises ValueError for a class that no front lists or
    that is of another kind, for an argument that the class does not know, lacks or cannot use, and
    for what the class itself refuses.
    """
    if not isinstance(node, DictConfig):
        raise ValueError(f"{shown(node)!r} is not a {kind.__name__}; see --help")
    key = _key_of(node)
    content: Any = OmegaConf.to_container(node, resolve=True, throw_on_missing=True)
    if not isinstance(content, dict) or "_target_" not in content:
        raise ValueError(f"{key}={shown(content)} has no _target_; {_remedy(key)}")
    if not issubclass(class_of(content), kind):
        raise ValueError(
            f"{_below(key, '_target_')}={content['_target_']} is no {kind.__name__}; {_remedy(key)}"
        )
    content = {k: v for k, v in content.items() if k not in (*LABELS, *more)}
    _check_targets(content, key, more)
    return _object(content, key, more)


def class_of(node: Mapping[str, Any]) -> type:
    """The class that `_target_` and `laws` name. Raises ValueError unless a front lists it."""
    target = node.get("_target_")
    room, _, name = target.partition(".") if isinstance(target, str) else ("", "", "")
    if room in FRONTS and name in FRONTS[room].PUBLIC:
        if room == "models":
            name = models.class_name(name, node.get("laws"))
        public: type = getattr(FRONTS[room], name)
        return public
    raise ValueError(
        f"_target_={shown(target)} is not a public class of this project's data or models; "
        "docs/classes.md lists them"
    )


@cache
def arguments_of(target: type) -> Mapping[str, tuple[Any, bool]]:
    """{name: annotation, whether it must be given} of a class's arguments."""
    hints = get_type_hints(target.__init__)  # type: ignore[misc]
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
    values = {name: _object(value, _below(key, name), {}) for name, value in node.items()}
    if "_target_" not in node:
        return values
    target = class_of(node)
    known = arguments_of(target)
    values = {name: value for name, value in values.items() if name in known}
    for name, value in values.items():
        require(_below(key, name), value, known[name][0], _remedy(key))
    try:
        return target(**values, **more)
    except ValueError as error:
        nested = not more and "." in key
        raise (ValueError(f"{key}: {error}") if nested else error) from None


def _key_of(node: DictConfig) -> str:
    """A node's place in the config, dotted; "" for the whole of it."""
    return str(node._get_full_key(None) or "")


def _below(key: str, name: Any) -> str:
    return f"{key}.{name}" if key else str(name)


def _remedy(key: str) -> str:
    group = key.partition(".")[0]
    return f"conf/{group}/ has examples" if group else "conf/ has examples"
