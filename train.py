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
from lightning.pytorch import Trainer, seed_everything
from lightning.pytorch.loggers import TensorBoardLogger
from lightning.pytorch.plugins.environments import LightningEnvironment
from omegaconf import DictConfig
from threadpoolctl import threadpool_limits

from models.checkpoint import save_estimator
from models.training.assemble import data_from, estimator_from, objective_from, solver_from
from models.training.identification import Identification
from models.training.resume import SaveProgress
from report.run.summary import compare_baselines, log_run, metrics_of, print_run
from runner.command_line import CONF, job_errors, one_line_errors, prepare_hydra, quiet_lightning
from runner.run_folder import (
    CHECKPOINT,
    PROGRESS,
    begin_run,
    config_text,
    finish_run,
    identity_of,
    plain,
)
from runner.validation import validation_error

prepare_hydra()


def identify(cfg: DictConfig, folder: Path) -> dict:
    """One run: data, fit, test, files; returns what `metrics.json` holds."""
    if cfg.threads < 1:
        raise ValueError(f"threads={cfg.threads} must be at least 1")
    quiet_lightning()
    if not isinstance(cfg.seed, int) or cfg.seed < 0:
        raise ValueError(f"seed={cfg.seed} must be a whole number, not negative")
    data = data_from(cfg)
    seed_everything(cfg.seed, verbose=False)
    estimator = estimator_from(cfg.model, data)
    module = Identification(
        estimator, solver_from(cfg.solver), cfg.max_fail, objective_from(cfg.objective)
    )
    baselines = {name: estimator_from(node, data) for name, node in cfg.baselines.items()}
    identity = identity_of(plain(cfg))
    unfinished = begin_run(folder, config_text(cfg), identity)
    data.setup()

    torch.set_num_threads(cfg.threads)
    threadpool_limits(cfg.threads)
    logger = TensorBoardLogger(folder, name="", version="tensorboard")
    trainer = Trainer(
        logger=logger,
        plugins=LightningEnvironment(),  # a run is one process, in a Slurm job too
        default_root_dir=folder,
        callbacks=SaveProgress(folder / PROGRESS, identity, cfg.checkpoint_seconds),
        enable_checkpointing=False,
        enable_model_summary=False,
        limit_val_batches=None if data.validation else 0,
        **cfg.trainer,
    )
    try:
        trainer.fit(module, datamodule=data, ckpt_path=unfinished, weights_only=True)
        trainer.test(module, datamodule=data, verbose=False)
    except SystemExit:  # what Lightning makes of Ctrl-C
        raise KeyboardInterrupt from None

    metrics = metrics_of(cfg, identity, module, data, compare_baselines(baselines, data))
    save_estimator(module.estimator, folder / CHECKPOINT, cfg.model.name)
    log_run(logger, module, data, metrics, cfg)
    finish_run(folder, metrics)
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
