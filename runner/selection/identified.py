"""The result of a selection: which model, how good, in words; kept as identify.json.

Held-back motion chooses the model that simulates: the fewest parameters within one standard error
of the least error. The test motion grades it. Where it does not simulate the test motion, the best
estimate one step ahead is taken in its place, if its own grade allows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib import import_module
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from data.arguments import as_html
from data.terminal import WIDTH
from models.estimator import Estimator
from models.fit.blocks import fewest
from models.fit.metrics import FREE_RUNS
from models.stored.folder import read_values
from models.stored.schema import SEARCH_KIND
from runner.scores.grade import ONE_STEP, SIMULATES
from runner.scores.spread import percent
from runner.scores.verdict import CLOSE

NAME, PAGE, MODELS = "identify.json", "report.html", "models"
LINES = 12
COLUMN = 26  # of the names of models


@dataclass(frozen=True, repr=False)
class Identified:
    """What became of records: `identify.json` of a folder, and what lies beside it."""

    folder: Path
    found: Mapping[str, Any]

    @classmethod
    def read(cls, folder: str | Path) -> Identified:
        """The result in a folder. Raises ValueError where there is none, or it is damaged."""
        path = Path(folder) / NAME
        if not path.is_file():
            raise ValueError(f"{folder} holds no {NAME}; python identify.py writes it")
        return cls(Path(folder), read_values(path, SEARCH_KIND))

    @property
    def verdict(self) -> Mapping[str, Any]:
        """Grade, error in percent with its interval, reason and advice."""
        return dict(self.found["verdict"])

    @property
    def candidates(self) -> list[Mapping[str, Any]]:
        """Each model that was tried or left out, and what came of it."""
        return list(self.found["candidates"])

    @property
    def chosen(self) -> Mapping[str, Any] | None:
        """The candidate that was chosen."""
        place = self.found["chosen"]
        return None if place is None else self.candidates[place]

    @property
    def run(self) -> Any:
        """The `FinishedRun` of the chosen model. Raises ValueError where none was identified."""
        if self.chosen is None:
            raise ValueError(f"no model was identified: {self.verdict['reason']}")
        front = import_module("report.front")  # a room above this one
        return front.FinishedRun(self.folder / self.chosen["folder"])

    @property
    def model(self) -> Estimator:
        """The chosen model. Raises ValueError where none was identified."""
        return self.run.model

    def page(self) -> Path:
        """The file report.html, which any browser opens; written when it is first asked for."""
        path = self.folder / PAGE
        if not path.is_file():
            import_module("report.page.page").write_page(self.folder)  # a room above this one
        return path

    def __str__(self) -> str:
        return "\n".join(self.found["lines"])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        """The models that were tried, the verdict, a link to the page."""
        text = as_html("\n".join([*map(outcome_line, self.candidates), "", str(self)]))
        return f'{text}<a href="{escape(self.page().absolute().as_uri())}">{PAGE}</a>'


def outcome_line(outcome: Mapping[str, Any]) -> str:
    """A candidate in a line: its seconds, its error on held-back motion; or why it has none."""
    taken = "" if outcome["seconds"] is None else f"{outcome['seconds']:.0f} s"
    start = f"  {outcome['name']:<{COLUMN}} {taken:>6}  "
    if outcome["status"] != "fitted":
        return f"{start}{outcome['status']}: {outcome['reason']}"
    held = outcome["held_back_percent"]
    error = "diverges" if held is None else f"{percent(held)} %"
    how = "simulated" if outcome["way"] == "free run" else "one step ahead"
    last = "unstable" if outcome["reason"] else f"{outcome['parameters']} parameters"
    return f"{start}error {error:>9} {how}, {last}"


def outcome_of(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """What a finished run says of its candidate, for `identify.json`.

    An unstable free run has no errors by block, so that it cannot be chosen.
    """
    verdict = metrics["verdict"]
    way = verdict.get("by", "one step")
    split = FREE_RUNS["test"] if way == "free run" else "test"
    held = verdict.get("held_back") or {}
    blocks = {one: errors["blocks"] for one, errors in held.items()}
    own = blocks.pop(way, None) if verdict.get("unstable") else blocks.get(way)
    return {
        "way": way,
        "held_back_percent": own and 100.0 * math.sqrt(sum(own) / len(own)),
        "test_percent": metrics[split].get("relative_rms_percent"),
        "parameters": metrics["parameters"],
        "blocks": blocks,
        "noise_percent": (held.get("free run") or {}).get("noise_percent"),
        "grade": verdict.get("grade"),
        "reason": verdict.get("unstable", ""),
    }


def leaves_noise(outcome: Mapping[str, Any]) -> bool:
    """Whether what a free run leaves of held-back motion is noise, within a standard error.

    A motion without noise is met as well as any opponent is asked to.
    """
    blocks, noise = outcome["blocks"].get("free run"), outcome["noise_percent"]
    if not blocks or noise is None:
        return False
    chance = float(np.std(blocks, ddof=1)) / math.sqrt(len(blocks))
    missed = float(np.mean(blocks)) - (0.01 * noise) ** 2
    return missed <= max(chance, (0.01 * CLOSE) ** 2)


def choose(outcomes: Sequence[Mapping[str, Any]]) -> int | None:
    """The place of the chosen model; None where none has an error on held-back motion.

    By free runs of held-back motion, also of models that were trained one step ahead; one that did
    better on test motion stands for none. Where the chosen one is graded worse, the best estimate
    one step ahead is taken, if that is one.
    """
    simulator, other = (_best(outcomes, way) for way in ("free run", "one step"))
    if simulator is None or other is None:
        return other if simulator is None else simulator
    grades = [(outcomes[i].get("grade") or {}).get("grade") for i in (simulator, other)]
    return other if grades[0] != SIMULATES and grades[1] == ONE_STEP else simulator


def _best(outcomes: Sequence[Mapping[str, Any]], way: str) -> int | None:
    """The fewest parameters within one standard error of the least error on held-back motion."""
    known = [i for i, one in enumerate(outcomes) if one.get("blocks", {}).get(way)]
    known.sort(key=lambda i: outcomes[i]["parameters"])
    return known[fewest(np.array([outcomes[i]["blocks"][way] for i in known]))] if known else None


def lines_of(
    verdict: Mapping[str, Any], chosen: Mapping[str, Any] | None, others: str
) -> list[str]:
    """The verdict in at most twelve lines of a terminal."""
    texts = [f"{verdict['grade'].capitalize()}: {verdict['reason']}"]
    if chosen is not None:
        size = f", {chosen['parameters']} parameters" if chosen.get("parameters") else ""
        texts.append(f"Model: {chosen['name']}{size}{others}")
    texts += [f"What would help: {'; '.join(verdict['advice'])}"] if verdict.get("advice") else []
    lines = [line for text in texts for line in wrap(text, WIDTH)]
    return lines if len(lines) <= LINES - 3 else [*lines[: LINES - 4], f"{lines[LINES - 4][:77]}…"]
