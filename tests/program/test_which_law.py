"""Classes of laws of one element: candidates, planted cases, the table of picks."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest

from benchmarks.which_law.cases import drawn, fit_of, laws
from benchmarks.which_law.elements import CLASSES, DEVELOPED, HELD_BACK, MOTIONS, motion
from benchmarks.which_law.page import by_bic, by_unseen, facts_of
from data.record import stack
from report.candidates.table import Candidate


def test_candidates_are_those_of_the_experiment():
    found = laws()
    assert [kind for kind, _ in found.values()].count("bouc_wen") == 3
    assert set(CLASSES) < {kind for kind, _ in found.values()}
    assert found["bouc_wen, model.units=2"][1]["model.units"] == "2"


def test_a_planted_slider_is_called_bilinear():
    """Neither the linear law, which errs more, nor the rounded one, which has more parameters."""
    _, records, _ = drawn("bilinear", DEVELOPED, np.random.default_rng(1))
    batch, unseen = stack(records[:2]), records[2:]
    asked = {name: laws()[name] for name in ("linear", "bilinear", "bouc_wen, model.units=1")}
    found = [fit_of(name, *own, batch, unseen) for name, own in asked.items()]
    assert by_unseen(found) == by_bic(found) == "bilinear"
    assert found[1].parameters == pytest.approx(4.0, abs=0.1)
    assert found[1].error < 2.3 < found[0].error  # the noise is 2 %


@pytest.mark.parametrize("own", [DEVELOPED, HELD_BACK])
def test_motions_reach_what_is_planted(own):
    """From rest to the largest size, with samples enough in a cycle."""
    rng = np.random.default_rng(0)
    assert set(own.motions) <= set(MOTIONS)
    assert own.samples[0] / own.cycles[1] > 30
    assert min(own.yields[0], own.gaps[0]) >= 1.4
    for kind in own.motions:
        y = motion(rng, kind, 1000, 10.0)
        assert y[0] == 0.0
        assert np.abs(y).max() == pytest.approx(1.0)


def test_the_table_counts_what_was_taken_for_what():
    sure = asdict(Candidate("linear", 2.0, 0.0, 2.0, kind="linear"))
    better = asdict(Candidate("cubic", 3.0, 10.0, 1.0, kind="cubic"))
    result = {"set": "developed", "kind": "linear", "number": 0}
    results = [
        result | {"candidates": {"a": sure | {"seconds": 0.1}}},
        result | {"candidates": {"a": sure | {"seconds": 0.1}, "b": better | {"seconds": 0.1}}},
    ]
    facts = facts_of(results)
    assert "| linear | 1 | 1 |" in facts["developed"]
    assert facts["developed_right"] == "50.0 %"
    assert facts["developed_by_bic"] == "100.0 %"
    assert facts["held_back_right"] == "–"
