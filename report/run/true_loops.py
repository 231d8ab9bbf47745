"""Loops of a model's elements over the true ones of a simulated structure.   E elements."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from data.datamodule import Data
from data.record import Record
from data.simulation.datamodule import SimulatedData
from data.simulation.laws.element import Element
from models.estimator import Estimator
from report.paper.figures import behaviour
from report.run.figures import LOOPS, few_cycles, first_of, strong_motion
from report.style import ESTIMATED, NARROW, TRUE, WIDE, finish_loop, one_legend, panels, titled

ROOM = 0.25  # times the true range, beyond it: a loop that runs away does not hide the true one


def true_loops(
    estimator: Estimator, data: Data, record: Record, loops: tuple[Tensor, Tensor], title: str
) -> Figure | None:
    """Loops (T, E) of a model over the true ones of a record; None where nothing can be compared.

    That is where the true forces are not known, no element joins the same nodes, or a loop is not
    finite.
    """
    pairs = getattr(estimator, "elements", None)
    if not isinstance(data, SimulatedData) or not isinstance(pairs, Sequence):
        return None
    elements = data.simulation.structure.elements
    places = matched(elements, pairs)
    if record.truth is None or not places or not all(torch.isfinite(u).all() for u in loops):
        return None
    return loops_over_truth(record, loops, elements, places, title)


def matched(
    elements: Mapping[str, Element], pairs: Sequence[Sequence[str]]
) -> dict[str, tuple[int, float]]:
    """Of each element of a structure, which of a model's joins its nodes, and in which direction.

    Elements that the model lacks are omitted.
    """
    found = {nodes(pair): e for e, pair in enumerate(pairs)}
    places = {}
    for name, element in elements.items():
        start, end = nodes(element.between)
        for pair, sign in (((start, end), 1.0), ((end, start), -1.0)):
            if pair in found:
                places[name] = found[pair], sign
    return places


def nodes(pair: Sequence[str]) -> tuple[str, str]:
    """Supports without motion are ground."""
    first, second = ("ground" if re.fullmatch(r"s\d+", node) else node for node in pair)
    return first, second


def loops_over_truth(
    record: Record,
    loops: tuple[Tensor, Tensor],
    elements: Mapping[str, Element],
    places: Mapping[str, tuple[int, float]],
    title: str,
) -> Figure:
    """Figs. 6–8 from a model: the loops of its elements over the true ones, the largest of them."""
    truth = record.truth
    assert truth is not None
    whole = first_of(truth.y)
    span = few_cycles(whole, strong_motion(first_of(truth.a), record.dt), LOOPS)
    y, r, true_y, true_r = (first_of(u)[span] for u in (*loops, truth.y, truth.r))
    figure, drawn = panels(len(elements), 3.2, 2.6, more=(0.0, 0.6), layout="constrained")
    for i, (name, element) in enumerate(elements.items()):
        axes, own = drawn[i], None
        if name in places:
            e, sign = places[name]
            own = (sign * y[:, e], sign * r[:, e])
        else:
            axes.text(0.97, 0.03, "not in the model", transform=axes.transAxes, ha="right",
                      fontsize="x-small")  # fmt: skip
        _loop(axes, (true_y[:, i], true_r[:, i]), own, f"{name}: {behaviour(element)}")
    one_legend(figure, figure.axes, loc="outside upper right", ncols=2)
    times = f"{record.dt * span.start:.3g}–{record.dt * span.stop:.3g} s"
    return titled(figure, f"{title}; {times}", 2.5)


def _loop(
    axes: Axes,
    true: tuple[np.ndarray, np.ndarray],
    own: tuple[np.ndarray, np.ndarray] | None,
    title: str,
) -> None:
    """One element: its true loop (y, r), and that of a model."""
    axes.plot(*true, color=TRUE, linewidth=WIDE, label="true")
    if own is not None:
        axes.plot(*own, color=ESTIMATED, linewidth=NARROW, label="free run")
    (left, right), (low, high) = ((float(u.min()), float(u.max())) for u in true)
    axes.set_xlim(left - ROOM * (right - left), right + ROOM * (right - left))
    axes.set_ylim(low - ROOM * (high - low), high + ROOM * (high - low))
    finish_loop(axes, title)
