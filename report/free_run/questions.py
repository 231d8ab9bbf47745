"""What a free run bears: rows of runs that differ from the leaderboard's in one setting.

The setting is found by comparing configs. The leaderboard's own runs of the model stand beside, at
the seeds that the others have.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from report.free_run.rows import SYSTEMS, Entry, Row, differing, row_of, typed
from report.free_run.tables import COLUMNS, Columns

QUESTION_COLUMNS: Columns = {
    "model": COLUMNS["model"],
    "value": lambda row: row.value,
    **{name: text for name, text in COLUMNS.items() if name not in ("model", "setting")},
}


def question_of(row: Row) -> str:
    """Title of the rows that answer one question."""
    return f"{row.system}: {row.varied or 'the seeds alone'}"


Answers = dict[Any, list[Entry]]  # runs by the value of what was varied


def answers(questions: Sequence[Entry], usual: Sequence[Entry]) -> dict[tuple[str, ...], Answers]:
    """{(system, varied, model): runs by value}, the leaderboard's runs among them."""
    found: dict[tuple[str, ...], Answers] = {}
    for model in sorted({entry.run.model for entry in questions}):
        asked = [entry for entry in questions if entry.run.model == model]
        known = [entry for entry in usual if entry.run.model == model]
        for system in {entry.run.system for entry in asked}:
            mine = [entry for entry in asked if entry.run.system == system]
            beside = [entry for entry in known if entry.run.system == system]
            for varied, by_value in _answers(mine, beside).items():
                found[system, varied, model] = by_value
    return dict(sorted(found.items(), key=lambda item: _place(item[0])))


def _place(key: tuple[str, ...]) -> tuple[Any, ...]:
    system, varied, model = key
    return varied, SYSTEMS.index(system) if system in SYSTEMS else len(SYSTEMS), system, model


def _answers(asked: list[Entry], known: list[Entry]) -> dict[str, Answers]:
    """Of one model and system: {varied: {value: runs}}."""
    if not known:  # nothing to compare with: what varies among themselves
        names = differing(asked)
        return {" ".join(names): _by_value(asked, names)}
    changes = [_changes(entry, known) for entry in asked]
    found: dict[str, Answers] = {}
    for varied, best in dict(changes).items():
        same = [e for e, change in zip(asked, changes, strict=True) if change[0] == varied]
        seeds = {entry.run.seed for entry in same}
        told = {_value(entry, varied) for entry in same}
        for entry in known:  # the usual value, and any other that need not be run again
            fits = set(differing([entry, best])) <= set(varied)
            if fits and entry.run.seed in seeds and _value(entry, varied) not in told:
                same.append(entry)
        found[" ".join(varied)] = _by_value(same, varied)
    return found


def _changes(entry: Entry, known: list[Entry]) -> tuple[tuple[str, ...], Entry]:
    """What differs from the nearest of the runs with the most training records; and that run."""
    most = max(other.train_records or 0 for other in known)
    usual = [other for other in known if (other.train_records or 0) == most]
    return min(
        ((tuple(differing([entry, other])), other) for other in usual),
        key=lambda change: len(change[0]),
    )


def _value(entry: Entry, names: Sequence[str]) -> str:
    return " ".join(typed(entry.choices.get(name)) for name in names)


def _by_value(entries: Sequence[Entry], names: Sequence[str]) -> Answers:
    """Runs by the value of a setting, numbers in their order."""
    found: Answers = {}
    for entry in entries:
        value = entry.choices.get(names[0]) if len(names) == 1 else None
        number = isinstance(value, int | float) and not isinstance(value, bool)
        found.setdefault(value if number else _value(entry, names), []).append(entry)
    numbers = all(not isinstance(value, str) for value in found)
    return dict(sorted(found.items())) if numbers else found


def question_rows(questions: Sequence[Entry], usual: Sequence[Entry]) -> list[Row]:
    """A row for each system, setting, model and value."""
    return [
        row_of(entries, varied, typed(value))
        for (_, varied, _), by_value in answers(questions, usual).items()
        for value, entries in by_value.items()
    ]
