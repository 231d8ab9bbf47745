"""Any collection of runs: one sweep, several, a glob → what each run chose, and what became of it.

A run is a folder with a config. It is finished where metrics.json is there, failed where it says
why, unfinished otherwise: killed, or still at work. What cannot be read is damaged. None of them is
left out.
"""

from __future__ import annotations

import glob
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from runner.run_folder import CONFIG, FAILED, METRICS, read_failure

Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
FINISHED, UNFINISHED, DAMAGED = "finished", "unfinished", "damaged"
UNTOLD = ("_target_",)  # the class, which the name of a choice stands for


@dataclass(frozen=True)
class Collected:
    """A run. `choices` are dotted; `metrics` is empty unless it is finished."""

    folder: Path
    status: str  # finished, failed, unfinished or damaged
    reason: str
    choices: Mapping[str, Any]
    metrics: Mapping[str, Any]

    @property
    def case(self) -> tuple[Any, ...]:
        """Model, system, scenario and seed; None where nobody knows."""
        names = ("model", "system", "scenario")
        told = [self.metrics.get(n, self.choices.get(f"{n}.name")) for n in names]
        return (*told, self.metrics.get("seed", self.choices.get("seed")))


def folders_of(typed: str | Sequence[str]) -> list[Path]:
    """Folders named by a person: one, a list, or patterns with *, ? and **.

    Raises ValueError for a folder that is not there or a pattern without any.
    """
    found: dict[Path, Path] = {}
    for name in [typed] if isinstance(typed, str) else typed:
        matches = sorted(glob.glob(str(name), recursive=True)) if glob.has_magic(name) else [name]
        folders = [Path(match) for match in matches if Path(match).is_dir()]
        if not folders:
            kind = "no folder matches" if glob.has_magic(name) else "there is no folder"
            raise ValueError(f"{kind} {name}; runs= takes a folder, a list [a,b] or a pattern")
        found |= {folder.resolve(): folder for folder in folders}
    return list(found.values())


def collect(folders: Sequence[Path]) -> list[Collected]:
    """All runs below these folders, each once. Raises ValueError where there are none."""
    places: dict[Path, Path] = {}
    for folder in folders:
        for path, below, files in os.walk(folder):
            if not {CONFIG, METRICS, FAILED}.isdisjoint(files):
                places.setdefault(Path(path).resolve(), Path(path))
                below.clear()
    if not places:
        raise ValueError(
            f"no runs in {', '.join(map(str, folders))}; make some (python train.py -m "
            "experiment=table3) or say where they are (runs=FOLDER)"
        )
    return [collected(path) for path in sorted(places.values())]


def collected(folder: Path) -> Collected:
    """What is known of one run."""
    try:
        choices = read_choices(folder / CONFIG) if (folder / CONFIG).is_file() else {}
        if (folder / METRICS).is_file():
            metrics = json.loads((folder / METRICS).read_text("utf-8"))
            if not isinstance(metrics, dict):
                raise ValueError(f"{METRICS} holds no numbers of a run")
            return Collected(folder, FINISHED, "", choices, metrics)
        why = why_failed(folder)
    except (ValueError, KeyError, yaml.YAMLError) as error:
        first = str(error).splitlines()[0]
        return Collected(folder, DAMAGED, f"{first}; repeat the run", {}, {})
    if why is not None:
        return Collected(folder, "failed", why, choices, {})
    return Collected(folder, UNFINISHED, f"it has no {METRICS} yet", choices, {})


def why_failed(folder: Path) -> str | None:
    """The reason that a failed run left; None where it has not failed."""
    return str(read_failure(folder)["reason"]) if (folder / FAILED).is_file() else None


def read_choices(path: Path) -> dict[str, Any]:
    """Every choice in a run's config, dotted. Raises ValueError for what is no config.

    Reading YAML is slow, and the runs of a sweep differ in a few lines: each of the config's blocks
    is read once, however many runs have it.
    """
    blocks = re.split(r"^(?=\w)", path.read_text("utf-8"), flags=re.MULTILINE)
    return {key: value for block in blocks for key, value in _choices(block)}


@cache
def _choices(block: str) -> tuple[tuple[str, Any], ...]:
    content = yaml.load(block, Loader) or {}
    if not isinstance(content, dict):
        raise ValueError(f"{CONFIG} holds {block.splitlines()[0]!r}, which is no setting")
    return tuple(dotted(content).items())


def dotted(node: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """{dotted name: value} of all leaves; a list is one, an empty choice is none."""
    found: dict[str, Any] = {}
    for key, value in node.items():
        if isinstance(value, Mapping):
            found |= dotted(value, f"{prefix}{key}.")
        elif key not in UNTOLD:
            found[f"{prefix}{key}"] = value
    return found


def typed(value: Any) -> Any:
    """A value as a table holds it: numbers and words as they are, a list as it would be typed."""
    if isinstance(value, list | tuple):
        return f"[{','.join(str(typed(v)) for v in value)}]"
    return "null" if value is None else value


def varying(runs: Sequence[Collected]) -> dict[str, list[Any]]:
    """{dotted name: value of each run} of the choices that are not the same in all of them.

    None where a run has no such choice; runs of which nothing is known do not count.
    """
    known = [run for run in runs if run.choices]
    names = dict.fromkeys(name for run in known for name in run.choices)
    found: dict[str, list[Any]] = {}
    for name in names:
        values = [typed(r.choices[name]) if name in r.choices else None for r in runs]
        if len({str(v) for v, r in zip(values, runs, strict=True) if r.choices}) > 1:
            found[name] = values
    return found
