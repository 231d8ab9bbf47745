"""The pictures of a study: the paper's Figs. 5–11, and errors over seeds, noise and cutoffs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from omegaconf import DictConfig, OmegaConf

from data.record import Record
from data.simulation import element_test
from data.simulation.datamodule import SimulatedData
from data.simulation.laws.bilinear import Bilinear
from data.simulation.laws.bouc_wen import BoucWen
from data.simulation.laws.element import Element
from data.simulation.laws.limited_slip import LimitedSlip
from data.simulation.laws.polynomial import Polynomial
from data.simulation.structure import Structure
from models.choice import Choice
from models.stored.run import read_run
from report.about import colour_of
from report.output import save_figure
from report.paper.tables import (
    METHODS,
    OWN_RESIDUAL,
    SETTINGS,
    as_configured,
    error_of,
    model_of,
    of,
)
from report.run.figures import draw_running_errors, element_loops
from report.style import (
    DASHES,
    MARKERS,
    MEASURED,
    TRUE,
    WIDE,
    mark_lost,
    one_legend,
    panels,
    percent_ticks,
    placed,
    plain_decades,
    titled,
)
from runner.config.compose import CONF
from runner.folder.run import restore
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
    figure, of_tables = panels(
        len(drawn), 2.6, 3.3, more=(1.8, 0.6), sharey=True, layout="constrained"
    )
    for axes, (system, scenario) in zip(of_tables, drawn, strict=True):
        for place, method in enumerate(METHODS):
            _spread(axes, place, method, _spread_of(runs, method, system, scenario))
            paper = paper_values(model_of(method), system, scenario).get("test", {})
            if printed := paper.get("relative_rms_percent"):
                axes.plot(printed, place, "kD", fillstyle="none", label="the paper's value")
        axes.set_title(f"{system}, {scenario}", fontsize="medium")
        axes.set_xscale("log")
        axes.set_xlabel("test error [%]")
    _finish_methods(figure, of_tables)
    return figure


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


def _finish_methods(figure: Figure, of_tables: Sequence[Axes]) -> None:
    """Methods down the shared axis, a line between the paper's and the rest; one legend."""
    for axes in of_tables:
        axes.axhline(len(SIX) - 0.5, color="#888888", linewidth=0.8)
        axes.grid(axis="x", alpha=0.3)
        axes.set_ylim(len(METHODS) - 0.5, -0.5)
        axes.set_yticks(range(len(METHODS)), METHODS, fontsize="small")
        percent_ticks(axes)
    one_legend(figure, of_tables, loc="outside upper right", ncols=2)


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


# Signals of the study's runs: element loops, phase planes, accelerations of all methods at once.
#
# Brewick & Masri (2016), Figs. 5–11.   T samples, n DOFs, E elements.

SIX = METHODS[:7]  # the paper's, one of them scored in two ways; the rest are baselines
SAME_AS_CHEBYSHEV = "power_series_restoring_force"  # two bases of one space: one estimate
LABELS = {
    SAME_AS_CHEBYSHEV: "power_series_restoring_force,\nchebyshev_restoring_force",
    "residual_mlp": "residual_mlp (measured residual)",
    f"residual_mlp_{OWN_RESIDUAL}": "residual_mlp (own residual)",
}
TURNS = (0.025, -0.025, 0.05, -0.05, 0.075, -0.075, 0.075)  # of Fig. 5's cycles [m]
LEG, STEP = 20.0, 0.05  # from turn to turn, and from sample to sample [s]


def slow_cycles(turns: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Deformation and its rate (T,) from rest to each deformation in `turns` [m], in `LEG` [s]."""
    u = np.arange(1, round(LEG / STEP) + 1) * STEP / LEG
    y, rate, last = [0.0], [0.0], 0.0
    for turn in turns:
        y.extend(last + (turn - last) * 0.5 * (1.0 - np.cos(np.pi * u)))
        rate.extend((turn - last) * 0.5 * np.pi / LEG * np.sin(np.pi * u))
        last = turn
    return np.array(y), np.array(rate)


def sample_loops() -> Figure:
    """Fig. 5: a bilinear (a) and a limited-slip element (b) under slow cycles of growing size."""
    values: Any = OmegaConf.to_container(OmegaConf.load(CONF / "system" / "bilinear.yaml"))
    structure: Structure = Choice("system.structure", values["structure"]).build(Structure)
    elements: dict[str, Any] = structure.elements
    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    _loop(left, elements["r1"], "(a) bilinear hysteretic", **_bilinear_marks(elements["r1"]))
    _loop(right, elements["r2"], "(b) limited slip", **_slip_marks(elements["r2"]))
    return figure


def _loop(
    axes: Axes,
    element: Element,
    title: str,
    limits: dict[str, float],
    slopes: dict[str, tuple[float, float]],
) -> None:
    """A loop with dotted lines at ±z_y and ±z_g, and its slopes as text."""
    y, rate = slow_cycles(TURNS)
    axes.plot(y, element_test.force(element, y, STEP, rate), color=MEASURED, linewidth=1.2)
    for name, limit in limits.items():
        for label, side in ((f"${name}$", limit), (f"$−{name}$", -limit)):
            axes.axvline(side, color="#888888", linewidth=0.8, linestyle=":")
            top = axes.get_xaxis_transform()
            axes.text(side, 1.01, label, transform=top, ha="center", va="bottom", fontsize="small")
    for name, place in slopes.items():
        outside: dict[str, Any] = {"xytext": (6, -3), "ha": "left", "va": "top"}
        if name == "k_2":  # the branch on top of the loop
            outside = {"xytext": (-5, 3), "ha": "right", "va": "bottom"}
        axes.annotate(f"${name}$", place, textcoords="offset points", **outside)
        axes.plot(*place, ".", color=MEASURED)
    axes.set_xticks([-0.05, 0.0, 0.05])
    axes.margins(x=0.15)
    axes.set_title(title, fontsize="medium", pad=18.0)
    axes.set_xlabel("relative displacement y [m]")
    axes.set_ylabel("restoring force r [N]")


def _bilinear_marks(e: Bilinear) -> dict[str, Any]:
    """Yield displacement, and a point (y, r) of the largest loop on a branch of each slope."""
    largest, zy, k1, k2 = TURNS[-1], e.yield_displacement, e.stiffness, e.post_yield_stiffness
    loading, unloading = 0.7 * largest, largest - zy
    slopes = {"k_1": (unloading, k2 * unloading), "k_2": (loading, k2 * loading + (k1 - k2) * zy)}
    return {"limits": {"z_y": zy}, "slopes": slopes}


def _slip_marks(e: LimitedSlip) -> dict[str, Any]:
    """The same, and the gap; k1 is written at the smallest loop, which does not close the gap."""
    largest, zy, zg, k1, k2 = TURNS[-1], e.yield_displacement, e.gap, e.stiffness, e.gap_stiffness
    loading, unloading = 0.5 * (zg + largest), largest - zy
    slopes = {
        "k_1": (TURNS[0] - zy, 0.0),
        "k_2": (loading, k1 * zy + k2 * (loading - zg)),
        "k_1 + k_2": (unloading, k2 * (unloading - zg)),
    }
    return {"limits": {"z_y": zy, "z_g": zg}, "slopes": slopes}


def phase_planes(run: Result, identical_scales: bool) -> Figure:
    """Figs. 6–8: force against deformation of every element in the run's training motion."""
    data = _motions(run)
    elements = data.simulation.structure.elements
    record = data.records["train"][0]
    titles = [f"{name}: {behaviour(element)}" for name, element in elements.items()]
    figure = element_loops(record, titles)
    titled(figure, f"{run.system} system, training motion of seed {run.seed}: true forces")
    if identical_scales:
        assert record.truth is not None
        for axes in figure.axes:
            axes.set_xlim(*(1.05 * side * float(record.truth.y.abs().max()) for side in (-1, 1)))
            axes.set_ylim(*(1.05 * side * float(record.truth.r.abs().max()) for side in (-1, 1)))
    return placed(figure)


def behaviour(element: Element) -> str:
    """What the paper calls an element of this law and sign; the law's name where it has none."""
    if isinstance(element, Polynomial):
        return "hardening" if element.cubic_stiffness > 0.0 else "softening"
    if isinstance(element, BoucWen):
        return f"Bouc–Wen, γ {'>' if element.gamma > 0.0 else '<'} 0"
    law = type(element).__name__
    return {"Bilinear": "bilinear", "LimitedSlip": "limited slip"}.get(law, law)


def _motions(run: Result) -> SimulatedData:
    data = read_run(run.folder).experiment.make_simulated_data()
    data.setup()
    return data


def of_one_seed(runs: Sequence[Result], system: str, scenario: str) -> list[Result]:
    """Runs of the paper's methods at the lowest seed at which all that have runs finished."""
    models = [method for method in SIX if OWN_RESIDUAL not in method]
    found = [of(runs, model, system, scenario) for model in models]
    seeds = [{run.seed for run in same if run.finished} for same in found if same]
    shared = set.intersection(*seeds) if seeds else set()
    return [run for same in found for run in same if run.seed == min(shared, default=None)]


def estimates(runs: Sequence[Result], record: Record) -> dict[str, np.ndarray]:
    """{method: estimated acceleration (T, n)} of a record, from each run's checkpoint."""
    found: dict[str, np.ndarray] = {}
    for run in runs:
        with torch.no_grad():
            ways = restore(read_run(run.folder)).estimates(record)
        for way, a in ways.items():
            found[f"{run.model}_{way}" if way else str(run.model)] = a.numpy()
    return {method: found[method] for method in METHODS if method in found}


def accelerations(runs: Sequence[Result], seconds: float = 3.0, room: float = 0.6) -> Figure:
    """Figs. 9–11: test motion measured and estimated by all methods, `seconds` from its middle.

    `runs`: one of each method, of one seed. An estimate that leaves the measured range by more than
    `room` times its span is cut off, and named.
    """
    record = _motions(runs[0]).records["test"][0]
    count = min(record.samples, round(seconds / record.dt))
    span = slice((record.samples - count) // 2, (record.samples + count) // 2)
    t, measured = record.dt * np.arange(record.samples)[span], record.a.numpy()[span]
    found = without_second_basis(estimates(runs, record))
    lines = {method: a[span] for method, a in found.items()}
    figure = Figure(figsize=(9.0, 2.0 * record.dofs + 4.0), layout="constrained")
    *rows, below = figure.subplots(record.dofs + 1, 1)
    for i, (axes, letter) in enumerate(zip(rows, ascii_lowercase, strict=False)):
        columns = {method: a[:, i] for method, a in lines.items()}
        _acceleration(axes, t, measured[:, i], columns, room)
        axes.set_ylabel(f"({letter})  ẍ{record.dof_numbers[i]} [m/s²]")
        axes.tick_params(labelbottom=i == len(rows) - 1)
    colours = {method: colour_of(method) for method in found}
    whole = {method: torch.from_numpy(a) for method, a in found.items()}
    draw_running_errors(below, record, whole, colours)
    below.axvspan(t[0], t[-1], color=TRUE, alpha=0.3, linewidth=0.0)
    below.set_xlabel("time [s]; shaded: what is drawn above")
    one_legend(figure, rows[:1], loc="outside lower center", ncols=3, fontsize="small")
    case = f"{runs[0].system}, {runs[0].setting}: test motion of seed {runs[0].seed}"
    return titled(figure, f"{case}, one step ahead")


def _acceleration(
    axes: Axes, t: np.ndarray, measured: np.ndarray, lines: dict[str, np.ndarray], room: float
) -> None:
    """One DOF: its measured acceleration (T,), and what each method says of it."""
    axes.plot(t, measured, color=TRUE, linewidth=WIDE, label="measured")
    for place, (method, a) in enumerate(lines.items()):
        label, dash = LABELS.get(method, method), DASHES[place % len(DASHES)]
        axes.plot(t, a, color=colour_of(method), linestyle=dash, linewidth=1.0, label=label)
    beyond = room * (measured.max() - measured.min())
    low, high = measured.min() - beyond, measured.max() + beyond
    cut = [LABELS.get(m, m) for m, a in lines.items() if a.min() < low or a.max() > high]
    if cut:
        axes.set_ylim(low, high)
        axes.text(
            0.995, 0.03, f"cut off: {', '.join(cut)}", transform=axes.transAxes, ha="right",
            fontsize="x-small", bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
        )  # fmt: skip
    axes.margins(x=0.0)


def without_second_basis(by_method: dict[str, Any]) -> dict[str, Any]:
    """Without the second of two methods that give the same estimate."""
    twice = SAME_AS_CHEBYSHEV in by_method
    return {m: v for m, v in by_method.items() if not (twice and m == "chebyshev_restoring_force")}
