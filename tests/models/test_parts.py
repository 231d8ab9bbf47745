"""Training on measured records: quiet starts, priors chosen on motion that is held back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from data.record import Record
from models.element_network import ElementNetwork
from models.fir import FIR
from models.fit.extrapolation import excess, stays_in_bounds
from models.fit.free_run_objective import FreeRun
from models.fit.held_back import held_back_from, onset
from models.fit.identification import Identification
from models.fit.problem import FreeRunProblem
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from models.fit.stages import LONGER, fit_linear, horizons_of
from tests.models.test_objective import free_run_loss
from tests.models.test_resume import Motions
from tests.models.test_starts import chain
from tests.models.test_starts import motion as shaken
from tests.models.training import fit
from tests.models.two_masses import DT


def test_a_quiet_start_is_no_part_of_a_horizon():
    record = shaken(chain(True), 1000, noise=0.02, rest=800)
    begin = onset(record)
    assert 800 <= begin < 1000
    assert onset(record.window(900, 900)) == 0
    objective, model = FreeRun([200, None], restart=False), chain(True)
    assert objective.problem(model, record, 0).record.samples == begin + 200
    assert objective.problem(model, record, 1).record.samples == record.samples


def test_what_is_held_back_is_a_share_of_the_motion_and_not_of_the_time():
    record = shaken(chain(True), 1000)
    quiet = replace(record, a=torch.cat([record.a, 0.0 * record.a]), f=torch.cat([record.f] * 2))
    k = held_back_from(quiet, 0.2)
    assert k == held_back_from(record, 0.2) < 1000
    assert float(record.a[k:].square().sum() / record.a.square().sum()) == pytest.approx(0.2, 0.05)


class Shaken(Motions):
    """Accelerations alone, by sensors."""

    dofs, inputs, forced, measured = 3, 1, "base", True

    def make_records(self) -> dict[str, list[Record]]:
        parts = [shaken(chain(True, 0.7), 300, 0.02, seed=seed) for seed in (0, 1)]
        return {"train": parts[:1], "test": parts[1:]}


def network() -> ElementNetwork:
    return ElementNetwork(3, 1, DT, forced="base", hinges=0, units=1, prior=1e-9)


def solver(parameters) -> LevenbergMarquardt:
    return LevenbergMarquardt(parameters, iterations=3, scaled=True)


@pytest.mark.parametrize("select", [None, []])
def test_priors_are_tried_on_held_back_motion_unless_told_otherwise(select, tmp_path):
    objective = FreeRun([1, 20, None], select=select)
    module = fit(Identification(network(), solver, objective=objective), Shaken(), tmp_path)
    trained = module.how_trained()
    assert "reconstructed" in trained["remarks"][0]
    if select is None:
        tried = trained["held_out_error_percent"]
        path = [f"{p} from linear" for p in ("0.01", "0.001", "0.0001")]
        assert list(tried) == ["1e-06", "0.0001", "1e-06 from single steps", *path]
        assert tried[trained["chosen"]] == min(e for e in tried.values() if e is not None)
        assert trained["stages"][-1]["stage"] == "whole motion"
    else:
        assert "prior" not in trained
    assert free_run_loss(module.estimator, module.trainer.datamodule) < 1.0


def test_a_law_that_runs_away_under_a_larger_motion_is_found_out():
    model = chain(True)
    record = shaken(model, 600)
    assert stays_in_bounds(model, record)
    with torch.no_grad():
        model.laws.cubic.theta.fill_(-1.0)
        model.laws.cubic.unit.mul_(1000.0)
    assert not stays_in_bounds(model, record)


def test_the_linear_structure_is_found_from_a_start_far_from_it():
    truth, model = chain(True), network()
    record = shaken(truth, 2000, noise=0.01)
    model.identify([record])
    with torch.no_grad():
        model.laws.stiffness.theta.add_(torch.tensor([0.3, -0.3, 0.2]))
        model.laws.damping.theta.add_(1.0)
    far = float(problem_of(model, record).loss().detach().sqrt())
    fit_linear(model, [record], horizons_of(record, LONGER), solver_of_many, lambda losses: None)
    assert float(problem_of(model, record).loss().detach().sqrt()) < min(0.02, 0.1 * far)
    ratio = model.laws.stiffness() / truth.laws.stiffness()
    assert torch.allclose(ratio / ratio[0], torch.ones(3).double(), atol=0.02)
    assert all(p.requires_grad for p in model.laws.unit_stiffness.parameters())
    assert (model.pull(False, 1e-3)[1] == 0.0).all()  # from here the laws are let go


def problem_of(model: ElementNetwork, record: Record) -> FreeRunProblem:
    return FreeRunProblem(model, record, None, prior=0.0)


def solver_of_many(parameters) -> LevenbergMarquardt:
    return LevenbergMarquardt(parameters, iterations=30, scaled=True)


# motion that is held back


@pytest.fixture(scope="module")
def model() -> ElementNetwork:
    return chain(True, 0.3)


@pytest.fixture(scope="module")
def record() -> Record:
    """Of a structure that is a little different, so that the model errs everywhere."""
    return shaken(chain(True, 0.7), 1000, 0.02)


@pytest.fixture(scope="module")
def growing(record: Record) -> Record:
    """The part of the motion in which it swells."""
    return record.window(0, 500)


def prepared(model: ElementNetwork, record: Record) -> FreeRun:
    objective = FreeRun([50, None], select=[1e-6])
    objective.prepare(model, [record], measured=True)
    return objective


def turned(record: Record, part: slice) -> Record:
    """Another motion of the same power: a part of it with the other sign."""
    a = record.a.clone()
    a[part] *= -1.0
    return replace(record, a=a)


@torch.no_grad()
def test_no_fit_before_the_last_sees_what_is_held_back(model, record):
    k = held_back_from(record, 0.2)
    other = turned(record, slice(k, None))
    objective = prepared(model, record)
    *first, last = (
        [float(objective.problem(model, r, stage).loss()) for r in (record, other)]
        for stage in range(len(objective.stages))
    )
    assert len(first) > 3
    assert all(one == two for one, two in first)
    assert last[1] > 1.5 * last[0]


@torch.no_grad()
def test_what_is_held_back_alone_judges(model, record):
    k = held_back_from(record, 0.2)
    objective = prepared(model, record)
    objective.present = 0
    loss = objective.final_loss(model, [record])
    assert objective.final_loss(model, [turned(record, slice(0, k))]) == pytest.approx(loss)
    assert objective.final_loss(model, [turned(record, slice(k, None))]) > 2.0 * loss


@torch.no_grad()
def test_the_first_part_is_held_back_where_the_strongest_motion_comes_last(model, record, growing):
    assert not prepared(model, record).judged_first
    objective, k = prepared(model, growing), held_back_from(growing, 0.8)
    assert objective.judged_first
    assert "the first part is held back" in objective.remarks[-1]
    other, later = turned(growing, slice(0, k)), turned(growing, slice(k, None))
    objective.present = 0
    loss = objective.final_loss(model, [growing])
    assert objective.final_loss(model, [later]) == pytest.approx(loss)
    assert objective.final_loss(model, [other]) > 2.0 * loss
    last = len(objective.horizons) - 1  # begins at rest, others at states that take in all before
    whole = [float(objective.problem(model, r, last).loss()) for r in (growing, other, later)]
    assert whole[0] == pytest.approx(whole[1])
    assert whole[2] > 1.5 * whole[0]


def test_a_law_that_moves_by_itself_is_found_out():
    model = chain(True)
    record = shaken(model, 2000)
    with torch.no_grad():
        model.laws.unit_limit.unit.mul_(0.05)
        model.laws.unit_stiffness.theta.fill_(-0.5)  # it drives what its units give way to
        assert float(model.free_run(record.drive()).a.abs().max()) < 20.0 * record.a.abs().max()
    assert not stays_in_bounds(model, record)


def test_a_record_at_rest_makes_no_model_unstable():
    model = FIR(1, 1, 0.01)
    f = torch.from_numpy(np.random.default_rng(0).standard_normal((400, 1)))
    moved = Record(0.01, 0.5 * f, f)
    model.identify([moved])
    still = replace(moved, a=0.0 * f, f=0.0 * f)
    assert excess(model, [moved, still]) == excess(model, [moved]) < 1.5


def test_a_stage_that_is_tried_again_takes_stated_priors():
    model = ElementNetwork(2, 2, DT, priors={"r1": {"stiffness": [400.0, 0.1]}})
    a = torch.from_numpy(np.random.default_rng(0).standard_normal((300, 2)))
    record, objective = Record(DT, a, a, a, a), FreeRun(select=[])
    objective.prepare(model, [record], measured=False)
    objective.raised = 100.0
    assert objective.problem(model, record, 0).prior == pytest.approx(1e-6)
