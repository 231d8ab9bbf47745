"""Files of finished runs of earlier versions are read with today's keys."""

import json

import pytest

from models.stored.earlier_keys import todays_keys
from models.stored.folder import read_metrics
from models.zoo.index import entries

BEFORE = {
    **{"model": "element_network", "system": "bilinear", "scenario": "full_state"},
    "free_run": {
        "relative_rms_percent": None,
        "left_after_s": [2.0],
        "own_residual": {"none": "x"},
    },
    "verdict": {"identified": True, "reason": "", "lost": "its test motion"},
    "per_record": {"none": {"test": {}, "free_run": {"none": "it cannot simulate"}}},
    "baselines": {"lost": {"test": {}, "free_run": {"left_after_s": [1.0]}}, "b": {"failed": "x"}},
    "uncertainty": {"coloured": [], "counts": [1.0], "noise": [1.0], "bands": {"none": "too few"}},
    "identification": {"sides": "alike", "apart_percent_2": "1.0", "rank": 3},
    "online": {"ways": {"adapting": {}}, "learnt_percent": {"10": 2.0}},
    "over_seeds": [{"seed": 0, "none": "it cannot simulate"}],
}
NOW = {
    **{"model": "element_network", "system": "bilinear", "scenario": "full_state"},
    "free_run": {
        **{"relative_rms_percent": None, "diverged_after_s": [2.0]},
        "own_residual": {"no_free_run": "x"},
    },
    "verdict": {"identified": True, "reason": "", "test_diverges": "its test motion"},
    "per_record": {"none": {"test": {}, "free_run": {"no_free_run": "it cannot simulate"}}},
    "baselines": {
        "lost": {"test": {}, "free_run": {"diverged_after_s": [1.0]}},
        "b": {"failed": "x"},
    },
    "uncertainty": {
        **{"residual_peaks": [], "channel_weights": [1.0], "noise": [1.0]},
        "bands": {"unavailable": "too few"},
    },
    "identification": {"tension_compression": "alike", "force_error_percent_2": "1.0", "rank": 3},
    "online": {"estimates": {"adapting": {}}, "frozen_error_percent": {"10": 2.0}},
    "over_seeds": [{"seed": 0, "no_free_run": "it cannot simulate"}],
}


def test_keys_of_earlier_versions_are_read_as_todays(tmp_path):
    (tmp_path / "metrics.json").write_text(json.dumps(BEFORE))
    assert read_metrics(tmp_path) == NOW == todays_keys(NOW)


@pytest.mark.parametrize("entry", entries()[:5], ids=lambda entry: entry.name)
def test_published_models_are_read_with_todays_keys(entry):
    scores = read_metrics(entry.folder)["free_run"]
    assert not {"none", "left_after_s"} & set(scores)


@pytest.mark.parametrize("odd", [[], "x", {"free_run": [], "verdict": 3, "per_record": {"a": 1}}])
def test_what_is_no_mapping_is_left_for_its_check(odd):
    assert todays_keys(odd) == odd
