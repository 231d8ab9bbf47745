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

The paper's tables: python -m report.paper.
As it was trained, a run prints the numbers of `metrics.json`, to the last digit. Under another
scenario, other seeds or another record the structure, excitation and model stay what they were.
Where a measured record is gone, the stored scores are printed: the model needs no record to load.
"""

from __future__ import annotations

import hydra
from omegaconf import DictConfig

from report.commands import evaluate
from runner.config.command_line import one_line_errors, read_words, refusals
from runner.config.compose import CONF, prepare_hydra

prepare_hydra()


@hydra.main(version_base="1.3", config_path=str(CONF), config_name="evaluate")
def main(cfg: DictConfig) -> None:
    with refusals():
        evaluate(cfg)


def cli() -> None:
    """What the command line runs: bad input ends in one line and exit status 1."""
    with one_line_errors("evaluate"):
        read_words()
        main()


if __name__ == "__main__":
    cli()
