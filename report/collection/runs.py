"""Any collection of runs: one sweep, several, a glob → every run in them, none left out."""

from __future__ import annotations

import glob
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from runner.config.choices import varying
from runner.config.command_line import absolute
from runner.folder.run_folder import CONFIG, FAILED, METRICS
from runner.progress import print_damaged
from runner.scores.result import DAMAGED, Result, read_result


def folders_of(typed: str | Sequence[str]) -> list[Path]:
    """Folders named by a person: one, a list, or patterns with *, ? and **.

    Raises ValueError for a folder that is not there or a pattern without any.
    """
    found: dict[Path, Path] = {}
    for one in [typed] if isinstance(typed, str) else typed:
        name = str(absolute(one))
        many = glob.has_magic(name) and not Path(name).is_dir()
        matches = sorted(glob.glob(name, recursive=True)) if many else [name]
        folders = [Path(match) for match in matches if Path(match).is_dir()]
        if not folders:
            kind = "no folder matches" if many else "there is no folder"
            raise ValueError(f"{kind} {one}; runs= takes a folder, a list [a,b] or a pattern")
        found |= {folder.resolve(): folder for folder in folders}
    return list(found.values())


def run_folders(folders: Sequence[Path]) -> list[Path]:
    """Folders of all runs below these, each once. Raises ValueError where there are none."""
    places: dict[Path, Path] = {}
    for folder in folders:
        for path, below, files in os.walk(folder):
            if not {CONFIG, METRICS, FAILED}.isdisjoint(files):
                places.setdefault(Path(path).resolve(), Path(path))
                below.clear()
    if not places:
        raise ValueError(
            f"no runs in {_listed(folders)}; make some (python train.py -m "
            "experiment=table3) or name another folder"
        )
    return sorted(places.values())


def collect(folders: Sequence[Path]) -> list[Result]:
    """All runs below these folders, each once. Raises ValueError where there are none."""
    return [read_result(path) for path in run_folders(folders)]


def read_runs(folders: Path | Sequence[Path]) -> list[Result]:
    """All runs below folders that ended, with numbers or a reason; the damaged ones are printed.

    Raises ValueError for none.
    """
    folders = [folders] if isinstance(folders, Path) else list(folders)
    every = collect(folders)
    print_damaged({run.folder.name: run.reason for run in every if run.status == DAMAGED})
    if runs := [run for run in every if run.has_ended]:
        return runs
    raise ValueError(f"no run in {_listed(folders)} has ended yet")


def as_typed(folder: Path) -> str:
    """A folder as a person would type it here."""
    absolute, here = folder.resolve(), Path.cwd().resolve()
    return (absolute.relative_to(here) if here in absolute.parents else absolute).as_posix()


def results_folder(folders: Path | Sequence[Path]) -> Path:
    """results/ in the folder of the runs, or in the one that holds all of several."""
    folders = [folders] if isinstance(folders, Path) else folders
    return Path(os.path.commonpath([folder.absolute() for folder in folders])) / "results"


def _listed(folders: Sequence[Path]) -> str:
    return ", ".join(map(str, folders))


NAMES = ("model.name", "system.name", "scenario.name", "seed")  # they name a run's case


def varied_choices(runs: Sequence[Result]) -> dict[str, list[Any]]:
    """Choices that vary; a system's dozens of settings only where its name does not tell them."""
    systems = [run.choices.get("system.name") for run in runs]
    found = {}
    for name, values in varying([run.choices for run in runs]).items():
        pairs = set(zip(systems, map(str, values), strict=True))
        implied = name.startswith("system.") and len(pairs) == len(set(systems))
        if name not in NAMES and not implied:
            found[name] = values
    return found
