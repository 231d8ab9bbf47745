"""Which topology, which law: fits of one set of records compared, with a recommendation.

BIC = −2 log L + p log N, L the likelihood of the residual under noise with the residual's own
spectrum (Whittle 1953), p the parameters that the data determine, N numbers measured. Its odds hold
if one of the candidates is the truth and noise is noise; the free run of records that no fit saw
asks for neither, and decides.      Schwarz (1978), Estimating the dimension of a model
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.experimental.callback import Callback
from omegaconf import DictConfig
from rich.console import Console
from rich.table import Table

from data.terminal import terminal
from models.training.metrics import FREE_RUNS
from report.collection.runs import read_runs
from runner.scores.spread import percent

WIDTH = 80
AS_GOOD = 1.05  # times the least error of unseen motion: the fewest parameters are taken of these
VARY = ("elements", "masses", "hinges", "tanhs", "units", "cubic")


@dataclass(frozen=True)
class Candidate:
    """A fit: what it may do, and how it does. error [%]: free run of unseen records."""

    words: str
    parameters: float
    bic: float
    error: float
    why_not: str = ""


def candidates_of(folder: Path) -> list[Candidate]:
    """The finished runs of a sweep. Raises ValueError where no two of them can be compared."""
    runs = [run for run in read_runs(folder) if run.finished]
    settings = [{k: v for k, v in run.choices.items() if k.startswith("model.")} for run in runs]
    varied = [
        key
        for key in dict.fromkeys(k for own in settings for k in own)
        if key.partition(".")[2].partition(".")[0] in VARY
        and len({str(own.get(key)) for own in settings}) > 1
    ]
    found = []
    for run, own in zip(runs, settings, strict=True):
        words = ", ".join(f"{k.partition('.')[2]}={own.get(k)}" for k in varied)
        found.append(_candidate(words, run.metrics))
    if len(found) < 2:
        raise ValueError(f"{folder} holds {len(found)} finished fits; two at least are compared")
    return found


def _candidate(words: str, metrics: Mapping[str, Any]) -> Candidate:
    sure = metrics.get("uncertainty", {})
    error = metrics[FREE_RUNS["test"]].get("relative_rms_percent")
    verdict = metrics.get("verdict", {})
    why = "" if verdict.get("identified") is not False else "not identified"
    if "log_likelihood" not in sure:
        return Candidate(words, math.nan, math.inf, error or math.inf, why or "diverged")
    p, samples = sure["determined"], sure["samples"]
    bic = -2.0 * sure["log_likelihood"] + p * math.log(samples)
    return Candidate(words, p, bic, math.inf if error is None else error, why)


def recommended(found: Sequence[Candidate]) -> Candidate | None:
    """Of those nearly as good as the best on unseen motion, the one with the fewest parameters."""
    sound = [c for c in found if not c.why_not and math.isfinite(c.error)]
    if not sound:
        return None
    least = min(c.error for c in sound)
    return min((c for c in sound if c.error <= AS_GOOD * least), key=lambda c: c.parameters)


def odds_of(found: Sequence[Candidate]) -> list[float]:
    """Probabilities of the candidates by BIC, if one of them is the truth."""
    best = min(c.bic for c in found)
    if not math.isfinite(best):
        return [0.0 for _ in found]
    weights = [math.exp(-0.5 * (c.bic - best)) for c in found]
    return [weight / sum(weights) for weight in weights]


def print_candidates(console: Console, found: Sequence[Candidate]) -> None:
    """The table, the likeliest first, and the recommendation."""
    table = Table(title="which elements, which law", title_justify="left")
    table.add_column("candidate")
    for head in ("parameters", "BIC more", "odds [%]", "unseen [%]"):
        table.add_column(head, justify="right", no_wrap=True)
    best = min(c.bic for c in found)
    pairs = sorted(zip(found, odds_of(found), strict=True), key=lambda pair: pair[0].bic)
    for one, odds in pairs:
        number = "–" if math.isnan(one.parameters) else f"{one.parameters:.0f}"
        more = f"{one.bic - best:.0f}" if math.isfinite(one.bic) else "–"
        error = one.why_not or percent(one.error)
        table.add_row(one.words, number, more, f"{100.0 * odds:.1f}", error)
    console.print(table)
    choice = recommended(found)
    if choice is None:
        console.print("none of them is a model of these records")
        return
    odds = odds_of(found)[list(found).index(choice)]
    console.print(
        f"recommended: {choice.words} (fewest parameters within {100.0 * (AS_GOOD - 1.0):.0f} % of "
        f"the least error of unseen motion; odds by BIC {100.0 * odds:.0f} %)"
    )


class PrintCandidates(Callback):
    """At the end of a sweep: its table."""

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        print_candidates(terminal(WIDTH), candidates_of(Path(config.hydra.sweep.dir)))
