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
from models.fit.metrics import FREE_RUNS
from report.collection.runs import read_runs
from runner.scores.spread import percent

WIDTH = 80
AS_GOOD = 1.05  # times the least error of unseen motion: the fewest parameters are taken of these
OTHER, NO_CLASS = "any_other", 1.25  # class that is none of the others: its error is so much less
VARY = ("elements", "masses", "hinges", "tanhs", "units", "cubic", "rounded")


@dataclass(frozen=True)
class Candidate:
    """A fit: its settings and its quality. error [%]: free run of unseen records.

    kind: class of laws that it represents, perhaps with others; "" where it has no class.
    """

    words: str
    parameters: float
    bic: float
    error: float
    why_not: str = ""
    kind: str = ""


def candidates_of(folder: Path, classes: bool = False) -> list[Candidate]:
    """The finished runs of a sweep. classes: each grid of the sweep is a class of laws.

    Raises ValueError where no two of them can be compared.
    """
    runs = [run for run in read_runs(folder) if run.finished]
    if len(runs) < 2:
        raise ValueError(f"{folder} holds {len(runs)} finished fits; two at least are compared")
    found = []
    for run in runs:
        kind = (run.grid or "") if classes else ""
        of_kind = [r.choices for r in runs if not kind or r.grid == run.grid]
        words = [f"{key.partition('.')[2]}={run.choices.get(key)}" for key in _varied(of_kind)]
        found.append(_candidate(", ".join([*filter(None, [kind]), *words]), kind, run.metrics))
    return found


def _varied(choices: Sequence[Mapping[str, Any]]) -> list[str]:
    """What models may do that differs between some runs."""
    keys = dict.fromkeys(key for own in choices for key in own if key.startswith("model."))
    return [
        key
        for key in keys
        if key.split(".")[1] in VARY and len({str(own.get(key)) for own in choices}) > 1
    ]


def _candidate(words: str, kind: str, metrics: Mapping[str, Any]) -> Candidate:
    sure = metrics.get("uncertainty", {})
    error = metrics[FREE_RUNS["test"]].get("relative_rms_percent")
    verdict = metrics.get("verdict", {})
    why = "" if verdict.get("identified") is not False else "not identified"
    if "log_likelihood" not in sure:
        return Candidate(words, math.nan, math.inf, error or math.inf, why or "diverged", kind)
    p, samples = sure["determined"], sure["samples"]
    bic = -2.0 * sure["log_likelihood"] + p * math.log(samples)
    return Candidate(words, p, bic, math.inf if error is None else error, why, kind)


def recommended(found: Sequence[Candidate]) -> Candidate | None:
    """The candidate of fewest parameters among those almost as good as the best on unseen motion.

    A law of no class is taken only where every class errs by far more.
    """
    sound = [c for c in found if not c.why_not and math.isfinite(c.error)]
    if not sound:
        return None
    classes = [c for c in sound if c.kind != OTHER]
    least = min((c.error for c in classes), default=math.inf)
    if least <= NO_CLASS * min(c.error for c in sound):
        sound = classes
    least = min(c.error for c in sound)
    return min((c for c in sound if c.error <= AS_GOOD * least), key=lambda c: c.parameters)


def odds_of(found: Sequence[Candidate]) -> list[float]:
    """Probabilities of the candidates by BIC, if one of them is the truth."""
    best = min(c.bic for c in found)
    if not math.isfinite(best):
        return [0.0 for _ in found]
    weights = [math.exp(-0.5 * (c.bic - best)) for c in found]
    return [weight / sum(weights) for weight in weights]


def odds_of_kind(choice: Candidate, found: Sequence[Candidate]) -> float:
    """The odds of all candidates of the same class."""
    pairs = zip(found, odds_of(found), strict=True)
    return sum(odds for c, odds in pairs if c is choice or (c.kind and c.kind == choice.kind))


def print_candidates(
    console: Console, found: Sequence[Candidate], title: str = "which elements, which law"
) -> None:
    """The table, the likeliest first, and the recommendation."""
    table = Table(title=title, title_justify="left")
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
        console.print("no candidate models these records")
        return
    odds, of = odds_of_kind(choice, found), " of its class" if choice.kind else ""
    console.print(
        f"recommended: {choice.words} (fewest parameters within {100.0 * (AS_GOOD - 1.0):.0f} % of "
        f"the least error of unseen motion; odds{of} by BIC {100.0 * odds:.0f} %)"
    )
    better = min((c.error for c in found if c.kind == OTHER), default=math.inf)
    if choice.kind and choice.kind != OTHER and choice.error > AS_GOOD * better:
        less = 100.0 * (1.0 - better / choice.error)
        console.print(f"no class is exact: the error of a law outside them is {less:.0f} % smaller")


class PrintCandidates(Callback):
    """At the end of a sweep: its table. classes: each grid of the sweep is a class of laws."""

    def __init__(self, title: str = "which elements, which law", classes: bool = False) -> None:
        self.title, self.classes = title, classes

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        found = candidates_of(Path(config.hydra.sweep.dir), self.classes)
        print_candidates(terminal(WIDTH), found, self.title)
