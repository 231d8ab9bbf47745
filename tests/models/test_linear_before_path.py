"""The linear structure before the path of priors: the best is kept, and the path begins there."""

from __future__ import annotations

import pytest
import torch

from data.record import Record
from models.element_network import ElementNetwork
from models.fit.free_run_objective import FreeRun
from models.fit.objective import state_of
from models.fit.prior_path import fit_linear
from models.fit.problem import FreeRunProblem
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from tests.models.test_starts import motion as shaken
from tests.models.test_starts import planted
from tests.models.two_masses import DT


@pytest.fixture
def record() -> Record:
    return shaken(planted(True), 1000, 0.01)


@pytest.fixture
def stiff(record: Record) -> ElementNetwork:
    """A network that begins far from the planted chain."""
    model = ElementNetwork(3, 1, DT, forced="base", hinges=0, units=1, prior=1e-9)
    model.identify([record])
    with torch.no_grad():
        model.laws.stiffness.theta.add_(torch.tensor([0.2, -0.2, 0.1]))
        model.laws.damping.theta.add_(0.5)
    return model


@torch.no_grad()
def loss(model: ElementNetwork, record: Record) -> float:
    return float(FreeRunProblem(model, record, None, prior=0.0).loss())


class LedAstray(LevenbergMarquardt):
    """Ends every fit but the first far from where it arrived."""

    made = 0

    def __init__(self, parameters) -> None:
        super().__init__(parameters, iterations=10, scaled=True)
        LedAstray.made += 1
        self.number = LedAstray.made

    @torch.no_grad()
    def solve(self, problem) -> list[float]:
        accepted = super().solve(problem)
        if self.finished and self.number > 1:
            for p in (p for group in self.param_groups for p in group["params"]):
                p.view(-1)[0] += 1.0  # alike for all would only change the unit of force
        return accepted


def test_of_several_fits_of_the_linear_structure_the_best_is_kept(stiff, record, monkeypatch):
    monkeypatch.setattr(LedAstray, "made", 0)
    before = loss(stiff, record)
    fit_linear(stiff, [record], [300, None], LedAstray, lambda losses: None)
    assert LedAstray.made == 2
    assert loss(stiff, record) < 0.1 * before


def test_the_path_begins_at_the_linear_structure_and_other_fits_at_the_start(stiff, record):
    objective = FreeRun([300, None], select=[1e-6])
    objective.prepare(stiff, [record], measured=True)
    begun, before = state_of(stiff), loss(stiff, record)
    objective.begin(
        stiff,
        [record],
        lambda free: LevenbergMarquardt(free, iterations=10, scaled=True),
        lambda losses: None,
    )
    objective.enter(stiff, 0)
    assert all(torch.equal(one, two) for one, two in zip(state_of(stiff), begun, strict=True))
    objective.enter(stiff, objective.stages.index("from linear, prior 0.01"))
    assert loss(stiff, record) < 0.1 * before
