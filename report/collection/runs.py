"""Any collection of runs: one sweep, several, a glob → every run in them, none left out."""

from __future__ import annotations

import glob
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from data.arguments import Parser
from data.record import dof_numbers
from models.stored.schema import SPLITS
from runner.config.choices import varying
from runner.config.command_line import absolute
from runner.folder.run_folder import CONFIG, FAILED, METRICS
from runner.progress import print_damaged
from runner.scores.conformal import FREE_RUN, ONE_STEP
from runner.scores.headline import believed, headline
from runner.scores.result import DAMAGED, Result, read_result


def folders_of(typed: str | Sequence[str]) -> list[Path]:
    """Folders named by a person: one, a list, or patterns with *, ? and **.

    Raises ValueError for a folder that is not there or a pattern without any.
    """
    found: dict[Path, Path] = {}
    for one in [typed] if isinstance(typed, str) else typed:
        name = str(absolute(one))
        matches = sorted(glob.glob(name, recursive=True)) if glob.has_magic(name) else [name]
        folders = [Path(match) for match in matches if Path(match).is_dir()]
        if not folders:
            kind = "no folder matches" if glob.has_magic(name) else "there is no folder"
            raise ValueError(f"{kind} {one}; runs= takes a folder, a list [a,b] or a pattern")
        found |= {folder.resolve(): folder for folder in folders}
    return list(found.values())


def folders_and_output(
    help_text: str | None, usual: Path, words: Sequence[str] | None
) -> tuple[list[Path], Path | None]:
    """Folders of runs and the output that a command line names; `usual` without any.

    Raises ValueError where they hold no run.
    """
    parser = Parser(description=(help_text or "").splitlines()[0])
    about = f"of the runs; {usual} without any"
    parser.add_argument("folders", nargs="*", type=Path, default=[usual], help=about)
    parser.add_argument("--output", type=Path, help="folder; results/ in that of the runs")
    options = parser.parse_args(words)
    run_folders(options.folders)
    return options.folders, options.output


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
    return Path(os.path.commonpath(folders)) / "results"


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


# The numbers of one run, named the same in the long-form table and in TensorBoard.
#
# A number has a split, an estimate ("" for the model's own, else another way in which it is
# scored), a metric as it is called in metrics.json, and a DOF where there is one for each.

OF_THE_RUN = ("fit_seconds", "parameters", "simulation_error")


class Score(NamedTuple):
    """One number. Infinite and `diverged` where an estimate overflowed or a free run left."""

    split: str  # "" for what belongs to the whole run
    estimate: str
    metric: str
    dof: int | None  # its number; None for all together
    value: float
    diverged: bool = False

    @property
    def name(self) -> str:
        """As in TensorBoard: test/relative_rms_percent, test/own_residual/per_dof_percent/x1."""
        dof = "" if self.dof is None else f"x{self.dof}"
        return "/".join(filter(None, (self.split or "run", self.estimate, self.metric, dof)))


def scores_of(metrics: Mapping[str, Any]) -> Iterator[Score]:
    """Every number of a run's metrics.json, except its baselines'."""
    for name in OF_THE_RUN:
        if isinstance(metrics.get(name), int | float):
            yield Score("", "", name, None, float(metrics[name]))
    for part in ("identification", "training"):
        for name, value in (metrics.get(part) or {}).items():
            if value is None or isinstance(value, int | float):
                yield Score("", "", name, None, math.inf if value is None else float(value))
    numbers = metrics.get("numbers", ())
    for split in SPLITS:
        yield from _of_split(split, "", metrics.get(split) or {}, numbers)
    yield from _online(metrics.get("online") or {})
    yield from _parameters(metrics.get("uncertainty") or {})
    yield from _bands(metrics.get("uncertainty") or {}, numbers)


def _of_split(
    split: str, estimate: str, scores: Mapping[str, Any], numbers: Sequence[int]
) -> Iterator[Score]:
    for name, value in scores.items():
        if isinstance(value, dict):
            yield from _of_split(split, name, value, numbers)
        elif name.startswith("per_dof") and isinstance(value, list):
            for dof, of_dof in zip(dof_numbers(numbers, len(value)), value, strict=True):
                yield _score(split, estimate, name, dof, of_dof)
        elif name == "diverged_after_s":  # by run that diverged: when the first of them left
            if value:
                yield Score(split, estimate, name, None, float(min(value)))
        elif name != "no_free_run":  # why there is no free run
            yield _score(split, estimate, name, None, value)


def _online(online: Mapping[str, Any]) -> Iterator[Score]:
    """Of a model that adapts (models/online/scores.py); infinite where an error never settled."""
    for way, of_way in online.get("estimates", {}).items():
        estimate = "" if way == "adapting" else way
        yield _score("test", estimate, "worst_percent", None, of_way.get("worst_percent"))
        for level, seconds in of_way.get("settle_s", {}).items():
            never = math.inf if seconds is None else seconds
            yield Score("test", estimate, f"settle_s/{level}", None, never)
    for seconds, percent in online.get("frozen_error_percent", {}).items():
        yield _score("test", "", f"frozen_error_percent/{seconds}", None, percent)


def _parameters(uncertainty: Mapping[str, Any]) -> Iterator[Score]:
    """Masses and elements, with half widths of 95 % intervals; none of what was given."""
    for p in headline(uncertainty):
        for metric, number in (("value", p["value"]), ("half_95", believed(p))):
            if number is not None:
                yield Score("", p["name"], metric, None, float(number))


def _bands(uncertainty: Mapping[str, Any], numbers: Sequence[int]) -> Iterator[Score]:
    """Share of the test samples in 95 % bands, and their mean half widths by DOF."""
    for split, key in (("test", ONE_STEP), ("free_run", FREE_RUN)):
        band = uncertainty.get(key) or {}
        if "covered_percent" in band:
            yield _score(split, "", "covered_percent", None, band["covered_percent"])
            halves = band.get("mean_half_widths", [])
            for dof, half in zip(dof_numbers(numbers, len(halves)), halves, strict=True):
                yield _score(split, "", "half_width_95", dof, half)


def _score(split: str, estimate: str, name: str, dof: int | None, value: float | None) -> Score:
    lost = value is None
    return Score(split, estimate, name, dof, math.inf if value is None else float(value), lost)
