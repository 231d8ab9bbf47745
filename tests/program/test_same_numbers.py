"""benchmarks/same_numbers.py: what counts as a difference between two runs, and how they pair."""

from __future__ import annotations

import json

import pytest

from benchmarks.same_numbers import compared, results

RUN = {
    "test": {"relative_rms_percent": "1.0", "per_dof_percent": ["1.0", "2.0"]},
    "fit_seconds": "3.1",
    "identity": {"results": 1},
    "versions": {"torch": "2"},
    "baselines": {"linear": {"fit_seconds": "0.2"}},
}


def test_times_identity_and_versions_are_no_difference():
    other = {
        **RUN,
        "fit_seconds": "9",
        "identity": {},
        "versions": None,
        "baselines": {"linear": {}},
    }
    assert compared(RUN, other) == (True, "identical")


def test_a_last_digit_is_a_difference_and_is_named_with_both_values():
    other = json.loads(json.dumps(RUN))
    other["test"]["per_dof_percent"][1] = "2.0000000000000004"
    same, line = compared(RUN, other)
    assert not same
    assert line == "differs in test.per_dof_percent[1]: 2.0 before, 2.0000000000000004 now"
    assert not compared(RUN, {**RUN, "test": {**RUN["test"], "per_dof_percent": ["1.0"]}})[0]


def test_runs_of_a_sweep_pair_without_their_hashes(tmp_path):
    for name, number in (("linear-bilinear-seed0-aaaa", "0.10"), ("linear-bilinear-seed1-bb", "1")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "metrics.json").write_text(f'{{"test": {number}}}')
    assert results(tmp_path) == {
        "linear-bilinear-seed0": {"test": "0.10"},
        "linear-bilinear-seed1": {"test": "1"},
    }
    (tmp_path / "linear-bilinear-seed1-cc").mkdir()
    (tmp_path / "linear-bilinear-seed1-cc" / "metrics.json").write_text("{}")
    with pytest.raises(ValueError, match="several runs linear-bilinear-seed1"):
        results(tmp_path)
