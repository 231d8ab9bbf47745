"""Runs compared by any choice that varies: median, range and failures of each group.

`python evaluate.py runs=FOLDER by=model.cutoff metric=relative_rms_percent split=test`. Models,
systems and scenarios are never mixed. What diverged is infinite and takes part in the median; a run
that failed has no number and is counted.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from rich.table import Table
from rich.text import Text

from report.collection.long_table import chosen
from report.collection.runs import FINISHED, Collected, typed
from report.collection.scores import SPLITS, scores_of
from report.free_run.rows import quantile
from report.paper.tables import percent

CASE = ("system", "scenario", "model")  # kept apart, whatever is asked for


@dataclass
class Group:
    """Runs with their labels in common; values in the order of the runs, infinite: diverged."""

    labels: tuple[Any, ...]  # of the keys of the comparison
    values: list[float] = field(default_factory=list)
    failed: int = 0  # failed, unfinished or damaged
    without: int = 0  # finished, but without this number: no free run, say

    @property
    def diverged(self) -> int:
        return sum(map(math.isinf, self.values))


@dataclass(frozen=True)
class Comparison:
    keys: tuple[str, ...]  # what the groups differ in: the parts of the case that vary, then `by`
    by: tuple[str, ...]  # as asked for
    number: str  # what is compared, as it is called in TensorBoard
    groups: list[Group]
    notes: list[str]


def compare(runs: Sequence[Collected], by: Sequence[str], metric: str, split: str) -> Comparison:
    """Groups in the order of their labels. Raises ValueError for a key, metric or split that these
    runs do not have, with the nearest ones that they do.
    """
    labels = labels_of(runs)
    by = tuple(_key(key, labels, runs) for key in by)
    extra = (k for k in CASE if k not in by and len(set(labels[k]) - {None}) > 1)
    keys = (*extra, *by)
    numbers = [{score.name: score.value for score in scores_of(run.metrics)} for run in runs]
    number = _number(set().union(*numbers), metric, split)
    groups: dict[tuple[Any, ...], Group] = {}
    members: dict[tuple[Any, ...], list[int]] = {}
    lacking = 0
    for i, run in enumerate(runs):
        of_run = tuple(labels[key][i] for key in keys)
        if None in of_run:
            lacking += 1
            continue
        group = groups.setdefault(of_run, Group(of_run))
        members.setdefault(of_run, []).append(i)
        if run.status != FINISHED:
            group.failed += 1
        elif number in numbers[i]:
            group.values.append(numbers[i][number])
        else:
            group.without += 1
    notes = [f"{lacking} runs have no {' or '.join(by)} and are left out"] if lacking else []
    if mixed := _mixed(labels, by, list(members.values())):
        notes.append(f"within a group there also vary {', '.join(mixed)}; see by=[…]")
    found = sorted(groups.values(), key=lambda group: [_order(label) for label in group.labels])
    return Comparison(keys, by, number, found, notes)


def labels_of(runs: Sequence[Collected]) -> dict[str, list[Any]]:
    """{key: label of each run} of all that runs may be told apart by."""
    cases = [run.case for run in runs]
    names = ("model", "system", "scenario", "seed")
    of_case = {name: [case[i] for case in cases] for i, name in enumerate(names)}
    of_case["code"] = [run.metrics.get("identity", {}).get("code") for run in runs]
    return of_case | chosen(runs)


def _key(key: str, labels: dict[str, list[Any]], runs: Sequence[Collected]) -> str:
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
    raise ValueError(f"by={key}: no such choice varies here{_nearest(key, vary)}")


def _nearest(word: str, known: Sequence[str]) -> str:
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
        raise ValueError(f"split={split}: these runs have none such{_nearest(split, splits)}")
    metrics = sorted(k.partition("/")[2] for k in known if k.startswith((f"{split}/", "run/")))
    raise ValueError(f"metric={metric}: there is none such in {split}{_nearest(metric, metrics)}")


def _mixed(
    labels: dict[str, list[Any]], by: Sequence[str], groups: Sequence[Sequence[int]]
) -> list[str]:
    """Choices, besides the seed, in which the runs of some group differ."""
    others = (k for k in labels if k not in (*by, *CASE) and k.split(".")[-1] != "seed")
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


def shown(value: float) -> str:
    """A number of a table; Eq. 21 in percent, or anything else."""
    if math.isinf(value):
        return "diverged"
    return percent(value) if 0.005 <= abs(value) < 1e5 or value == 0.0 else f"{value:.1e}"


def as_table(comparison: Comparison) -> Table:
    """What is printed."""
    title = f"{comparison.number}: median (min – max)"
    table = Table(title=Text(title, style="table.title"), title_justify="left")
    for key in comparison.keys:
        table.add_column(Text(key), overflow="fold")
    for name in ("runs", "median (min – max)", *_counts(comparison)):
        table.add_column(name, justify="right")
    for group in comparison.groups:
        cells = [str(len(group.values) + group.failed + group.without), _range(group)]
        cells += [str(getattr(group, name)) for name in _counts(comparison)]
        table.add_row(*(Text(str(label)) for label in group.labels), *cells)
    return table


def _counts(comparison: Comparison) -> list[str]:
    """Columns of what went wrong anywhere."""
    return [
        name
        for name in ("diverged", "failed", "without")
        if any(getattr(group, name) for group in comparison.groups)
    ]


def _range(group: Group) -> str:
    middle = quantile(group.values, 0.5)
    if middle is None:
        return "–"
    low, high = shown(min(group.values)), shown(max(group.values))
    return shown(middle) if low == high == shown(middle) else f"{shown(middle)} ({low} – {high})"
