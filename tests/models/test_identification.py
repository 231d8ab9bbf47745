"""The LightningModule: closed form first, then gradients for what is left, truth never seen."""

from __future__ import annotations

import pytest
import torch
from hydra import compose, initialize_config_dir
from lightning.pytorch import Trainer
from torch import nn

from data.record import Record
from models.baselines import TwoPoint
from models.fit.identification import Identification
from models.fit.solvers.lbfgs import LBFGS
from models.fit.trainable import Trainable
from models.training.assemble import data_from
from models.vwnn import VWNN
from runner.config.compose import CONF, prepare_hydra

pytestmark = [
    pytest.mark.filterwarnings("ignore:.*LeafSpec.*"),
    pytest.mark.filterwarnings("ignore:.*does not have many workers.*"),
    pytest.mark.filterwarnings("ignore:.*litlogger.*"),
]


class ScaledTwoPoint(TwoPoint, Trainable):
    """A line through two values times a gain that only a gradient can find."""

    def __init__(self, dofs: int, inputs: int, dt: float) -> None:
        super().__init__(dofs, inputs, dt)
        self.gain = nn.Parameter(torch.tensor(0.1, dtype=torch.float64))

    def forward(self, record: Record) -> torch.Tensor:
        assert record.truth is None
        return self.gain * super().forward(record)


@pytest.fixture(scope="module")
def data():
    prepare_hydra()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return data_from(compose("train", ["data.duration=20"]))


def fit(module: Identification, data, folder, epochs: int = 10) -> Trainer:
    trainer = Trainer(
        accelerator="cpu",
        devices=1,
        max_epochs=epochs,
        logger=False,
        log_every_n_steps=1,
        enable_progress_bar=False,
        enable_model_summary=False,
        enable_checkpointing=False,
        limit_val_batches=0,
        default_root_dir=folder,
    )
    trainer.fit(module, datamodule=data)
    return trainer


def test_an_estimator_without_free_parameters_is_solved_without_an_epoch(data, tmp_path):
    module = Identification(VWNN(3, 3, 0.01))
    trainer = fit(module, data, tmp_path)
    assert trainer.global_step == 0
    assert module.solution["rank"] == 91
    assert module.fit_seconds > 0.0


def test_scores_of_both_splits_are_those_of_the_plain_loop(data, tmp_path):
    from models.fit.metrics import score

    module = Identification(VWNN(3, 3, 0.01))
    trainer = fit(module, data, tmp_path)
    trainer.test(module, datamodule=data, verbose=False)
    for split in ("train", "test"):
        assert module.results()[split] == score(module.estimator, data.loader(split))


def test_free_parameters_without_a_solver_are_an_error(data, tmp_path):
    with pytest.raises(ValueError, match="choose a solver"):
        fit(Identification(ScaledTwoPoint(3, 3, 0.01)), data, tmp_path)


def test_free_parameters_of_an_estimator_that_is_not_trainable_are_refused(data, tmp_path):
    class Untrainable(TwoPoint):
        def __init__(self, dofs: int, inputs: int, dt: float) -> None:
            super().__init__(dofs, inputs, dt)
            self.gain = nn.Parameter(torch.tensor(0.1, dtype=torch.float64))

    with pytest.raises(ValueError, match="Untrainable has free parameters but is no Trainable"):
        fit(Identification(Untrainable(data.dofs, data.inputs, data.dt), LBFGS), data, tmp_path)
