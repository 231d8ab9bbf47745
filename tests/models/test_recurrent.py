"""Recurrent networks: what they read, their initial state, both signals and integrals, training."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from data.record import Record, stack
from models.fit.problem import Problem
from models.fit.solvers.adam import Adam
from models.recurrent import Recurrent
from models.stored.run import read_run
from models.zoo.index import ROOT
from tests.models.two_masses import DT, motion


def identified(record: Record, **choices) -> Recurrent:
    torch.manual_seed(0)
    estimator = Recurrent(2, 2, DT, hidden=6, **choices)
    estimator.identify([record])
    return estimator


def test_it_reads_the_force_and_the_initial_state_alone():
    record = motion(begins="given")
    estimator = identified(record, layers=2)
    lies = replace(record, a=record.a + 1.0, x=record.x.clone(), v=record.v.clone())
    lies.x[1:] += 1.0
    lies.v[1:] += 1.0
    assert torch.equal(estimator(lies), estimator(record))
    for name in ("x", "v"):
        moved = getattr(record, name).clone()
        moved[0] += 1.0
        assert (estimator(replace(record, **{name: moved})) != estimator(record))[0].all()


def test_training_counts_every_measured_signal_alike():
    """The loss is the mean of the squared relative errors of ẍ, x and ẋ, for equal DOFs."""
    record = motion()
    one = record.map(lambda u: u[..., :1])
    estimator = Recurrent(1, 1, DT, hidden=4)
    estimator.identify([one])
    with torch.no_grad():
        run = estimator.free_run(one.drive())
    errors = [
        float(((getattr(run, s) - getattr(one, s)) ** 2).sum() / (getattr(one, s) ** 2).sum())
        for s in "axv"
    ]
    loss = float(Problem(estimator, one).loss().detach())
    assert loss == pytest.approx(np.mean(errors), rel=1e-9)


def test_adam_trains_it():
    record = stack([motion(begins="given"), motion(seed=1, begins="given")])
    estimator = identified(record)
    solver, losses = Adam(estimator.parameters(), iterations=100, rate=0.05), []
    while not solver.finished:
        losses += solver.solve(Problem(estimator, record))
    assert losses[-1] < 0.25 * losses[0]


@pytest.mark.parametrize("wrong", [{"hidden": 0}, {"layers": 0}])
def test_a_network_that_cannot_be_built_is_refused(wrong):
    with pytest.raises(ValueError, match="=0 must be a whole number"):
        Recurrent(2, 2, DT, **wrong)


def test_an_older_run_is_read_with_gated_units_and_refused_with_others(tmp_path):
    """Its config names the cells, of which there was a choice."""
    run = Path(shutil.copytree(ROOT / "gru" / "bilinear.v1", tmp_path / "run"))
    config = run / "config.yaml"
    assert "cell: gru" in config.read_text("utf-8")
    assert isinstance(read_run(run).restore(), Recurrent)
    config.write_text(config.read_text("utf-8").replace("cell: gru", "cell: lstm"), "utf-8")
    with pytest.raises(ValueError, match="has no argument 'cell'"):
        read_run(run).restore()
