"""What the files of a run hold: types, sizes and needed keys of all values that programs use.

A kind is a type, None, a tuple of kinds of which one has to fit, [kind] for a list, {key: kind} for
a mapping, where `...` represents all other keys, which hold anything where it is not there; or a
Rule, which asks for more than a kind does.
Keys may be absent unless a rule needs them: older runs lack some.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import data
import models
from data.annotations import MOST


@dataclass(frozen=True)
class Rule:
    """A kind, and what else holds for its values. fault: what is wrong with one; "" for nothing."""

    kind: Any
    fault: Callable[[Any], str]


def needing(kind: Any, *keys: str) -> Rule:
    """A mapping that has these keys."""

    def fault(value: Any) -> str:
        lacking = [key for key in keys if key not in value]
        return f"lacks {', '.join(lacking)}" if lacking else ""

    return Rule(kind, fault)


def within(kind: Any, low: float, high: float) -> Rule:
    """A number from `low` to `high`; nothing, where the kind allows that."""

    def fault(value: Any) -> str:
        inside = value is None or low <= value <= high
        return "" if inside else f"is {_short(value)}, expected {low:.12g} to {high:.12g}"

    return Rule(kind, fault)


def _unlike(value: Any, *names: str) -> str:
    """Lists of a mapping, those that are there, have one length."""
    sizes = {name: len(value[name]) for name in names if name in value}
    told = ", ".join(f"{size} {name}" for name, size in sizes.items())
    return f"has {told}: expected as many of each" if len(set(sizes.values())) > 1 else ""


def _not_two(ends: Any) -> str:
    return "" if len(ends) == 2 else f"has {len(ends)} values, expected 2"


def one_of(*words: str) -> Rule:
    """One of these words."""
    told = ", ".join(words)
    return Rule(str, lambda word: "" if word in words else f"is {_short(word)}, expected {told}")


QUANTITY = one_of("acceleration", "velocity", "displacement", "force", "output")  # data/record.py
HOLD = one_of("linear", "zero_order", "band_limited")  # data/record.py
NUMBER = (int, float)
NUMBERS = [NUMBER]
PERCENT = (NUMBER, None)  # None: it overflowed
TEXTS = (str, [str], None)
COUNT = within(int, 0, 2**53)
NEEDED = ("system", "scenario", "model", "data", "excitation", "seed", "threads")  # of a config
LARGEST_SEED = int(np.iinfo(np.uint32).max)  # of PyTorch's and NumPy's generators
MOST_THREADS = 1024
SEED, THREADS = within(int, 0, LARGEST_SEED), within((int, None), 1, MOST_THREADS)
OTHER = "other input"  # a kind of the trained range, which has two ends
SPECTRUM = "spectrum"  # a kind of the trained range, which has periods
SCORES: dict[Any, Any] = {
    "no_free_run": str,
    "diverged_after_s": ([NUMBER], None),
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


def _unexplained(verdict: Any) -> str:
    return "lacks reason" if verdict.get("identified") is False and "reason" not in verdict else ""


GRADE = needing(
    {
        **dict.fromkeys(("grade", "by", "reason"), str),
        **dict.fromkeys(("error_percent", "noise_percent", "tolerance_percent"), PERCENT),
        "interval_percent": (Rule(NUMBERS, _not_two), None),
        "advice": [str],
    },
    "grade",
)
VERDICT = Rule(
    {
        "identified": (bool, None),  # None: nothing to judge
        "reason": str,
        "by": str,
        "test_diverges": str,  # test motions on which the free run diverges
        **dict.fromkeys(("as_good", "not_better", "worse", "unstable"), str),  # than plain models
        "opponents": {...: {...: PERCENT}},  # errors by motion
        "grade": GRADE,
        "blocks": {...: NUMBERS},  # squared relative errors
        **dict.fromkeys(("error_percent", "linear_percent"), PERCENT),
    },
    _unexplained,
)


def range_kind(*lists: str) -> Rule:
    """The range of a kind of signal: a name for each channel, and its ends."""
    ends = {"unit": str, "names": [str], **dict.fromkeys(lists, NUMBERS)}
    return Rule(
        needing(ends, *ends),
        lambda value: (
            _unlike(value, *lists, "names")
            or (
                ""
                if "lowest" in lists or "lowest" not in value
                else f"has lowest; only {OTHER} has"
            )
        ),
    )


def _unlike_spectrum(spectrum: Any) -> str:
    uneven = any(len(row) != len(spectrum["names"]) for row in spectrum["largest"])
    return (
        _unlike(spectrum, "periods", "largest", "power")
        or "has largest of other lengths than names" * uneven
    )


PERIODIC = {"unit": str, "names": [str], "periods": NUMBERS, "largest": [NUMBERS], "power": NUMBERS}
TRAINED_RANGE = {
    OTHER: range_kind("lowest", "largest"),
    SPECTRUM: Rule(needing(PERIODIC, *PERIODIC), _unlike_spectrum),
    ...: range_kind("largest"),
}
OUTSIDE_VALUES: dict[Any, Any] = {
    **dict.fromkeys(("kind", "name", "unit"), str),
    **dict.fromkeys(("largest", "trained"), NUMBER),
    "times": PERCENT,
    "channels": int,
}
OUTSIDE = needing(OUTSIDE_VALUES, *OUTSIDE_VALUES)
CONFORMAL = ("factor", "floor", "memory_s", "coverage_of_others", "records")


def _open_band(band: Any) -> str:
    """What a band lacks to be drawn or printed."""
    held = ("mean_half_widths",) if "covered_percent" in band else ()
    known = band.get("method") == "conformal"
    return needing(dict, *CONFORMAL, *held).fault(band) if known else ""


BAND = Rule(
    {
        **dict.fromkeys(("unavailable", "method"), str),
        **{key: [within(NUMBER, 0.0, 1e300)] for key in ("factor", "floor")},
        **{"coverage_of_others": [NUMBER], "records": int, "memory_s": within(NUMBER, 1e-12, 1e12)},
        **{"covered_percent": NUMBER, "mean_half_width": PERCENT, "mean_half_widths": [PERCENT]},
    },
    lambda band: _open_band(band) or _unlike(band, "factor", "floor", "mean_half_widths"),
)
INTERVAL = needing(
    {
        "name": Rule(str, lambda name: "" if name[:1].isalpha() else "is no name"),
        **dict.fromkeys(("status", "unit", "about"), str),
        **dict.fromkeys(("value", "truth"), NUMBER),
        **dict.fromkeys(("half", "white", "model_error", "believed"), within(PERCENT, 0.0, 1e308)),
        "combined_with": [str],
    },
    *("name", "value", "half", "status"),
)
PRIOR = {"stated": str, "contradicted": bool, "records_alone": NUMBER, "fit": NUMBER}
FINDING = {"significant": bool, "kind": str, "name": str, "gain": NUMBER}
COLOUR = {"channel": int, "times": NUMBER, "frequency_hz": NUMBER}
SIZE = within(NUMBER, -1e100, 1e100)  # squares of larger ones overflow
OF_DRIFT = ("peak", "residual", "peak_half", "residual_half")
HEIGHTS = 0.01, 100.0  # [m] of storeys: others are in another unit
DRIFT: dict[Any, Any] = {
    **{"record": str, "element": str, "height": within(NUMBER, *HEIGHTS)},
    **dict.fromkeys(OF_DRIFT, SIZE),
    ...: (SIZE, None),
}


def _unlike_rows(rows: Any) -> str:
    return "has rows of different keys" if len({frozenset(row) for row in rows}) > 1 else ""


UNCERTAINTY = Rule(
    {
        **dict.fromkeys(("bands", "one_step_bands"), BAND),
        "drifts": Rule([needing(DRIFT, "record", "element", *OF_DRIFT)], _unlike_rows),
        "parameters": [INTERVAL],
        "unavailable": str,
        "priors": [needing(PRIOR, *PRIOR)],
        "criticism": [needing(FINDING, *FINDING)],
        "residual_peaks": [needing(COLOUR, *COLOUR)],
        **dict.fromkeys(("noise", "channel_weights"), NUMBERS),
    },
    lambda value: "lacks noise" if "channel_weights" in value and "noise" not in value else "",
)
PER_RECORD = needing({"test": SCORES, "free_run": SCORES}, "test")
SEED_ROW = needing(
    {
        **{"seed": SEED, "escaped": str, "no_free_run": str},
        **dict.fromkeys(("one_step_percent", "free_run_percent"), PERCENT),
    },
    "seed",
)
RMS = (NUMBERS, None)


def _open_benchmark(found: Any) -> str:
    """What scores of a benchmark lack to be printed; other data have none."""
    band = ["band_hz"] if "in_band_rms" in found else []
    return needing(dict, "unit", "noise_rms", "published_rms", *band).fault(found) if found else ""


BENCHMARK = Rule(
    {
        "unit": str,
        "in_band_rms": {...: RMS},
        "band_hz": Rule(NUMBERS, _not_two),
        "noise_rms": RMS,
        "published_rms": ({...: NUMBER}, None),
    },
    _open_benchmark,
)
METRICS_KIND = needing(
    {
        **dict.fromkeys(("model", "system", "scenario"), str),
        "quantity": QUANTITY,
        "numbers": [within(int, 1, MOST)],
        **dict.fromkeys(SPLITS, SCORES),
        "verdict": VERDICT,
        "per_record": {...: PER_RECORD},
        "baselines": {...: {**dict.fromkeys(SPLITS, SCORES), "failed": str}},
        "uncertainty": UNCERTAINTY,
        "trained_range": TRAINED_RANGE,
        "outside_trained_range": [OUTSIDE],
        "scenario_settings": {},
        "seed": SEED,
        "identity": {"config": str, "results": int},
        "checkpoint": str,
        "fit_seconds": NUMBER,
        "parameters": COUNT,
        "simulation_error": PERCENT,
        "identification": {},
        "training": {"prior": within(PERCENT, 0.0, 1e30)},
        "benchmark": (BENCHMARK, None),
        "paper": {...: SCORES},
        "records": {...: [str]},
        "online": {
            "estimates": {...: ONLINE_WAY},
            "frozen_error_percent": {...: PERCENT},
        },
        "over_seeds": [SEED_ROW],  # of an entry of the zoo
    },
    *("model", "system", "scenario"),
)
WORD = (str, None)
FILE: dict[str, Any] = {
    **{"name": str, "samples": (COUNT, None), "seconds": PERCENT, "dt": PERCENT, "notes": [str]},
    "channels": [{...: WORD}],
    "findings": [{**dict.fromkeys(("what", "channel", "text"), str), "blocks": bool}],
}
CANDIDATE: dict[Any, Any] = {
    **dict.fromkeys(("name", "folder", "status", "reason", "way"), WORD),
    **dict.fromkeys(("held_back_percent", "test_percent", "parameters", "seconds"), PERCENT),
}
SEARCH_KIND = Rule(  # identify.json
    needing(
        {
            "record": {"files": [FILE], "repairs": [str], "left_out": [str], ...: str},
            "questions": [needing({...: str}, "text", "option")],
            "candidates": [CANDIDATE],
            "chosen": (COUNT, None),
            "verdict": GRADE,
            "command": WORD,
        },
        *("candidates", "chosen", "verdict"),
    ),
    lambda found: (
        f"has chosen={found['chosen']} of {len(found['candidates'])} candidates"
        if (found["chosen"] or 0) >= max(len(found["candidates"]), 1)
        else ""
    ),
)
FAILURE_KIND = needing(
    {"reason": str, "own": bool, "escaped": bool, "results": int, "config": str}, "reason"
)


def _unfit_sensors(sensors: Any) -> str:
    """What does not fit together of the channels that a model was built for."""
    dofs, inputs, forced = sensors["dofs"], sensors["inputs"], sensors.get("forced")
    if isinstance(forced, str) and forced != "base":
        return f"has forced={_short(forced)}, expected base, or numbers of DOFs"
    listed = forced if isinstance(forced, list) else []
    named = sensors.get("channels")  # beside which DOFs may have no sensor
    if odd := [number for number in listed if not 1 <= number <= (MOST if named else dofs)]:
        return f"has forced={odd[0]}, and its DOFs are 1 to {dofs}"
    if len(set(listed)) < len(listed) or len(listed) > inputs:
        return f"has {len(listed)} numbers in forced for {inputs} inputs: expected each once"
    return ""


SENSORS_KIND = Rule(
    needing(
        {
            "dt": within(NUMBER, 1e-9, 1e9),  # s
            "dofs": within(int, 1, MOST),
            "inputs": within(int, 0, MOST),
            "forced": ([int], str, None),
            "quantity": QUANTITY,
            "channels": [Rule(str, lambda name: "" if name else "is empty, expected a name")],
            "units": {...: str},
        },
        *("dt", "dofs", "inputs"),
    ),
    _unfit_sensors,
)
CHOICES_KIND: dict[Any, Any] = {  # of a config, dotted
    **dict.fromkeys(("model.name", "system.name", "scenario.name"), str),
    "seed": int,
    "grid": (str, None),
    "data.train_records": (int, None),
}
NAMED = needing({"name": str, "_target_": str}, "name")
BUILT = needing({"_target_": str}, "_target_")
DATA = needing(
    {
        "_target_": str,
        **dict.fromkeys(("path", "train", "test"), TEXTS),
        **dict.fromkeys(("folder", "benchmark"), (str, None)),
        "hold": (HOLD, None),
        **dict.fromkeys(("split", "duration"), within(PERCENT, 0.0, 1e12)),
        "train_records": (COUNT, None),
    },
    "_target_",
)
BLOCK: dict[Any, Any] = {}
CONFIG_KIND = needing(
    {
        **dict.fromkeys(("model", "system", "scenario"), NAMED),
        "data": DATA,
        **dict.fromkeys(("adaptation", "solver", "objective"), (BUILT, None)),
        **dict.fromkeys(("excitation", "damage", "baselines"), (BLOCK, None)),
        "seed": SEED,
        "threads": THREADS,
    },
    *NEEDED,
)
FRONTS = {"data": data.PUBLIC, "models": models.PUBLIC}
WORDS = {str: "text", int: "a whole number", float: "a number", bool: "true or false"}


def require(value: Any, kind: Any, place: str = "") -> None:
    """Raise ValueError, with the place, where a value is not of its kind."""
    for one in kind if isinstance(kind, tuple) else (kind,):
        if fits_outside(value, one):
            break
    else:
        raise ValueError(f"{place or 'it'} is {_short(value)}, expected {_words(kind)}")
    if isinstance(one, Rule):
        require(value, one.kind, place)
        if fault := one.fault(value):
            raise ValueError(f"{place or 'it'} {fault}")
    elif isinstance(one, dict):
        others = one.get(..., object)  # which is every value
        for key, inner in value.items():
            require(inner, one.get(key, others), f"{place}.{key}".lstrip("."))
    elif isinstance(one, list):
        for inner in value:
            require(inner, one[0], f"a value of {place}")


def _kinds(kind: Any) -> list[Any]:
    if isinstance(kind, Rule):
        return _kinds(kind.kind)
    return [k for one in kind for k in _kinds(one)] if isinstance(kind, tuple) else [kind]


def fits_outside(value: Any, kind: Any) -> bool:
    """Whether a value fits, whatever is inside it; true and false are no numbers."""
    if isinstance(kind, Rule):
        return fits_outside(value, kind.kind)
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


def front_name(target: str) -> str:
    """A class as the fronts name it: `models.mlp.GlobalMLP`, as older configs say, is theirs."""
    room, _, place = target.partition(".")
    name = place.rpartition(".")[2]
    return f"{room}.{name}" if name in FRONTS.get(room, {}) else target
