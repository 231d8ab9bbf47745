"""What a run's residual suggests, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rich.console import Console
from rich.text import Text

from models.uncertainty.criticism import ELEMENT, INPUT, LAW

MOST = 3  # laws of elements that are printed


def print_criticism(console: Console, uncertainty: Mapping[str, Any]) -> None:
    """A missing element, laws that are too simple, a residual that is not noise."""
    for line in sentences(uncertainty):
        console.print(Text(line, style="yellow"))


def sentences(uncertainty: Mapping[str, Any]) -> Iterator[str]:
    """What is significant, the weightiest first. Where an element is missing, that alone."""
    found = [f for f in uncertainty.get("criticism", []) if f["significant"]]
    if found and (missing := [f for f in found if f["kind"] == ELEMENT]):
        first, *others = missing
        ends = first["name"].replace("–", " and ")
        also = f"; next: {others[0]['name']}" if others else ""
        yield (
            f"the residual suggests an element between {ends}, which would explain "
            f"{_share(first)} of it{also}"
        )
        return
    for law in [f for f in found if f["kind"] == LAW][:MOST]:
        share = _share(law)
        yield f"the law of {law['name']} lacks terms that would explain {share} of the residual"
    inputs = [f for f in found if f["kind"] == INPUT]
    if inputs:
        yield (
            f"the residual still depends on the excitation {inputs[0]['name']} "
            f"({_share(inputs[0])} of it): the model lacks dynamics"
        )
    if coloured := uncertainty.get("coloured", []):
        listed = ", ".join(
            f"channel {one['channel']}: {one['times']:.3g} times its median near "
            f"{one['frequency_hz']:.3g} Hz"
            for one in coloured
        )
        yield f"the residual is not white ({listed}); the intervals account for that"


def _share(finding: Mapping[str, Any]) -> str:
    return f"{100.0 * finding['gain']:.2g} %"
