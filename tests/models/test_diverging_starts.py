"""Starts whose free run overflows: parameters are left alone, or led back by short horizons."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from data.record import Drive, Record
from models.fit.problem import FreeRunProblem
from models.fit.solvers.adam import Adam
from models.fit.solvers.lbfgs import LBFGS
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from tests.models.two_masses import DT, Growth, free_of

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


def test_short_horizons_lead_to_where_the_whole_record_can_be_run():
    estimator, record = falling(30.0, 1500)
    assert not torch.isfinite(FreeRunProblem(estimator, record, None).loss())
    for horizon in (5, None):
        fitted = LBFGS(free_of(estimator), iterations=30)
        while not fitted.finished:
            fitted.solve(FreeRunProblem(estimator, record, horizon))
    assert float(estimator.gain.detach()) == pytest.approx(-3.0, rel=1e-5)
