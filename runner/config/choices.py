"""Choices of a run, dotted as they would be typed: how they are read, written and compared."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from data.plain_data import read_text, read_yaml
from models.stored.schema import CHOICES_KIND, require

UNTOLD = ("_target_", "about")  # the class and the words of a choice, which its name stands for


def plain(cfg: DictConfig) -> dict[str, Any]:
    """A config's values, resolved, without Hydra's own."""
    content = {}
    for key in (str(key) for key in cfg if key != "hydra"):  # a masked copy would be slow
        value = cfg[key]
        content[key] = (
            OmegaConf.to_container(value, resolve=True) if OmegaConf.is_config(value) else value
        )
    return content


def take_settings(kind: Any, values: Mapping[str, Any]) -> Any:
    """An object of a dataclass, whose fields have the names of settings; defaults where absent."""
    return kind(**{one.name: values[one.name] for one in fields(kind) if one.name in values})


def read_choices(path: Path) -> dict[str, Any]:
    """Every choice in a run's config, dotted. Raises ValueError for what is no config, OSError for
    no file.

    Reading YAML is slow, and the runs of a sweep differ in a few lines: each of the config's blocks
    is read once, however many runs have it.
    """
    blocks = re.split(r"^(?=\w)", read_text(path), flags=re.MULTILINE)
    choices = {key: value for block in blocks for key, value in _choices(block)}
    require(choices, CHOICES_KIND)
    return choices


@cache
def _choices(block: str) -> tuple[tuple[str, Any], ...]:
    content = read_yaml(block) or {}
    if not isinstance(content, dict):
        raise ValueError(f"config.yaml holds {block.splitlines()[0]!r}, which is no setting")
    return tuple(dotted(content).items())


def dotted(node: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """{dotted name: value} of all leaves; a list is one, an empty choice is none."""
    found: dict[str, Any] = {}
    for key, value in node.items():
        if key in UNTOLD:
            continue
        if isinstance(value, Mapping):
            found |= dotted(value, f"{prefix}{key}.")
        else:
            found[f"{prefix}{key}"] = value
    return found


def typed(value: Any) -> Any:
    """A value as a table holds it: numbers and words as they are, a list as it would be typed."""
    if isinstance(value, list | tuple):
        return f"[{','.join(str(typed(v)) for v in value)}]"
    return "null" if value is None else value


def varying(choices: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """{name: value of each run} of the choices that are not the same in all of these runs.

    None where a run has no such choice; runs of which nothing is known do not count.
    """
    names = dict.fromkeys(name for of_run in choices for name in of_run)
    found: dict[str, list[Any]] = {}
    for name in names:
        values = [typed(of_run[name]) if name in of_run else None for of_run in choices]
        if len({str(v) for v, of_run in zip(values, choices, strict=True) if of_run}) > 1:
            found[name] = values
    return found
