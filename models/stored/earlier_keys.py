"""Keys of metrics.json that earlier versions named otherwise, and settings that they had."""

from __future__ import annotations

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
# Keys of metrics.json, read as today's (CHANGELOG.md): a mapping has the name of today, or what is
# renamed inside of a key that stays; `...` are all other keys, such as names of records or models.
OF_A_WAY = {"none": "no_free_run", "left_after_s": "diverged_after_s"}
OF_SPLITS = {key: {**OF_A_WAY, ...: OF_A_WAY} for key in SPLITS}
BANDS = {"none": "unavailable", "others": "coverage_of_others"}
EARLIER: dict[Any, Any] = {
    **OF_SPLITS,
    **{key: {...: OF_SPLITS} for key in ("per_record", "baselines")},
    "over_seeds": [OF_A_WAY],  # of an entry of the zoo
    "verdict": {"lost": "test_diverges"},
    "online": {"ways": "estimates", "learnt_percent": "frozen_error_percent"},
    "training": {"held_back_percent": "held_out_error_percent"},
    "identification": {
        "apart_percent": "force_error_percent",
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
    "uncertainty": {
        "none": "unavailable",
        "coloured": "residual_peaks",
        "counts": "channel_weights",
        "lacking": "model_lacks_terms",
        **dict.fromkeys(("bands", "one_step_bands"), BANDS),
    },
}


def todays_keys(node: Any, earlier: Any = EARLIER) -> Any:
    """Content of metrics.json with the keys of today; what is no mapping stays for its check."""
    if isinstance(node, list) and isinstance(earlier, list):
        return [todays_keys(value, earlier[0]) for value in node]
    if not isinstance(node, dict) or not isinstance(earlier, dict):
        return node
    found = {}
    for key, value in node.items():
        stem, _, number = key.rpartition("_")  # of an element, at the end
        numbered = number.isdecimal() and isinstance(earlier.get(stem), str)
        own = f"{earlier[stem]}_{number}" if numbered else earlier.get(key, earlier.get(...))
        found[own if isinstance(own, str) else key] = todays_keys(value, own)
    return found
