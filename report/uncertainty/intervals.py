"""How sure a run is, as printed: intervals of parameters, bands, what the residual suggests."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from data.record import QUANTITIES
from data.terminal import LISTED, ROWS
from models.estimator import Estimator
from models.experiment import Experiment
from models.fit.metrics import FREE_RUNS
from models.uncertainty.criticism import ELEMENT, INPUT, LAW
from runner.scores.conformal import FREE_RUN, METHOD, ONE_STEP, conformal_bands
from runner.scores.headline import HEADLINE, believed, headline
from runner.scores.spread import percent
from runner.scores.verdict import CANNOT

LARGEST_PLAIN = 1e6  # number that is written without an exponent
TIMES = 2.0  # ratio of intervals, with the model's error over noise alone, that is reported

WIDER = (
    "the residual shows that the model lacks something: ± is the scatter of the parameters between "
    "parts of the records; from noise alone it would be narrower (half in metrics.json)"
)


def print_intervals(console: Console, uncertainty: Mapping[str, Any], both: bool = False) -> None:
    """Masses and elements with intervals, and the true values where they are known.

    both: two columns, intervals from noise alone and with a term for the model's error.
    """
    rows = sorted(headline(uncertainty), key=_place)
    if not rows:
        if "unavailable" in uncertainty:
            console.print(f"no intervals: {uncertainty['unavailable']}")
        return
    known = any("truth" in row for row in rows)
    table = Table(caption_justify="left")
    table.add_column("parameter", no_wrap=True)
    halves = ("± noise", "± model error") if both else ("± 95 %",)
    for head in ("value", *halves, *(("truth",) if known else ())):
        table.add_column(head, justify="right", no_wrap=True)
    table.add_column("status", overflow="fold")
    last = ""
    for row in rows[:ROWS]:
        part, _, quantity = row["name"].partition(".")
        if part != last and "–" in row["about"]:  # an element has several parameters, a mass one
            table.add_row(f"{part} {row['about']}")
        last, indent = part, "  " if "–" in row["about"] else f"{part} "
        value, *half = value_and_half(row["value"], row["half"] if both else believed(row))
        if both:
            half.append(f"{row['model_error']:.2g}" if row["model_error"] is not None else "")
        truth = (rounded(row["truth"], believed(row)) if "truth" in row else "–",) if known else ()
        words = f"{quantity.replace('_displacement', 's at').replace('_', ' ')} {_unit(row)}"
        table.add_row(f"{indent}{words.strip()}", value, *half, *truth, _words(row))
    table.caption = _caption(rows)
    console.print(table)
    wider = uncertainty.get("model_lacks_terms") and not both
    which = WIDER if wider else which_to_believe(rows, both)
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
    if any(row["status"] == "only in a combination" for row in rows[:ROWS]):
        lines.append("with …: determined only in combination with that parameter")
    if len(rows) > ROWS:
        lines.append(f"{ROWS} of {len(rows)}; metrics.json has all")
    return "\n".join(lines) or None


def contradictions(uncertainty: Mapping[str, Any]) -> Iterator[str]:
    """A line for every stated prior that the records contradict."""
    for prior in uncertainty.get("priors", []):
        if prior["contradicted"]:
            yield (
                f"{prior['stated']}: contradicted by the records, which alone give about "
                f"{prior['records_alone']:.3g}; the fit has {prior['fit']:.3g}. Correct the prior "
                "or the model; intervals span both"
            )


def unequal(uncertainty: Mapping[str, Any]) -> str:
    """A line where channels are weighted by their noise; "" where all weigh the same."""
    counts = uncertainty.get("channel_weights")
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
    if None in errors or not uncertainty.get("residual_peaks") or errors[1] < TIMES * errors[0]:
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


# The 95 % bands of a run: those it has, or can still be given; their coverage, in a line.

ALIKE = 0.8  # of a held-back record in the band of the others, where records are alike
WAYS = {ONE_STEP: "one step ahead", FREE_RUN: "in free run"}


def bands_of_run(
    estimator: Estimator, run: Experiment, metrics: Mapping[str, Any], records: int | None
) -> Mapping[str, Any]:
    """`uncertainty` of a finished run; with bands where an older version made it without.

    records: how many to hold back, of a simulated structure; None: as the run says.
    """
    stored: Mapping[str, Any] = metrics.get("uncertainty", {})
    known = stored.get(FREE_RUN) or {}
    if known.get("method") or "covered_percent" in known or (known and records is None):
        return stored
    if records is not None:
        run = replace(run, data=run.data.with_values({"calibration_records": records}))
    data = run.make_data()
    from runner.scores.uncertainty import minimum_of  # loads every model that has intervals

    try:
        data.setup()
        prior = metrics.get("training", {}).get("prior")
        if minimum_of(estimator, data, prior) is not None:  # intervals, and bands by them
            return stored
    except (*CANNOT, OSError):  # its records are gone, say
        return stored
    return {**stored, **conformal_bands(estimator, data, [])}


def print_bands(
    console: Console, metrics: Mapping[str, Any], uncertainty: Mapping[str, Any] | None = None
) -> None:
    """Print the coverage and width of a run's bands; or why there are none.

    uncertainty: in place of that in `metrics`.
    """
    symbol = QUANTITIES[metrics.get("quantity", "acceleration")]
    unit = (metrics.get("benchmark") or {}).get("unit", symbol[1])
    own = metrics["uncertainty"] if uncertainty is None else uncertainty
    for line in band_lines(own, unit):
        console.print(Text(line))


def over_seeds(
    uncertainty: Mapping[str, Any], results: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    """`uncertainty` with the coverage of its bands on all scored test motions, by seed."""
    content = dict(uncertainty)
    for key in WAYS:
        shares = [
            r["uncertainty"][key] for r in results.values() if key in r.get("uncertainty", {})
        ]
        if shares:
            mean = sum(s["covered_percent"] for s in shares) / len(shares)
            content[key] = {**uncertainty[key], **shares[0], "covered_percent": mean}
    return content


def band_lines(uncertainty: Mapping[str, Any], unit: str) -> Iterator[str]:
    """unit: of the output."""
    bands = uncertainty.get(FREE_RUN) or {}
    if "covered_percent" in bands and bands.get("method") != METHOD:
        share = f"{bands['covered_percent']:.1f} %"
        yield f"95 % bands of the free run contain {share} of the test samples"
        return
    bands_of = {way: uncertainty.get(key) or {} for key, way in WAYS.items()}
    held = {way: band for way, band in bands_of.items() if "covered_percent" in band}
    if not held:
        reasons = [band["unavailable"] for band in bands_of.values() if "unavailable" in band]
        if reasons and reasons[0]:
            yield f"no 95 % bands: {reasons[0]}"
        return
    if len(held) == 2 and len({str(band) for band in held.values()}) == 1:
        held.pop(WAYS[ONE_STEP])  # the estimate is the free run
    parts, whose = [], " of the test samples"
    for way, band in held.items():
        wide = f"± {_widths(band['mean_half_widths'])} {unit}"
        parts.append(f"{band['covered_percent']:.1f} %{whose} {way} ({wide})")
        whose = ""
    count = next(iter(held.values()))["records"]
    yield f"95 % bands from {count} held-back records contain {', '.join(parts)}"
    apart = min(min(band["coverage_of_others"], default=1.0) for band in held.values())
    if apart < ALIKE:
        yield (
            f"the held-back records differ: the band of the others contains {100.0 * apart:.0f} % "
            "of one; hold more back (data.calibration_records, data.calibration)"
        )
    if "diverges" in (reason := bands.get("unavailable", "")):
        yield f"no 95 % band of the free run: {reason}"


def _widths(widths: list[float | None]) -> str:
    """Mean half widths by channel; of many the least and the largest."""
    known = [w for w in widths if w is not None]
    if len(known) < len(widths):
        return "∞"
    if len(known) > LISTED:
        return f"{min(known):.3g} to {max(known):.3g}"
    return ", ".join(f"{w:.3g}" for w in known)


# What a run's residual suggests, in sentences.

MOST_LAWS = 3  # laws of elements that are printed


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
    for law in [f for f in found if f["kind"] == LAW][:MOST_LAWS]:
        share = _share(law)
        yield f"the law of {law['name']} lacks terms that would explain {share} of the residual"
    inputs = [f for f in found if f["kind"] == INPUT]
    if inputs:
        yield (
            f"the residual still depends on the excitation {inputs[0]['name']} "
            f"({_share(inputs[0])} of it): the model lacks dynamics"
        )
    if coloured := uncertainty.get("residual_peaks", []):
        listed = ", ".join(
            f"channel {one['channel']}: {one['times']:.3g} times its median near "
            f"{one['frequency_hz']:.3g} Hz"
            for one in coloured
        )
        yield f"the residual is not white ({listed}); the intervals account for that"


def _share(finding: Mapping[str, Any]) -> str:
    return f"{100.0 * finding['gain']:.2g} %"
