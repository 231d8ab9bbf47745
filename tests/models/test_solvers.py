"""Solvers against SciPy, plain PyTorch and hand-written references; validation of a fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir
from lightning.pytorch import Trainer
from scipy.optimize import least_squares
from torch import Tensor, nn
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from data.record import Record
from models.estimator import Estimator
from models.linear import EquivalentLinear
from models.mlp import GlobalMLP
from models.training.assemble import changed, data_from, estimator_from, solver_from
from models.training.identification import Identification
from models.training.problem import Problem
from models.training.solvers.adam import Adam
from models.training.solvers.lbfgs import LBFGS, _Recall
from models.training.solvers.levenberg_marquardt import LevenbergMarquardt
from models.training.trainable import Trainable
from runner.config.compose import CONF, prepare_hydra

pytestmark = [
    pytest.mark.filterwarnings("ignore:.*LeafSpec.*"),
    pytest.mark.filterwarnings("ignore:.*does not have many workers.*"),
    pytest.mark.filterwarnings("ignore:.*litlogger.*"),
]
SOLVERS = sorted(path.stem for path in (CONF / "solver").glob("*.yaml"))
NO_STOP = {"gradient": 0.0, "change": 0.0}


class LinearInForce(Trainable):
    """ẍ̂ = W f, W by a solver: what is linear in its parameters."""

    def __init__(self, dofs: int, inputs: int, dt: float) -> None:
        super().__init__(dofs, inputs, dt)
        self.gains = nn.Linear(inputs, dofs, bias=False, dtype=torch.float64)

    def forward(self, record: Record) -> Tensor:
        return self.gains(record.f)

    def regression(self, record: Record) -> tuple[nn.Module, Tensor, Tensor]:
        return self.gains, record.f, record.a


class Saturating(nn.Module):
    """u → −k u − r tanh(s u) with θ = (k, r, s): a softening spring, far from the truth."""

    def __init__(self) -> None:
        super().__init__()
        self.theta = start(3.0, 4.0, 2.0)

    def forward(self, u: Tensor) -> Tensor:
        k, r, s = self.theta
        return -k * u - r * torch.tanh(s * u)


class SofteningSpring(Trainable):
    """ẍ̂ of each mass from its own displacement."""

    def __init__(self) -> None:
        super().__init__(2, 2, 0.01)
        self.spring = Saturating()

    def regression(self, record: Record) -> tuple[nn.Module, Tensor, Tensor]:
        return self.spring, record.x, record.a


class Valley:
    """Rosenbrock's function as a problem: e = (10 (b − a²), 1 − a)."""

    y = torch.zeros(2, dtype=torch.float64)
    own = ()

    def __init__(self, theta: nn.Parameter) -> None:
        self.theta, self.evaluations = theta, 0

    def loss(self) -> Tensor:
        self.evaluations += 1
        a, b = self.theta
        return (100.0 * (b - a**2) ** 2 + (1.0 - a) ** 2) / 2.0

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        J, e = valley(self.theta.detach().numpy())
        return torch.from_numpy(J.T @ J), torch.from_numpy(J.T @ e)


def valley(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    a, b = theta
    return np.array([[-20.0 * a, 10.0], [-1.0, 0.0]]), np.array([10.0 * (b - a**2), 1.0 - a])


def start(*theta: float) -> nn.Parameter:
    return nn.Parameter(torch.tensor(theta, dtype=torch.float64))


def motion(samples: int = 150, seed: int = 0) -> Record:
    """Random motion of two masses on cubic springs, with noise that no model explains."""
    rng = np.random.default_rng(seed)
    x, v, f = torch.from_numpy(0.5 * rng.standard_normal((3, samples, 2)))
    noise = 0.1 * torch.from_numpy(rng.standard_normal((samples, 2)))
    return Record(dt=0.01, a=f - 4.0 * x - 0.3 * v - 5.0 * x**3 + noise, f=f, x=x, v=v)


def network(hidden: tuple[int, ...] = (4,), seed: int = 0) -> tuple[Problem, list[nn.Parameter]]:
    torch.manual_seed(seed)
    estimator = GlobalMLP(2, 2, 0.01, hidden=hidden)
    estimator.identify([motion()])
    return Problem(estimator, motion()), list(estimator.network.parameters())


def linear() -> tuple[Problem, list[nn.Parameter], Tensor]:
    """A problem linear in its parameters, and its solution by NumPy."""
    torch.manual_seed(0)
    estimator, record = LinearInForce(2, 2, 0.01), motion()
    wanted = np.linalg.lstsq(record.f.numpy(), record.a.numpy(), rcond=None)[0].T
    free = list(estimator.parameters())
    return Problem(estimator, record), free, torch.from_numpy(wanted)


def spring() -> tuple[Problem, list[nn.Parameter]]:
    """Three well determined parameters; the forces, which the model lacks, stay as residuals."""
    estimator, record = SofteningSpring(), motion()
    a = record.f - 4.0 * record.x - 6.0 * torch.tanh(3.0 * record.x)
    return Problem(estimator, replace(record, a=a)), list(estimator.parameters())


def run(solver, problem, steps: int = 1000) -> list[float]:
    losses: list[float] = []
    for _ in range(steps):
        losses += solver.solve(problem)
        if solver.finished:
            return losses
    return losses


def counting(problem: Problem, monkeypatch) -> list[int]:
    """Notes each evaluation of the loss."""
    calls, loss = [], problem.loss
    monkeypatch.setattr(problem, "loss", lambda: calls.append(1) or loss())
    return calls


# Levenberg–Marquardt


def test_levenberg_marquardt_ends_where_scipys_ends():
    """Residuals that stay: a step to the minimum of a model is not yet the answer."""
    problem, free = spring()
    here = parameters_to_vector(free).detach().clone()

    def errors(theta: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            vector_to_parameters(torch.from_numpy(theta), free)
            return problem.errors().numpy()

    scipys = least_squares(errors, here.numpy(), method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    vector_to_parameters(here, free)
    losses = run(LevenbergMarquardt(free, gradient=1e-12), problem)
    assert losses[-1] > 1e-3
    assert 2.0 * scipys.cost / len(scipys.fun) == pytest.approx(losses[-1], rel=1e-6)
    ours = parameters_to_vector(free).detach().numpy()
    assert np.linalg.norm(ours - scipys.x) < 1e-6 * np.linalg.norm(scipys.x)
    assert np.linalg.norm(ours - here.numpy()) > 1e-2 * np.linalg.norm(scipys.x)


def test_one_hardly_damped_step_solves_what_is_linear_in_its_parameters():
    problem, free, wanted = linear()
    solver = LevenbergMarquardt(free, damping=1e-12)
    assert len(solver.solve(problem)) == 1
    assert torch.allclose(free[0].detach(), wanted, rtol=1e-10)
    assert solver.solve(problem) == []
    assert solver.why == "gradient below 1e-07"


def test_a_large_damping_makes_a_small_step_down_the_gradient():
    problem, free, _ = linear()
    before, slope = free[0].detach().clone(), problem.normal_equations()[1].view(2, 2)
    LevenbergMarquardt(free, damping=1e9).solve(problem)
    assert torch.allclose(free[0].detach(), before - slope / 1e9, rtol=0.0, atol=1e-15)


def test_steps_and_damping_are_those_of_trainlm():
    """A hand-written trainlm goes down the same valley: × 0.1 after success, × 10 after failure."""
    theta = start(-1.2, 1.0)
    solver, problem = LevenbergMarquardt([theta], gradient=0.0), Valley(theta)
    here, mu, failures = np.array([-1.2, 1.0]), 1e-3, 0
    for _ in range(12):
        J, e = valley(here)
        while True:
            tried = here - np.linalg.solve(J.T @ J + mu * np.eye(2), J.T @ e)
            if np.sum(valley(tried)[1] ** 2) < e @ e:
                break
            mu, failures = 10.0 * mu, failures + 1
        here, mu = tried, 0.1 * mu
        (loss,) = solver.solve(problem)
        assert loss == pytest.approx(np.sum(valley(here)[1] ** 2) / 2.0, rel=1e-6, abs=1e-25)
        assert np.allclose(theta.detach(), here, rtol=1e-8)
        assert solver.damping == pytest.approx(mu, rel=1e-9)
    assert failures >= 3
    assert problem.evaluations == 12 * 2 + failures


def test_damping_factors_are_those_asked_for():
    theta = start(-1.2, 1.0)
    solver = LevenbergMarquardt([theta], damping=0.01, decrease=0.5, increase=3.0)
    before = solver.damping
    solver.solve(Valley(theta))
    tries = np.log(solver.damping / before / 0.5) / np.log(3.0)
    assert tries == pytest.approx(round(tries), abs=1e-9)
    assert tries >= 1.0


@pytest.mark.parametrize(
    ("settings", "why", "iterations"),
    [
        ({"iterations": 3}, "3 iterations", 3),
        ({"gradient": 1e6}, "gradient below 1e+06", 0),
        ({"largest": 1e-4}, "damping above 0.0001", 0),
    ],
)
def test_levenberg_marquardt_says_why_it_stops(settings, why, iterations):
    problem, free = network()
    before = parameters_to_vector(free).detach().clone()
    solver = LevenbergMarquardt(free, **settings)
    assert len(run(solver, problem)) == iterations
    assert solver.finished
    assert solver.why == why
    assert torch.equal(parameters_to_vector(free), before) == (iterations == 0)


def test_levenberg_marquardt_stops_at_a_gradient_of_the_loss_that_is_small_enough():
    problem, free = spring()
    solver, slopes = LevenbergMarquardt(free, gradient=1e-5), []
    while not solver.finished:
        slopes.append(float(torch.autograd.grad(problem.loss(), free)[0].norm()))
        solver.solve(problem)
    assert solver.why == "gradient below 1e-05"
    assert [slope < 1e-5 for slope in slopes] == [False] * (len(slopes) - 1) + [True]
    assert slopes[-2] < 1e-3


def test_levenberg_marquardt_stops_where_it_gains_too_little():
    problem, free = network()
    solver = LevenbergMarquardt(free, change=0.5, patience=4)
    losses = run(solver, problem)
    assert "lower the loss by less than 0.5" in solver.why
    assert 1.0 - losses[-1] / losses[-5] < 0.5
    assert all(1.0 - b / a >= 0.5 for a, b in zip(losses[:-5], losses[4:-1], strict=True))


def test_levenberg_marquardt_goes_down_at_every_iteration():
    problem, free = network(hidden=(6,))
    losses = [float(problem.loss().detach()), *run(LevenbergMarquardt(free), problem, 40)]
    assert len(losses) > 20
    assert (np.diff(losses) < 0.0).all()
    assert losses[-1] == float(problem.loss().detach())


def test_steps_that_lead_uphill_are_taken_back(monkeypatch):
    """A gradient of the wrong sign: nothing helps, and nothing changes."""
    theta = start(-1.2, 1.0)
    matrix, vector = Valley(theta).normal_equations()
    monkeypatch.setattr(Valley, "normal_equations", lambda self, every=1: (matrix, -vector))
    solver = LevenbergMarquardt([theta])
    assert solver.solve(Valley(theta)) == []
    assert solver.why == "damping above 1e+10"
    assert theta.tolist() == [-1.2, 1.0]


def test_every_fourth_sample_shows_the_way_to_the_same_minimum():
    ends = []
    for every in (1, 4):
        problem, free = spring()
        ends.append(run(LevenbergMarquardt(free, gradient=1e-9, every=every), problem)[-1])
    assert ends[0] == pytest.approx(ends[1], rel=1e-9)


# LBFGS


def in_valley() -> tuple[Valley, list[nn.Parameter]]:
    theta = start(-1.2, 1.0)
    return Valley(theta), [theta]


def plain_lbfgs(begin, iterations: int, history: int) -> tuple[Tensor, int]:
    """PyTorch's own, on the sum of squares: parameters and evaluations of one run."""
    problem, free = begin()
    solver = torch.optim.LBFGS(
        free, max_iter=iterations, max_eval=10**6, history_size=history, tolerance_grad=0.0,
        tolerance_change=0.0, line_search_fn="strong_wolfe",
    )  # fmt: skip
    calls = []

    def closure() -> Tensor:
        calls.append(1)
        solver.zero_grad()
        loss = problem.y.numel() * problem.loss()
        loss.backward()
        return loss

    solver.step(closure)
    return parameters_to_vector(free).detach(), len(calls)


@pytest.mark.parametrize("patience", [4, 20])
@pytest.mark.parametrize("history", [3, 50])
@pytest.mark.parametrize("begin", [network, in_valley])
def test_lbfgs_is_plain_pytorch_one_iteration_at_a_time(begin, history, patience, monkeypatch):
    """The same points with no more evaluations, in one call of the solver or in several.

    The valley bends: line searches take several evaluations there.
    """
    for iterations in (1, 7, 15):
        problem, free = begin()
        calls = counting(problem, monkeypatch)
        settings = {"history": history, "patience": patience, **NO_STOP}
        losses = run(LBFGS(free, iterations=iterations, **settings), problem)
        wanted, evaluations = plain_lbfgs(begin, iterations, history)
        assert len(losses) == iterations
        assert torch.allclose(parameters_to_vector(free), wanted, rtol=1e-8, atol=1e-10)
        assert losses[-1] == pytest.approx(float(problem.loss().detach()), rel=1e-12)
        again = -(-iterations // patience)  # each call of the solver begins with one
        assert len(calls) - 1 <= evaluations + again


def test_a_point_that_is_remembered_has_its_own_slope_again():
    problem, (theta,) = in_valley()
    recall, slopes = _Recall(LBFGS([theta]), problem), []
    for a in (-1.2, 0.3, -1.2):
        theta.data[0] = a
        recall()
        slopes.append(theta.grad.clone())
    J, e = valley(theta.detach().numpy())
    assert np.allclose(slopes[2], 2.0 * J.T @ e)
    assert not torch.equal(slopes[1], slopes[2])
    assert problem.evaluations == 2


def test_lbfgs_never_goes_uphill():
    problem, free = network(hidden=(6,))
    losses = [float(problem.loss().detach()), *run(LBFGS(free, iterations=200), problem)]
    assert len(losses) == 201
    assert (np.diff(losses) <= 0.0).all()
    assert losses[-1] < 0.2 * losses[0]


def test_lbfgs_solves_what_is_quadratic_in_its_parameters():
    problem, free, wanted = linear()
    solver = LBFGS(free, change=0.0)
    assert len(run(solver, problem)) < 40
    assert torch.allclose(free[0].detach(), wanted, rtol=1e-8)


def test_lbfgs_walks_through_rosenbrocks_valley():
    theta = start(-1.2, 1.0)
    solver = LBFGS([theta])
    losses = run(solver, Valley(theta))
    assert solver.why == "gradient below 1e-12"
    assert np.allclose(theta.detach(), 1.0, rtol=0.0, atol=1e-9)
    assert len(losses) < 60


@pytest.mark.parametrize(
    ("settings", "why", "iterations"),
    [
        ({"iterations": 7}, "7 iterations", 7),
        ({"gradient": 1e6}, "gradient below 1e+06", 1),
        ({"change": 0.999, "patience": 5}, "loss falls by less than 0.999", 5),
    ],
)
def test_lbfgs_says_why_it_stops(settings, why, iterations):
    problem, free = network()
    solver = LBFGS(free, **settings)
    assert len(run(solver, problem)) == iterations
    assert solver.finished
    assert solver.why == why


# Adam


def test_adams_step_length_falls_to_zero_along_half_a_cosine():
    problem, free, _ = linear()
    solver, rates = Adam(free, iterations=8, rate=0.3), []
    for _ in range(8):
        solver.solve(problem)
        rates.append(solver.param_groups[0]["lr"])
    assert np.allclose(rates, 0.3 * np.cos(np.pi * np.arange(8) / 16.0) ** 2)
    assert solver.finished
    assert solver.why == "8 iterations"


def test_adams_first_step_is_its_rate_against_the_sign_of_each_slope():
    problem, free, _ = linear()
    before = free[0].detach().clone()
    slope = torch.autograd.grad(problem.loss(), free)[0]
    loss = float(problem.loss().detach())
    assert Adam(free, rate=0.02).solve(problem) == [pytest.approx(loss, rel=1e-12)]
    assert torch.allclose(free[0].detach(), before - 0.02 * slope.sign(), rtol=0.0, atol=1e-6)


def test_adam_comes_close_to_the_least_squares_solution():
    problem, free, wanted = linear()
    run(Adam(free, iterations=400, rate=0.05), problem)
    assert torch.allclose(free[0].detach(), wanted, rtol=0.0, atol=1e-3)


@pytest.mark.parametrize("solver", [LBFGS, Adam])
def test_gradients_of_one_problem_do_not_leak_into_the_next(solver):
    """A start with other gradients than zero makes no difference."""
    (one, free), (other, _) = network(), network(seed=1)
    run(solver(free, iterations=1), one)
    after = parameters_to_vector(free).detach().clone()
    problem, free = network()
    other.loss().backward()
    for p in free:
        p.grad = torch.full_like(p, 7.0)
    run(solver(free, iterations=1), problem)
    assert torch.allclose(parameters_to_vector(free), after, rtol=1e-12)


@pytest.mark.parametrize(
    "wrong", [{"iterations": 0}, {"rate": 0.0}, {"rate": float("nan")}, {"rate": -1.0}]
)
def test_adam_without_steps_is_refused(wrong):
    with pytest.raises(ValueError, match="must be positive"):
        Adam([start(0.0)], **wrong)


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


def test_mini_batches_are_shuffled_for_training_alone(records):
    data = data_of(composed("data.window=121", "data.batch=2"), records)
    orders = {
        split: {tuple(float(u[0, 0]) for r in loader() for u in r.a) for _ in range(6)}
        for split, loader in (
            ("train", data.train_dataloader),
            ("scored", lambda: data.test_dataloader()[0]),
        )
    }
    assert len(orders["train"]) > 1
    assert len(orders["scored"]) == 1
    (whole,) = data.test_dataloader()[0]
    assert whole.samples == records["train"][0].samples


@pytest.mark.parametrize("solver", [name for name in SOLVERS if "adam" not in name])
def test_a_solver_of_full_batches_refuses_several(solver, records, tmp_path):
    choices = "model=global_mlp", f"solver={solver}", "data.window=251", "data.batch=2"
    with pytest.raises(ValueError, match=r"there are 2 batches; set data\.batch=null"):
        trained(records, tmp_path, *choices)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_misspelt_setting_of_a_solver_is_found_before_any_work(solver):
    with pytest.raises(ValueError, match="did you mean 'iterations'"):
        solver_from(composed(f"solver={solver}", "+solver.iteration=5").solver)


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


def test_the_last_parameters_may_be_the_best(held_back, tmp_path):
    module = Identification(Gain(), lambda p: Walk(p, [0.5, 0.9, 0.99]))
    fit(module, held_back, tmp_path)
    assert float(module.estimator.gain.detach()) == 0.99


def test_without_a_validation_part_the_last_parameters_are_kept(records, tmp_path):
    module = Identification(Gain(), lambda p: Walk(p, [0.5, 0.9, 0.2]))
    fit(module, data_of(composed(), records), tmp_path)
    assert float(module.estimator.gain.detach()) == 0.2
    assert module.best == (float("inf"), {})


@pytest.mark.parametrize("fraction", [-0.1, 1.0, 1.5])
def test_a_validation_part_is_a_fraction(fraction):
    with pytest.raises(ValueError, match=r"data\.validation=.* must be a fraction"):
        data_from(changed(composed(), {"data": {"validation": fraction}}))
