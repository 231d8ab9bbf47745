"""The LightningModule: closed form first, then gradients for what is left; both splits scored."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from models.baselines import TwoPoint
from models.fit.identification import Identification
from models.fit.metrics import score
from models.fit.solvers.lbfgs import LBFGS
from models.fit.trainable import Trainable
from models.training.assemble import data_from
from models.vwnn import VWNN
from runner.config.compose import composed
from tests.models.training import fit


class Gained(TwoPoint):
    """A line through two values times a gain that only a gradient can find."""

    def __init__(self) -> None:
        super().__init__(3, 3, 0.01)
        self.gain = nn.Parameter(torch.tensor(0.1, dtype=torch.float64))


class Untold(Gained, Trainable):
    """Such a line for a solver that nobody chose."""


@pytest.fixture(scope="module")
def data():
    return data_from(composed("data.duration=10"))


def test_a_closed_form_is_solved_without_an_epoch_and_scored_as_by_the_plain_loop(data, tmp_path):
    module = fit(Identification(VWNN(3, 3, 0.01)), data, tmp_path)
    assert module.trainer.global_step == 0
    assert module.solution["rank"] == 91
    module.trainer.test(module, datamodule=data, verbose=False)
    for split in ("train", "test"):
        assert module.results()[split] == score(module.estimator, data.loader(split))


def test_free_parameters_ask_for_a_solver_and_a_trainable(data, tmp_path):
    with pytest.raises(ValueError, match="choose a solver"):
        fit(Identification(Untold()), data, tmp_path)
    with pytest.raises(ValueError, match="Gained has free parameters but is no Trainable"):
        fit(Identification(Gained(), LBFGS), data, tmp_path)
