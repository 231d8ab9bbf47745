"""What the files of a run hold: the types of all values that programs use; others may be anything.

A kind is a type, None, a tuple of kinds of which one has to fit, [kind] for a list, {key: kind} for
a mapping, where `...` stands for all other keys. Absent keys are allowed: older runs lack some.
"""

from __future__ import annotations

from typing import Any

NUMBER = (int, float)
ANYTHING = object
PERCENT = (NUMBER, None)  # None: it overflowed
SCORES: dict[Any, Any] = {
    "none": str,
    "left_after_s": ([NUMBER], None),
    **{f"per_dof_{of}{true}": [PERCENT] for of in ("percent", "rms") for true in ("", "_true")},
    **{f"relative_rms_percent{true}": PERCENT for true in ("", "_true")},
}
SCORES[...] = (NUMBER, None, SCORES)  # another way in which the model estimates
SPLITS = ("train", "validation", "test", "free_run_train", "free_run_validation", "free_run")
ONLINE_WAY: dict[Any, Any] = {
    "settle_s": {...: PERCENT},
    "worst_percent": PERCENT,
    "unstable_s": PERCENT,
}
VERDICT: dict[Any, Any] = {
    "identified": (bool, None),  # None: nothing to judge
    "reason": str,
    "by": str,
    "lost": str,  # test motions on which the free run diverges
    **dict.fromkeys(("error_percent", "linear_percent"), PERCENT),
}
RANGE: dict[Any, Any] = {  # of a kind of signal
    **{"unit": str, "names": [str], "largest": [NUMBER]},
    "lowest": [NUMBER],  # of other inputs
}
OUTSIDE: dict[Any, Any] = {
    **dict.fromkeys(("kind", "name", "unit"), str),
    **dict.fromkeys(("largest", "trained"), NUMBER),
    "times": PERCENT,
    "channels": int,
}
BAND: dict[Any, Any] = {
    **dict.fromkeys(("none", "method"), str),
    **{"factor": [NUMBER], "floor": [NUMBER], "others": [NUMBER]},
    **{"records": int, "memory_s": NUMBER, "mean_half_widths": [PERCENT]},
    **dict.fromkeys(("covered_percent", "mean_half_width"), PERCENT),
}
METRICS_KIND: dict[Any, Any] = {
    **dict.fromkeys(("model", "system", "scenario", "quantity"), str),
    **dict.fromkeys(SPLITS, SCORES),
    "verdict": VERDICT,
    "per_record": {...: {"test": SCORES, "free_run": SCORES}},
    "uncertainty": {"bands": BAND, "one_step_bands": BAND, ...: ANYTHING},
    "trained_range": {...: RANGE},
    "outside_trained_range": [OUTSIDE],
    "scenario_settings": {...: ANYTHING},
    "seed": int,
    "identity": {"config": str, "results": int, ...: ANYTHING},
    "checkpoint": str,
    "fit_seconds": NUMBER,
    "parameters": int,
    "simulation_error": PERCENT,
    "identification": {...: ANYTHING},
    "training": {...: ANYTHING},
    "online": {"ways": {...: ONLINE_WAY}, "learnt_percent": {...: PERCENT}, ...: ANYTHING},
    ...: ANYTHING,
}
FAILURE_KIND: dict[Any, Any] = {
    "reason": str,
    "own": bool,
    "escaped": bool,
    "results": int,
    ...: ANYTHING,
}
SENSORS_KIND: dict[Any, Any] = {
    "dt": NUMBER,
    "dofs": int,
    "inputs": int,
    "forced": ([int], str, None),
    "quantity": str,
    "channels": [str],
    "units": {...: str},
    ...: ANYTHING,
}
CHOICES_KIND: dict[Any, Any] = {  # of a config, dotted
    **dict.fromkeys(("model.name", "system.name", "scenario.name"), str),
    "seed": int,
    "grid": (str, None),
    "data.train_records": (int, None),
    ...: ANYTHING,
}
NAMED: dict[Any, Any] = {"name": str, ...: ANYTHING}
BUILT: dict[Any, Any] = {"_target_": str, ...: ANYTHING}
BLOCK: dict[Any, Any] = {...: ANYTHING}
CONFIG_KIND: dict[Any, Any] = {
    **dict.fromkeys(("model", "system", "scenario"), NAMED),
    "data": BUILT,
    **dict.fromkeys(("adaptation", "solver", "objective"), (BUILT, None)),
    **dict.fromkeys(("excitation", "damage", "baselines"), (BLOCK, None)),
    "seed": int,
    "threads": (int, None),
    ...: ANYTHING,
}
WORDS = {str: "text", int: "a whole number", float: "a number", bool: "true or false"}


def require(value: Any, kind: Any, place: str = "") -> None:
    """Raise ValueError, with the place, where a value is not of its kind."""
    for one in kind if isinstance(kind, tuple) else (kind,):
        if fits_outside(value, one):
            break
    else:
        raise ValueError(f"{place or 'it'} is {_short(value)}, expected {_words(kind)}")
    if isinstance(one, dict):
        others = one.get(..., ANYTHING)
        for key, inner in value.items():
            if (of_key := one.get(key, others)) is not ANYTHING:
                require(inner, of_key, f"{place}.{key}".lstrip("."))
    elif isinstance(one, list):
        for inner in value:
            require(inner, one[0], f"a value of {place}")


def _kinds(kind: Any) -> list[Any]:
    return [k for one in kind for k in _kinds(one)] if isinstance(kind, tuple) else [kind]


def fits_outside(value: Any, kind: Any) -> bool:
    """Whether a value fits, whatever is inside it; true and false are no numbers."""
    if isinstance(kind, type):
        return isinstance(value, kind) and not (isinstance(value, bool) and kind in (int, float))
    if isinstance(kind, tuple):
        return any(fits_outside(value, one) for one in kind)
    return value is None if kind is None else isinstance(value, type(kind))


def _words(kind: Any) -> str:
    kinds = [one for one in _kinds(kind) if one is not int or float not in _kinds(kind)]
    return " or ".join(dict.fromkeys(map(_word, kinds)))


def _word(kind: Any) -> str:
    if isinstance(kind, dict):
        return "a mapping"
    return "a list" if isinstance(kind, list) else WORDS.get(kind, "nothing")


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 60 else f"{text[:60]}…"
