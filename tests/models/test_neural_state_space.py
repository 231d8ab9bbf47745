"""Neural state space: its linear start, derivatives of the trajectory, encoder, training."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch.func import jvp

from data.record import Record
from models.fit.problem import FreeRunProblem
from models.fit.solvers.lbfgs import LBFGS
from models.layers.perceptron import latent_run
from models.linear import EquivalentLinear
from models.neural_state_space import NeuralStateSpace, trajectory
from tests.models.test_recurrent import DT, motion


def softening() -> Record:
    """The linear motion with a restoring force that no linear system has."""
    record = motion(200)
    f = record.f - 4.0 * torch.tanh(record.x * 20.0)
    return replace(record, f=2.0 * record.f - f)


def identified(record: Record, memory: int = 2) -> NeuralStateSpace:
    torch.manual_seed(0)
    estimator = NeuralStateSpace(2, 2, DT, memory=memory, hidden=4, past=3)
    estimator.identify([record])
    return estimator


@pytest.mark.parametrize("hold", ["linear", "zero_order"])
def test_it_starts_as_the_equivalent_linear_system(hold):
    record = replace(motion(), hold=hold)
    estimator, linear = identified(record), EquivalentLinear(2, 2, DT)
    linear.identify([record])
    with torch.no_grad():
        estimator.step.outer.weight.zero_()
        estimator.output.outer.weight.zero_()
    ours, its = estimator.free_run(record.drive()), linear.free_run(record.drive())
    for name in ("x", "v", "a"):
        wanted = getattr(its, name)
        size = float(wanted.abs().max())
        assert torch.allclose(getattr(ours, name), wanted, rtol=0.0, atol=1e-10 * size)


def points() -> tuple[torch.Tensor, ...]:
    """z[0], w and θ of two runs with three states."""
    rng = torch.Generator().manual_seed(0)
    shapes = [(2, 3), (8, 2, 4), (3, 7), (5, 7), (5,), (3, 5), (3,)]
    return tuple(0.4 * torch.randn(s, generator=rng, dtype=torch.float64) for s in shapes)


def test_the_derivatives_of_a_trajectory_are_those_of_its_steps_one_by_one():
    first, w, *theta = points()

    def plain(z: torch.Tensor, *theta: torch.Tensor) -> torch.Tensor:
        return latent_run(z, w, *theta)

    def ours(z: torch.Tensor, *theta: torch.Tensor) -> torch.Tensor:
        return trajectory(z, w, *theta)

    leaves = [p.clone().requires_grad_() for p in (first, *theta)]
    cotangent = torch.randn(9, 2, 3, generator=torch.Generator().manual_seed(1)).double()
    for one, other in zip(
        torch.autograd.grad((ours(*leaves) * cotangent).sum(), leaves),
        torch.autograd.grad((plain(*leaves) * cotangent).sum(), leaves),
        strict=True,
    ):
        assert torch.allclose(one, other, rtol=1e-9, atol=1e-12)
    along = tuple(torch.ones_like(p) for p in leaves)
    primals = (first, *theta)
    assert torch.allclose(jvp(ours, primals, along)[1], jvp(plain, primals, along)[1], rtol=1e-9)


def test_the_encoder_reads_nothing_after_the_first_sample_of_a_window():
    record = softening()
    estimator = identified(record)
    torch.nn.init.normal_(estimator.encoder.weight)
    run = estimator.restarted_run(record, 50)
    for name in ("x", "v"):
        signal = getattr(record, name).clone()
        signal[51:100] += 1.0
        changed = (estimator.restarted_run(replace(record, **{name: signal}), 50) - run).abs()
        assert (changed[:100] == 0.0).all()
        signal = getattr(record, name).clone()
        signal[48] += 1.0  # one of the three samples up to the 50th
        changed = (estimator.restarted_run(replace(record, **{name: signal}), 50) - run).abs()
        assert (changed[:50] == 0.0).all()
        assert (changed[51:100].amax(dim=1) > 0.0).all()


def test_training_on_the_free_run_beats_the_linear_start():
    record = softening()
    estimator = identified(record)
    problem = FreeRunProblem(estimator, record, None)
    before = float(problem.loss().detach())
    solver = LBFGS(estimator.parameters(), iterations=60)
    while not solver.finished:
        solver.solve(problem)
    assert float(problem.loss().detach()) < 0.2 * before


@pytest.mark.parametrize("wrong", [{"memory": 0}, {"hidden": 0}, {"past": 0}])
def test_a_model_that_cannot_be_built_is_refused(wrong):
    with pytest.raises(ValueError, match="=0 must be a whole number of at least 1"):
        NeuralStateSpace(2, 2, DT, **wrong)
