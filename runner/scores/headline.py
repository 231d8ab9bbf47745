"""Which parameters of a finished run tables tell, and how wide their intervals are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

HEADLINE = (  # quantities of masses and elements that tables tell
    "mass",
    "stiffness",
    "damping",
    "yield_displacement",
    "activation_displacement",
    "post_yield_ratio",
    "hardening_ratio",
    "gap",
)


def headline(uncertainty: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Parameters of masses and elements as a whole, without their hinges' and units'.

    Without what an element does after it yields, where nothing in training showed that it does.
    """
    listed = uncertainty.get("parameters", [])
    if not listed:
        return []
    from models.uncertainty.intervals import UNEXCITED  # loads every model that has parameters

    told = (p for p in listed if p["status"] != UNEXCITED)
    yields = {part_of(p) for p in told if p["name"].endswith(".yield_displacement")
              and ".unit" not in p["name"]}  # fmt: skip
    return [
        p
        for p in listed
        if p["name"].partition(".")[2] in HEADLINE
        and (not p["name"].endswith("post_yield_ratio") or part_of(p) in yields)
    ]


def believed(interval: Mapping[str, Any]) -> float | None:
    """The half width that tables show; of runs by older code that of noise alone."""
    return interval.get("believed", interval["half"])


def part_of(parameter: Mapping[str, Any]) -> str:
    """The mass or element that a parameter is of."""
    return str(parameter["name"]).partition(".")[0]


def interval_in(interval: Mapping[str, Any] | None) -> dict[str, Any]:
    """What files tell of a parameter's interval; {} where there is none."""
    if interval is None:
        return {}
    return {"half_width_95": believed(interval), "status": interval["status"]}
