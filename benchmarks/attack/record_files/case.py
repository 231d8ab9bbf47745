"""What a generated file of a record is, and what a good reader finds in it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

Columns = dict[str, np.ndarray]


@dataclass(frozen=True)
class Case:
    """A file to write: what it is, and what a good reader finds in it (None where it is spoilt)."""

    what: str
    suffix: str
    write: Callable[[Path], object]
    mapped: dict[str, str] = field(default_factory=dict)  # {channel: column}, {}: by their names
    truth: Columns | None = None


def escaped(text: str) -> str:
    """Text that one resolution by OmegaConf gives back."""
    return re.sub(r"(\\*)\$\{", r"\1\1\\${", text)


def holding(raw: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(raw)
