"""Models that are as good as can be on one motion, and run away on another."""

from __future__ import annotations

import pytest
import torch

from models.starts.judged import farthest
from models.training.stands import MORE, stands
from tests.models.test_starts import motion as shaken
from tests.models.test_starts import planted


def test_a_spring_that_gives_way_beyond_the_trained_motion_is_found_out():
    """Softening: k y + k₃ y³ with k₃ < 0 holds up to y = √(k/|k₃|), and nothing holds beyond."""
    model = planted(True)
    record = shaken(model, 600)
    with torch.no_grad():
        model.laws.cubic.theta.fill_(-1.0)
        model.laws.cubic.unit.mul_(10.0)
        drive = record.drive()
        assert float(model.free_run(drive).a.abs().max()) < float(record.a.abs().max())
        larger = model.free_run(shaken(model, 600).map(lambda u: MORE * u).drive()).a
    assert not larger.isfinite().all()
    assert not stands(model, record)
    assert farthest(model, [record]) > 100.0


@pytest.mark.parametrize("times", [1.0, 1e-6])
def test_a_linear_structure_moves_in_proportion_under_excitations_like_those_of_a_record(times):
    """The spectrum tells how large a stationary motion is; peaks of draws differ by less."""
    model = planted(False)
    record = shaken(model, 2000).map(lambda u: times * u)
    assert 0.5 < farthest(model, [record]) < 2.0
