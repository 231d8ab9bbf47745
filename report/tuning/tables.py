"""Tables of tuned settings: for the terminal, and the rows of the page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

from rich.table import Table

from report.free_run.rows import SYSTEMS
from report.output import markdown
from report.tuning.cases import WAYS, Case
from report.tuning.onset import onsets
from runner.scores.result import Result
from runner.scores.spread import Spread, percent

PRINTED = {"bouc_wen": "Bouc–Wen"}
Rows = Iterator[Sequence[str]]  # the first is the heading


def spread(errors: Mapping[int, float]) -> str:
    """Median (smallest – largest) over the seeds."""
    return Spread(tuple(errors.values())).text()


def as_printed(cases: Sequence[Case]) -> Table:
    """The table of the terminal."""
    title = "error of the test motion on fresh seeds in %: median (min – max)"
    table = Table(title=title, title_justify="left")
    for name in ("model", "system", "as configured", "tuned", "better", "settings"):
        table.add_column(name, overflow="fold")
    for case in cases:
        settings = " ".join(f"{key}={value}" for key, value in case.settings.items())
        errors = (spread(case.errors(way)) for way in WAYS)
        table.add_row(case.model, case.system, *errors, case.better, settings)
    return table


def as_markdown(rows: Rows) -> str:
    """Rows as a table in Markdown."""
    head, *lines = rows
    return markdown(head, lines, left=None)


def error_rows(cases: Sequence[Case]) -> Rows:
    """Test errors one step ahead, and on how many seeds the tuned settings do better."""
    yield "model", "system", "paper's settings", "tuned", "tuned is better"
    for case in cases:
        yield (*_head(case), *(spread(case.errors(way)) for way in WAYS), case.better)


def setting_rows(cases: Sequence[Case]) -> Rows:
    """Validation errors of the first and the best trial, and the best trial's settings."""
    yield "model", "system", "validation, first trial", "best trial", "settings"
    for case in cases:
        errors = (percent(case.search[f"{which}_percent"]) for which in ("first", "best"))
        settings = ", ".join(
            f"{key.removeprefix('model.')} {value}" for key, value in case.settings.items()
        )
        yield (*_head(case), *errors, settings)


def onset_rows(cases: Sequence[Case]) -> Rows:
    """Test errors without the first second, beside those of a line through two values."""
    yield "model", "system", "paper's settings", "tuned", "line through two values"
    for case in cases:
        configured, tuned = (onsets(case, way) for way in WAYS)
        models = (
            spread({seed: _error(o.model) for seed, o in by_seed.items()})
            for by_seed in (configured, tuned)
        )
        line = spread({seed: _error(onset.line) for seed, onset in configured.items()})
        yield (*_head(case), *models, line)


def free_run_rows(cases: Sequence[Case]) -> Rows:
    """Free-run errors of the test motions."""
    yield "model", "system", "paper's settings", "tuned"
    for case in cases:
        yield (*_head(case), *(spread(case.free_runs(way)) for way in WAYS))


def warmup_rows(runs: Iterable[Result]) -> Rows:
    """Validation errors with the whole held-back part counted, and without its first second."""
    errors: dict[tuple[str, float], dict[int, float | None]] = {}
    for run in runs:
        of_case = errors.setdefault((str(run.system), run.choices["model.cutoff"]), {})
        of_case[run.choices["data.warmup"]] = run.error("validation")
    yield "system", "cutoff", "all counted", "first second not"
    for system, cutoff in sorted(errors, key=lambda case: (SYSTEMS.index(case[0]), case[1])):
        by_warmup = sorted(errors[system, cutoff].items())
        yield PRINTED.get(system, system), f"{cutoff:g} rad/s", *(percent(e) for _, e in by_warmup)


def _head(case: Case) -> tuple[str, str]:
    return f"`{case.model}`", PRINTED.get(case.system, case.system)


def _error(percent: float | None) -> float:
    return math.inf if percent is None else percent
