"""The pictures of the leaderboard: errors over seeds, against data and noise; motions and loops."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from report.free_run.questions import Answers, answers
from report.free_run.rows import SYSTEMS, Entry, Row, quantile, rank, row_of, rows_apart
from report.free_run.signals import colour_of, loops_of_model, motions
from report.free_run.tables import case, records_of
from report.paper.figures import percent_ticks
from report.run.figures import save_figure

BEST = 3  # models drawn against truth, and the linear system
AXIS = {  # label of the setting that is varied, and its unit in that of the config
    "data.train_records": ("training records", 1.0),
    "scenario.level": ("standard deviation of the noise over the signal's [%]", 100.0),
}
NAMES = {"data.train_records": "training_records", "scenario.level": "noise_level"}


def draw_leaderboard(
    entries: Sequence[Entry], questions: Sequence[Entry], folder: Path
) -> list[Path]:
    """Draw what the runs allow, as PNG and PDF; returns the files."""
    paths: list[Path] = []
    for name, figure in leaderboard_figures(entries, questions):
        paths += save_figure(figure, folder, name)
    return paths


def leaderboard_figures(
    entries: Sequence[Entry], questions: Sequence[Entry]
) -> Iterator[tuple[str, Figure]]:
    """(name, figure) of everything for which there are runs."""
    scored = [entry for entry in entries if entry.no_free_run is None]
    by_setting: dict[tuple[int | None, str], list[Entry]] = {}
    for entry in scored:
        by_setting.setdefault((entry.train_records, entry.scenario), []).append(entry)
    for (records, scenario), same in by_setting.items():
        plural = "" if records == 1 else "s"
        counted = "" if records is None else f"{records}_record{plural}_"
        name = "_".join(scenario.replace("=", "_").split())
        name = "".join(sign for sign in name if sign.isalnum() or sign in "_.")
        yield f"free_run_errors_{counted}{name}", errors_over_seeds(same)
    for system in _systems(scored):
        if compared := best_of(scored, system):
            yield f"free_run_{system}", motions(compared)
            for entry in compared:
                figure = loops_of_model(entry)
                if figure is not None:
                    yield f"loops_{entry.run.model}_{system}", figure
    asked = answers(questions, scored)
    for varied in AXIS:
        curves = {(key[0], key[2]): curve for key, curve in asked.items() if key[1] == varied}
        if any(len(curve) > 1 for curve in curves.values()):
            yield f"free_run_error_against_{NAMES[varied]}", error_curves(curves, varied)


def _systems(entries: Sequence[Entry]) -> list[str]:
    found = {entry.run.system for entry in entries}
    return [*(s for s in SYSTEMS if s in found), *sorted(found - set(SYSTEMS))]


def best_of(entries: Sequence[Entry], system: str) -> list[Entry]:
    """Finished runs of the best models of a system and of the linear one, at one seed.

    Of the setting with the most training records; the lowest seed at which all of them finished.
    """
    mine = [entry for entry in entries if entry.run.system == system]
    runs = [(row_of(same, varied), same) for varied, same in rows_apart(mine)]
    runs = sorted((pair for pair in runs if _finite(pair[0].median_percent)), key=_rank)
    models: dict[str, list[Entry]] = {}  # each in its best setting
    for row, same in runs:
        if case(row) == case(runs[0][0]):
            models.setdefault(row.model, same)
    linear = models.pop("linear", None)
    drawn = [*list(models.values())[:BEST], *([linear] if linear else [])]
    by_seed = [{e.run.seed: e for e in same if not e.failed} for same in drawn]
    shared = set.intersection(*map(set, by_seed)) if by_seed else set()
    return [found[min(shared)] for found in by_seed] if shared else []


def _rank(pair: tuple[Row, list[Entry]]) -> tuple[Any, ...]:
    return rank(pair[0])


def _finite(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def errors_over_seeds(entries: Sequence[Entry]) -> Figure:
    """Free-run error of every model over the seeds; a panel per system, the best model on top."""
    systems = _systems(entries)
    errors = _errors(entries)
    labels = _best_first(errors)
    size = (2.4 + 2.9 * len(systems), 1.2 + 0.34 * len(labels))
    figure = Figure(figsize=size, layout="constrained")
    panels = figure.subplots(1, len(systems), sharey=True, squeeze=False)[0]
    for axes, system in zip(panels, systems, strict=True):
        for place, label in enumerate(labels):
            _spread(axes, place, label.split()[0], errors.get((label, system), []))
        axes.set_title(system, fontsize="medium")
        _finish_errors(axes, labels)
    setting = f"{records_of(entries[0].train_records)}{entries[0].scenario}"
    figure.suptitle(setting, fontsize="medium")
    figure.supxlabel("free-run test error [%]  (▶: seeds diverged or failed)", fontsize="medium")
    return figure


def _errors(entries: Sequence[Entry]) -> dict[tuple[str, str], list[float]]:
    """{(model and settings that tell it apart, system): errors of all seeds}."""
    return {
        (f"{same[0].run.model} {varied}".strip(), same[0].run.system): list(map(_error, same))
        for varied, same in rows_apart(entries)
    }


def _error(entry: Entry) -> float:
    return math.inf if entry.free_run is None else entry.free_run


def _best_first(errors: dict[tuple[str, str], list[float]]) -> list[str]:
    """Models by the median over the systems of their medians over the seeds."""
    middle: dict[str, list[float]] = {}
    for (label, _), of_seeds in errors.items():
        middle.setdefault(label, []).append(quantile(of_seeds, 0.5) or 0.0)
    return sorted(middle, key=lambda label: (quantile(middle[label], 0.5), label))


def _spread(axes: Axes, place: int, model: str, errors: Sequence[float]) -> None:
    """Box of the quartiles and median of all seeds, every seed, and those that diverged."""
    finite = [error for error in errors if math.isfinite(error)]
    lost = len(errors) - len(finite)
    colour = colour_of(model)
    low, middle, high = (quantile(errors, q) for q in (0.25, 0.5, 0.75))
    if low is not None and high is not None and math.isfinite(high):
        axes.barh(place, high - low, left=low, height=0.6, color=colour, alpha=0.45)
    if middle is not None and math.isfinite(middle):
        axes.plot([middle] * 2, [place - 0.3, place + 0.3], color="black", linewidth=1.6)
    axes.plot(finite, [place] * len(finite), "o", color=colour, markersize=3.5, alpha=0.9)
    if lost:
        edge = axes.get_yaxis_transform()
        axes.plot(0.985, place, ">", markersize=6, transform=edge, color=colour)
        axes.text(0.955, place, str(lost), transform=edge, ha="right", va="center", fontsize=7)


def _finish_errors(axes: Axes, models: Sequence[str]) -> None:
    """Room on both sides, at the right for what diverged; few enough ticks."""
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    high = max(high, 1.5 * low)
    decades = np.log10(high / low)
    axes.set_xlim(low * 10.0 ** (-0.04 * decades), high * 10.0 ** (0.12 * decades))
    percent_ticks(axes)
    axes.grid(axis="x", alpha=0.3)
    axes.set_ylim(len(models) - 0.5, -0.5)
    axes.set_yticks(range(len(models)), models, fontsize="small")


def error_curves(curves: dict[tuple[str, str], Answers], varied: str) -> Figure:
    """Median and quartiles of the free-run error against a setting; a panel per system.

    A median that diverged stands at the upper edge.
    """
    found = {system for system, _ in curves}
    systems = [*(s for s in SYSTEMS if s in found), *sorted(found - set(SYSTEMS))]
    figure = Figure(figsize=(0.8 + 3.1 * len(systems), 3.9), layout="constrained")
    panels = figure.subplots(1, len(systems), sharey=True, squeeze=False)[0]
    label, unit = AXIS[varied]
    for axes, system in zip(panels, systems, strict=True):
        values: set[float] = set()
        for (of_system, model), curve in curves.items():
            if of_system == system:
                values |= {unit * float(value) for value in curve}
                _curve(axes, model, curve, unit)
        axes.set_xscale("log")
        axes.set_xticks(sorted(values), [f"{value:g}" for value in sorted(values)])
        axes.set_xticks([], minor=True)
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=[1.0, 2.0, 5.0]))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.grid(alpha=0.3, axis="y")
        axes.set_title(system, fontsize="medium")
    panels[0].set_ylabel("free-run test error [%]")
    figure.supxlabel(label, fontsize="medium")
    handles = dict(zip(*reversed(panels[0].get_legend_handles_labels()), strict=True))
    for axes in panels[1:]:
        handles |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    figure.legend(
        handles.values(), handles.keys(), loc="outside upper center", ncols=4, frameon=False
    )
    return figure


def _curve(axes: Axes, model: str, curve: Answers, unit: float) -> None:
    x = [unit * float(value) for value in curve]
    errors = [[_error(entry) for entry in same] for same in curve.values()]
    low, middle, high = (np.array([quantile(e, q) for e in errors]) for q in (0.25, 0.5, 0.75))
    finite, colour = np.isfinite(middle), colour_of(model)
    drawn = np.where(finite, middle, np.nan)
    axes.plot(x, drawn, color=colour, marker="o", markersize=4, label=model)
    low, high = (np.where(np.isfinite(high), side, np.nan) for side in (low, high))
    axes.fill_between(x, low, high, color=colour, alpha=0.18, linewidth=0.0)
    gone = [value for value, known in zip(x, finite, strict=True) if not known]
    edge = axes.get_xaxis_transform()
    axes.plot(gone, [0.975] * len(gone), "^", color=colour, transform=edge)
