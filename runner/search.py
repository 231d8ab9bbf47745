"""A search for settings: Optuna proposes them, and runs over some seeds give the validation error.

A trial is judged by the median over its seeds; a run that failed or diverged counts as infinite.
Every search lies in search.sqlite3 of the sweep's folder. A trial follows from its number and from
the trials before it alone, so a search that was killed ends like an undisturbed one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import optuna
from hydra.core.override_parser.types import IntervalSweep, Override, RangeSweep
from omegaconf import DictConfig, OmegaConf
from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
    distribution_to_json,
)
from optuna.trial import TrialState
from rich.table import Table
from rich.text import Text

from data.plain_data import read_json
from data.terminal import Terminal, terminal
from runner.config.choices import typed
from runner.config.identity import RESULTS, digest
from runner.folder.run_folder import METRICS, read_metrics, write_json
from runner.scores.outcome import validation_error
from runner.scores.spread import percent

STORAGE, FILE = "search.sqlite3", "search.json"
AT_RANDOM = 8  # trials of random settings, before the sampler uses the errors
Space = Mapping[str, BaseDistribution]
optuna.logging.set_verbosity(optuna.logging.WARNING)


def distribution(override: Override) -> BaseDistribution:
    """The distribution that Hydra's words describe: interval(a,b), range(a,b), choice(a,b).

    range(a,b) is without b; tag(log,…) draws the logarithm evenly. Raises ValueError for other
    words, which cannot be searched.
    """
    sweep: Any = override.value()
    if isinstance(sweep, IntervalSweep):
        low, high = (float(str(end)) for end in (sweep.start, sweep.end))
        return FloatDistribution(low, high, log="log" in sweep.tags)
    if isinstance(sweep, RangeSweep) and isinstance(sweep.start, int) and sweep.step == 1:
        return IntDistribution(sweep.start, int(str(sweep.stop)) - 1, log="log" in sweep.tags)
    if override.is_discrete_sweep():
        return CategoricalDistribution(list(override.sweep_string_iterator()))
    raise ValueError(
        f"{override.input_line}: what is tuned is an interval(a,b), a range(a,b) or a choice(a,b)"
    )


def start_of(cfg: DictConfig, space: Space) -> dict[str, Any]:
    """The settings of the first trial: the config's own, moved into the intervals."""
    start = {}
    for key, of_key in space.items():
        value = OmegaConf.select(cfg, key, throw_on_missing=True)
        if isinstance(of_key, CategoricalDistribution):
            word = str(typed(OmegaConf.to_object(value) if OmegaConf.is_config(value) else value))
            if word in of_key.choices:
                start[key] = word
        elif isinstance(of_key, FloatDistribution | IntDistribution):
            start[key] = min(max(value, of_key.low), of_key.high)
    return start


class Search:
    """A search of one case: `case` are the words of its runs, `seeds` the seed=… of each run."""

    def __init__(
        self,
        case: Sequence[str],
        seeds: Sequence[str],
        space: Space,
        start: Mapping[str, Any],
        folder: Path,
        trials: int,
        sampler_seed: int,
    ) -> None:
        self.case, self.seeds, self.space = list(case), list(seeds), dict(space)
        self.trials, self.sampler_seed = trials, sampler_seed
        self.name = " ".join(word for word in case if not word.startswith("experiment="))
        content = {key: distribution_to_json(of_key) for key, of_key in space.items()}
        text = json.dumps([content, self.case, self.seeds, sampler_seed, RESULTS])
        self.study = optuna.create_study(
            storage=f"sqlite:///{folder / STORAGE}",
            study_name=f"{self.name} {digest(text)}",
            load_if_exists=True,
        )
        if not self.study.trials:
            self.study.enqueue_trial(dict(start))

    @property
    def remaining(self) -> int:
        """How many trials remain to be done."""
        return self.trials - len(self.study.get_trials(False, (TrialState.COMPLETE,)))

    def ask(self) -> Trial:
        """The next trial; one that was interrupted comes first."""
        for trial in self.study.get_trials(False, (TrialState.RUNNING,)):
            if trial.params.keys() == self.space.keys():
                return Trial(self, trial.number, trial.params)
            self.study.tell(trial.number, state=TrialState.FAIL)
        done = len(self.study.get_trials(False, (TrialState.COMPLETE,)))
        self.study.sampler = optuna.samplers.TPESampler(
            seed=self.sampler_seed + done, n_startup_trials=AT_RANDOM
        )
        asked = self.study.ask(self.space)
        return Trial(self, asked.number, asked.params)

    @property
    def best_words(self) -> list[str]:
        """The best settings, as they would be typed. Raises ValueError where all trials failed."""
        best = self.study.best_trial
        if not math.isfinite(best.values[0]):
            raise ValueError(f"{self.name}: every setting failed; see its runs")
        return words(best.params)

    def content(self) -> dict[str, Any]:
        """The content of search.json: settings and errors in percent, None where infinite."""
        done = self.study.get_trials(False, (TrialState.COMPLETE,))
        values = [{"settings": t.params, "percent": _finite(t.values[0])} for t in done]
        best = self.study.best_trial
        return {
            "case": self.case,
            "seeds": self.seeds,
            "first_percent": values[0]["percent"],
            "best_percent": _finite(best.values[0]),
            "best": best.params,
            "best_trial": best.number,
            "trials": values,
        }


@dataclass(frozen=True)
class Trial:
    """Settings that the runs over the seeds are to judge."""

    search: Search
    number: int
    settings: Mapping[str, Any]

    @property
    def jobs(self) -> list[list[str]]:
        """The words of each run of the trial."""
        return [[*self.search.case, *words(self.settings), seed] for seed in self.search.seeds]

    def tell(self, folders: Sequence[Path]) -> None:
        """Take the median error of the runs in these folders for the trial's, and print it."""
        value = median(map(error_in, folders))
        self.search.study.tell(self.number, value)
        done = self.search.trials - self.search.remaining
        text = "failed" if math.isinf(value) else f"{percent(value)} %"
        best = self.search.study.best_value
        lowest = "–" if math.isinf(best) else f"{percent(best)} %"
        line = f"[{done}/{self.search.trials}] {self.search.name}: {text}, best {lowest}"
        settings = " ".join(f"{k}={_short(v)}" for k, v in self.settings.items())
        Terminal().print(f"{line}; {settings}", highlight=False, markup=False, soft_wrap=True)


def error_in(folder: Path) -> float:
    """Validation error of a run in percent; infinite where it has none."""
    return validation_error(read_metrics(folder)) if (folder / METRICS).is_file() else math.inf


def words(settings: Mapping[str, Any]) -> list[str]:
    """Settings as they would be typed."""
    return [f"{key}={value}" for key, value in settings.items()]


def _short(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def write_searches(
    folder: Path, searches: Sequence[Search], chosen: Mapping[str, Mapping[str, list[str]]]
) -> None:
    """Write search.json: each search, and its runs on fresh seeds, as configured and as tuned."""
    new = {search.name: {**search.content(), "final": chosen[search.name]} for search in searches}
    content = read_json(folder / FILE) if (folder / FILE).is_file() else {}
    write_json(folder / FILE, {**content, **new})


def print_searches(searches: Sequence[Search]) -> None:
    """Print the first and the best error of each search, and its best settings."""
    title = "validation error in %, median over the seeds of a trial"
    table = Table(title=title, title_justify="left")
    for name in ("searched", "trials", "first", "best", "settings"):
        table.add_column(name, overflow="fold")
    for search in searches:
        content = search.content()
        errors = (percent(content[name]) for name in ("first_percent", "best_percent"))
        settings = " ".join(f"{key}={_short(value)}" for key, value in content["best"].items())
        table.add_row(Text(search.name), str(search.trials), *errors, Text(settings))
    terminal(160).print(table)
