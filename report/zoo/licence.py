"""Licences of a published model."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Licence:
    """Of weights and of the data that they were trained on, apart."""

    weights: str = "MIT"
    data: str = "none is needed: simulated"
    source: str = ""  # of the data
