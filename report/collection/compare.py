"""Runs compared by any choice that varies: median, range and failures of each group.

`python evaluate.py runs=FOLDER by=model.cutoff metric=relative_rms_percent split=test`. Models,
systems and scenarios are never mixed. What diverged or failed is infinite and takes part in the
median, as everywhere (runner/scores/spread.py).
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rich.table import Table
from rich.text import Text

from models.stored.schema import SPLITS
from report.collection.runs import varied_choices
from report.collection.scores import scores_of
from runner.config.choices import typed
from runner.scores.result import Result, spread_of
from runner.scores.spread import DIVERGED, ESCAPED, FAILED, NOT_IDENTIFIED, Spread, percent

CASE = ("system", "scenario", "model")  # kept apart, whatever is asked for
LOST = (DIVERGED, FAILED, ESCAPED)
SMALL = 0.005  # below it a number has no decimals that count


@dataclass(frozen=True)
class Group:
    """Runs with their labels in common, and the spread of what is compared."""

    labels: tuple[Any, ...]  # of the keys of the comparison
    spread: Spread
    without: int  # runs that are unfinished, damaged, or without this number: no free run, say

    @property
    def runs(self) -> int:
        return len(self.spread.values) + self.spread.escaped + self.without


@dataclass(frozen=True)
class Comparison:
    keys: tuple[str, ...]  # what the groups differ in: the parts of the case that vary, then `by`
    by: tuple[str, ...]  # as asked for
    number: str  # what is compared, as it is called in TensorBoard
    groups: list[Group]
    notes: list[str]


def compare(runs: Sequence[Result], by: Sequence[str], metric: str, split: str) -> Comparison:
    """Groups in the order of their labels. Raises ValueError for a key, metric or split that these
    runs do not have, with the nearest ones that they do.
    """
    labels = labels_of(runs)
    by = tuple(_key(key, labels, runs) for key in by)
    extra = (k for k in CASE if k not in by and len(set(labels[k]) - {None}) > 1)
    keys = (*extra, *by)
    numbers = [{score.name: score.value for score in scores_of(run.metrics)} for run in runs]
    number = _number(set().union(*numbers), metric, split)
    members: dict[tuple[Any, ...], list[int]] = {}
    lacking = 0
    for i in range(len(runs)):
        of_run = tuple(labels[key][i] for key in keys)
        if None in of_run:
            lacking += 1
        else:
            members.setdefault(of_run, []).append(i)
    of_folder = {run.folder: found.get(number) for run, found in zip(runs, numbers, strict=True)}
    groups = []
    for of_group, places in members.items():
        same = [runs[i] for i in places]
        spread = spread_of(same, lambda run: of_folder[run.folder])
        groups.append(Group(of_group, spread, len(same) - len(spread.values) - spread.escaped))
    notes = [f"{lacking} runs have no {' or '.join(by)} and are omitted"] if lacking else []
    if mixed := _mixed(labels, by, list(members.values())):
        notes.append(f"within a group there also vary {', '.join(mixed)}; see by=[…]")
    groups.sort(key=lambda group: [_order(label) for label in group.labels])
    return Comparison(keys, by, number, groups, notes)


def labels_of(runs: Sequence[Result]) -> dict[str, list[Any]]:
    """{key: label of each run} of everything by which runs may be compared."""
    names = ("model", "system", "scenario", "seed", "results")
    return {name: [getattr(run, name) for run in runs] for name in names} | varied_choices(runs)


def in_common(runs: Sequence[Result]) -> str:
    """Model, system and scenario, where all runs have the same."""
    labels = labels_of(runs)
    shared = {key: set(map(str, labels[key])) for key in ("model", "system", "scenario")}
    return ", ".join(values.pop() for values in shared.values() if len(values) == 1)


def _key(key: str, labels: dict[str, list[Any]], runs: Sequence[Result]) -> str:
    name = key.removesuffix(".name")
    if name in labels:
        return name
    same = {str(typed(run.choices[key])) for run in runs if key in run.choices}
    vary = sorted(k for k, of_key in labels.items() if len(set(map(str, of_key))) > 1)
    if same:
        why = f"is {same.pop()} in all of these runs"
        if same:
            why = "follows from the system; take by=system"
        raise ValueError(f"by={key} {why}; there vary {', '.join(vary) or 'nothing'}")
    raise ValueError(f"by={key}: no such choice varies here{_hint(key, vary)}")


def _hint(word: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(word, known, n=3, cutoff=0.5)
    if near:
        return f"; did you mean {' or '.join(near)}?"
    return f"; choose {', '.join(known) or 'nothing: there is none'}"


def _number(known: set[str], metric: str, split: str) -> str:
    """Its name in TensorBoard, of all that these runs have."""
    wanted = [name for name in (f"{split}/{metric}", f"run/{metric}") if name in known]
    if wanted:
        return wanted[0]
    splits = [name for name in SPLITS if any(k.startswith(f"{name}/") for k in known)]
    if not splits:
        raise ValueError("none of these runs is finished; there is nothing to compare")
    if split not in splits:
        raise ValueError(f"split={split}: these runs have none such{_hint(split, splits)}")
    metrics = sorted(k.partition("/")[2] for k in known if k.startswith((f"{split}/", "run/")))
    raise ValueError(f"metric={metric}: there is none such in {split}{_hint(metric, metrics)}")


def _mixed(
    labels: dict[str, list[Any]], by: Sequence[str], groups: Sequence[Sequence[int]]
) -> list[str]:
    """Choices, besides the seed, in which the runs of some group differ."""
    others = (k for k in labels if k not in (*by, *CASE, "grid") and k.split(".")[-1] != "seed")
    return [
        k
        for k in others
        if any(len({str(labels[k][i]) for i in group} - {"None"}) > 1 for group in groups)
    ]


def _order(label: Any) -> tuple[bool, float, str]:
    """Numbers by size, before words."""
    number = is_number(label)
    return not number, float(label) if number else 0.0, str(label)


def is_number(label: Any) -> bool:
    return isinstance(label, int | float) and not isinstance(label, bool)


def written(value: float) -> str:
    """A number of a table; Eq. 21 in percent, or anything else."""
    return percent(value) if abs(value) >= SMALL or value == 0.0 else f"{value:.1e}"


def as_table(comparison: Comparison) -> Table:
    """What is printed."""
    title = f"{comparison.number}: median (min – max)"
    table = Table(title=Text(title, style="table.title"), title_justify="left")
    for key in comparison.keys:
        table.add_column(Text(key), overflow="fold")
    for name in ("runs", "median (min – max)", *_counts(comparison)):
        table.add_column(name, justify="right")
    for group in comparison.groups:
        counts = _counts_of(group)
        cells = [str(group.runs), group.spread.text(written)]
        cells += [str(counts[name]) for name in _counts(comparison)]
        table.add_row(*(Text(str(label)) for label in group.labels), *cells)
    return table


def _counts(comparison: Comparison) -> list[str]:
    """Columns of what went wrong anywhere."""
    counts = [_counts_of(group) for group in comparison.groups]
    columns = (*LOST, NOT_IDENTIFIED, "without")
    return [name for name in columns if any(of_group[name] for of_group in counts)]


def _counts_of(group: Group) -> dict[str, int]:
    lost = {name: getattr(group.spread, name) for name in LOST}
    return {**lost, NOT_IDENTIFIED: group.spread.unidentified, "without": group.without}
