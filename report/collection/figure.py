"""One picture of a comparison: lines over a number, or a row for every run.

Over a number: median and range over the runs, a line for each model or other label. Over words:
a row for each, every run a mark, the median a bar. A panel for each system and scenario. What
diverged is drawn at the upper edge.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from report.about import colours, unit_of
from report.collection.compare import LOST, Comparison, Group, is_number
from report.style import DASHES, MARKERS, SERIES, plain_decades

WORDS = {"relative_rms_percent": "relative RMS error [%]", "fit_seconds": "time of the fit [s]"}
DECADES = 1.0  # of values: from here on the axis is logarithmic
BEYOND = 10.0  # times the largest median: the end of the axis
DRAWN = 15  # values that a line joins; more were drawn at random, and other choices with them
TICKS = 8  # values that fit beside each other
PANELS = ("system", "scenario")


def draw_comparison(comparison: Comparison) -> Figure:
    """Raises ValueError where no run has a value."""
    if not any(group.spread.values for group in comparison.groups):
        raise ValueError(f"no run has {comparison.number}; there is nothing to draw")
    x = _numeric_key(comparison)
    panels = _panels(comparison, x)
    series = [_series(comparison, group, x) for group in comparison.groups]
    names = _coloured(dict.fromkeys(series))
    rows = 1.0 if x is not None else 0.32 * len(names)
    columns = min(3, len(panels))
    lines = -(-len(panels) // columns)
    height = lines * (3.4 if x is not None else rows + 0.9) + 0.7
    wide = 4.3 if columns == 1 else 3.2
    figure = Figure(figsize=(columns * wide + 2.4, height), layout="constrained")
    grid = figure.subplots(lines, columns, sharex=x is None, sharey=True, squeeze=False)
    drawn = grid.flatten().tolist()
    for axes in drawn[len(panels) :]:
        axes.remove()
    for axes, (title, groups) in zip(drawn, panels.items(), strict=False):
        axes.set_title(title, fontsize="medium")
        if x is not None:
            _draw_lines(axes, comparison, groups, x, names)
        else:
            _draw_strips(axes, comparison, groups, names)
    if x is not None and any(names):
        _legend(figure, drawn[: len(panels)], names)
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
    told = [
        str(label) if key == "model" else f"{key}={label}"
        for i, (key, label) in enumerate(zip(comparison.keys, group.labels, strict=True))
        if i != x and not (key in PANELS and key not in comparison.by)
    ]
    return ", ".join(told)


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
        style: dict[str, Any] = {
            "marker": marker,
            "markersize": 4,
            "color": colour,
            "linestyle": joined,
        }
        axes.plot(places, middle, label=name or None, **style)
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
    told = WORDS.get(metric, metric)
    return told if split == "run" else f"{split.replace('_', ' ')}: {told}"


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


def _legend(figure: Figure, panels: Sequence[Axes], names: dict[str, str]) -> None:
    handles: dict[Any, Any] = {}
    for axes in panels:
        handles |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    ordered = {name: handles[name] for name in names if name in handles}
    figure.legend(
        ordered.values(), ordered.keys(), loc="outside right upper", frameon=False, fontsize="small"
    )
