"""The table of intervals: digits that mean something, words where the record tells nothing."""

from __future__ import annotations

import pytest
from rich.console import Console

from models.fit.metrics import FREE_RUNS
from report.uncertainty.intervals import (
    beyond_training,
    print_intervals,
    sentences,
    value_and_half,
    which_to_believe,
)
from report.uncertainty.storeys import print_drifts


@pytest.mark.parametrize(
    ("value", "half", "shown"),
    [
        (39.4321, 0.86, ("39.43", "0.86")),
        (0.80038, 0.00061, ("0.80038", "0.00061")),
        (31.2, 174.0, ("31.2", "174")),
        (1234.5, 210.0, ("1234", "210")),
        (0.0, 0.2, ("0", "0.2")),
        (2.5e8, 3e6, ("2.5e+08", "3e+06")),
        (1.2, None, ("1.2000", "given")),
    ],
)
def test_a_value_has_the_digits_that_its_interval_leaves(value, half, shown):
    assert value_and_half(value, half) == shown


def parameter(name: str, **more) -> dict:
    base = {"value": 40.0, "half": 1.0, "white": 0.5, "model_error": 1.0, "status": "determined"}
    return {"name": name, "unit": "N/m", "about": "ground–x1", "combined_with": [], **base, **more}


def test_a_wrong_model_is_told_by_what_parts_of_the_records_ask_for():
    assert not which_to_believe([parameter("r1.stiffness", model_error=1.2)])
    wrong = [parameter("r1.stiffness", model_error=3.0)]
    assert "3 times as wide" in which_to_believe(wrong)
    console = Console(width=80)
    with console.capture() as capture:
        print_intervals(console, {"parameters": wrong}, both=True)
    assert "± model error" in capture.get()
    assert "use ± model error, 3 times as wide" in capture.get()


@pytest.mark.parametrize(("half", "told"), [(0.0010, True), (0.0062, False)])
def test_a_drift_whose_interval_holds_zero_is_none_that_accelerations_tell(half, told):
    row = {"record": "e2", "element": "r1 ground–x1", "peak": 0.0401, "peak_half": 0.0012,
           "residual": 0.0049, "residual_half": half}  # fmt: skip
    console = Console(width=80)
    with console.capture() as capture:
        print_drifts(console, {"drifts": [row]})
    line = next(line for line in capture.get().splitlines() if "r1 ground–x1" in line)
    assert "40.1 ± 1.2" in line
    assert f"4.90 ± {1e3 * half:.1f}" in line
    assert ("*" not in line) == told
    assert ("not determined by the accelerations" in capture.get()) != told


@pytest.mark.parametrize(
    ("unseen", "coloured", "told"), [(60.0, [1], True), (60.0, [], False), (12.0, [1], False)]
)
def test_intervals_of_one_motion_are_not_those_of_another(unseen, coloured, told):
    """A residual that repeats with the motion is alike in all blocks: they cannot tell it."""
    errors = {"train": 10.0, "test": unseen}
    metrics = {FREE_RUNS[part]: {"relative_rms_percent": e} for part, e in errors.items()}
    line = beyond_training(metrics, {"residual_peaks": coloured})
    assert bool(line) == told
    assert not told or "error is 60" in line


def finding(kind: str, name: str, gain: float) -> dict:
    return {"kind": kind, "name": name, "gain": gain, "p": 1e-9, "significant": True}


def test_sentences_name_a_missing_element_alone_and_otherwise_laws():
    brace = finding("a missing element", "x1–x3", 0.26)
    law = finding("the law of an element", "r2", 0.03)
    told = list(sentences({"criticism": [brace, law]}))
    assert told == [
        "the residual suggests an element between x1 and x3, which would explain 26 % of it"
    ]
    assert "r2 lacks terms" in next(sentences({"criticism": [law]}))
    assert not list(sentences({"criticism": [{**law, "significant": False}]}))
