"""What train.py, evaluate.py and predict.py do once their words are a config.

Bad input stops before PyTorch is loaded, which takes seconds.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from report.collection.runs import folders_of
from report.collection.runs import results_folder as results_beside
from runner.config.choices import plain, take_settings
from runner.config.command_line import absolute
from runner.config.settings import (
    EVALUATE,
    PREDICT,
    Conditions,
    Question,
    Wanted,
    Written,
    check_excitation,
    check_files,
    check_settings,
)
from runner.folder.run_folder import require_finished, results_folder, run_folder
from runner.loading import loading


def train(cfg: DictConfig, folder: Path, in_sweep: bool = False) -> dict[str, Any]:
    """One run in a folder; what its `metrics.json` holds. Raises ValueError, OSError: see below.

    In a sweep, which checks its words once for all, the folder of a run that fails says why.
    """
    if not in_sweep:
        check_settings(cfg)
        check_files(cfg)
    with loading():
        from report.run.summary import draw_run
        from runner.job import identify, job_errors

    with job_errors(folder if in_sweep else None, cfg):
        return identify(cfg, folder, draw_run, progress=not in_sweep)
    return {}


def require_folder(output: str | None) -> None:
    """Raise ValueError for an output that is a file, or lies in one."""
    place = None if output is None else absolute(output)
    while place is not None and not place.exists() and place != place.parent:
        place = place.parent
    if place is not None and not place.is_dir():
        raise ValueError(f"output={output}: {place} is no folder; choose another")


def folder_of(run: str) -> Path:
    """The folder of a finished run as typed, from where it was typed."""
    return absolute(run_folder(run))


def evaluate(cfg: DictConfig) -> Any:
    """Scores of a finished run as they are saved; of many runs their table or comparison; a page.

    Raises ValueError for words that do not go together, and what they name that is not there.
    """
    check_settings(cfg, EVALUATE)
    require_folder(cfg.output)
    if cfg.run is not None and cfg.page is None:
        require_finished(folder_of(cfg.run))
    folders_of(cfg.runs or [])
    with loading():
        from report.run.evaluation import evaluate, report_runs
        from runner.job import job_errors

    asked = plain(cfg)
    with job_errors():
        if cfg.page is not None:
            return page_of(asked)
        if cfg.run is None:
            return report_runs(*(asked[key] for key in ("runs", "by", "metric", "split", "output")))
        if cfg.output or cfg.runs:
            raise ValueError("runs= and output= are for many runs; leave them out with run=")
        folder = folder_of(cfg.run)
        conditions = take_settings(Conditions, asked)
        if cfg.change and cfg.uncertainty is not None:
            raise ValueError("change=true and uncertainty= are two questions; leave one out")
        if cfg.change:
            from report.uncertainty.change import evaluate_change

            return evaluate_change(folder, conditions)
        if cfg.uncertainty is not None:
            from report.uncertainty.command import evaluate_uncertainty

            return evaluate_uncertainty(folder, take_settings(Question, asked), conditions)
        return evaluate(folder, (cfg.label or "as_trained").replace("/", "_"), conditions)


OTHER_SCORES = ("uncertainty", "change", "seeds", "scenario", "by")  # than those of a page


def page_of(asked: Mapping[str, Any]) -> Path:
    """Write the page of one run, or of many, and print where it is.

    asked: as in conf/evaluate.yaml. Raises ValueError for words that ask for other scores.
    """
    from report.page.page import write_page, write_runs_page
    from report.run.evaluation import said_alone

    others = [key for key in OTHER_SCORES if asked.get(key)]
    others += [f"data.{key}" for key in said_alone(asked["data"])]
    others += ["output"] if asked["run"] is not None and asked["output"] else []
    if others:
        raise ValueError(f"page=html shows runs as they were trained; leave {others[0]}= out")
    if (asked["run"] is None) == (not asked["runs"]):
        raise ValueError("page=html of what? say run=FOLDER, or runs=FOLDER to compare many")
    if asked["run"] is not None:
        page = write_page(folder_of(asked["run"]))
    else:
        folders = folders_of(asked["runs"])
        output = absolute(asked["output"]) if asked["output"] else results_beside(folders)
        page = write_runs_page(folders, output)
    print(f"page in {page}")
    return page


def predict(cfg: DictConfig) -> tuple[Path, list[Any], list[Any]]:
    """The folder of the results; a `Prediction` for each motion and scale; fragility curves.

    Raises ValueError for a run, a motion or settings that cannot be used.
    """
    if cfg.run is None:
        raise ValueError("which model? give run=FOLDER, the folder that train.py wrote")
    require_folder(cfg.output)
    check_settings(cfg, PREDICT)
    check_excitation(cfg.excitation)
    folder = folder_of(cfg.run)
    require_finished(folder)
    with loading():
        from report.prediction.predict import predict
        from runner.job import job_errors

    with job_errors():
        asked = plain(cfg)
        wanted, written = take_settings(Wanted, asked["excitation"]), take_settings(Written, asked)
        own = results_folder(folder) / "prediction" / wanted.label
        place = absolute(cfg.output) if cfg.output else own
        return place, *predict(folder, wanted, written, place)
