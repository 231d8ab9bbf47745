"""The last stage of a fit ends no worse than an earlier one on motion that was held back."""

from __future__ import annotations

from dataclasses import replace
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from data.simulation.datamodule import SimulatedData
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.scenario import FullState
from models.element_network import ElementNetwork
from models.fit.free_run_objective import FreeRun
from models.fit.held_back import unless_worse
from models.fit.identification import HELD_BACK, Identification
from models.fit.objective import restore, state_of
from models.fit.problem import FreeRunProblem
from models.fit.progress import limited
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from models.fit.solvers.solver import OUT_OF_TIME
from models.modal import fit as modal_fit
from models.neural_state_space import NeuralStateSpace
from tests.models.solver_problems import Astray
from tests.models.training import fit
from tests.models.two_masses import DT


@pytest.mark.parametrize(("end", "kept"), [(0.2, 0.2), (0.3, 0.3), (0.5, 0.3), (np.nan, 0.3)])
def test_a_stage_is_kept_unless_it_loses(end, kept):
    assert unless_worse(end, 0.3, lambda error: error) == kept


def test_a_refit_that_loses_on_the_motion_held_back_is_given_up(bilinear_records, monkeypatch):
    """Its loss on the whole counts as infinite, so that the stage's start is kept."""
    record = bilinear_records[0].measured()
    model = ElementNetwork(3, 3, record.dt, elements="chain", hinges=0, units=0)
    model.identify([record])
    objective = FreeRun(horizons=[None], select=[1e-6])
    objective.prepare(model, [record], measured=True)
    objective.present = len(objective.stages) - 1
    assert objective.refits
    start = objective.final_loss(model, [record])
    assert np.isfinite(start)
    assert objective.final_loss(model, [record]) == start  # as good
    whole = FreeRun._loss_of

    def worse_late(self, estimator, records):
        (one,) = records
        return whole(self, estimator, records) * (2.0 if one.warmup else 0.5)

    monkeypatch.setattr(FreeRun, "_loss_of", worse_late)
    assert objective.final_loss(model, [record]) == np.inf
    assert objective.remarks[-1].endswith("its start is kept")


def in_stages(structure, solver):
    """A fit in three stages, and its data."""
    excitation = Excitation(force=BandLimitedGaussian(2.0, (0.0, 4.0)))
    own = {"duration": 3.2, "validation": 0.3}
    model = NeuralStateSpace(2, 2, DT, memory=1, hidden=2, past=2)
    data = SimulatedData(structure, excitation, FullState(), seed=0, **own)
    return data, Identification(model, solver, objective=FreeRun([20, 40, None]))


def test_out_of_time_no_further_stage_is_begun(linear_chain, tmp_path):
    data, training = in_stages(linear_chain(2), LevenbergMarquardt)
    with limited(0.0):
        fit(training, data, tmp_path)
    assert [stage["stopped"] for stage in training.ended] == [OUT_OF_TIME]


def test_of_stages_the_best_on_what_the_data_hold_back_is_kept(linear_chain, monkeypatch, tmp_path):
    """The last stage leads astray, and follows the training motion best: so it is said here."""
    made, ends, falling = count(), [], count(10, -1)

    def final_loss(self, estimator, batches) -> float:
        ends.append(state_of(estimator))
        return float(next(falling))

    monkeypatch.setattr(FreeRun, "final_loss", final_loss)
    data, training = in_stages(linear_chain(2), lambda p: Astray(p, next(made) == 2))
    fit(training, data, tmp_path)
    model = training.estimator
    kept = state_of(model)

    def held_back_loss() -> float:
        (record,) = data.loader(HELD_BACK)
        return float(FreeRunProblem(model, record, None).loss().detach())

    losses = []
    for state in ends:
        restore(model, state)
        losses.append(held_back_loss())
    best = int(np.argmin(losses))
    assert losses[best] < losses[-1]  # which would have been taken
    assert all(torch.equal(one, same) for one, same in zip(kept, ends[best], strict=True))


def test_iterations_of_a_modal_network_that_lose_are_given_up(monkeypatch):
    nothing = SimpleNamespace(now=lambda: None)
    for name in ("settle", "learned", "minimise"):
        monkeypatch.setattr(modal_fit, name, lambda *_, **__: None)
    monkeypatch.setattr(modal_fit, "ModalProblem", lambda *_: nothing)
    monkeypatch.setattr(modal_fit, "judge", lambda one, motions: replace(one, error=motions))
    before = modal_fit.Fit(None, None, error=0.3)
    assert modal_fit.train(before, [], modal_fit.Plan(), 1, judged=0.2).error == 0.2
    assert modal_fit.train(before, [], modal_fit.Plan(), 1, judged=0.5) is before
    untrained = modal_fit.Fit(None, None)
    assert modal_fit.train(untrained, 0.9, modal_fit.Plan(), 1).error == 0.9
