"""The table of a model's physical parameters with 95 % intervals, within 80 columns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from models.fit.metrics import FREE_RUNS
from runner.scores.headline import HEADLINE, believed, headline
from runner.scores.spread import percent

LARGEST_PLAIN = 1e6  # number that is written without an exponent
MOST = 40  # rows; metrics.json has all
TIMES = 2.0  # ratio of intervals, with the model's error over noise alone, that is reported

WIDER = (
    "the residual shows that the model lacks something: ± is the scatter of the parameters between "
    "parts of the records; from noise alone it would be narrower (half in metrics.json)"
)


def print_intervals(
    console: Console, uncertainty: Mapping[str, Any], title: str = "", both: bool = False
) -> None:
    """Masses and elements with intervals, and the true values where they are known.

    both: two columns, intervals from noise alone and with a term for the model's error.
    """
    rows = sorted(headline(uncertainty), key=_place)
    if not rows:
        if "none" in uncertainty:
            console.print(f"no intervals: {uncertainty['none']}")
        return
    known = any("truth" in row for row in rows)
    table = Table(title=title or None, title_justify="left", caption_justify="left")
    table.add_column("parameter", no_wrap=True)
    halves = ("± noise", "± model error") if both else ("± 95 %",)
    for head in ("value", *halves, *(("truth",) if known else ())):
        table.add_column(head, justify="right", no_wrap=True)
    table.add_column("status", overflow="fold")
    last = ""
    for row in rows[:MOST]:
        part, _, quantity = row["name"].partition(".")
        if part != last and "–" in row["about"]:  # an element has several parameters, a mass one
            table.add_row(f"{part} {row['about']}")
        last, indent = part, "  " if "–" in row["about"] else f"{part} "
        value, *half = value_and_half(row["value"], row["half"] if both else believed(row))
        half += (
            [f"{row['model_error']:.2g}" if row["model_error"] is not None else ""] if both else []
        )
        truth = (rounded(row["truth"], believed(row)) if "truth" in row else "–",) if known else ()
        words = f"{quantity.replace('_displacement', 's at').replace('_', ' ')} {_unit(row)}"
        table.add_row(f"{indent}{words.strip()}", value, *half, *truth, _words(row))
    table.caption = _caption(rows)
    console.print(table)
    which = WIDER if uncertainty.get("lacking") and not both else which_to_believe(rows, both)
    for line in (*contradictions(uncertainty), which, unequal(uncertainty)):
        if line:
            console.print(Text(line, style="yellow"))


def _unit(row: Mapping[str, Any]) -> str:
    return f"[{row['unit']}]" if row["unit"] else ""


def value_and_half(value: float, half: float | None) -> tuple[str, str]:
    """A value, rounded by its half width, and the half width to two digits; "given" without one."""
    if half is None:
        return plain(value, 5), "given"
    return rounded(value, half), plain(half, 2)


def rounded(value: float, half: float | None) -> str:
    """To the second digit of the half width; three digits at least, six at most."""
    if not half or not math.isfinite(half):
        return plain(value, 5)
    place = 1 - math.floor(math.log10(half))
    digits = place + (math.floor(math.log10(abs(value))) + 1 if value else 1)
    return plain(value, min(max(digits, 3), 6))


def plain(value: float, digits: int) -> str:
    """A number to some significant digits, without an exponent below `LARGEST_PLAIN`."""
    if 1.0 <= abs(value) < LARGEST_PLAIN:
        return f"{value:.{max(0, digits - 1 - math.floor(math.log10(abs(value))))}f}"
    return f"{value:.{digits}g}"


def _place(row: Mapping[str, Any]) -> tuple[str, int, int]:
    """Masses first, then elements in order."""
    part, _, quantity = row["name"].partition(".")
    return ("r" if part[0] == "r" else "", int(part[1:]), HEADLINE.index(quantity))


def _words(row: Mapping[str, Any]) -> str:
    if row["status"] == "only in a combination":
        return f"with {row['combined_with'][0] if row['combined_with'] else 'others'}"
    return str(row["status"]).replace("determined", "")


def _caption(rows: Sequence[Mapping[str, Any]]) -> str | None:
    lines = []
    if any(row["status"] == "only in a combination" for row in rows[:MOST]):
        lines.append("with …: determined only in combination with that parameter")
    if len(rows) > MOST:
        lines.append(f"{MOST} of {len(rows)}; metrics.json has all")
    return "\n".join(lines) or None


def contradictions(uncertainty: Mapping[str, Any]) -> list[str]:
    """A line for every stated prior that the records contradict."""
    lines = []
    for prior in uncertainty.get("priors", []):
        if prior["contradicted"]:
            lines.append(
                f"{prior['stated']}: contradicted by the records, which alone give about "
                f"{prior['records_alone']:.3g}; the fit has {prior['fit']:.3g}. Correct the prior "
                "or the model; intervals span both"
            )
    return lines


def unequal(uncertainty: Mapping[str, Any]) -> str:
    """A line where channels are weighted by their noise; "" where all weigh the same."""
    counts = uncertainty.get("counts")
    if not counts:
        return ""
    listed = ", ".join(plain(value, 2) for value in counts)
    noise = ", ".join(plain(value, 2) for value in uncertainty["noise"])
    return (
        f"channels are weighted by their noise ({noise}): errors times {listed}; "
        "objective.channels=equal weights all the same"
    )


def beyond_training(metrics: Mapping[str, Any], uncertainty: Mapping[str, Any]) -> str:
    """A line where a residual that is not noise is far larger on motion that was not trained on."""
    errors = [metrics.get(FREE_RUNS[p], {}).get("relative_rms_percent") for p in ("train", "test")]
    if None in errors or not uncertainty.get("coloured") or errors[1] < TIMES * errors[0]:
        return ""
    return (
        f"neither interval holds for other motions: the free-run error is {percent(errors[1])} % "
        f"on the test motion, {percent(errors[0])} % in training, and the residual is not white; "
        "the parameters fit the training motion"
    )


def which_to_believe(rows: Sequence[Mapping[str, Any]], both: bool = False) -> str:
    """A line where the residual is more than noise; "" where intervals of noise are enough.

    both: the table shows intervals of both kinds.
    """
    ratios = sorted(
        row["model_error"] / row["half"]
        for row in rows
        if row["status"] == "determined" and row["half"] and row["model_error"]
    )
    if not ratios or (middle := ratios[len(ratios) // 2]) < TIMES:
        return ""
    if both:
        return (
            f"use ± model error, {middle:.2g} times as wide in the median: parts of the records "
            "give parameters that differ more than noise explains, so the structure is not of the "
            "model's kind, and ± noise is only the precision of its best fit"
        )
    return (
        f"parts of the records give parameters that differ more than noise explains: use "
        f"intervals {middle:.2g} times as wide (model_error in metrics.json)"
    )
