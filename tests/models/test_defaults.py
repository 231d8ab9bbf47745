"""Defaults stand once: a config says what its class would do by itself, or names a variant."""

from __future__ import annotations

import inspect
from typing import Any

import pytest
from omegaconf import OmegaConf

from models.choice import LABELS
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
