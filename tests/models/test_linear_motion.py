"""The linear bar: recovers what is linear from any channels, and never diverges."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from data.record import Record
from models.fit.metrics import free_run_score
from models.linear import EquivalentLinear
from models.linear_motion import LinearMotion, OutputError, run_of_weights


def error(record: Record) -> float:
    model = LinearMotion(record.dofs, record.excitation.shape[-1], record.dt)
    model.identify([record])
    return free_run_score(model, [record])["relative_rms_percent"]


def test_a_linear_structure_is_recovered(linear_record):
    assert error(linear_record) < 1e-3


def test_accelerations_and_forces_alone_are_enough(linear_record):
    assert error(replace(linear_record, x=None, v=None)) < 1.0


def test_its_free_run_is_fitted_from_noisy_accelerations(linear_record):
    noise = torch.randn(linear_record.a.shape, generator=torch.Generator().manual_seed(0))
    level = 0.3 * float(linear_record.a.std())
    noisy = replace(linear_record, a=linear_record.a + level * noise.to(linear_record.a))
    noisy = replace(noisy.measured(), x=None, v=None)
    model = LinearMotion(noisy.dofs, noisy.f.shape[-1], noisy.dt)
    model.identify([noisy])
    assert free_run_score(model, [linear_record])["relative_rms_percent"] < 3.0


def test_derivatives_of_the_free_run_are_those_of_small_steps(linear_record):
    model = LinearMotion(linear_record.dofs, linear_record.f.shape[-1], linear_record.dt)
    model.identify([linear_record])
    weights = 1.05 * model.system.weights.data
    problem = OutputError(weights, [linear_record], run_of_weights, lambda motion: motion.a)
    _, slope = problem.normal_equations()
    place, here = (3, 1), problem.loss()
    step = 1e-5 * float(problem.theta.data[place])
    problem.theta.data[place] += step
    measured = float(problem.loss() - here) / step
    expected = 2.0 / problem.y.numel() * float(slope[place[0] * weights.shape[1] + place[1]])
    assert measured == pytest.approx(expected, rel=1e-2)


@pytest.mark.parametrize("hold", ["zero_order", "band_limited"])
def test_its_run_is_that_of_the_equivalent_linear_system(linear_record, hold):
    ours = LinearMotion(linear_record.dofs, linear_record.f.shape[-1], linear_record.dt)
    theirs = EquivalentLinear(linear_record.dofs, linear_record.f.shape[-1], linear_record.dt)
    for model in (ours, theirs):
        model.identify([linear_record])
    theirs.weights.data = ours.system.weights.data
    drive = replace(linear_record.drive(), hold=hold)
    near = {"rtol": 0.0, "atol": (1e-3 if hold == "band_limited" else 1e-9) * float(drive.u.std())}
    assert torch.allclose(ours.free_run(drive).a, theirs.free_run(drive).a, **near)


def test_noise_makes_it_useless_and_never_diverge():
    noise = torch.randn(2000, 4, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    assert error(Record(0.01, noise[:, :3], noise[:, 3:])) < 110.0


@pytest.mark.parametrize("quantity", ["displacement", "acceleration"])
def test_a_model_that_is_loaded_estimates_what_it_was_trained_on(linear_record, quantity):
    seen = linear_record if quantity == "acceleration" else of_displacements(linear_record)
    first, second = (LinearMotion(seen.dofs, seen.f.shape[-1], seen.dt) for _ in range(2))
    first.identify([seen])
    second.load_state_dict(first.state_dict())
    assert torch.equal(second(seen), first(seen))
    assert (first(seen) - seen.a).norm() < 0.02 * seen.a.norm()


def of_displacements(record):
    return replace(record.measured(), a=record.x, x=None, v=None, quantity="displacement")
