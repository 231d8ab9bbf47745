"""What a run's numbers follow from: every choice that can change one, and the code that ran.

The code is what the modules of this run *do*: the syntax trees of their statements without
docstrings, comments, imports of this project and messages of errors. A moved file, a split one and
a mended sentence leave it as it is; an estimator that this run does not use does too.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

import data
import models
from data.plain_data import read_text
from models.stored.schema import front_name
from runner.config.choices import plain
from runner.config.statements import keep_parsed, parsed_file

ROOT = Path(__file__).parents[2]
FRONTS = {"data": data.PUBLIC, "models": models.PUBLIC}
CORE = (  # of all
    "models.training.assemble",
    "models.training.identification",
    "runner.scores.outcome",
)
WORDS = "about"  # of a choice, for tables and pictures
INERT = ("figures", "checkpoint_seconds", "grid")  # they change no number,
EVERY_CLASS = frozenset(f"{room}.{name}" for room, names in FRONTS.items() for name in names)
INERT_DATA = ("calibration_records",)  # nor do records of their own that bands are made from
INERT_TRAINER = ("enable_progress_bar", "log_every_n_steps")  # nor do these of the trainer


def digest(text: str) -> str:
    """Ten characters that stand for a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:10]


def config_digest(content: dict[str, Any]) -> str:
    """Ten characters that tell runs apart: a hash of every choice that can change a number."""
    return digest(choices_text(content))


def choices_text(content: dict[str, Any]) -> str:
    """Every choice that can change a number, always in the same order."""
    content = _without_words({k: v for k, v in content.items() if k not in INERT})
    if content.get("start") is None:  # as in runs of older code, which have no such setting
        content.pop("start", None)
    content["data"] = {k: v for k, v in content["data"].items() if k not in INERT_DATA}
    if content["data"].get("calibration", "") is None:  # likewise
        del content["data"]["calibration"]
    content["trainer"] = {k: v for k, v in content["trainer"].items() if k not in INERT_TRAINER}
    return json.dumps(content, sort_keys=True, ensure_ascii=False)


def name_of(content: dict[str, Any], told: str = "") -> str:
    """Folder within a sweep of the run with these resolved values; told: their digest, if known."""
    names = (content[part]["name"] for part in ("model", "system", "scenario"))
    return "-".join((*names, f"seed{content['seed']}", told or config_digest(content)))


def run_name(cfg: DictConfig) -> str:
    return name_of(plain(cfg))


def _without_words(node: dict[str, Any]) -> dict[str, Any]:
    """The same without what choices say about themselves."""
    kept = {key: value for key, value in node.items() if key != WORDS}
    return {k: _without_words(v) if isinstance(v, dict) else v for k, v in kept.items()}


def targets_of(node: Any) -> frozenset[str]:
    """Every `_target_` of resolved values."""
    inner = node.values() if isinstance(node, dict) else node if isinstance(node, list) else ()
    own = {str(node["_target_"])} if isinstance(node, dict) and "_target_" in node else set()
    return frozenset(own.union(*map(targets_of, inner)))


def code_version(targets: frozenset[str], root: Path = ROOT) -> str:
    """Ten characters that change with the code of a run of these classes."""
    return _code_of(frozenset(map(front_name, targets)), root)


def written_code_version(config: Path) -> str:
    """The same for the run that a config.yaml describes; "" where there is none.

    The file is not parsed: a sweep has many.
    """
    if not config.is_file():
        return ""
    return code_version(frozenset(re.findall(r"_target_: (\S+)", read_text(config))))


def identity_of(content: dict[str, Any]) -> dict[str, str]:
    """What a run's numbers follow from: its resolved values and the code."""
    return {"config": config_digest(content), "code": code_version(targets_of(content))}


@cache
def _code_of(targets: frozenset[str], root: Path) -> str:
    named = (target.partition(".") for target in targets)
    roots = [FRONTS[room][name] for room, _, name in named if name in FRONTS.get(room, {})]
    statements = {s for module in _imported([*roots, *CORE], root) for s in _read(module, root)[0]}
    keep_parsed()
    return digest("\n".join(sorted(statements)))


def _imported(modules: Iterable[str], root: Path) -> set[str]:
    """These modules and all of the project that they import, directly or not."""
    found: set[str] = set()
    waiting = list(modules)
    while waiting:
        module = waiting.pop()
        if module not in found:
            found.add(module)
            waiting += _read(module, root)[1]
    return found


@cache
def _read(module: str, root: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the statements of a module do, and which modules of data and models it imports."""
    parsed = parsed_file(_file_of(module, root))
    ours = {name for place, names in parsed.imports for name in _own_imports(place, names, root)}
    return tuple(parsed.statements), tuple(sorted(ours))


def _file_of(module: str, root: Path) -> Path:
    """The file of a module, or of a package: what it gathers is imported from there."""
    place = root / Path(*module.split("."))
    return place / "__init__.py" if place.is_dir() else place.with_suffix(".py")


def _own_imports(module: str, names: Iterable[str], root: Path) -> Iterator[str]:
    """Modules that `from module import names` loads, of those that make numbers."""
    if module.split(".")[0] in FRONTS:
        for name in names:  # a module of a package, or what a module defines
            inside = f"{module}.{name}"
            place = inside if _file_of(inside, root).is_file() else module
            if place not in FRONTS:
                yield place
