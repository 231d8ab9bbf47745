"""Quiet parts of a motion: what they count by."""

from __future__ import annotations

import pytest
import torch
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from data.record import Record
from models.training.levels import weights_of_samples
from models.training.problem import FreeRunProblem
from tests.models.composites import DT, Everything, excited

T = 2000


def motion(level: torch.Tensor) -> torch.Tensor:
    t = torch.arange(T, dtype=torch.float64)[:, None]
    return level[:, None] * torch.cat([torch.sin(0.3 * t), torch.cos(0.3 * t)], dim=1)


def test_a_steady_motion_counts_as_it_is():
    assert torch.equal(weights_of_samples(motion(torch.ones(T).double())), torch.ones(T, 1))


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_a_quiet_part_counts_as_half_the_level_and_silence_by_no_more_than_its_bound(unit):
    level = torch.ones(T, dtype=torch.float64)
    level[1000:1500], level[1500:] = 0.2, 0.0
    a = unit * motion(level)
    weights = weights_of_samples(a)[:, 0]
    whole = float(a.square().sum(dim=1).mean().sqrt())
    assert torch.equal(weights[:900], torch.ones(900))
    assert torch.allclose(
        weights[1100:1400], torch.full((300,), 0.5 * whole / (0.2 * unit)).double(), rtol=0.05
    )
    assert torch.allclose(weights[1700:], torch.full((300,), 10.0).double())


def test_the_normal_equations_are_those_of_the_weighted_errors():
    model, drive = Everything(), excited(400)
    a = model.free_run(drive).a.detach().clone()
    a[200:] *= 0.1
    record = Record(DT, a, drive.u[:, :2], s=drive.u[:, 2:3], s_dot=drive.u[:, 3:])
    model.counts_quiet = True
    problem = FreeRunProblem(model, record, None, prior=0.0)
    assert problem.weight.shape == a.shape
    _, vector = problem.normal_equations()
    free = [p for p in model.parameters() if p.requires_grad]
    here = parameters_to_vector(free).detach()
    along, losses = torch.cos(torch.arange(len(here), dtype=torch.float64)), []
    with torch.no_grad():
        for step in (1e-6, -1e-6):
            vector_to_parameters(here + step * along, free)
            losses.append(float(problem.loss()))
    slope = (losses[0] - losses[1]) / 2e-6
    assert 2.0 / problem.y.numel() * float(vector @ along) == pytest.approx(slope, rel=1e-3)
