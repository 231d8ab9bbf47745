"""The LightningModule: every solver fits a network, validation, what is solved in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import DictConfig
from torch import Tensor, nn
from torch.nn.utils import parameters_to_vector

from data.record import Record
from models.baselines import TwoPoint
from models.estimator import Estimator
from models.fit.identification import Identification
from models.fit.metrics import score
from models.fit.problem import Problem
from models.fit.solvers.lbfgs import LBFGS
from models.fit.trainable import Trainable
from models.linear import EquivalentLinear
from models.vwnn import VWNN
from runner.config.compose import CONF, composed
from tests.experiments import data_from, estimator_from, solver_from
from tests.models.training import fit

SOLVERS = sorted(path.stem for path in (CONF / "solver").glob("*.yaml"))


def config(*words: str) -> DictConfig:
    return composed("data.duration=12", *words)


@pytest.fixture(scope="module")
def records():
    """Simulated once, for every choice of solver."""
    data = data_from(config())
    data.setup()
    return data.records


def data_of(cfg, records):
    data = data_from(cfg)
    if data.validation:
        data.setup()
    else:
        data.records = records
    return data


def trained(records, folder: Path, *overrides: str, seed: int = 0) -> tuple[Identification, float]:
    """A fit as in train.py, and the loss on all of the training windows before it."""
    cfg = config(*overrides)
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


@pytest.mark.parametrize("solver", SOLVERS)
def test_every_solver_fits_a_network(solver, records, tmp_path):
    model = "residual_mlp" if solver == "levenberg_marquardt" else "global_mlp"
    overrides = f"model={model}", f"solver={solver}", "solver.iterations=7"
    module, before = trained(records, tmp_path, *overrides)
    assert len(module.losses) == 7
    assert module.solver.why == "7 iterations"
    assert module.how_trained()["iterations"] == 7
    after = whole_loss(module.estimator, data_of(config(*overrides), records))
    assert after < (0.95 if solver == "adam" else 0.5) * before


def test_mini_batches_lower_the_loss_and_the_seed_decides_their_order(records, tmp_path):
    """Four windows in two batches; 33 steps end in the middle of an epoch."""
    choices = "model=global_mlp", "solver=adam", "solver.iterations=33", "data.batch=2"
    runs = [trained(records, tmp_path, *choices, seed=seed) for seed in (0, 0, 1)]
    weights = [parameters_to_vector(m.estimator.network.parameters()) for m, _ in runs]
    assert torch.equal(weights[0], weights[1])
    assert not torch.equal(weights[0], weights[2])
    assert [len(module.losses) for module, _ in runs] == [33, 33, 33]
    after = whole_loss(runs[0][0].estimator, data_of(config(*choices), records))
    assert after < 0.3 * runs[0][1]


def test_a_solver_of_full_batches_refuses_several(records, tmp_path):
    choices = "model=global_mlp", "solver=lbfgs", "data.window=251", "data.batch=2"
    with pytest.raises(ValueError, match=r"there are 2 batches; set data\.batch=null"):
        trained(records, tmp_path, *choices)


# validation


@pytest.fixture(scope="module")
def held_back():
    """The last 30 % of the power of a motion of 12 s."""
    data = data_from(config("data.validation=0.3"))
    data.setup()
    return data


def test_the_validation_part_is_the_end_of_the_motion_and_not_in_the_fit(records, held_back):
    (whole,), (train,) = records["train"], list(held_back.train_dataloader())
    (validation,) = held_back.val_dataloader()
    first = train.a.shape[1]
    assert whole.a[:first].square().sum() < 0.7 * whole.a.square().sum()
    assert whole.a[: first + 1].square().sum() >= 0.7 * whole.a.square().sum()
    assert torch.equal(train.a[0], whole.a[:first])
    assert torch.equal(validation.a[0], whole.a[first:])
    assert torch.equal(validation.x[0], whole.x[first:])
    assert torch.equal(held_back.records["test"][0].a, records["test"][0].a)


def test_the_closed_form_does_not_see_the_validation_part(held_back, records, tmp_path):
    module = Identification(EquivalentLinear(3, 3, 0.01))
    fit(module, held_back, tmp_path)
    first = held_back.records["train"][0].samples
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


@pytest.mark.parametrize("max_fail", [1, 4])
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


def test_where_the_solver_ends_by_itself_the_best_validated_parameters_are_kept_or_the_last(
    held_back, records, tmp_path
):
    for data, kept in ((held_back, 0.9), (data_of(config(), records), 0.2)):
        module = Identification(Gain(), lambda p: Walk(p, [0.5, 0.9, 0.2]))
        fit(module, data, tmp_path)
        assert module.solver.why == "end of the walk"
        assert float(module.estimator.gain.detach()) == kept


# closed forms


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
