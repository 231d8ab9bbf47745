"""The kept values of the golden cases, and what differs from them.

On the platform they were made on, `platform` in values.json, every bit is compared. Processors and
versions of numpy, torch, scipy and numba differ in last bits: elsewhere numbers agree to TOLERANCE
of the largest of their list, and hashes are not compared.
"""

from __future__ import annotations

import json
import platform as machine
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba
import numpy as np
import scipy
import torch

FILE = Path(__file__).with_name("values.json")
TOLERANCE = 1e-9
LOOSER: dict[str, float] = {}
HASHES = ("sha256", "text")  # last words of labels


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
    """{"platform": …, "cases": {case: {label: value}}}; no cases where the file is not there."""
    if not FILE.is_file():
        return {"platform": {}, "cases": {}}
    content: dict[str, Any] = json.loads(FILE.read_text("utf-8"))
    return content


def write(cases: dict[str, Any]) -> None:
    """Keep these values as those of this platform; floats as digits that give them back exactly."""
    content = {"platform": platform(), "cases": {name: cases[name] for name in sorted(cases)}}
    FILE.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", "utf-8")


def differences(case: str, kept: Any, now: Any, exact: bool) -> list[str]:
    """A line for each label whose values differ, and for each that one side lacks."""
    tolerance = 0.0 if exact else LOOSER.get(case, TOLERANCE)
    return list(_differences(case, kept, json.loads(json.dumps(now)), tolerance))


def _differences(label: str, kept: Any, now: Any, tolerance: float) -> Iterator[str]:
    if isinstance(kept, dict) and isinstance(now, dict):
        for key in sorted({*kept, *now}):
            here = f"{label}, {key}"
            if key not in now:
                yield f"{here}: is gone"
            elif key not in kept:
                yield f"{here}: is new"
            elif not (tolerance and key.endswith(HASHES)):
                yield from _differences(here, kept[key], now[key], tolerance)
    elif not _agree(kept, now, tolerance):
        yield f"{label}: {now}, kept is {kept}"


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
