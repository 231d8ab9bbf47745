"""Identify a structure: simulate it, fit a model, score it on unseen motion, save all of it.

python train.py model=vwnn system=bilinear
python train.py -m model=vwnn,linear system=bilinear,polynomial,bouc_wen seed=0,1
python train.py --help

What one run does, from data to files: `identify` in runner/job.py.
"""

from __future__ import annotations

import math
from contextlib import nullcontext
from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig

from report.commands import train
from runner.config.command_line import one_line_errors, read_words, refusals
from runner.config.compose import CONF, prepare_hydra

prepare_hydra()


@hydra.main(version_base="1.3", config_path=str(CONF), config_name="train")
def main(cfg: DictConfig) -> float | None:
    """The validation error in percent, which Hydra's sweepers may minimise; None without one."""
    hydra_cfg = HydraConfig.get()
    folder, in_sweep = Path(hydra_cfg.runtime.output_dir), hydra_cfg.mode == RunMode.MULTIRUN
    with nullcontext() if in_sweep else refusals():
        metrics = train(cfg, folder, in_sweep)
        if not metrics:
            return math.inf  # a run of a sweep that failed
        from report.run.summary import print_run
        from runner.scores.outcome import require_identified, validation_error

        error = validation_error(metrics) if cfg.data.validation else None
        if not in_sweep:
            print_run(metrics, folder)
            require_identified(metrics)
    return error


def cli() -> None:
    """What the command line runs: bad input ends in one line and exit status 1."""
    with one_line_errors("train"):
        read_words()
        main()


if __name__ == "__main__":
    cli()
