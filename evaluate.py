"""Finished runs → tables and figures; or one run scored again. No training.

    python evaluate.py                              the paper's tables of the runs in runs/study,
                                                    the leaderboard of those in runs/free_run
    python evaluate.py runs=FOLDER output=FOLDER    both, as far as the runs of a folder allow, and
                                                    all numbers as one table: results.parquet, .csv
    python evaluate.py runs=[a,b]                   of several folders, or 'runs=runs/*/'
    python evaluate.py runs=FOLDER by=model.cutoff  compared by a choice: a table and a picture
    python evaluate.py page=docs/results.md         the whole page of the study
    python evaluate.py free_run_page=docs/free_run.md   that of the leaderboard
    python evaluate.py run=FOLDER                   one run, from its own config and checkpoint
    python evaluate.py run=FOLDER scenario=noisy seeds=[5,6,7]
    python evaluate.py run=FOLDER data.duration=100

As it was trained, a run prints the numbers of `metrics.json`, to the last digit. Under another
scenario, other seeds or another record the structure, excitation and model stay what they were.
Where a measured record is gone, the stored scores are printed: the model needs no record to load.
"""

from __future__ import annotations

from pathlib import Path

import hydra
from omegaconf import DictConfig

from models.training.assemble import changed
from report.collection.runs import folders_of
from report.paper.results import (
    report_by,
    report_collection,
    report_leaderboard,
    report_study,
    report_usual,
)
from report.run.rescore import (
    draw_figures,
    print_evaluation,
    print_stored,
    record_gone,
    score_seeds,
)
from runner.command_line import CONF, absolute, job_errors, one_line_errors, prepare_hydra
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
    """Tables and figures of many runs, as the config says."""
    output = absolute(cfg.output) if cfg.output else None
    typed = [cfg.runs] if isinstance(cfg.runs, str) else list(cfg.runs or [])
    folders = folders_of([str(absolute(name)) for name in typed]) if typed else []
    if len(folders) > 1 and (cfg.page or cfg.free_run_page):
        raise ValueError("a page is made of one folder of runs; give runs= one folder")
    if cfg.by is not None:
        keys = [cfg.by] if isinstance(cfg.by, str) else list(cfg.by)
        if not folders:
            raise ValueError("by= compares the runs of runs=FOLDER; say which")
        report_by(folders, keys, cfg.metric, cfg.split, output)
        return
    study = folders[0] if folders else absolute(cfg.study)
    if cfg.page:
        others = absolute(cfg.outside), absolute(cfg.close_fit)
        report_study(study, output, absolute(cfg.page), *others)
    if cfg.free_run_page:
        free_runs = folders[0] if folders else absolute(cfg.free_run)
        report_leaderboard(free_runs, absolute(cfg.questions), output, absolute(cfg.free_run_page))
    if cfg.page or cfg.free_run_page:
        return
    if folders:
        report_collection(folders, output)
    else:
        report_usual(study, absolute(cfg.free_run), absolute(cfg.questions), output)


@hydra.main(version_base="1.3", config_path=str(CONF), config_name="evaluate")
def main(cfg: DictConfig) -> None:
    with job_errors():
        if cfg.run is not None and (cfg.output or cfg.page or cfg.free_run_page):
            raise ValueError(
                "output and pages are for tables of many runs; leave them out with run="
            )
        if cfg.run is not None:
            evaluate(cfg, absolute(cfg.run), (cfg.label or "as_trained").replace("/", "_"))
            return
        report_runs(cfg)


def cli() -> None:
    """What the command line runs: bad input ends in one line and exit status 1."""
    with one_line_errors("evaluate"):
        main()


if __name__ == "__main__":
    cli()
