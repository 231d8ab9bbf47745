"""The pictures of the leaderboard: errors over seeds, against data and noise; motions and loops."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from report.about import colour_of
from report.free_run.questions import Answers, answers
from report.free_run.rows import RECORDS, SYSTEMS, Row, rank, row_of, rows_apart
from report.free_run.signals import loops_of_model, motions
from report.free_run.tables import case, records_of
from report.output import save_figure
from report.style import (
    DASHES,
    MARKERS,
    mark_lost,
    one_legend,
    percent_ticks,
    plain_decades,
    titled,
)
from runner.scores.result import Result, spread_of
from runner.scores.spread import Spread, quantile

BEST = 3  # models drawn against truth, and the linear system
AXIS = {  # label of the setting that is varied, and its unit in that of the config
    RECORDS: ("training records", 1.0),
    "scenario.level": ("noise over the signal, standard deviations [%]", 100.0),
}
NAMES = {RECORDS: "training_records", "scenario.level": "noise_level"}


def draw_leaderboard(
    runs: Sequence[Result], questions: Sequence[Result], folder: Path
) -> list[Path]:
    """Draw what the runs allow, as PNG and PDF; returns the files."""
    paths: list[Path] = []
    for name, figure in leaderboard_figures(runs, questions):
        paths += save_figure(figure, folder, name)
    return paths


def leaderboard_figures(
    runs: Sequence[Result], questions: Sequence[Result]
) -> Iterator[tuple[str, Figure]]:
    """(name, figure) of everything for which there are runs."""
    scored = [run for run in runs if run.no_free_run is None]
    by_setting: dict[tuple[int | None, str], list[Result]] = {}
    for run in scored:
        by_setting.setdefault((run.train_records, run.setting), []).append(run)
    for (records, scenario), same in by_setting.items():
        plural = "" if records == 1 else "s"
        counted = "" if records is None else f"{records}_record{plural}_"
        name = "_".join(scenario.replace("=", "_").split())
        name = "".join(sign for sign in name if sign.isalnum() or sign in "_.")
        yield f"free_run_errors_{counted}{name}", errors_over_seeds(same)
    for system in _systems(scored):
        if compared := best_of(scored, system):
            yield f"free_run_{system}", motions(compared)
            for run in compared:
                figure = loops_of_model(run)
                if figure is not None:
                    yield f"loops_{run.model}_{system}", figure
    asked = answers(questions, scored)
    for varied in AXIS:
        curves = {(key[0], key[2]): curve for key, curve in asked.items() if key[1] == varied}
        if any(len(curve) > 1 for curve in curves.values()):
            yield f"free_run_error_against_{NAMES[varied]}", error_curves(curves, varied)


def _systems(runs: Sequence[Result]) -> list[str]:
    found = {str(run.system) for run in runs}
    return [*(s for s in SYSTEMS if s in found), *sorted(found - set(SYSTEMS))]


def best_of(runs: Sequence[Result], system: str) -> list[Result]:
    """Finished runs of the best models of a system and of the linear one, at one seed.

    Of the setting with the most training records; the lowest seed at which all of them finished.
    """
    mine = [run for run in runs if run.system == system]
    pairs = [(row_of(same, varied), same) for varied, same in rows_apart(mine)]
    pairs = sorted((pair for pair in pairs if _finite(pair[0].errors.median)), key=_rank)
    models: dict[str, list[Result]] = {}  # each in its best setting
    for row, same in pairs:
        if case(row) == case(pairs[0][0]):
            models.setdefault(row.model, same)
    linear = models.pop("linear", None)
    drawn = [*list(models.values())[:BEST], *([linear] if linear else [])]
    by_seed = [{run.seed: run for run in same if run.finished} for same in drawn]
    shared = set.intersection(*map(set, by_seed)) if by_seed else set()
    return [found[min(shared)] for found in by_seed] if shared else []


def _rank(pair: tuple[Row, list[Result]]) -> tuple[Any, ...]:
    return rank(pair[0])


def _finite(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def errors_over_seeds(runs: Sequence[Result]) -> Figure:
    """Free-run error of every model over the seeds; a panel per system, the best model on top."""
    systems = _systems(runs)
    errors = _errors(runs)
    labels = _best_first(errors)
    size = (2.4 + 2.9 * len(systems), 1.2 + 0.34 * len(labels))
    figure = Figure(figsize=size, layout="constrained")
    panels = figure.subplots(1, len(systems), sharey=True, squeeze=False)[0]
    for axes, system in zip(panels, systems, strict=True):
        for place, label in enumerate(labels):
            _spread(axes, place, label.split()[0], errors.get((label, system), Spread()))
        axes.set_title(system, fontsize="medium")
        _finish_errors(axes, labels)
    titled(figure, f"Free runs: {records_of(runs[0].train_records)}{runs[0].setting}")
    figure.supxlabel("free-run test error [%]  (▶: seeds diverged or failed)", fontsize="medium")
    return figure


def _errors(runs: Sequence[Result]) -> dict[tuple[str, str], Spread]:
    """{(model and settings that tell it apart, system): errors of all seeds}."""
    return {
        (f"{same[0].model} {varied}".strip(), str(same[0].system)): _of_free_runs(same)
        for varied, same in rows_apart(runs)
    }


def _of_free_runs(runs: Sequence[Result]) -> Spread:
    return spread_of(runs, lambda run: run.free_run)


def _best_first(errors: dict[tuple[str, str], Spread]) -> list[str]:
    """Models by the median over the systems of their medians over the seeds."""
    middle: dict[str, list[float]] = {}
    for (label, _), of_seeds in errors.items():
        middle.setdefault(label, []).append(of_seeds.median or 0.0)
    return sorted(middle, key=lambda label: (quantile(middle[label], 0.5), label))


def _spread(axes: Axes, place: int, model: str, errors: Spread) -> None:
    """Box of the quartiles and median of all seeds, every seed, and those that were lost."""
    colour = colour_of(model)
    low, high = errors.quartiles
    if low is not None and high is not None and math.isfinite(high):
        axes.barh(place, high - low, left=low, height=0.6, color=colour, alpha=0.45)
    if errors.median is not None and math.isfinite(errors.median):
        axes.plot([errors.median] * 2, [place - 0.3, place + 0.3], color="black", linewidth=1.6)
    finite = errors.finite
    axes.plot(finite, [place] * len(finite), "o", color=colour, markersize=3.5, alpha=0.9)
    mark_lost(axes, place, len(errors.values) - len(finite), colour)


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
    models = list(dict.fromkeys(model for _, model in curves))
    for axes, system in zip(panels, systems, strict=True):
        values: set[float] = set()
        for (of_system, model), curve in curves.items():
            if of_system == system:
                values |= {unit * float(value) for value in curve}
                _curve(axes, models.index(model), model, curve, unit)
        axes.set_xscale("log")
        axes.set_xticks(sorted(values), [f"{value:g}" for value in sorted(values)])
        axes.set_xticks([], minor=True)
        axes.set_yscale("log")
        plain_decades(axes.yaxis, [1.0, 2.0, 5.0])
        axes.grid(alpha=0.3, axis="y")
        axes.set_title(system, fontsize="medium")
        axes.set_xlabel(label, fontsize="small")
    panels[0].set_ylabel("free-run test error [%]")
    one_legend(figure, panels, loc="outside lower center", ncols=4)
    titled(
        figure, f"Free runs against {label.partition(' [')[0]}: median and quartiles of the seeds"
    )
    return figure


def _curve(axes: Axes, place: int, model: str, curve: Answers, unit: float) -> None:
    x = [unit * float(value) for value in curve]
    errors = [_of_free_runs(same).values for same in curve.values()]
    low, middle, high = (
        np.array([quantile(e, q) for e in errors], dtype=float) for q in (0.25, 0.5, 0.75)
    )
    finite, colour = np.isfinite(middle), colour_of(model)
    drawn = np.where(finite, middle, np.nan)
    style = {"linestyle": DASHES[place % len(DASHES)], "marker": MARKERS[place % len(MARKERS)]}
    axes.plot(x, drawn, color=colour, markersize=4, label=model, **style)
    low, high = (np.where(np.isfinite(high), side, np.nan) for side in (low, high))
    axes.fill_between(x, low, high, color=colour, alpha=0.18, linewidth=0.0)
    gone = [value for value, known in zip(x, finite, strict=True) if not known]
    edge = axes.get_xaxis_transform()
    axes.plot(gone, [0.975] * len(gone), "^", color=colour, transform=edge)
