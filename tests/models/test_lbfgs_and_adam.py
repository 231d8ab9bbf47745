"""LBFGS against plain PyTorch, Adam against its formulas; why they stop."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor, nn
from torch.nn.utils import parameters_to_vector

from models.fit.solvers.adam import Adam
from models.fit.solvers.lbfgs import LBFGS
from tests.models.solver_problems import (
    NO_STOP,
    Valley,
    counting,
    linear,
    network,
    run,
    start,
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
