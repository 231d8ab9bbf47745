"""What a free run bears: runs that ask for less data, more noise or a wrong topology.

Each of these is a grid of experiment=free_run_questions, whose name its runs keep. The
leaderboard's own runs of the model stand beside, at the seeds that the others have.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from report.free_run.rows import RECORDS, SYSTEMS, Row, row_of, settings_of
from report.free_run.tables import COLUMNS, Columns
from runner.config.choices import typed
from runner.scores.result import Result

EXPERIMENT = "free_run_questions"
ASK = f"python train.py -m experiment={EXPERIMENT}"
QUESTIONS = {  # grid: the setting that it varies
    "less_data": RECORDS,
    "more_noise": "scenario.level",
    "topology": "model.elements",
}
QUESTION_COLUMNS: Columns = {
    "model": COLUMNS["model"],
    "value": lambda row: row.value,
    **{name: text for name, text in COLUMNS.items() if name not in ("model", "setting")},
}
Answers = dict[Any, list[Result]]  # runs by the value of what was varied


def question_of(row: Row) -> str:
    """Title of the rows that answer one question."""
    return f"{row.system}: {row.varied}"


def answers(questions: Sequence[Result], usual: Sequence[Result]) -> dict[tuple[str, ...], Answers]:
    """{(system, varied, model): runs by value}, the leaderboard's runs among them."""
    groups: dict[tuple[str, ...], list[Result]] = {}
    for run in questions:
        if run.grid in QUESTIONS:
            key = (str(run.system), QUESTIONS[run.grid], str(run.model))
            groups.setdefault(key, []).append(run)
    found = {key: _by_value(_beside(runs, key, usual), key[1]) for key, runs in groups.items()}
    return dict(sorted(found.items(), key=lambda item: _place(item[0])))


def _place(key: tuple[str, ...]) -> tuple[Any, ...]:
    system, varied, model = key
    return varied, SYSTEMS.index(system) if system in SYSTEMS else len(SYSTEMS), system, model


def _beside(asked: list[Result], key: tuple[str, ...], usual: Sequence[Result]) -> list[Result]:
    """These runs, and the usual ones that differ from one of them in what was varied alone."""
    system, varied, model = key
    rests = [_rest(run, varied) for run in asked]
    taken = {(run.seed, typed(run.choices.get(varied))) for run in asked}
    seeds = {run.seed for run in asked}
    return asked + [
        run
        for run in usual
        if (run.system, run.model) == (system, model)
        and run.seed in seeds
        and (run.seed, typed(run.choices.get(varied))) not in taken
        and _rest(run, varied) in rests
    ]


def _rest(run: Result, varied: str) -> dict[str, Any]:
    return {name: value for name, value in settings_of(run).items() if name != varied}


def _by_value(runs: Sequence[Result], varied: str) -> Answers:
    """Runs by the value of a setting, numbers in their order."""
    found: Answers = {}
    for run in runs:
        found.setdefault(typed(run.choices.get(varied)), []).append(run)
    numbers = all(isinstance(value, int | float) for value in found)
    return dict(sorted(found.items())) if numbers else found


def question_rows(questions: Sequence[Result], usual: Sequence[Result]) -> list[Row]:
    """A row for each system, setting, model and value."""
    return [
        row_of(runs, varied, str(value))
        for (_, varied, _), by_value in answers(questions, usual).items()
        for value, runs in by_value.items()
    ]
