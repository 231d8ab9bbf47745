"""A fault of a record, in one line with its place and its remedy."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One fault of a record, and its remedy."""

    what: str  # "dropped samples", "NaN run", "saturation", …
    channel: str  # "" for the clock
    message: str  # one line: values, places in seconds and samples, and the remedy
    blocks: bool = False  # training must not go on unless it is mended

    def __str__(self) -> str:
        return f"{self.what}{f' in {self.channel}' if self.channel else ''}: {self.message}"
