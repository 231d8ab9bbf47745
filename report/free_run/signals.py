"""Signals of free runs: motions of the best models against truth, and the loops of their elements.

T samples, n DOFs, E elements.
"""

from __future__ import annotations

from collections.abc import Sequence
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
from report.paper.signals import behaviour
from report.run.figures import strong_motion
from report.run.identified import NARROW, TRUE, WIDE, matched
from runner.folder.run import restore
from runner.folder.run_folder import read_run
from runner.scores.result import Result

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


def motions(runs: Sequence[Result], seconds: float = 10.0) -> Figure:
    """Acceleration and displacement of free runs against truth, `seconds` before the end.

    There a drift shows; a measured motion is shown about its peak, for it may end at rest.
    `runs`: one run of each model, all of one system and seed.
    """
    record, responses = _simulated(runs)
    count = min(record.samples, max(2, round(seconds / record.dt)))
    last = record.samples
    if record.truth is None:
        peak = record.warmup + int(record.a[record.warmup :].abs().amax(dim=1).argmax())
        last = min(last, max(count, peak + count // 2))
    span = slice(last - count, last)
    t = record.dt * np.arange(record.samples)[span]
    true = {"a": record.a if record.truth is None else record.truth.a, "x": displacement_of(record)}
    symbol, unit = QUANTITIES[record.quantity]
    shown = [("a", f"{symbol}{{}} [{unit}]"), ("x", "x{} [m]")]
    shown = shown if record.quantity == "acceleration" and true["x"] is not None else shown[:1]
    figure = Figure(figsize=(12.0, 1.9 * record.dofs + 1.2), layout="constrained")
    panels = figure.subplots(record.dofs, len(shown), sharex=True, squeeze=False)
    for column, (name, label) in enumerate(shown):
        reference = true[name]
        for i, axes in enumerate(panels[:, column]):
            curves = {
                model: getattr(response, name)[span, i].numpy()
                for model, response in responses.items()
            }
            known = None if reference is None else reference[span, i].numpy()
            _motion(axes, t, known, curves, "measured" if record.truth is None else "true")
            axes.set_ylabel(label.format(i + 1))
        panels[-1, column].set_xlabel(f"time [s] of the test motion, seed {runs[0].seed}")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=5, frameon=False)
    return figure


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
        axes.plot(t, true, color="black", linewidth=3.0, label=label)
    for place, (model, curve) in enumerate(curves.items()):  # the first, the best, on top
        colour, above = colour_of(model), 3.0 - 0.01 * place
        axes.plot(t, curve, color=colour, linewidth=1.1, label=model, zorder=above)
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
        y, r = (signal.numpy() for signal in simulated.element_loops(record))
    assert isinstance(data, SimulatedData)  # only those know the truth
    elements = data.simulation.structure.elements
    places = matched(elements, simulated.elements)
    span = strong_motion(record.truth.a.numpy(), record.dt)
    y, r = y[span], r[span]
    columns = min(3, len(elements))
    rows = -(-len(elements) // columns)
    figure = Figure(figsize=(3.2 * columns, 2.6 * rows + 0.4), layout="constrained")
    for i, (name, element) in enumerate(elements.items()):
        axes = figure.add_subplot(rows, columns, i + 1)
        true = (signal[span, i].numpy() for signal in (record.truth.y, record.truth.r))
        axes.plot(*true, color=TRUE, linewidth=WIDE, label="true")
        if name in places:
            e, sign = places[name]
            loop, colour = (sign * y[:, e], sign * r[:, e]), colour_of(str(run.model))
            axes.plot(*loop, color=colour, linewidth=NARROW, label=run.model)
        else:
            _note(axes, "not in the model")
        axes.set_title(f"{name}: {behaviour(element)}", fontsize="medium")
        axes.set_xlabel("y [m]")
        axes.set_ylabel("r [N]")
        axes.grid(alpha=0.25)
        _true_range(axes, record, i)
    handles: dict[Any, Any] = {}
    for axes in figure.axes:
        handles |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    figure.legend(
        handles.values(), handles.keys(), loc="outside upper right", ncols=2, frameon=False
    )
    return figure


def _true_range(axes: Axes, record: Record, i: int) -> None:
    """A quarter more than the truth's: a loop that runs away does not hide it."""
    assert record.truth is not None
    for limits, signal in ((axes.set_xlim, record.truth.y), (axes.set_ylim, record.truth.r)):
        low, high = float(signal[:, i].min()), float(signal[:, i].max())
        limits(low - 0.25 * (high - low), high + 0.25 * (high - low))
