"""Defaults stand once: a config says what its class would do by itself, or names a variant."""

from __future__ import annotations

import inspect
import json
from typing import Any

import pytest
from omegaconf import OmegaConf

from models.choice import LABELS
from models.stored.earlier_keys import todays_keys
from models.stored.folder import read_metrics
from models.zoo.index import entries
from runner.config.compose import CONF, EARLIER, composed
from tests.experiments import class_of

VARIANTS = {  # config → the settings that make it another model, or another way of solving
    "model=chebyshev_restoring_force": {"basis"},
    "model=element_network": {"mass_damping", "dofs"},  # not of networks made before; by sensors
    "model=element_network_branch": {"dofs"},
    "model=element_network_named": {"dofs"},
    "model=linear_modes": {"elements"},
    "model=online_polynomial": {"fits"},
    "model=power_series_residual": {"fits"},
    "model=vwnn_first_order": {"order"},
    "model=vwnn_third_order": {"order"},
    "solver=adam_sequences": {"iterations", "rate"},
    "solver=lbfgs_short": {"iterations", "change"},
}
CONFIGS = [
    f"{group}={path.stem}"
    for group in ("model", "solver", "objective", "adaptation")
    for path in sorted((*(CONF / group).glob("*.yaml"), *(EARLIER / group).glob("*.yaml")))
]


def other_than_default(node: dict[str, Any]) -> set[str]:
    """Settings that differ from the default of the class; what is interpolated is no default."""
    arguments = inspect.signature(class_of(node)).parameters
    differ = set()
    for name, value in node.items():
        if isinstance(value, dict) and "_target_" in value:
            differ |= other_than_default(value)
        elif name not in ("_target_", *LABELS) and not str(value).startswith("${"):
            default = arguments[name].default
            if value != (list(default) if isinstance(default, tuple) else default):
                differ.add(name)
    return differ


@pytest.mark.parametrize("config", CONFIGS)
def test_a_config_and_its_class_have_the_same_defaults_and_a_model_the_name_of_its_file(config):
    """Models are fitted in test_every_estimator.py, and with their solvers in test_units.py."""
    cfg = composed(config) if config.startswith("model=") else composed(config, "model=vwnn")
    name = "hysteretic_element" if config == "model=element_test" else config.partition("=")[2]
    assert not config.startswith("model=") or cfg.model.name == name
    node = OmegaConf.to_container(cfg[config.partition("=")[0]], resolve=False)
    assert isinstance(node, dict)
    assert other_than_default(node) == VARIANTS.get(config, set())


# Files of finished runs of earlier versions are read with today's keys


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
