"""Every solver fits every network in the LightningModule; validation of a fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir
from lightning.pytorch import Trainer
from torch import Tensor, nn
from torch.nn.utils import parameters_to_vector

from data.record import Record
from models.estimator import Estimator
from models.fit.identification import Identification
from models.fit.problem import Problem
from models.fit.trainable import Trainable
from models.linear import EquivalentLinear
from models.training.assemble import data_from, estimator_from, solver_from
from runner.config.compose import CONF, prepare_hydra

pytestmark = [
    pytest.mark.filterwarnings("ignore:.*LeafSpec.*"),
    pytest.mark.filterwarnings("ignore:.*does not have many workers.*"),
    pytest.mark.filterwarnings("ignore:.*litlogger.*"),
]
SOLVERS = sorted(path.stem for path in (CONF / "solver").glob("*.yaml"))


# in the LightningModule


def composed(*overrides: str):
    prepare_hydra()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return compose("train", ["data.duration=12", *overrides])


@pytest.fixture(scope="module")
def records():
    """Simulated once, for every choice of solver."""
    data = data_from(composed())
    data.setup()
    return data.records


def data_of(cfg, records):
    data = data_from(cfg)
    if data.validation:
        data.setup()
    else:
        data.records = records
    return data


def fit(module: Identification, data, folder: Path, epochs: int = -1) -> Trainer:
    trainer = Trainer(
        accelerator="cpu",
        devices=1,
        max_epochs=epochs,
        logger=False,
        num_sanity_val_steps=0,
        enable_progress_bar=False,
        enable_model_summary=False,
        enable_checkpointing=False,
        limit_val_batches=None if data.validation else 0,
        log_every_n_steps=1,
        default_root_dir=folder,
    )
    trainer.fit(module, datamodule=data)
    return trainer


def trained(records, folder: Path, *overrides: str, seed: int = 0) -> tuple[Identification, float]:
    """A fit as in train.py, and the loss on all of the training windows before it."""
    cfg = composed(*overrides)
    data = data_of(cfg, records)
    torch.manual_seed(seed)
    module = Identification(estimator_from(cfg.model, data), solver_from(cfg.solver), cfg.max_fail)
    state = {name: u.clone() for name, u in module.free_parameters().items()}
    fit(module, data, folder)
    untrained = estimator_from(cfg.model, data)
    untrained.load_state_dict({**module.estimator.state_dict(), **state})
    return module, whole_loss(untrained, data)


def whole_loss(estimator: Estimator, data) -> float:
    parts = [Problem(estimator, record) for record in data.loader("train")]
    sums = [(float(p.loss().detach()), p.y.numel() / p.weight**2) for p in parts]
    return sum(loss * size for loss, size in sums) / sum(size for _, size in sums)


@pytest.mark.parametrize("model", ["residual_mlp", "global_mlp"])
@pytest.mark.parametrize("solver", SOLVERS)
def test_every_solver_fits_every_network(solver, model, records, tmp_path):
    overrides = f"model={model}", f"solver={solver}", "solver.iterations=7"
    module, before = trained(records, tmp_path, *overrides)
    assert len(module.losses) == 7
    assert module.solver.why == "7 iterations"
    assert module.how_trained()["iterations"] == 7
    after = whole_loss(module.estimator, data_of(composed(*overrides), records))
    assert after < (0.95 if solver == "adam" else 0.5) * before


def test_mini_batches_lower_the_loss_and_the_seed_decides_their_order(records, tmp_path):
    """Four windows in two batches; 33 steps end in the middle of an epoch."""
    choices = "model=global_mlp", "solver=adam", "solver.iterations=33", "data.batch=2"
    runs = [trained(records, tmp_path, *choices, seed=seed) for seed in (0, 0, 1)]
    weights = [parameters_to_vector(m.estimator.network.parameters()) for m, _ in runs]
    assert torch.equal(weights[0], weights[1])
    assert not torch.equal(weights[0], weights[2])
    assert [len(module.losses) for module, _ in runs] == [33, 33, 33]
    after = whole_loss(runs[0][0].estimator, data_of(composed(*choices), records))
    assert after < 0.3 * runs[0][1]


@pytest.mark.parametrize("solver", [name for name in SOLVERS if "adam" not in name])
def test_a_solver_of_full_batches_refuses_several(solver, records, tmp_path):
    choices = "model=global_mlp", f"solver={solver}", "data.window=251", "data.batch=2"
    with pytest.raises(ValueError, match=r"there are 2 batches; set data\.batch=null"):
        trained(records, tmp_path, *choices)


# validation


@pytest.fixture(scope="module")
def held_back():
    """The last 30 % of a motion of 12 s."""
    data = data_from(composed("data.validation=0.3"))
    data.setup()
    return data


def test_the_validation_part_is_the_end_of_the_motion_and_not_in_the_fit(records, held_back):
    (whole,), (train,) = records["train"], list(held_back.train_dataloader())
    (validation,) = held_back.val_dataloader()
    first = round(0.7 * whole.samples)
    assert torch.equal(train.a[0], whole.a[:first])
    assert torch.equal(validation.a[0], whole.a[first:])
    assert torch.equal(validation.x[0], whole.x[first:])
    assert torch.equal(held_back.records["test"][0].a, records["test"][0].a)


def test_the_closed_form_does_not_see_the_validation_part(held_back, records, tmp_path):
    module = Identification(EquivalentLinear(3, 3, 0.01))
    fit(module, held_back, tmp_path)
    first = round(0.7 * records["train"][0].samples)
    train = records["train"][0].window(0, first)
    state = np.concatenate([train.v, train.x, train.f], axis=1)
    wanted = np.linalg.lstsq(state, train.a.numpy(), rcond=None)[0]
    assert np.allclose(module.estimator.weights, wanted, rtol=1e-6, atol=1e-9)


class Gain(Trainable):
    """ẍ̂ = g ẍ, to be walked past its best value: the error is |1 − g|."""

    def __init__(self) -> None:
        super().__init__(3, 3, 0.01)
        self.gain = nn.Parameter(torch.zeros(1, dtype=torch.float64))

    def forward(self, record: Record) -> Tensor:
        return self.gain * record.a


class Walk(torch.optim.Optimizer):
    """Takes the values of a list one after another."""

    full_batch = True

    def __init__(self, parameters, values: list[float]) -> None:
        super().__init__(parameters, {})
        self.values, self.finished, self.why = values, False, ""

    @torch.no_grad()
    def solve(self, problem: Problem) -> list[float]:
        self.param_groups[0]["params"][0].fill_(self.values.pop(0))
        self.finished, self.why = not self.values, "end of the walk"
        return [float(problem.loss())]


@pytest.mark.parametrize("max_fail", [1, 2, 4])
def test_training_stops_after_some_validations_without_gain_at_the_best(
    max_fail, held_back, tmp_path
):
    """Errors of 0.5, 0.1, 0.3, 0.05 and worse: the best may come after a failure."""
    values = [0.5, 1.1, *([0.7, 0.95] if max_fail > 1 else []), *[1.5 + 0.1 * i for i in range(9)]]
    best = 0.95 if max_fail > 1 else 1.1
    module = Identification(Gain(), lambda p: Walk(p, list(values)), max_fail)
    fit(module, held_back, tmp_path)
    assert module.solver.why == f"{max_fail} validations without gain"
    assert len(module.losses) == values.index(best) + 1 + max_fail
    assert module.losses[-1] > 0.2
    assert float(module.estimator.gain.detach()) == best
    assert module.best[0] == pytest.approx((1.0 - best) ** 2, rel=1e-9)


def test_the_best_parameters_are_kept_where_the_solver_ends_by_itself(held_back, tmp_path):
    module = Identification(Gain(), lambda p: Walk(p, [0.5, 0.9, 0.2]))
    fit(module, held_back, tmp_path)
    assert module.solver.why == "end of the walk"
    assert float(module.estimator.gain.detach()) == 0.9


def test_without_a_validation_part_the_last_parameters_are_kept(records, tmp_path):
    module = Identification(Gain(), lambda p: Walk(p, [0.5, 0.9, 0.2]))
    fit(module, data_of(composed(), records), tmp_path)
    assert float(module.estimator.gain.detach()) == 0.2
    assert module.best == (float("inf"), {})
