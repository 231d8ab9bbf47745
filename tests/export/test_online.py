"""The on-line step in C: estimates one step ahead, and weights that adapt, as in Python."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from data.record import Drive, Record
from export.steps import online, step_of
from models.online.adaptive import Online
from models.online.laws.normalised_gradient import NormalisedGradient
from models.online.laws.random_walk import RandomWalk
from models.online.laws.recursive_least_squares import RecursiveLeastSquares
from models.vwnn import VWNN
from tests.export.compiling import needs_gcc, run_in_c
from tests.export.every_model import chain

pytestmark = needs_gcc
LAWS = {"rls": RecursiveLeastSquares, "gradient": NormalisedGradient, "walk": RandomWalk}


def told(record: Record) -> Drive:
    """Forces and measured accelerations as they come, held: an estimate cannot read the latter."""
    u = torch.cat([record.excitation, record.a], dim=1)
    rest = torch.zeros(record.dofs, dtype=torch.float64)
    return Drive(record.dt, u, rest, rest, "zero_order")


def assert_alike(found: np.ndarray, right: torch.Tensor, share: float) -> None:
    wanted = right.detach().numpy()
    assert np.abs(found - wanted).max() <= share * np.abs(wanted).max()


def test_a_vwnn_estimates_one_step_ahead(tmp_path):
    record = chain(3)
    model = VWNN(3, 3, record.dt)
    model.identify([record])
    with torch.inference_mode():
        right = model(record)
    found = run_in_c(online.step_of(model), told(record), tmp_path)["a"]
    assert_alike(found, right, 1e-11)


@pytest.mark.parametrize("law", LAWS)
def test_weights_adapt(law, tmp_path):
    record = chain(2)
    model = Online(2, 2, record.dt, VWNN(2, 2, record.dt), LAWS[law]())
    model.identify([record.window(0, 150)])
    later = record.window(150, record.samples)
    with torch.inference_mode():
        right = model(later)
    found = run_in_c(step_of(model), told(later), tmp_path)["a"]
    assert_alike(found, right, 1e-9)


def test_an_estimate_never_reads_the_sample_it_estimates(tmp_path):
    record = chain(2)
    model = VWNN(2, 2, record.dt)
    model.identify([record])
    given = told(record)
    other = Drive(given.dt, given.u.clone(), given.x0, given.v0, given.hold)
    other.u[200:, 2:] += 5.0
    step = online.step_of(model)
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    one, two = (
        run_in_c(step, drive, tmp_path / name)["a"]
        for drive, name in ((given, "one"), (other, "two"))
    )
    np.testing.assert_array_equal(one[:201], two[:201])
    assert not np.array_equal(one[201], two[201])
