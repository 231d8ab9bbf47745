"""What TensorBoard's HParams tab shows of a run: its choices, and its numbers in all splits.

Choices and numbers have the names of the long table (report/collection/report.py).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from report.collection.scores import scores_of
from runner.config.choices import dotted, typed

GROUPS = ("scenario", "excitation", "data", "model", "solver", "objective")
FIRST = ("free_run/relative_rms_percent", "test/relative_rms_percent")
FILES = ("path", "folder")  # where things lie is no choice that changes a number


def swept(content: Mapping[str, Any]) -> dict[str, int | float | bool | str]:
    """The choices that a person sweeps; a system is identified by its name alone."""
    found: dict[str, Any] = {
        name: content[name]["name"] for name in ("model", "system", "scenario")
    }
    found |= {name: content[name] for name in ("seed", "max_fail")}
    for key, value in dotted({name: content[name] for name in GROUPS}).items():
        text, last = typed(value), key.rpartition(".")[2]
        if last not in ("name", *FILES) and not ("/" in str(text) or "\\" in str(text)):
            found[key] = text
    return found


def numbers(metrics: Mapping[str, Any]) -> dict[str, float]:
    """The numbers by name, the errors of test motion first; what diverged is in `diverged`."""
    found = {s.name: s.value for s in scores_of(metrics) if math.isfinite(s.value)}
    return {name: found[name] for name in FIRST if name in found} | found
