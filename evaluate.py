"""One finished run scored again, under other conditions if asked; or many compared. No training.

    python evaluate.py run=FOLDER                   one run, from its own config and checkpoint
    python evaluate.py run=FOLDER scenario=noisy seeds=[5,6,7]
    python evaluate.py run=FOLDER data.duration=100
    python evaluate.py runs=FOLDER output=FOLDER    all numbers as one table: results.parquet, .csv
    python evaluate.py runs=[a,b]                   of several folders, or 'runs=runs/*/'
    python evaluate.py runs=FOLDER by=model.cutoff  compared by a choice: a table and a picture

The paper's tables and the leaderboard: python -m report.paper, python -m report.free_run.
As it was trained, a run prints the numbers of `metrics.json`, to the last digit. Under another
scenario, other seeds or another record the structure, excitation and model stay what they were.
Where a measured record is gone, the stored scores are printed: the model needs no record to load.
"""

from __future__ import annotations

from pathlib import Path

import hydra
from omegaconf import DictConfig

from models.training.assemble import changed
from report.collection.report import report_by, report_collection
from report.collection.runs import folders_of
from report.run.rescore import (
    draw_figures,
    print_evaluation,
    print_stored,
    record_gone,
    score_seeds,
)
from runner.command_line import absolute, job_errors, one_line_errors
from runner.compose import CONF, prepare_hydra
from runner.run_folder import read_run, restore, write_json

prepare_hydra()


def evaluate(cfg: DictConfig, folder: Path, label: str) -> dict:
    """Scores of a run under the changes in `cfg`, saved with figures in its `evaluation/`."""
    run, metrics = read_run(folder)
    estimator = restore(run, folder)
    changes = {key: value for key, value in cfg.data.items() if value is not None}
    run = changed(run, {"data": changes})
    if cfg.get("scenario") is not None:
        run.scenario = cfg.scenario
    seeds = [run.seed] if cfg.seeds is None else list(cfg.seeds)
    altered = cfg.get("scenario") is not None or bool(changes) or cfg.seeds is not None
    gone = record_gone(run)
    if gone is not None and not altered:
        print_stored(metrics, gone)
        return metrics

    results = score_seeds(estimator, run, seeds, same_motions=not changes)
    print_evaluation(results, metrics, altered)
    output = folder / "evaluation" / label
    draw_figures(estimator, run, seeds[0], output)
    write_json(output / "scores.json", results)
    print(f"figures and scores in {output}")
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


@hydra.main(version_base="1.3", config_path=str(CONF), config_name="evaluate")
def main(cfg: DictConfig) -> None:
    with job_errors():
        if cfg.run is None:
            report_runs(cfg)
            return
        if cfg.output or cfg.runs:
            raise ValueError("runs= and output= are for many runs; leave them out with run=")
        evaluate(cfg, absolute(cfg.run), (cfg.label or "as_trained").replace("/", "_"))


def cli() -> None:
    """What the command line runs: bad input ends in one line and exit status 1."""
    with one_line_errors("evaluate"):
        main()


if __name__ == "__main__":
    cli()
