"""Runs → the leaderboard of free runs, printed and as CSV, Markdown and LaTeX. No training.

python -m report.free_run                            of the runs in runs/free_run
python -m report.free_run FOLDER … --output FOLDER   of some folders

How well does each model simulate on its own? A row is a system, the number of training records, the
scenario and a model; its errors are of the test motions of all seeds, in percent, against the true
signals where they are known. How lost runs count: runner/scores/spread.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from data.terminal import terminal
from report.about import contains
from report.collection.runs import folders_and_output, read_runs, results_folder
from report.output import Section, as_csv, latex, printed, sections_markdown, write_texts
from runner.config.choices import typed, varying
from runner.config.command_line import command_errors
from runner.scores.result import NOT_SCORED, Result, spread_of
from runner.scores.spread import Spread, percent, quantile

LEADERBOARD = Path("runs/free_run")
SYSTEMS = ("bilinear", "polynomial", "bouc_wen")  # first, in this order; others after them
INERT = {"seed", "figures", "threads", "trainer", "baselines", "name", "grid"}


def case_of(run: Result) -> tuple[Any, ...]:
    """What a row of the leaderboard is about."""
    return run.system, run.train_records, run.setting, run.model


def settings_of(run: Result) -> dict[str, Any]:
    """All choices that may change a number, except the seeds."""
    return {k: value for k, value in run.choices.items() if INERT.isdisjoint(k.split("."))}


@dataclass(frozen=True)
class Row:
    """One line of the CSV. Where there is no free run, `no_free_run` says why."""

    system: str
    train_records: int | None
    scenario: str
    model: str
    varied: str  # settings in which this row differs from the other rows of its model
    errors: Spread  # of the free runs, in percent
    displacement: Spread
    one_step_percent: float | None  # median
    fit_seconds: float | None  # median
    parameters: int | None
    no_free_run: str = ""

    def columns(self) -> dict[str, Any]:
        case = ("system", "train_records", "scenario", "model", "varied")
        return {
            **{name: getattr(self, name) for name in case},
            **self.errors.columns(),
            "displacement_median_percent": self.displacement.median,
            "one_step_median_percent": self.one_step_percent,
            "fit_seconds_median": self.fit_seconds,
            "parameters": self.parameters,
            "no_free_run": self.no_free_run,
        }


def row_of(runs: Sequence[Result], varied: str = "") -> Row:
    """Runs of one case, in a row."""
    reasons = [run.no_free_run for run in runs if run.no_free_run]
    done = [run.metrics for run in runs if run.finished]
    system, train_records, scenario, model = case_of(runs[0])
    return Row(
        system, train_records, scenario, model, varied,
        errors=spread_of(runs, lambda run: run.free_run),
        displacement=spread_of(runs, lambda run: run.displacement),
        one_step_percent=spread_of(runs, lambda run: run.one_step).median,
        fit_seconds=quantile([m["fit_seconds"] for m in done if "fit_seconds" in m], 0.5),
        parameters=max((m["parameters"] for m in done if "parameters" in m), default=None),
        no_free_run=reasons[0] if reasons else "",
    )  # fmt: skip


def leaderboard(runs: Sequence[Result]) -> list[Row]:
    """Rows of the best free run first, within each system and setting.

    Raises ValueError where no run has the free-run score.
    """
    if all(run.no_free_run == NOT_SCORED for run in runs if run.finished):
        raise ValueError("none of these runs has a free-run score; repeat them")
    return sorted((row_of(same, varied) for varied, same in rows_apart(runs)), key=rank)


def rows_apart(runs: Sequence[Result]) -> Iterator[tuple[str, list[Result]]]:
    """Runs of one row, all seeds; where runs of one case differ in other settings, each of these.

    Raises ValueError where a seed is there twice.
    """
    for _, group in groupby(sorted(runs, key=_sort_case), key=_sort_case):
        same = list(group)
        names = sorted(varying([settings_of(run) for run in same]))
        settings: dict[str, list[Result]] = {}
        for run in same:
            text = " ".join(f"{name}={typed(run.choices.get(name))}" for name in names)
            settings.setdefault(text, []).append(run)
        for text, of_setting in settings.items():
            _refuse_twice(of_setting)
            yield text, of_setting


def _sort_case(run: Result) -> tuple[str, ...]:
    return tuple(map(str, case_of(run)))


def _refuse_twice(runs: Sequence[Result]) -> None:
    by_seed: dict[int, Result] = {}
    for run in runs:
        other = by_seed.setdefault(run.seed, run)
        if other is not run:
            raise ValueError(
                f"{other.folder} and {run.folder} are the same run made twice; remove one of them"
            )


def rank(row: Row) -> tuple[Any, ...]:
    """Systems in the paper's order, most records first, then the best median first."""
    place = SYSTEMS.index(row.system) if row.system in SYSTEMS else len(SYSTEMS)
    error = row.errors.median
    lost = sum(map(math.isinf, row.errors.values)) / max(1, len(row.errors.values))
    return (
        (place, row.system, -(row.train_records or 0), row.scenario),
        (error is None, math.inf if error is None else error, lost, row.model, row.varied),
    )


# Rows of free runs as texts: columns, titles, and why some models have no free run.

CAPTION = (
    "errors of the test motions in %, against the true signals where they are known; free run: "
    "from the excitation and the initial state alone. A run that diverged or failed is the worst"
)


def case(row: Row) -> str:
    """Title of the rows of a system and setting."""
    return f"{row.system}, {records_of(row.train_records)}{row.scenario}"


def records_of(count: int | None) -> str:
    return "" if count is None else f"{count} training record{'' if count == 1 else 's'}, "


COLUMNS: dict[str, Callable[[Row], str]] = {  # heading: the text of a row below it
    "model": lambda row: row.model,
    "setting": lambda row: row.varied,
    "runs": lambda row: str(row.errors.runs),
    "failed": lambda row: str(row.errors.failed),
    "diverged": lambda row: str(row.errors.diverged),
    "escaped": lambda row: str(row.errors.escaped or ""),
    "free run": lambda row: row.errors.words(row.errors.median),
    "quartiles": lambda row: row.errors.between(row.errors.quartiles),
    "min – max": lambda row: row.errors.between(row.errors.range),
    "displacement": lambda row: row.displacement.words(row.displacement.median),
    "one step": lambda row: row.errors.words(row.one_step_percent),
    "fit [s]": lambda row: percent(row.fit_seconds),
    "parameters": lambda row: "" if row.parameters is None else str(row.parameters),
    "law inside": lambda row: contains(row.model, row.system),
}


def sections(rows: Sequence[Row]) -> list[Section]:
    """Rows that follow each other under a title; columns that are empty everywhere are omitted."""
    filled = {name: text for name, text in COLUMNS.items() if any(text(row) for row in rows)}
    result = []
    for name, group in groupby(rows, key=case):
        same = list(group)
        lines = [[text(row) for text in filled.values()] for row in same]
        result.append(Section(list(filled), lines, name, reasons(same)))
    return result


def reasons(rows: Sequence[Row]) -> list[str]:
    """A line for each reason why there is no free run, with the models that it holds for."""
    named: dict[str, list[str]] = {}
    for row in rows:
        if row.no_free_run:
            named.setdefault(row.no_free_run, []).append(row.model)
    return [f"no free run of {', '.join(models)}: {why}" for why, models in named.items()]


def write_rows(rows: Sequence[Row], parts: list[Section], folder: Path) -> list[Path]:
    """leaderboard.csv, .md and .tex in a folder."""
    texts = {
        "csv": as_csv([row.columns() for row in rows]),
        "md": sections_markdown(parts, CAPTION),
        "tex": latex(parts, CAPTION),
    }
    return write_texts(folder, "leaderboard", texts)


def main(words: Sequence[str] | None = None) -> None:
    """Bad input ends in one line and exit status 1."""
    with command_errors():
        report_free_run(*folders_and_output(__doc__, LEADERBOARD, words))


def report_free_run(folders: Sequence[Path], output: Path | None = None) -> None:
    """Write and print the leaderboard of the runs in some folders."""
    # PyTorch takes seconds to load: a mistyped folder is refused before
    from report.collection.report import tell_ended

    output = output or results_folder(folders)
    runs = read_runs(folders)
    rows = leaderboard(runs)
    parts = sections(rows)
    paths = write_rows(rows, parts, output)
    console = terminal(165)
    console.print(*map(printed, parts))
    console.print(CAPTION)
    for note in dict.fromkeys(note for part in parts for note in part.notes):
        console.print(note, soft_wrap=True, markup=False)
    console.print(f"{len(paths)} files in {output}", soft_wrap=True)
    tell_ended(console, runs)


if __name__ == "__main__":
    main()
