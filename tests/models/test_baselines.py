"""What a model has to be better than: no motion, or one with the base."""

from __future__ import annotations

import pytest

from data.datamodule import Data
from models.baselines import NotApplicableError, Rigid, Zero
from models.fit.metrics import free_run_score, score
from models.linear_motion import LinearMotion
from runner.scores.outcome import compare_baselines


@pytest.mark.parametrize(("kind", "forced"), [(Zero, [1, 2, 3]), (Rigid, "base")])
def test_no_motion_errs_by_all_of_it(kind, forced, bilinear_record):
    model = kind(3, 3, bilinear_record.dt, forced)
    model.identify([bilinear_record])
    assert score(model, [bilinear_record])["relative_rms_percent"] == 100.0
    assert free_run_score(model, [bilinear_record])["per_dof_percent"] == [100.0] * 3


@pytest.mark.parametrize(("kind", "forced"), [(Rigid, [1]), (Zero, "base"), (Rigid, None)])
def test_one_of_both_is_the_word_for_it(kind, forced, bilinear_record):
    with pytest.raises(NotApplicableError, match="relative to a base"):
        kind(3, 3, bilinear_record.dt, forced).identify([bilinear_record])


def test_a_baseline_that_cannot_run_stops_nothing(bilinear_record):
    class Given(Data):
        dt, dofs, inputs = bilinear_record.dt, 3, 3

        def make_records(self):
            return {"train": [bilinear_record], "test": [bilinear_record]}

    data = Given()
    data.setup()

    class Broken(Zero):
        def identify(self, batches):
            raise RuntimeError("the matrix is singular")

    baselines = {
        "broken": Broken(3, 3, bilinear_record.dt),
        "unbuilt": ValueError("too many channels"),
        "rigid": Rigid(3, 3, bilinear_record.dt),
        "zero": Zero(3, 3, bilinear_record.dt),
        "linear": LinearMotion(3, 3, bilinear_record.dt),
    }
    results = compare_baselines(baselines, data)
    assert list(results) == ["broken", "unbuilt", "zero", "linear"]
    assert results["broken"] == {"failed": "the matrix is singular"}
    assert results["unbuilt"] == {"failed": "too many channels"}
    assert 0.0 < results["linear"]["free_run"]["relative_rms_percent"] < 100.0
