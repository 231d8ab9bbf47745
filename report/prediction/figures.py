"""Pictures of predictions: histories and loops of one run; peaks over the scale of many."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from models.estimator import Estimator
from report.prediction.peaks import largest, leading
from report.prediction.runs import Prediction, Signal, parts_of
from report.run.figures import MOST_LOOPS
from report.style import DASHES, ESTIMATED, MEASURED, SERIES, finish_loop, panels, titled

MOST_ROWS = 8  # that are drawn, those with the largest peaks
OUTPUTS = ("displacement", "velocity", "acceleration", "force", "output")


def draw_one(prediction: Prediction, estimator: Estimator, title: str) -> dict[str, Figure]:
    """Histories of excitation and outputs; loops of the elements where there are any."""
    drawn = {"history": _histories(prediction, estimator, title)}
    y, r = prediction.signal("deformation"), prediction.signal("loop")
    if y is not None and r is not None:
        drawn["loops"] = _loops(y, r, parts_of(r, estimator), "m", title)
    imposed = [s for s in prediction.signals if s.symbol == "s"]
    force = prediction.signal("force")
    if force is not None and len(imposed) == force.values.shape[1]:
        s = Signal("deformation", "s", "m", force.names, np.hstack([u.values for u in imposed]))
        drawn["loops"] = _loops(s, force, parts_of(force, estimator), "m", title)
    return drawn


def _histories(prediction: Prediction, estimator: Estimator, title: str) -> Figure:
    """The excitation above, then positions, or else all outputs, a panel for each quantity."""
    inputs = [s for s in prediction.signals if s.kind == "input" and s.symbol != "s_dot"]
    outputs = [s for s in prediction.signals if s.kind in OUTPUTS and s.symbol != "v"]
    panels = [*inputs, *outputs]
    if len(inputs) > 2:  # forces on many DOFs share a panel
        values = np.hstack([s.values for s in inputs])
        numbers = [f"{s.symbol}{s.names[0]}" for s in inputs]
        panels = [Signal("input", "", inputs[0].unit, numbers, values), *outputs]
    figure = Figure(figsize=(8.0, 1.0 + 1.9 * len(panels)), layout="constrained")
    axes = np.atleast_1d(figure.subplots(len(panels), 1, sharex=True))
    t = prediction.dt * np.arange(len(panels[0].values))
    for ax, signal in zip(axes, panels, strict=True):
        _history(ax, t, signal, parts_of(signal, estimator))
    axes[-1].set_xlabel("time [s]")
    titled(figure, title)
    return figure


def _history(ax: Axes, t: np.ndarray, signal: Signal, names: Sequence[str]) -> None:
    sizes = np.abs(np.nan_to_num(signal.values, posinf=0.0, neginf=0.0)).max(axis=0)
    shown = sorted(np.argsort(-sizes, kind="stable")[:MOST_ROWS].tolist())
    for place, i in enumerate(shown):
        colour = MEASURED if signal.kind == "input" and len(shown) == 1 else _colour(place, shown)
        dash = DASHES[place % len(DASHES)]
        ax.plot(t, signal.values[:, i], color=colour, linestyle=dash, linewidth=0.8, label=names[i])
        if signal.half is not None:
            low, high = (signal.values[:, i] + way * signal.half[:, i] for way in (-1.0, 1.0))
            ax.fill_between(t, low, high, color=colour, alpha=0.2, linewidth=0.0)
    unit = f" [{signal.unit.replace('^2', '²')}]" if signal.unit else ""
    words = "excitation" if signal.kind == "input" else signal.kind
    ax.set_ylabel(f"{words}\n{unit.strip()}", fontsize=8)
    ax.set_xlim(t[0], t[-1])
    ax.grid(alpha=0.25)
    ax.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    if len(sizes) > len(shown):
        ax.set_title(f"the {len(shown)} largest of {len(sizes)}", fontsize=7, loc="right")


def _colour(place: int, shown: Sequence[int]) -> str:
    return ESTIMATED if len(shown) == 1 else SERIES[(3, 0, 4, 5, 2, 1, 6, 7)[place % 8]]


def _loops(y: Signal, r: Signal, names: Sequence[str], unit: str, title: str) -> Figure:
    """Force over deformation, an element each."""
    sizes = np.abs(np.nan_to_num(r.values)).max(axis=0)
    shown = sorted(np.argsort(-sizes, kind="stable")[:MOST_LOOPS].tolist())
    figure, drawn = panels(len(shown), 2.6, 2.3, more=(1.5, 0.8), layout="constrained")
    for ax, i in zip(drawn, shown, strict=True):
        ax.plot(y.values[:, i], r.values[:, i], color=ESTIMATED, linewidth=0.7)
        finish_loop(ax, names[i], "", "")
        ax.tick_params(labelsize=7)
        ax.ticklabel_format(scilimits=(-3, 4))
    figure.supxlabel(f"deformation [{unit}]", fontsize=8)
    figure.supylabel("force [N]", fontsize=8)
    titled(figure, title)
    return figure


def draw_many(predictions: Sequence[Prediction], title: str) -> Figure:
    """The largest deformation, or output, of each motion over its scale."""
    kind, words, unit = leading(predictions)
    figure = Figure(figsize=(6.4, 4.6), layout="constrained")
    ax = figure.subplots()
    names = list(dict.fromkeys(p.name for p in predictions))
    scales = list(dict.fromkeys(p.scale for p in predictions))
    peaks = {(p.name, p.scale): largest(p, kind) for p in predictions}
    table = np.array([[np.nan if (u := peaks[n, s]) is None else u for s in scales] for n in names])
    if len(scales) == 1:
        return _bars(figure, ax, predictions, table[:, 0], f"largest {words} [{unit}]", title)
    order = np.argsort(scales)
    x = np.array(scales)[order]
    for row in table:
        ax.plot(row[order], x, color="#bbbbbb", linewidth=0.7, zorder=1)
    for p in predictions:
        if (u := peaks[p.name, p.scale]) is not None:
            filled = ESTIMATED if p.outside else "#0072B2"
            ax.plot(u, p.scale, "." if not p.outside else "x", color=filled, markersize=4, zorder=2)
    whole = np.where(np.isfinite(table), table, np.inf)
    median = np.sort(whole, axis=0)[(len(names) - 1) // 2][order]
    ax.plot(
        np.where(np.isfinite(median), median, np.nan), x, color=MEASURED, linewidth=1.8, zorder=3
    )
    marks = {
        "median": {"color": MEASURED}, "a motion": {"color": "#bbbbbb"},
        "inside the trained range": {"color": "#0072B2", "marker": ".", "linestyle": ""},
        "outside it": {"color": ESTIMATED, "marker": "x", "linestyle": ""},
    }  # fmt: skip
    for label, style in marks.items():
        ax.plot([], [], label=label, **style)  # type: ignore[arg-type]
    ax.set_xlabel(f"largest {words} [{unit}]")
    ax.set_ylabel("scale of the motion")
    ax.set_xlim(left=0.0)
    ax.set_ylim(bottom=0.0)
    ax.legend(fontsize=7, loc="lower right")
    ax.grid(alpha=0.25)
    titled(figure, title)
    return figure


def _bars(
    figure: Figure, ax: Axes, predictions: Sequence[Prediction], peaks: np.ndarray, label: str,
    title: str,
) -> Figure:  # fmt: skip
    """One scale: a bar for each motion."""
    figure.set_size_inches(6.4, max(2.0, 0.9 + 0.19 * len(peaks)))
    colours = [ESTIMATED if p.outside else "#0072B2" for p in predictions]
    bars = ax.barh(range(len(peaks)), np.nan_to_num(peaks), color=colours, edgecolor="white")
    for bar, prediction in zip(bars, predictions, strict=True):
        bar.set_hatch("///" if prediction.outside else "")
    ax.set_yticks(range(len(peaks)), [p.name for p in predictions], fontsize=7)
    ax.invert_yaxis()
    ax.set_xlabel(label)
    titled(figure, title)
    kinds = (("inside the trained range", "#0072B2", ""), ("outside it", ESTIMATED, "///"))
    for name, colour, hatch in kinds:
        ax.bar(0, 0, color=colour, hatch=hatch, edgecolor="white", label=name)
    ax.legend(fontsize=7)
    return figure
