"""Identify a structure: simulate it, fit a model, score it on unseen motion, save all of it.

python train.py model=vwnn system=bilinear
python train.py -m model=vwnn,linear system=bilinear,polynomial,bouc_wen seed=0,1
python train.py --help
"""

from __future__ import annotations

import math
from pathlib import Path

import hydra
import torch
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from lightning.pytorch import Trainer
from lightning.pytorch.loggers import TensorBoardLogger
from lightning.pytorch.plugins.environments import LightningEnvironment
from omegaconf import DictConfig
from threadpoolctl import threadpool_limits

from models.training.assemble import assembled
from models.training.resume import SaveProgress
from report.run.summary import log_run, print_run
from runner.command_line import job_errors, one_line_errors, quiet_lightning
from runner.compose import CONF, prepare_hydra
from runner.outcome import compare_baselines, metrics_of, validation_error
from runner.run_folder import Run

prepare_hydra()


def identify(cfg: DictConfig, folder: Path) -> dict:
    """One run: data, fit, test, files; returns what `metrics.json` holds."""
    quiet_lightning()
    data, module, baselines = assembled(cfg)
    run = Run.begin(folder, cfg, data.sensors)
    data.setup()

    torch.set_num_threads(cfg.threads)
    threadpool_limits(cfg.threads)
    logger = TensorBoardLogger(folder, name="", version="tensorboard")
    trainer = Trainer(
        logger=logger,
        plugins=LightningEnvironment(),  # a run is one process, in a Slurm job too
        default_root_dir=folder,
        callbacks=SaveProgress(run.progress, run.identity, cfg.checkpoint_seconds),
        enable_checkpointing=False,
        enable_model_summary=False,
        limit_val_batches=None if data.validation else 0,
        **cfg.trainer,
    )
    try:
        trainer.fit(module, datamodule=data, ckpt_path=run.unfinished, weights_only=True)
        trainer.test(module, datamodule=data, verbose=False)
    except SystemExit:  # what Lightning makes of Ctrl-C
        raise KeyboardInterrupt from None

    metrics = metrics_of(run, module, data, compare_baselines(baselines, data))
    run.save(module.estimator)
    log_run(logger, run.choices, module, data, metrics)
    run.finish(metrics)
    return metrics


@hydra.main(version_base="1.3", config_path=str(CONF), config_name="train")
def main(cfg: DictConfig) -> float | None:
    """What a search minimises: the validation error in percent; None where nothing is held back."""
    hydra_cfg = HydraConfig.get()
    folder, in_sweep = Path(hydra_cfg.runtime.output_dir), hydra_cfg.mode == RunMode.MULTIRUN
    error: float | None = math.inf  # of a run that fails
    with job_errors(folder if in_sweep else None, cfg):
        metrics = identify(cfg, folder)
        error = validation_error(metrics) if cfg.data.validation else None
        if not in_sweep:
            print_run(metrics, folder)
    return error


def cli() -> None:
    """What the command line runs: bad input ends in one line and exit status 1."""
    with one_line_errors("train"):
        main()


if __name__ == "__main__":
    cli()
