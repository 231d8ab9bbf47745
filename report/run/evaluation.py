"""What evaluate.py does: a finished run scored again or on other records, or many compared."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from data.plain_data import as_config
from data.terminal import terminal
from models.estimator import Estimator
from models.training.assemble import changed
from report.collection.report import report_by, report_collection
from report.collection.runs import folders_of
from report.run.bands import bands_of_run, over_seeds, print_bands
from report.run.new_records import evaluate_records
from report.run.rescore import (
    draw_figures,
    print_evaluation,
    print_stored,
    record_gone,
    require_scores,
    score_seeds,
)
from report.run.table import WIDTH
from runner.config.command_line import absolute
from runner.folder.run import restore
from runner.folder.run_files import results_folder
from runner.folder.run_folder import read_run, write_json


def evaluate(cfg: DictConfig, folder: Path, label: str) -> dict[str, Any]:
    """Scores of a run under the changes in `cfg`, saved with figures in its `evaluation/`."""
    run, metrics = read_run(folder)
    estimator = restore(run, folder)
    require_scores(metrics, estimator.dofs)
    changes = _typed(OmegaConf.to_container(cfg.data, resolve=True))
    held_back = changes.pop("calibration_records", None)
    as_trained = run.copy()
    if cfg.get("scenario") is not None:
        run.scenario = cfg.scenario
    if "path" in changes:
        return _on_new_records(cfg, run, metrics, folder, estimator, changes, label)
    run = changed(run, {"data": as_config(changes)})
    seeds = [run.seed] if cfg.seeds is None else list(cfg.seeds)
    altered = cfg.get("scenario") is not None or bool(changes) or cfg.seeds is not None
    require_scores(metrics, estimator.dofs)
    gone = record_gone(run)
    if gone is not None and not altered:
        print_stored(metrics, gone)
        return metrics

    sure = bands_of_run(estimator, as_trained, metrics, held_back)
    results = score_seeds(estimator, run, seeds, not changes, sure)
    print_evaluation(results, metrics, altered)
    print_bands(terminal(WIDTH), metrics, over_seeds(sure, results))
    output = results_folder(folder) / "evaluation" / label
    prior = metrics.get("training", {}).get("prior")
    output.mkdir(parents=True, exist_ok=True)
    if cfg.figures:
        draw_figures(estimator, run, seeds[0], output, prior, sure)
    write_json(output / "scores.json", results)
    print(f"{'figures and ' if cfg.figures else ''}scores in {output}")
    return results


def _typed(values: Any) -> dict[str, Any]:
    """What was said of the data, without what was left open."""
    kept = {key: _typed(v) if isinstance(v, dict) else v for key, v in values.items()}
    return {key: value for key, value in kept.items() if value is not None and value != {}}


def _on_new_records(
    cfg: DictConfig,
    run: DictConfig,
    metrics: dict[str, Any],
    folder: Path,
    estimator: Estimator,
    changes: dict[str, Any],
    label: str,
) -> dict[str, Any]:
    """Scores on the records of other files, saved in the run's `evaluation/`."""
    if cfg.seeds is not None:
        raise ValueError("seeds= draws motions, and data.path= names measured ones; leave one out")
    files = [changes["path"]] if isinstance(changes["path"], str) else list(changes["path"])
    changes["path"] = [str(absolute(file)) for file in files]
    stems = "+".join(Path(file).stem for file in files).replace("*", "all")
    label = stems[:80] if "data.path=" in label else label
    output = results_folder(folder) / "evaluation" / label
    results = evaluate_records(estimator, run, metrics, folder, changes, output, cfg.figures)
    print(f"{'figures and ' if cfg.figures else ''}scores in {output}")
    return results


def report_runs(cfg: DictConfig) -> None:
    """All numbers of many runs, or a comparison of them."""
    output = absolute(cfg.output) if cfg.output else None
    typed = [cfg.runs] if isinstance(cfg.runs, str) else list(cfg.runs or [])
    if not typed:
        asked = (
            "by= compares the runs of runs=FOLDER"
            if cfg.by is not None
            else ("run=FOLDER scores a run again, runs=FOLDER compares many")
        )
        raise ValueError(f"{asked}; say which")
    folders = folders_of([str(absolute(name)) for name in typed])
    if cfg.by is None:
        report_collection(folders, output)
    else:
        keys = [cfg.by] if isinstance(cfg.by, str) else list(cfg.by)
        report_by(folders, keys, cfg.metric, cfg.split, output)
