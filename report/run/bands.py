"""The 95 % bands of a run: those it has, or can still be given; their coverage, in a line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from omegaconf import DictConfig
from rich.console import Console
from rich.text import Text

from data.record import QUANTITIES
from models.estimator import Estimator
from models.training.assemble import changed, data_from
from runner.scores.conformal import FREE_RUN, METHOD, ONE_STEP, conformal_bands
from runner.scores.verdict import CANNOT

ALIKE = 0.8  # of a held-back record in the band of the others, where records are alike
MOST = 6  # channels whose half widths are printed one by one
WAYS = {ONE_STEP: "one step ahead", FREE_RUN: "in free run"}


def bands_of_run(
    estimator: Estimator, run: DictConfig, metrics: Mapping[str, Any], records: int | None
) -> Mapping[str, Any]:
    """`uncertainty` of a finished run; with bands where an older version made it without.

    records: how many to hold back, of a simulated structure; None: as the run says.
    """
    stored: Mapping[str, Any] = metrics.get("uncertainty", {})
    known = stored.get(FREE_RUN) or {}
    if known.get("method") or "covered_percent" in known or (known and records is None):
        return stored
    if records is not None:
        run = changed(run, {"data": {"calibration_records": records}})
    data = data_from(run)
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
        if reason := next((band["none"] for band in bands_of.values() if "none" in band), ""):
            yield f"no 95 % bands: {reason}"
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
    apart = min(min(band["others"], default=1.0) for band in held.values())
    if apart < ALIKE:
        yield (
            f"the held-back records differ: the band of the others contains {100.0 * apart:.0f} % "
            "of one; hold more back (data.calibration_records, data.calibration)"
        )
    if "diverges" in (reason := bands.get("none", "")):
        yield f"no 95 % band of the free run: {reason}"


def _widths(widths: list[float | None]) -> str:
    """Mean half widths by channel; of many the least and the largest."""
    known = [w for w in widths if w is not None]
    if len(known) < len(widths):
        return "∞"
    if len(known) > MOST:
        return f"{min(known):.3g} to {max(known):.3g}"
    return ", ".join(f"{w:.3g}" for w in known)
