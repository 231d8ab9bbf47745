"""One finished run scored again, under other conditions if asked; or many compared. No training.

    python evaluate.py run=FOLDER                   one run, from its own config and checkpoint
    python evaluate.py run=FOLDER scenario=noisy seeds=[5,6,7]
    python evaluate.py run=FOLDER data.duration=100
    python evaluate.py run=FOLDER data.path=other.csv  on records of other files
    python evaluate.py run=zoo:element_network/bouc_wen   a published model, docs/zoo.md
    python evaluate.py run=FOLDER uncertainty=laplace  how sure its parameters are: profile, smc
    python evaluate.py run=FOLDER data.path=after.csv change=true   has it changed?
    python evaluate.py run=FOLDER page=html        one file to mail: report.html; or runs=FOLDER
    python evaluate.py runs=FOLDER output=FOLDER    all numbers as one table: results.parquet, .csv
    python evaluate.py runs=[a,b]                   of several folders, or 'runs=runs/*/'
    python evaluate.py runs=FOLDER by=model.cutoff  compared by a choice: a table and a picture

The paper's tables and the leaderboard: python -m report.paper, python -m report.free_run.
As it was trained, a run prints the numbers of `metrics.json`, to the last digit. Under another
scenario, other seeds or another record the structure, excitation and model stay what they were.
Where a measured record is gone, the stored scores are printed: the model needs no record to load.
"""

from __future__ import annotations

import hydra
from omegaconf import DictConfig

from report.collection.runs import folders_of
from runner.config.choices import plain, take_settings
from runner.config.command_line import absolute, one_line_errors, read_words, refusals
from runner.config.compose import CONF, prepare_hydra
from runner.config.settings import EVALUATE, check_settings
from runner.folder.run_folder import require_finished, run_folder
from runner.loading import loading

prepare_hydra()


@hydra.main(version_base="1.3", config_path=str(CONF), config_name="evaluate")
def main(cfg: DictConfig) -> None:
    with refusals():
        check_settings(cfg, EVALUATE)
        if cfg.run is not None and cfg.page is None:
            require_finished(absolute(run_folder(cfg.run)))
        folders_of(cfg.runs or [])
    with refusals(), loading():  # takes seconds: a mistyped word is reported before
        from report.run.evaluation import Conditions, evaluate, report_runs
        from runner.job import job_errors

    asked = plain(cfg)
    with job_errors():
        if cfg.page is not None:
            from report.page.command import page_of

            page_of(asked)
            return
        if cfg.run is None:
            report_runs(*(asked[key] for key in ("runs", "by", "metric", "split", "output")))
            return
        if cfg.output or cfg.runs:
            raise ValueError("runs= and output= are for many runs; leave them out with run=")
        folder = absolute(run_folder(cfg.run))
        conditions = take_settings(Conditions, asked)
        if cfg.change and cfg.uncertainty is not None:
            raise ValueError("change=true and uncertainty= are two questions; leave one out")
        if cfg.change:
            from report.uncertainty.change import evaluate_change

            evaluate_change(folder, conditions)
            return
        if cfg.uncertainty is not None:
            from report.uncertainty.command import Question, evaluate_uncertainty

            evaluate_uncertainty(folder, take_settings(Question, asked), conditions)
            return
        evaluate(folder, (cfg.label or "as_trained").replace("/", "_"), conditions)


def cli() -> None:
    """What the command line runs: bad input ends in one line and exit status 1."""
    with one_line_errors("evaluate"):
        read_words()
        main()


if __name__ == "__main__":
    cli()
