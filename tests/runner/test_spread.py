"""How runs count: medians with diverged and failed runs, draws that escaped, ranges."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from runner.scores.result import FINISHED, Result, spread_of
from runner.scores.spread import ESCAPED, FAILED, Spread, percent


def runs(*values: float | str) -> list[Result]:
    """Finished runs with these test errors, None: diverged; words: runs without numbers."""
    return [
        Result(Path(str(seed)), value, "why", {}, {})
        if isinstance(value, str)
        else Result(Path(str(seed)), FINISHED, "", {}, {"test": {"relative_rms_percent": value}})
        for seed, value in enumerate(values)
    ]


def spread(*values: float | str) -> Spread:
    return spread_of(runs(*values), lambda run: run.error("test"))


def test_diverged_and_failed_runs_are_infinite_and_never_left_out():
    ours = spread(9.0, None, FAILED, 10.0, 11.0)
    assert (ours.median, *ours.range) == (11.0, 9.0, math.inf)
    assert (ours.runs, ours.diverged, ours.failed) == (5, 1, 1)
    assert ours.text() == "11.00 (9.00 – diverged)"
    assert ours.counts() == "5, 1 diverged, 1 failed"


def test_a_draw_whose_structure_escaped_is_counted_and_changes_no_statistic():
    ours, without = spread(9.0, ESCAPED, 11.0), spread(9.0, 11.0)
    assert (ours.median, ours.quartiles, ours.range) == (10.0, (9.5, 10.5), (9.0, 11.0))
    assert (ours.median, ours.quartiles) == (without.median, without.quartiles)
    assert ours.counts() == "3, 1 escaped"
    assert spread(ESCAPED).text() == "–"


def test_what_failed_has_no_number_where_no_run_of_its_case_has_one():
    """A model without a free run, say."""
    ours = spread_of(runs(1.0, FAILED), lambda run: run.free_run)
    assert (ours.values, ours.runs, ours.failed) == ((), 2, 1)
    assert spread(FAILED, FAILED).text() == "failed"


@pytest.mark.parametrize(("value", "inside"), [(9.0, True), (10.5, True), (1e9, False)])
def test_an_infinite_end_lets_no_value_in(value, inside):
    assert spread(9.0, 10.5, None).holds(value) is inside
    assert not spread(None).holds(value)


def test_percents_have_the_digits_that_can_be_read():
    texts = [percent(value) for value in (0.004, 9.996, 99.996, 1234.5, 2e5, math.inf, None)]
    assert texts == ["0.00", "10.00", "100", "1234", "2e+05", "diverged", ""]
