"""Keys of metrics.json that earlier versions named otherwise, and settings that they had."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from models.stored.schema import SPLITS

# settings that configs of earlier runs have → their value in today's code; of those that went since
# 0.12 began, finished runs have them in their digests
GONE_SINCE: dict[str, dict[str, Any]] = {
    "models.FreeRun": {"warmup": 0},
    "models.ElementNetwork": {"tanhs": 0, "early_prior": None},
    "models.ElementTest": {"tanhs": 0},
    "models.HystereticElement": {"tanhs": 0},
    "models.LatentHysteresisNetwork": {"tanhs": 0},
    "models.ModalNetwork": {
        "hinges": 2,
        "units": 3,
        "ahead": None,
        "held_back": 0.2,
        "prior": 1e-9,
    },
}
ONLY_WAY = {"models.Recurrent": {"cell": "gru"}, **GONE_SINCE}
# Keys of metrics.json, read as today's (CHANGELOG.md).
SCORES = {"none": "no_free_run", "left_after_s": "diverged_after_s"}
UNCERTAINTY = {
    "none": "unavailable",
    "coloured": "residual_peaks",
    "counts": "channel_weights",
    "lacking": "model_lacks_terms",
}
BANDS = {"none": "unavailable", "others": "coverage_of_others"}
PARTS = {  # of metrics.json
    "verdict": {"lost": "test_diverges"},
    "online": {"ways": "estimates", "learnt_percent": "frozen_error_percent"},
    "training": {"held_back_percent": "held_out_error_percent"},
    "identification": {
        "fits_that_ran_away": "diverged_fits",
        "forces_off_percent": "force_error_percent",
        "free_run_percent_unrefined": "free_run_percent_before_refinement",
        "held_back_linear_percent": "held_out_error_linear_percent",
        "held_back_percent": "held_out_error_percent",
        "laws_off_held_back_percent": "held_out_force_error_percent",
        "laws_off_percent": "force_error_percent",
        "left_open": "undetermined",
        "memory": "law_memory",
        "sides": "tension_compression",
        "topologies_held_back_percent": "held_out_error_by_topology_percent",
    },
}
BY_ELEMENT = (  # a number at the end
    (re.compile(r"held_back_percent_(\d+)"), r"held_out_error_percent_\1"),
    (re.compile(r"apart_percent_(\d+)"), r"force_error_percent_\1"),
)


def todays_keys(metrics: Any) -> Any:
    """Content of metrics.json with the keys of today; what is no mapping stays for its check."""
    if not isinstance(metrics, dict):
        return metrics
    found = {key: _renamed(value, PARTS.get(key, {})) for key, value in metrics.items()}
    found |= {key: _scores(found[key]) for key in SPLITS if key in found}
    for key in ("per_record", "baselines"):
        found |= {key: _each(found[key], _split_scores)} if key in found else {}
    if "identification" in found:
        found["identification"] = _by_element(found["identification"])
    if "uncertainty" in found:
        found["uncertainty"] = _uncertainty(found["uncertainty"])
    if isinstance(rows := found.get("over_seeds"), list):  # of an entry of the zoo
        found["over_seeds"] = [_renamed(row, SCORES) for row in rows]
    return found


def _renamed(node: Any, names: Mapping[str, str]) -> Any:
    if not isinstance(node, dict):
        return node
    return {names.get(key, key): value for key, value in node.items()}


def _each(node: Any, change: Any) -> Any:
    """The values of a mapping changed, whose keys are names of records or models."""
    return {k: change(v) for k, v in node.items()} if isinstance(node, dict) else node


def _scores(node: Any) -> Any:
    """Of a split, with those of other ways in which a model estimates."""
    return _each(_renamed(node, SCORES), lambda value: _renamed(value, SCORES))


def _split_scores(node: Any) -> Any:
    if not isinstance(node, dict):
        return node
    return {key: _scores(value) if key in SPLITS else value for key, value in node.items()}


def _by_element(node: Any) -> Any:
    if not isinstance(node, dict):
        return node
    found = {}
    for key, value in node.items():
        for pattern, new in BY_ELEMENT:
            key = pattern.sub(new, key) if pattern.fullmatch(key) else key
        found[key] = value
    return found


def _uncertainty(node: Any) -> Any:
    found = _renamed(node, UNCERTAINTY)
    if not isinstance(found, dict):
        return found
    bands = [key for key in ("bands", "one_step_bands") if key in found]
    return found | {key: _renamed(found[key], BANDS) for key in bands}
