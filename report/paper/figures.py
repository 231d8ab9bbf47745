"""The pictures of a study: the paper's Figs. 5–11, and errors over seeds, noise and cutoffs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from omegaconf import DictConfig, OmegaConf

from report.about import colour_of
from report.output import save_figure
from report.paper.cells import METHODS, OWN_RESIDUAL, SETTINGS, as_configured, error_of, of
from report.paper.signals import (
    LABELS,
    SIX,
    accelerations,
    of_one_seed,
    phase_planes,
    sample_loops,
    without_second_basis,
)
from report.style import MARKERS, mark_lost, one_legend, percent_ticks, plain_decades, titled
from runner.config.compose import CONF
from runner.scores.paper_values import paper_values
from runner.scores.result import Result, spread_of
from runner.scores.spread import Spread, quantile

SYSTEMS = ("bilinear", "polynomial", "bouc_wen")  # Figs. 6–8 and 9–11 in this order
SWEPT = "polynomial"  # the system whose noise level and cutoff are varied
UNIT = {"level": 100.0, "cutoff": 1.0}
AXIS = {
    "level": "standard deviation of the noise over the signal's [%]",
    "cutoff": "cutoff of the high-pass filters [Hz]",
}


def draw_study(runs: Sequence[Result], folder: Path) -> list[Path]:
    """Draw what the runs allow, as PNG and PDF; returns the files."""
    paths: list[Path] = []
    for name, figure in study_figures(runs):
        paths += save_figure(figure, folder, name)
    return paths


def study_figures(runs: Sequence[Result]) -> Iterator[tuple[str, Figure]]:
    """(name, figure) of everything for which there are runs."""
    usual = as_configured(runs)
    yield "fig05_element_loops", sample_loops()
    for number, system in enumerate(SYSTEMS, start=6):
        mine = [run for run in usual if run.system == system and run.finished]
        if mine:
            lowest = min(mine, key=lambda run: run.seed)
            figure = phase_planes(lowest, identical_scales=system == "bilinear")
            yield f"fig{number:02}_phase_plane_{system}", figure
    for number, system in enumerate(SYSTEMS, start=9):
        if compared := of_one_seed(usual, system, "full_state"):
            yield f"fig{number:02}_acceleration_{system}", accelerations(compared)
    if any(_spread_of(usual, m, *setting).finite for m in METHODS for setting in SETTINGS.values()):
        yield "test_error_over_seeds", errors_over_seeds(usual)
    for scenario, setting, name in (
        ("noisy", "level", "error_against_noise_level"),
        ("integrated", "cutoff", "error_against_cutoff"),
    ):
        curves = {m: errors_against(runs, m, scenario, setting) for m in METHODS}
        most = max(len(curve) for curve in curves.values())
        swept = {method: curve for method, curve in curves.items() if len(curve) == most}
        if most > 1:
            yield name, error_curves(swept, scenario, setting)


def _errors(runs: Sequence[Result], method: str, system: str, scenario: str) -> dict[int, float]:
    """{seed: test error in percent} of the runs that finished."""
    found = {r.seed: error_of(r, method, "test") for r in of(runs, method, system, scenario)}
    return {seed: error for seed, error in found.items() if error is not None}


def _spread_of(runs: Sequence[Result], method: str, system: str, scenario: str) -> Spread:
    """Of the test errors."""
    same = of(runs, method, system, scenario)
    return spread_of(same, lambda run: error_of(run, method, "test"))


def errors_over_seeds(runs: Sequence[Result]) -> Figure:
    """Test error of every method over the seeds, with the paper's value; a panel per table."""
    drawn = [s for s in SETTINGS.values() if any(_spread_of(runs, m, *s).finite for m in METHODS)]
    columns = min(3, len(drawn))
    rows = -(-len(drawn) // columns)
    figure = Figure(figsize=(1.8 + 2.6 * columns, 0.6 + 3.3 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False).flatten().tolist()
    for axes in panels[len(drawn) :]:
        axes.remove()
    for axes, (system, scenario) in zip(panels, drawn, strict=False):
        for place, method in enumerate(METHODS):
            _spread(axes, place, method, _spread_of(runs, method, system, scenario))
            if printed := _printed(method, system, scenario):
                axes.plot(printed, place, "kD", fillstyle="none", label="the paper's value")
        axes.set_title(f"{system}, {scenario}", fontsize="medium")
        axes.set_xscale("log")
        axes.set_xlabel("test error [%]")
    _finish_methods(figure, panels[: len(drawn)])
    return figure


def _printed(method: str, system: str, scenario: str) -> float | None:
    """The paper's test error; it does not say which residual its network was given."""
    model = method.removesuffix(f"_{OWN_RESIDUAL}")
    return paper_values(model, system, scenario).get("test", {}).get("relative_rms_percent")


def _spread(axes: Axes, place: int, method: str, errors: Spread) -> None:
    """Box from quartile to quartile, whiskers from smallest to largest, and every seed.

    Of the finite errors; the number of lost seeds is at the right edge.
    """
    mark_lost(axes, place, len(errors.values) - len(errors.finite), colour_of(method))
    if not errors.finite:
        return
    box = axes.boxplot(
        errors.finite, orientation="horizontal", positions=[place], widths=0.6, whis=(0, 100),
        patch_artist=True, manage_ticks=False,
    )  # fmt: skip
    box["boxes"][0].set(facecolor=colour_of(method), alpha=0.6)
    box["medians"][0].set(color="black", linewidth=1.6)
    places = np.full(len(errors.finite), place)
    axes.plot(errors.finite, places, "|", color="#555555", markersize=4, label="one seed")


def _finish_methods(figure: Figure, panels: Sequence[Axes]) -> None:
    """Methods down the shared axis, a line between the paper's and the rest; one legend."""
    for axes in panels:
        axes.axhline(len(SIX) - 0.5, color="#888888", linewidth=0.8)
        axes.grid(axis="x", alpha=0.3)
        axes.set_ylim(len(METHODS) - 0.5, -0.5)
        axes.set_yticks(range(len(METHODS)), METHODS, fontsize="small")
        percent_ticks(axes)
    one_legend(figure, panels, loc="outside upper right", ncols=2)


def errors_against(
    runs: Sequence[Result], method: str, scenario: str, setting: str
) -> dict[float, list[float]]:
    """{value of a scenario's setting: test errors}, at the seeds that all values have in common.

    Without noise (level 0) the records are those of full_state.
    """
    by_value: dict[float, dict[int, float]] = {}
    for value in {run.settings[setting] for run in runs if run.scenario == scenario}:
        same = [r for r in runs if r.scenario == scenario and r.settings[setting] == value]
        by_value[value] = _errors(same, method, SWEPT, scenario)
    if setting == "level":
        by_value[0.0] = _errors(runs, method, SWEPT, "full_state")
    by_value = {value: errors for value, errors in sorted(by_value.items()) if errors}
    seeds = set.intersection(*map(set, by_value.values())) if by_value else set()
    return {value: [errors[s] for s in seeds] for value, errors in by_value.items() if seeds}


def error_curves(
    curves: dict[str, dict[float, list[float]]], scenario: str, setting: str
) -> Figure:
    """Median and quartiles of the test error of each method against a setting of the sensors."""
    figure = Figure(figsize=(9.0, 4.8), layout="constrained")
    axes = figure.add_subplot()
    if setting == "cutoff":
        axes.set_xscale("log")
    for place, (method, curve) in enumerate(without_second_basis(curves).items()):
        x = UNIT[setting] * np.array(list(curve))
        low, middle, high = np.array([_quartiles(errors) for errors in curve.values()]).T
        color, seeds = colour_of(method), max(map(len, curve.values()))
        line, label = "-" if method in SIX else "--", LABELS.get(method, method)
        axes.plot(x, middle, line, c=color, marker=MARKERS[place], markersize=5, label=label)
        axes.fill_between(x, low, high, color=color, alpha=0.18, linewidth=0.0)
    axes.set_xticks(x, [f"{value:g}" for value in x])
    axes.set_xticks([], minor=True)
    axes.set_ylabel(f"test error [%], median and quartiles of {seeds} seeds")
    _finish_curves(axes, scenario, setting)
    titled(
        figure, f"{SWEPT} system, {scenario}: one step ahead on the test motion; dashed: baselines"
    )
    figure.legend(loc="outside right upper", frameon=False, fontsize="small")
    return figure


def _quartiles(errors: Sequence[float]) -> tuple[float, ...]:
    """And the median between them; not a number where infinite."""
    known = (quantile(errors, q) for q in (0.25, 0.5, 0.75))
    return tuple(math.nan if u is None or math.isinf(u) else u for u in known)


def _finish_curves(axes: Axes, scenario: str, setting: str) -> None:
    """Units on the axes, and a line at the value that the tables have."""
    usual = OmegaConf.load(CONF / "scenario" / f"{scenario}.yaml")
    assert isinstance(usual, DictConfig)
    value = UNIT[setting] * usual[setting]
    axes.axvline(value, color="#888888", linewidth=0.8, linestyle=":", zorder=0)
    top = axes.get_xaxis_transform()
    axes.text(value, 1.01, "default", transform=top, ha="center", va="bottom", fontsize="small")
    axes.set_xlabel(AXIS[setting])
    axes.set_yscale("log")
    plain_decades(axes.yaxis, [1.0])
    axes.grid(alpha=0.3, axis="y")
