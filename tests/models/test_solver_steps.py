"""LBFGS against PyTorch's, Levenberg–Marquardt against SciPy and trainlm; why they stop."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.optimize import least_squares
from torch import Tensor, nn
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from models.fit.solvers.adam import Adam
from models.fit.solvers.lbfgs import LBFGS
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from tests.models.solver_problems import (
    NO_STOP,
    Valley,
    counting,
    linear,
    network,
    run,
    spring,
    start,
    valley,
)

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


@pytest.mark.parametrize(("begin", "history", "patience"), [(network, 3, 4), (in_valley, 50, 20)])
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


# Adam


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


@pytest.mark.parametrize(
    ("kind", "settings", "why", "iterations"),
    [
        (LBFGS, {"iterations": 7}, "7 iterations", 7),
        (LBFGS, {"gradient": 1e6}, "gradient below 1e+06", 1),
        (LBFGS, {"change": 0.999, "patience": 5}, "loss falls by less than 0.999", 5),
        (LevenbergMarquardt, {"iterations": 3}, "3 iterations", 3),
        (LevenbergMarquardt, {"gradient": 1e6}, "gradient below 1e+06", 0),
        (LevenbergMarquardt, {"largest": 1e-4}, "damping above 0.0001", 0),
    ],
)
def test_a_solver_says_why_it_stops(kind, settings, why, iterations):
    problem, free = network()
    before = parameters_to_vector(free).detach().clone()
    solver = kind(free, **settings)
    assert len(run(solver, problem)) == iterations
    assert solver.finished
    assert solver.why == why
    assert torch.equal(parameters_to_vector(free), before) == (iterations == 0)


def test_steps_that_lead_uphill_are_taken_back(monkeypatch):
    """A gradient of the wrong sign: nothing helps, and nothing changes."""
    theta = start(-1.2, 1.0)
    matrix, vector = Valley(theta).normal_equations()
    monkeypatch.setattr(Valley, "normal_equations", lambda self, every=1: (matrix, -vector))
    solver = LevenbergMarquardt([theta])
    assert solver.solve(Valley(theta)) == []
    assert solver.why == "damping above 1e+10"
    assert theta.tolist() == [-1.2, 1.0]
