"""Starts whose free run overflows: parameters are left alone, or led back by short horizons."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from data.record import Drive, Record
from models.fit.problem import FreeRunProblem, Problem
from models.fit.solvers.adam import Adam
from models.fit.solvers.lbfgs import LBFGS
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from tests.models.two_masses import DT, Growth, free_of, identified, motion

# PyTorch's forward differentiation compiles its own rules with what PyTorch deprecates
pytestmark = [
    pytest.mark.filterwarnings("ignore:.*torch.jit.script. is deprecated"),
    pytest.mark.filterwarnings("ignore:.*LeafSpec.*"),
    pytest.mark.filterwarnings("ignore:.*does not have many workers.*"),
    pytest.mark.filterwarnings("ignore:.*litlogger.*"),
]


# starts that diverge


def falling(gain: float, samples: int = 4000) -> tuple[Growth, Record]:
    """A record of Growth(−3), and Growth with another gain to start from."""
    f = torch.from_numpy(np.random.default_rng(0).standard_normal((samples, 2)))
    drive = Drive(DT, f, torch.zeros(2, dtype=f.dtype), torch.zeros(2, dtype=f.dtype))
    with torch.no_grad():
        run = Growth(-3.0).free_run(drive)
    return Growth(gain), Record(DT, run.a, f, run.x, run.v)


@pytest.mark.parametrize("solver", [LevenbergMarquardt, LBFGS, Adam])
def test_a_start_that_overflows_leaves_the_parameters_alone(solver):
    estimator, record = falling(80.0, 1500)
    fitted = solver(estimator.parameters(), iterations=3)
    problem = FreeRunProblem(estimator, record, None)
    assert not torch.isfinite(problem.loss())
    for _ in range(3):
        if not fitted.finished:
            assert fitted.solve(problem) == []
    assert fitted.finished
    assert float(estimator.gain.detach()) == 80.0
    assert solver is Adam or "not finite" in fitted.why


def test_levenberg_marquardt_stops_where_derivatives_overflow():
    class Steep(Growth):
        def restarted_jacobian(self, record, *how) -> tuple[Tensor, Tensor]:
            derivatives = torch.full((400, 2, 1), torch.inf, dtype=torch.float64)
            return self.restarted_run(record, None), derivatives

    estimator, record = Steep(-1.0), falling(0.0, 400)[1]
    solver = LevenbergMarquardt(estimator.parameters())
    assert solver.solve(FreeRunProblem(estimator, record, None)) == []
    assert solver.why == "the derivatives are not finite"


@pytest.mark.parametrize("solver", [LevenbergMarquardt, LBFGS])
def test_short_horizons_lead_to_where_the_whole_record_can_be_run(solver):
    estimator, record = falling(30.0, 1500)
    assert not torch.isfinite(FreeRunProblem(estimator, record, None).loss())
    for horizon in (5, None):
        fitted = solver(free_of(estimator), iterations=30)
        while not fitted.finished:
            fitted.solve(FreeRunProblem(estimator, record, horizon))
    assert float(estimator.gain.detach()) == pytest.approx(-3.0, rel=1e-5)


def test_a_line_search_turns_back_where_the_run_overflows():
    """A wall of NaN beyond 1 on the way from 0 to the minimum at 0.9, steep at the start."""

    class Wall:
        y, steepest = torch.zeros(1, dtype=torch.float64), float("inf")
        theta = nn.Parameter(torch.tensor([0.0], dtype=torch.float64))

        def loss(self) -> Tensor:
            e = (self.theta - 0.9) * 3.0
            return torch.where(self.theta > 1.0, torch.nan, e**2 + e**4).sum()

    wall = Wall()
    solver = LBFGS([wall.theta], change=0.0)
    losses = []
    while not solver.finished:
        losses += solver.solve(wall)
    assert np.isfinite(losses).all()
    assert float(wall.theta.detach()) == pytest.approx(0.9, abs=1e-4)


def test_adam_shortens_long_gradients_of_a_free_run_and_of_nothing_else():
    record = motion()
    for problem, shortened in (
        (FreeRunProblem(identified("global", record), record, None), True),
        (Problem(identified("global", record), record), False),
    ):
        estimator = problem.estimator if shortened else problem.module
        scaled = 1e4 * problem.loss()
        problem.loss = lambda value=scaled: value
        Adam(free_of(estimator)).solve(problem)
        norm = float(torch.cat([p.grad.reshape(-1) for p in free_of(estimator)]).norm())
        assert (norm <= 1.0 + 1e-9) == shortened
