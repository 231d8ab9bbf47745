"""The on-line step estimates and learns as the on-line estimator does, in Python and in C."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from data.record import Drive, Record
from export.step import run
from export.steps import step_of
from models.linear import EquivalentLinear
from models.online.adaptive import Online
from models.online.laws.normalised_gradient import NormalisedGradient
from models.online.laws.random_walk import RandomWalk
from models.online.laws.recursive_least_squares import RecursiveLeastSquares
from models.vwnn import VWNN
from tests.export.compiling import needs_gcc, run_in_c
from tests.export.every_model import DT, agrees_with, chain

LAWS = [NormalisedGradient, RandomWalk, RecursiveLeastSquares]


def online(law: type, unfiltered: bool = False) -> Online:
    network = VWNN(2, 1, DT, order=2, unfiltered_excitation=unfiltered)
    model = Online(2, 1, DT, network, law())
    model.identify([replace(chain(2, 1, 150), x=None, v=None)])
    return model


def told(record: Record) -> Drive:
    """Excitation and measured accelerations."""
    rest = torch.zeros(record.dofs, dtype=torch.float64)
    return Drive(DT, torch.cat([record.excitation, record.a], dim=-1), rest, rest)


@pytest.mark.parametrize("unfiltered", [False, True])
@pytest.mark.parametrize("law", LAWS)
def test_it_estimates_and_learns_as_the_estimator(law, unfiltered):
    model, record = online(law, unfiltered), chain(2, 1, 200)
    found = run(step_of(model, online=True), told(record))
    agrees_with(found["a"], model(record), 1e-9)  # laws magnify rounding


@needs_gcc
@pytest.mark.parametrize("law", LAWS)
def test_it_learns_in_c(law, tmp_path):
    model, record = online(law), chain(2, 1, 200)
    found = run_in_c(step_of(model, online=True), told(record), tmp_path)
    agrees_with(found["a"], model(record), 1e-9)


def test_a_network_that_no_law_adapts_estimates_too():
    model, record = online(RecursiveLeastSquares).estimator, chain(2, 1, 200)
    agrees_with(run(step_of(model, online=True), told(record))["a"], model(record), 1e-12)


def test_a_sample_that_is_not_finite_teaches_nothing():
    step, given = step_of(online(RecursiveLeastSquares), online=True), told(chain(2, 1, 100))
    given.u[40, 2] = torch.nan
    found = run(step, given)["a"]
    assert np.isfinite(found).all()


def test_the_free_run_is_that_of_what_was_learned():
    model = online(RandomWalk)
    given = chain(2, 1, 60).drive()
    found, wanted = (run(step_of(one), given)["a"] for one in (model, model.estimator))
    np.testing.assert_array_equal(found, wanted)


def test_other_models_have_no_step_on_line():
    with pytest.raises(ValueError, match="EquivalentLinear has no step on line"):
        step_of(EquivalentLinear(2, 2, DT), online=True)
