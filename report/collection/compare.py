"""Runs compared by any choice that varies: median, range and failures of each group.

`python evaluate.py runs=FOLDER by=model.cutoff metric=relative_rms_percent split=test`. Models,
systems and scenarios are never mixed; models of one case are ranked by their medians. What diverged
or failed is infinite and takes part in the median, as everywhere (runner/scores/spread.py).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.table import Table

from data.arguments import suggestion
from models.stored.schema import SPLITS
from report.about import colours, contains, unit_of
from report.collection.runs import varied_choices
from report.output import Section, printed
from report.style import DASHES, MARKERS, SERIES, one_legend, panels, plain_decades
from runner.config.choices import typed
from runner.scores.numbers import scores_of
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
    law_inside: str  # of the structure, in the model: yes, possible or no

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
        without = len(same) - len(spread.values) - spread.escaped
        inside = contains(str(same[0].model), str(same[0].system))
        groups.append(Group(of_group, spread, without, inside))
    notes = [f"{lacking} runs have no {' or '.join(by)} and are omitted"] if lacking else []
    if mixed := _mixed(labels, by, list(members.values())):
        notes.append(f"within a group there also vary {', '.join(mixed)}; see by=[…]")
    if number.startswith("free_run"):
        notes += _no_free_run(runs)
    groups.sort(key=lambda group: _place(keys, group))
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
    meant = suggestion(word, known, 3, 0.5)
    return meant or f"; choose {', '.join(known) or 'nothing: there is none'}"


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


def _no_free_run(runs: Sequence[Result]) -> list[str]:
    """A line for each reason why there is no free run, with the models that it holds for."""
    named: dict[str, set[str]] = {}
    for run in runs:
        if run.no_free_run:
            named.setdefault(run.no_free_run, set()).add(str(run.model))
    return [f"no free run of {', '.join(sorted(of))}: {why}" for why, of in named.items()]


def _place(keys: Sequence[str], group: Group) -> list[tuple[bool, float, str]]:
    """By its labels; models, where they come last, by their medians, without one at the end."""
    place, median = [_order(label) for label in group.labels], group.spread.median
    if keys[-1] == "model":
        place[-1] = (median is None, math.inf if median is None else median, place[-1][2])
    return place


def _order(label: Any) -> tuple[bool, float, str]:
    """Numbers by size, before words."""
    number = is_number(label)
    return not number, float(label) if number else 0.0, str(label)


def is_number(label: Any) -> bool:
    return isinstance(label, int | float) and not isinstance(label, bool)


def written(value: float) -> str:
    """A number of a table; Eq. 21 in percent, or anything else."""
    return percent(value) if abs(value) >= SMALL or value == 0.0 else f"{value:.1e}"


def as_section(comparison: Comparison) -> Section:
    """A line for each group: its labels, runs, statistics, and what went wrong anywhere."""
    counts = _counts(comparison)
    inside = any(group.law_inside != "no" for group in comparison.groups)
    lines = [
        [
            *map(str, group.labels),
            *(str(group.runs), group.spread.text(written)),
            *(str(_counts_of(group)[name]) for name in counts),
            *([group.law_inside] if inside else []),
        ]
        for group in comparison.groups
    ]
    more = ["law inside"] if inside else []
    head = [*comparison.keys, "runs", "median (min – max)", *counts, *more]
    return Section(head, lines, f"{comparison.number}: median (min – max)", comparison.notes)


def as_rows(comparison: Comparison) -> list[dict[str, Any]]:
    """The same in full precision, with quartiles: {column: value} of each group."""
    rows = []
    for group in comparison.groups:
        columns = group.spread.columns().items()
        numbers = {name.removesuffix("_percent"): value for name, value in columns}
        labels = dict(zip(comparison.keys, group.labels, strict=True))
        rows.append({**labels, **numbers, "law_inside": group.law_inside})
    return rows


def as_table(comparison: Comparison) -> Table:
    """What is printed."""
    return printed(as_section(comparison), range(len(comparison.keys)), fold=True)


def _counts(comparison: Comparison) -> list[str]:
    """Columns of what went wrong anywhere."""
    counts = [_counts_of(group) for group in comparison.groups]
    columns = (*LOST, NOT_IDENTIFIED, "without")
    return [name for name in columns if any(of_group[name] for of_group in counts)]


def _counts_of(group: Group) -> dict[str, int]:
    lost = {name: getattr(group.spread, name) for name in LOST}
    return {**lost, NOT_IDENTIFIED: group.spread.unidentified, "without": group.without}


# One picture of a comparison: lines over a number, or a row for every run.
#
# Over a number: median and range over the runs, a line for each model or other label. Over words:
# a row for each, every run a mark, the median a bar. A panel for each system and scenario. What
# diverged is drawn at the upper edge.

WORDS = {"relative_rms_percent": "relative RMS error [%]", "fit_seconds": "time of the fit [s]"}
DECADES = 1.0  # of values: from here on the axis is logarithmic
BEYOND = 10.0  # times the largest median: the end of the axis
DRAWN = 15  # values that a line joins; more were drawn at random, and other choices with them
TICKS = 8  # values that fit on an axis
PANELS = ("system", "scenario")


def draw_comparison(comparison: Comparison) -> Figure:
    """Raises ValueError where no run has a value."""
    if not any(group.spread.values for group in comparison.groups):
        raise ValueError(f"no run has {comparison.number}; there is nothing to draw")
    x = _numeric_key(comparison)
    titled = _panels(comparison, x)
    series = [_series(comparison, group, x) for group in comparison.groups]
    names = _coloured(dict.fromkeys(series))
    rows = 1.0 if x is not None else 0.32 * len(names)
    size = (4.3 if len(titled) == 1 else 3.2, 3.4 if x is not None else rows + 0.9)
    figure, drawn = panels(
        len(titled), *size, more=(2.4, 0.7), sharex=x is None, sharey=True, layout="constrained"
    )
    for axes, (title, groups) in zip(drawn, titled.items(), strict=True):
        axes.set_title(title, fontsize="medium")
        if x is not None:
            _draw_lines(axes, comparison, groups, x, names)
        else:
            _draw_strips(axes, comparison, groups, names)
    if x is not None and any(names):
        one_legend(figure, drawn, names, loc="outside right upper", fontsize="small")
    return figure


def _panels(comparison: Comparison, x: int | None) -> dict[str, list[Group]]:
    """{title: groups}; by system and scenario unless they are what is compared.

    Over a number, those that have several values of it, if any has.
    """
    places = [i for i, k in enumerate(comparison.keys) if k in PANELS and k not in comparison.by]
    found: dict[str, list[Group]] = {}
    for group in comparison.groups:
        found.setdefault(", ".join(str(group.labels[i]) for i in places), []).append(group)
    if x is None:
        return found
    several = {t: gs for t, gs in found.items() if len({group.labels[x] for group in gs}) > 1}
    return several or found


def _numeric_key(comparison: Comparison) -> int | None:
    """The last of the keys asked for whose labels are several numbers."""
    for place in reversed(range(len(comparison.keys))):
        labels = {group.labels[place] for group in comparison.groups}
        asked = comparison.keys[place] in comparison.by
        if asked and len(labels) > 1 and all(map(is_number, labels)):
            return place
    return None


def _series(comparison: Comparison, group: Group, x: int | None) -> str:
    """What tells a line or a row from the others of its panel."""
    parts = [
        str(label) if key == "model" else f"{key}={label}"
        for i, (key, label) in enumerate(zip(comparison.keys, group.labels, strict=True))
        if i != x and not (key in PANELS and key not in comparison.by)
    ]
    return ", ".join(parts)


def _coloured(names: Iterable[str]) -> dict[str, str]:
    """A model's colour is the same in all pictures; others take the remaining colours."""
    taken = {name: colours()[name] for name in names if name in colours()}
    left = cycle([colour for colour in SERIES if colour not in taken.values()] or SERIES)
    return {name: taken.get(name) or next(left) for name in names}


def _draw_lines(
    axes: Axes, comparison: Comparison, groups: Sequence[Group], x: int, names: dict[str, str]
) -> None:
    by_name: dict[str, list[Group]] = {}
    for group in groups:
        by_name.setdefault(_series(comparison, group, x), []).append(group)
    for name, of_name in by_name.items():
        places = [float(group.labels[x]) for group in of_name]
        middle = [_finite(group.spread.median) for group in of_name]
        low = [min(group.spread.finite, default=math.nan) for group in of_name]
        high = [max(group.spread.finite, default=math.nan) for group in of_name]
        line = list(names).index(name)
        colour, marker = names[name], MARKERS[line % len(MARKERS)]
        joined = DASHES[line % len(DASHES)] if len(places) <= DRAWN else "none"
        label = name or None
        axes.plot(places, middle, marker, ms=4, color=colour, linestyle=joined, label=label)
        if len(places) <= DRAWN:
            axes.fill_between(places, low, high, color=colour, alpha=0.25, linewidth=0.0)
        else:
            axes.vlines(places, low, high, color=colour, alpha=0.4)
        counts = [len(group.spread.values) - len(group.spread.finite) for group in of_name]
        lost = [place for place, count in zip(places, counts, strict=True) if count]
        if lost:
            edge = axes.get_xaxis_transform()
            axes.plot(lost, [1.0] * len(lost), "x", color=colour, transform=edge, clip_on=False)
    scale(axes, "y", [v for group in comparison.groups for v in group.spread.values])
    _limit(axes, comparison.groups)
    values = sorted({float(group.labels[x]) for group in comparison.groups})
    scale(axes, "x", values)
    if len(values) <= TICKS:
        axes.set_xticks(values, [f"{value:g}" for value in values])
        axes.set_xticks([], minor=True)
    unit = unit_of(comparison.keys[x])
    axes.set_xlabel(f"{comparison.keys[x]} [{unit}]" if unit else comparison.keys[x])
    if axes.get_subplotspec().is_first_col():  # type: ignore[union-attr]
        axes.set_ylabel(f"{_words(comparison.number)}\nmedian, smallest and largest")
    axes.grid(alpha=0.3)


def _draw_strips(
    axes: Axes, comparison: Comparison, groups: Sequence[Group], names: dict[str, str]
) -> None:
    lost = []
    for group in groups:
        name = _series(comparison, group, None)
        place = list(names).index(name)
        values = group.spread.finite
        spread = np.linspace(-0.2, 0.2, len(values)) if len(values) > 1 else np.zeros(len(values))
        axes.plot(values, place + spread, "o", color=names[name], markersize=3.5, alpha=0.6)
        if math.isfinite(middle := _finite(group.spread.median)):
            axes.plot([middle] * 2, [place - 0.35, place + 0.35], color="black", linewidth=1.6)
        counts = [(getattr(group.spread, what), what) for what in LOST]
        if text := ", ".join(f"{count} {what}" for count, what in counts if count):
            lost.append((place, text))
    scale(axes, "x", [v for group in comparison.groups for v in group.spread.values])
    for place, text in lost:
        axes.text(
            0.99, place, text, transform=axes.get_yaxis_transform(), ha="right", va="center",
            fontsize="x-small", bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
        )  # fmt: skip
    axes.set_yticks(range(len(names)), names, fontsize="small")
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlabel(_words(comparison.number))
    axes.grid(axis="x", alpha=0.3)


def _words(number: str) -> str:
    """What is on the axis."""
    split, _, metric = number.partition("/")
    words = WORDS.get(metric, metric)
    return words if split == "run" else f"{split.replace('_', ' ')}: {words}"


def _finite(value: Any) -> float:
    return value if value is not None and math.isfinite(value) else math.nan


def scale(axes: Axes, which: str, values: Sequence[float]) -> None:
    """Logarithmic where positive values span decades, with ticks that can be read."""
    finite = [v for v in values if math.isfinite(v)]
    if not finite or min(finite) <= 0.0 or max(finite) < 10.0**DECADES * min(finite):
        return
    axis = axes.yaxis if which == "y" else axes.xaxis
    (axes.set_yscale if which == "y" else axes.set_xscale)("log")
    decades = math.log10(max(finite) / min(finite))
    plain_decades(axis, [1.0] if decades > 2.5 else [1.0, 2.0, 5.0])


def _limit(axes: Axes, groups: Sequence[Group]) -> None:
    """Ranges that leave the picture show that they do; the medians stay readable."""
    medians = [m for g in groups if math.isfinite(m := _finite(g.spread.median))]
    if medians and axes.get_ylim()[1] > BEYOND * max(medians) > 0.0:
        axes.set_ylim(top=BEYOND * max(medians))
