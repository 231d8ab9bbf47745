"""What became of a run, read from its folder: its choices, its numbers, or why there are none.

A run is finished where metrics.json is there; failed where it says why, and escaped where the
reason is that the structure's own motion did; unfinished otherwise: killed, or still at work. What
cannot be read is damaged. A finished run's model may still be no result: not identified
(runner/scores/verdict.py). Its numbers count as they are.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from data.arguments import reason
from runner.config.choices import dotted, read_choices, typed
from runner.folder import run_folder
from runner.folder.run_folder import CONFIG, FREE_RUN, METRICS, read_failure, read_metrics
from runner.scores.spread import ESCAPED, FAILED, NOT_IDENTIFIED, Spread

FINISHED, UNFINISHED, DAMAGED = "finished", "unfinished", "damaged"
LOST = (FAILED, ESCAPED, UNFINISHED, DAMAGED)
STATUSES = (FINISHED, *LOST)
VERDICTS = (FINISHED, NOT_IDENTIFIED, *LOST)  # what a person is told of a run
NOT_SCORED = "this older run has no free-run score; repeat it"
ERROR = "relative_rms_percent"


@dataclass(frozen=True)
class Result:
    """A run: `choices` are dotted; `metrics` is empty unless the run is finished."""

    folder: Path
    status: str  # one of STATUSES
    reason: str
    choices: Mapping[str, Any]
    metrics: Mapping[str, Any]

    @property
    def finished(self) -> bool:
        return self.status == FINISHED

    @property
    def has_ended(self) -> bool:
        """Whether there is something to tell: numbers, or why there are none."""
        return self.status in (FINISHED, FAILED, ESCAPED)

    @property
    def identified(self) -> bool | None:
        """Whether the model is a result; None where nobody judged it, as in older runs."""
        return self.metrics.get("verdict", {}).get("identified")

    @property
    def verdict(self) -> str:
        """One of VERDICTS."""
        return NOT_IDENTIFIED if self.identified is False else self.status

    @property
    def why(self) -> str:
        """Why the run has no numbers, or no model behind them; "" where it has both."""
        lost = self.identified is False
        return self.metrics["verdict"].get("reason", "") if lost else self.reason

    @property
    def model(self) -> str | None:
        return self._name("model")

    @property
    def system(self) -> str | None:
        return self._name("system")

    @property
    def scenario(self) -> str | None:
        return self._name("scenario")

    def _name(self, part: str) -> Any:
        return self.metrics.get(part, self.choices.get(f"{part}.name"))

    @property
    def seed(self) -> Any:
        return self.metrics.get("seed", self.choices.get("seed"))

    @property
    def settings(self) -> dict[str, Any]:
        """Those of the scenario, dotted, without its name."""
        if "scenario_settings" in self.metrics:
            return dotted(self.metrics["scenario_settings"])
        mine = (item for item in self.choices.items() if item[0].startswith("scenario."))
        return {key.removeprefix("scenario."): v for key, v in mine if key != "scenario.name"}

    @property
    def setting(self) -> str:
        """Name and settings of the scenario, as they would be typed."""
        settings = (f"{key}={typed(value)}" for key, value in self.settings.items())
        return " ".join((str(self.scenario), *settings))

    @property
    def results(self) -> int | None:
        """The results version; None of runs before there was one."""
        return self.metrics.get("identity", {}).get("results")

    def error(self, split: str, estimate: str = "", dof: int | None = None) -> float | None:
        """Relative RMS error in percent; infinite where it diverged, None where there is none."""
        scores = self.metrics.get(split, {})
        scores = scores.get(estimate, {}) if estimate else scores
        if dof is None:
            return _or_infinite(scores[ERROR]) if ERROR in scores else None
        per_dof = scores.get("per_dof_percent", [])
        return _or_infinite(per_dof[dof - 1]) if len(per_dof) >= dof else None

    @property
    def no_free_run(self) -> str | None:
        """Why a finished run has no free run."""
        return self._free_run.get("no_free_run")

    @property
    def free_run(self) -> float | None:
        """Error of the free run in percent against the true signals, else the measured.

        Infinite where it diverged; None where there is none.
        """
        if not self.finished or self.no_free_run:
            return None
        scores = self._free_run
        return _or_infinite(scores.get(f"{ERROR}_true", scores.get(ERROR)))

    @property
    def _free_run(self) -> Mapping[str, Any]:
        none = {"no_free_run": NOT_SCORED} if self.finished else {}
        return self.metrics.get(FREE_RUN, none)


def _or_infinite(value: float | None) -> float:
    return math.inf if value is None else value


def read_result(folder: Path) -> Result:
    """What is known of one run."""
    try:
        known, failed = (_is_there(folder / name) for name in (METRICS, run_folder.FAILED))
        failure = read_failure(folder) if failed and not known else None
        choices = _choices_of(folder, failure) if _is_there(folder / CONFIG) else {}
        if known:
            return Result(folder, FINISHED, "", choices, read_metrics(folder))
    except (ValueError, OSError) as error:
        return Result(folder, DAMAGED, f"{reason(error)}; repeat the run", {}, {})
    if failure is None:
        return Result(folder, UNFINISHED, f"it has no {METRICS} yet", choices, {})
    status = ESCAPED if failure["escaped"] else FAILED
    return Result(folder, status, failure["reason"], choices, {})


def _choices_of(folder: Path, failure: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """Choices; {} of a run that failed because they cannot be used, as its reason says."""
    try:
        return read_choices(folder / CONFIG)
    except ValueError:
        if failure is None or not failure["own"]:
            raise
        return {}


def _is_there(path: Path) -> bool:
    """Whatever it is; what is no file is damage."""
    return os.path.lexists(path)


def spread_of(runs: Sequence[Result], number: Callable[[Result], float | None]) -> Spread:
    """Spread of a number over runs of one case; unfinished and damaged ones do not count.

    Where no finished run has the number, what failed would have had none either.
    """
    values = [value for run in runs if run.finished and (value := number(run)) is not None]
    escaped, failed = (sum(run.status == lost for run in runs) for lost in (ESCAPED, FAILED))
    if values or not any(run.finished for run in runs):
        values += [math.inf] * failed
    without = sum(run.has_ended for run in runs) - len(values) - escaped
    unidentified = sum(run.identified is False for run in runs)
    return Spread(tuple(values), failed, escaped, without, unidentified)
