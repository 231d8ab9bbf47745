"""The kept values of the golden cases, and what differs from them.

On the platform they were made on, `platform` in values.json, every bit is compared, except those of
CONTRACTED. Processors and versions of numpy, torch, scipy and numba differ in last bits: elsewhere
numbers agree to TOLERANCE of the largest of their list, and hashes are not compared.
"""

from __future__ import annotations

import json
import platform as machine
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
import scipy
import torch

from runner.config.identity import RESULTS

FILE = Path(__file__).with_name("values.json")
TOLERANCE = 1e-9
LOOSER = {  # fits that end where a step gains little: other instructions end them 1.4e-8 elsewhere
    **dict.fromkeys(("named", "named_element", "unit_element"), 1e-6)
}
# Whether a product and a sum round once, where compiled code may do so, depends on which functions
# were compiled together with their caller, which read from the cache: 1e-13 of a branch law.
CONTRACTED = ("branch", "branch_element")
HASHES = ("sha256", "text")  # last words of labels
ABSENT = "(absent)"


class Difference(NamedTuple):
    """A label, dotted by commas, and its values; ABSENT where one side has none."""

    label: str
    kept: Any
    now: Any

    @property
    def of_numbers(self) -> bool:
        """Whether a result is another: neither a case that came or went, nor another C source."""
        return ABSENT not in (self.kept, self.now) and not self.label.endswith("text")

    def __str__(self) -> str:
        return f"{self.label}: {self.now}, kept is {self.kept}"


def platform() -> dict[str, str]:
    """What last bits depend on."""
    cpus = Path("/proc/cpuinfo")
    names = re.findall(r"model name\s*: (.+)", cpus.read_text()) if cpus.is_file() else []
    return {
        "processor": names[0] if names else machine.processor() or machine.machine(),
        "vectors": torch.backends.cpu.get_cpu_capability(),
        "python": ".".join(machine.python_version_tuple()[:2]),
        **{m.__name__: m.__version__ for m in (torch, np, scipy, numba)},
    }


def read() -> dict[str, Any]:
    """{"platform": …, "results": version, "cases": {case: {label: value}}}; empty without file."""
    if not FILE.is_file():
        return {"platform": {}, "results": RESULTS, "cases": {}}
    content: dict[str, Any] = json.loads(FILE.read_text("utf-8"))
    return content


def write(cases: dict[str, Any]) -> None:
    """Keep these values as those of this platform; floats as digits that give them back exactly."""
    content = {"platform": platform(), "results": RESULTS, "cases": dict(sorted(cases.items()))}
    FILE.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", "utf-8")


def fault_of(found: list[Difference], results: int) -> str:
    """Why values of a results version do not fit to this code's, and what to do; "" where they do.

    A number that changed is a new results version, and the kept values are those of the newest.
    """
    if any(difference.of_numbers for difference in found) and results == RESULTS:
        return (
            f"numbers differ from those of results version {RESULTS}: mend the change, or, where "
            "they have to differ, raise RESULTS in runner/config/identity.py; then --make"
        )
    if results != RESULTS:
        return f"kept is results version {results}, this code's is {RESULTS}: --make"
    return "values differ, and no number does: python -m tests.golden --make" if found else ""


def differences(case: str, kept: Any, now: Any, exact: bool) -> list[Difference]:
    """All labels whose values differ, and those that one side lacks."""
    every_bit = exact and case not in CONTRACTED
    tolerance = 0.0 if every_bit else LOOSER.get(case, TOLERANCE)
    return list(_differences(case, kept, json.loads(json.dumps(now)), tolerance))


def _differences(label: str, kept: Any, now: Any, tolerance: float) -> Iterator[Difference]:
    if isinstance(kept, dict) and isinstance(now, dict):
        for key in sorted({*kept, *now}):
            if not (tolerance and key.endswith(HASHES)):
                inner = (side.get(key, ABSENT) for side in (kept, now))
                yield from _differences(f"{label}, {key}", *inner, tolerance)
    elif not _agree(kept, now, tolerance):
        yield Difference(label, kept, now)


def _agree(kept: Any, now: Any, tolerance: float) -> bool:
    """Whether two numbers, lists of numbers (None: diverged) or texts do."""
    if kept == now:
        return True
    ours, theirs = (u if isinstance(u, list) else [u] for u in (now, kept))
    if not tolerance or len(ours) != len(theirs) or any(isinstance(u, str) for u in ours + theirs):
        return False
    diverged = [[u is None for u in side] for side in (ours, theirs)]
    a, b = (np.array([u for u in side if u is not None], dtype=float) for side in (ours, theirs))
    if diverged[0] != diverged[1]:
        return False
    return bool((np.abs(a - b) <= tolerance * np.abs(b).max(initial=0.0)).all())
