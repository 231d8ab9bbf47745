"""Signals of free runs: motions of the best models against truth, and the loops of their elements.

T samples, n DOFs, E elements.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from data.datamodule import Data
from data.record import QUANTITIES, Record, Response
from data.simulation.datamodule import SimulatedData
from models.estimator import Estimator
from models.training.assemble import data_from
from models.training.free_run import simulate
from models.training.metrics import displacement_of
from report.about import colour_of
from report.run.compared import draw_running_errors
from report.run.identified import loops_over_truth, matched
from report.style import DASHES, TRUE, WIDE, one_legend, titled
from runner.folder.run import restore
from runner.folder.run_folder import read_run
from runner.scores.result import Result
from runner.scores.spread import percent

ROOM = 0.5  # of the true range, above and below; a motion beyond is cut off


def restored(run: Result) -> tuple[Estimator, Data]:
    """The identified estimator of a run and its motions."""
    cfg, _ = read_run(run.folder)
    return restore(cfg, run.folder), _motions(run.folder)


@cache
def _motions(folder: Path) -> Data:
    data = data_from(read_run(folder)[0])
    data.setup()
    return data


def motions(runs: Sequence[Result], seconds: float = 6.0) -> Figure:
    """Acceleration and displacement of free runs against truth, `seconds` before the end.

    There a drift shows; a measured motion is shown about its peak, for it may end at rest. Beneath,
    the error of each over the whole motion. `runs`: one of each model, of one system and seed.
    """
    record, responses = _simulated(runs)
    count = min(record.samples, max(2, round(seconds / record.dt)))
    last = record.samples
    if record.truth is None:
        peak = record.warmup + int(record.a[record.warmup :].abs().amax(dim=1).argmax())
        last = min(last, max(count, peak + count // 2))
    span = slice(last - count, last)
    t = record.dt * np.arange(record.samples)[span]
    a = record.a if record.truth is None else record.truth.a
    true = {"a": a, "x": displacement_of(record)}
    symbol, unit = QUANTITIES[record.quantity]
    shown = [("a", f"{symbol}{{}} [{unit}]"), ("x", "x{} [m]")]
    shown = shown if record.quantity == "acceleration" and true["x"] is not None else shown[:1]
    figure = Figure(figsize=(10.0, 1.6 * record.dofs + 3.4), layout="constrained")
    grid = figure.add_gridspec(
        record.dofs + 1, len(shown), height_ratios=(*[1.0] * record.dofs, 1.4)
    )
    known = "measured" if record.truth is None else "true"
    for column, (name, label) in enumerate(shown):
        reference = true[name]
        for i in range(record.dofs):
            axes = figure.add_subplot(grid[i, column])
            curves = {
                model: getattr(response, name)[span, i].numpy()
                for model, response in responses.items()
            }
            here = None if reference is None else reference[span, i].numpy()
            _motion(axes, t, here, curves, known)
            axes.set_ylabel(label.format(i + 1))
            axes.tick_params(labelbottom=i == record.dofs - 1)
    error = figure.add_subplot(grid[-1, :])
    accelerations = {model: response.a for model, response in responses.items()}
    colours = {model: colour_of(model) for model in responses}
    draw_running_errors(error, replace(record, a=a), accelerations, colours)
    error.axvspan(t[0], t[-1], color=TRUE, alpha=0.3, linewidth=0.0)
    error.set_xlabel(f"time [s]; shaded: what is drawn above; the error is that of {symbol}")
    one_legend(figure, figure.axes[:1], loc="outside lower center", ncols=3)
    errors = ", ".join(f"{run.model} {_percent(run)}" for run in runs)
    on = f"Free runs of {runs[0].system}, unseen motion of seed {runs[0].seed}"
    return titled(figure, f"{on}: {errors}")


def _simulated(runs: Sequence[Result]) -> tuple[Record, dict[str, Response]]:
    """The first test record, and the free run of it by each model."""
    responses = {}
    for run in runs:
        estimator, data = restored(run)
        record = data.records["test"][0]
        with torch.inference_mode():
            responses[str(run.model)] = simulate(estimator, record)
    return record, responses


def _motion(
    axes: Axes,
    t: np.ndarray,
    true: np.ndarray | None,
    curves: dict[str, np.ndarray],
    label: str = "true",
) -> None:
    """Truth (T,) and what each model makes of it; a curve that leaves the picture is named."""
    if true is not None:
        axes.plot(t, true, color=TRUE, linewidth=WIDE, label=label)
    for place, (model, curve) in enumerate(curves.items()):  # the first, the best, on top
        dash, above = DASHES[place % len(DASHES)], 3.0 - 0.01 * place
        style: dict[str, Any] = {"color": colour_of(model), "linestyle": dash, "zorder": above}
        axes.plot(t, curve, linewidth=1.1, label=model, **style)
    if true is not None:
        beyond = ROOM * (true.max() - true.min())
        low, high = true.min() - beyond, true.max() + beyond
        # NaN is outside too
        cut = [m for m, curve in curves.items() if not ((low <= curve) & (curve <= high)).all()]
        if cut:
            axes.set_ylim(low, high)
            _note(axes, f"cut off: {', '.join(cut)}")
    axes.margins(x=0.0)


def _note(axes: Axes, text: str) -> None:
    box = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
    place: dict[str, Any] = {"transform": axes.transAxes, "ha": "right", "fontsize": "x-small"}
    axes.text(0.995, 0.03, text, bbox=box, **place)


def loops_of_model(run: Result) -> Figure | None:
    """Figs. 6–8 redrawn from a model: force against deformation of its elements over the truth.

    For estimators with `element_loops`, whose `elements` are pairs of nodes; elements are matched
    by their nodes, in whichever direction. None for the others.
    """
    estimator, data = restored(run)
    record = data.records["test"][0]
    simulated: Any = estimator  # of the two, the interface knows neither
    if not (hasattr(simulated, "element_loops") and hasattr(simulated, "elements")):
        return None
    if record.truth is None:
        return None
    with torch.inference_mode():
        loops = simulated.element_loops(record)
    assert isinstance(data, SimulatedData)  # only those know the truth
    elements = data.simulation.structure.elements
    places = matched(elements, simulated.elements)
    return loops_over_truth(record, loops, elements, places, named(run), colour_of(str(run.model)))


def named(run: Result) -> str:
    """Model, system, seed and error of the free run that a picture shows."""
    on = f"{run.model} on {run.system}, unseen motion of seed {run.seed}"
    return f"{on}: free run {_percent(run)}"


def _percent(run: Result) -> str:
    error = run.free_run
    return "diverged" if error is None or not math.isfinite(error) else f"{percent(error)} %"
