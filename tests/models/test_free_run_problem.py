"""Restarted free runs: windows by themselves, normal equations, starts that overflow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from data.record import Drive, Record
from models.estimator import Estimator, NoFreeRunError
from models.fit.problem import FreeRunProblem
from models.fit.solvers.adam import Adam
from models.fit.solvers.lbfgs import LBFGS
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from models.fit.trainable import Trainable
from models.vwnn import VWNN
from tests.models.two_masses import DT, RECORDS, Growth, free_of, identified, motion

# restarted runs


@pytest.mark.parametrize("kind", ["in_motion", "batch"])
def test_a_restarted_run_is_that_of_every_window_by_itself(kind):
    record = RECORDS[kind]()
    estimator = identified("global", record)
    for horizon in (1, 7, 39):
        pieces = []
        for start in range(0, record.samples, horizon):
            whole, u = record.drive(), record.f[..., start : start + horizon, :]
            x0, v0 = record.x[..., start, :], record.v[..., start, :]
            x0, v0 = (whole.x0, whole.v0) if start == 0 else (x0, v0)
            pieces.append(estimator.free_run(Drive(DT, u, x0, v0)).a)
        together = estimator.restarted_run(record, horizon)
        assert torch.allclose(together, torch.cat(pieces, dim=-2), rtol=1e-12, atol=1e-12)


def test_the_first_window_begins_as_the_record_does_and_the_others_as_measured():
    record = motion()
    lies = replace(record, x=record.x + 1.0)
    run, other = (Growth(-1.0).restarted_run(r, 10) for r in (record, lies))
    assert torch.equal(run, other)  # x plays no part in ẍ here
    lies = replace(record, v=record.v + 1.0)
    changed = (Growth(-1.0).restarted_run(lies, 10) - run).abs().amax(dim=-1)
    assert (changed[:10] == 0.0).all()
    assert (changed[10:] > 0.5).all()


def test_without_measured_states_only_the_whole_record_can_be_run():
    record = replace(motion(), x=None, v=None)
    estimator = identified("global", motion())
    estimator.restarted_run(record, None)
    with pytest.raises(ValueError, match=r"horizons=\[null\]"):
        estimator.restarted_run(record, 10)


# the problem


@pytest.mark.parametrize(
    ("model", "kind", "horizon"),
    [("global", "batch", 7), ("residual", "in_motion", 10), ("state_space", "record", None)],
)
def test_normal_equations_of_a_free_run(model, kind, horizon):
    """JᵀJ and Jᵀe against reverse differentiation of every single error."""
    record = RECORDS[kind]()
    estimator = identified(model, record)
    problem = FreeRunProblem(estimator, record, horizon)
    matrix, vector = problem.normal_equations()
    free = free_of(estimator)
    errors = problem.errors()
    assert errors.numel() == record.a[..., record.warmup :, :].numel()
    weights = torch.linspace(-1.0, 1.0, errors.numel(), dtype=torch.float64)
    along = _gradient((errors * weights).sum(), free)  # Jᵀ w
    assert torch.allclose(2.0 * vector / errors.numel(), _gradient(problem.loss(), free), atol=1e-9)
    shifted = _gradient((problem.errors() * problem.errors().detach()).sum(), free)
    assert torch.allclose(vector, shifted, rtol=1e-8, atol=1e-9 * float(vector.abs().max()))
    J = _jacobian(problem, free)
    assert torch.allclose(J.T @ weights, along, rtol=1e-6, atol=1e-8 * float(along.abs().max()))
    assert torch.allclose(matrix, J.T @ J, rtol=0.0, atol=1e-9 * float(matrix.abs().max()))


def _gradient(value: Tensor, free: list[nn.Parameter]) -> Tensor:
    slopes = torch.autograd.grad(value, free, allow_unused=True)
    return torch.cat(
        [
            (torch.zeros_like(p) if slope is None else slope).reshape(-1)
            for slope, p in zip(slopes, free, strict=True)
        ]
    )


def _jacobian(problem: FreeRunProblem, free: list[nn.Parameter]) -> Tensor:
    errors = problem.errors()
    each = torch.eye(len(errors), dtype=errors.dtype)
    slopes = torch.autograd.grad(errors, free, each, allow_unused=True, is_grads_batched=True)
    none = [errors.new_zeros(len(errors), p.numel()) for p in free]
    parts = [o if s is None else s.flatten(1) for s, o in zip(slopes, none, strict=True)]
    return torch.cat(parts, dim=1)


def test_an_estimator_that_cannot_simulate_says_so():
    estimator = VWNN(2, 2, DT)
    with pytest.raises(NoFreeRunError):
        FreeRunProblem(Trainable(2, 2, DT), motion(), None).loss()
    assert isinstance(estimator, Estimator)


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
