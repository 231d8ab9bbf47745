"""What a network of elements found: its free run and loops in one picture, and all of its loops.

For simulated structures, whose motion and forces are known. T samples, E elements.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from data.record import Record, Response
from data.simulation.laws.element import Element
from report.paper.figures import behaviour
from report.run.figures import LOOPS, few_cycles, first_of, strong_motion
from report.style import ESTIMATED, NARROW, TRUE, WIDE, finish_loop, one_legend, panels, titled

SHOWN = 2  # elements next to the motion, of the largest forces, of two behaviours if there are
ROOM = 0.25  # times the true range, beyond it: a loop that runs away does not hide the true one


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


def identified(
    record: Record,
    response: Response,
    loops: tuple[Tensor, Tensor],
    elements: Mapping[str, Element],
    places: Mapping[str, tuple[int, float]],
    title: str,
) -> Figure:
    """Acceleration of the last DOF in free run with its error, and loops of two elements.

    Of the strong part of the first record of a batch. loops: deformation and force (T, E) of the
    model's elements; places: as by `matched`.
    """
    truth = record.truth
    assert truth is not None
    last, span = record.dofs - 1, strong_motion(first_of(truth.a), record.dt)
    t = record.dt * np.arange(record.samples)[span]
    figure = titled(Figure(figsize=(10.5, 4.8), layout="constrained"), title)
    grid = figure.add_gridspec(2, 3, height_ratios=(1.0, 1.0))
    motion = figure.add_subplot(grid[0, :2])
    left = figure.add_subplot(grid[1, :2], sharex=motion)
    true, own = (first_of(a)[span, last] for a in (truth.a, response.a))
    motion.plot(t, true, color=TRUE, linewidth=WIDE, label="true")
    motion.plot(t, own, color=ESTIMATED, linewidth=NARROW, label="free run")
    motion.set_ylabel(f"ẍ{record.dof_numbers[last]} [m/s²]")
    motion.legend(frameon=False, ncols=2, loc="upper right", fontsize="small")
    motion.set_ylim(top=1.35 * max(true.max(), own.max()))  # room for the legend
    left.plot(t, own - true, color=ESTIMATED, linewidth=NARROW)
    left.set_ylabel("its error [m/s²]")
    left.set_xlabel("time [s]")
    for axes in (motion, left):
        axes.margins(x=0.0)
    near = few_cycles(first_of(truth.y), span, LOOPS)
    y, r, true_y, true_r = (first_of(u)[near] for u in (*loops, truth.y, truth.r))
    for row, name in enumerate(_shown(true_r, elements, places)):
        axes, (e, sign) = figure.add_subplot(grid[row, 2]), places[name]
        i = list(elements).index(name)
        title = f"{name}: {behaviour(elements[name])}"
        _loop(axes, (true_y[:, i], true_r[:, i]), (sign * y[:, e], sign * r[:, e]), title)
    return figure


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


def _shown(
    r: np.ndarray, elements: Mapping[str, Element], places: Mapping[str, tuple[int, float]]
) -> list[str]:
    """Names of the elements with the largest forces, of different behaviour where there are any."""
    size = dict(zip(elements, np.abs(r).max(axis=0).tolist(), strict=True))
    order = sorted(places, key=lambda name: -size[name])
    largest = {behaviour(elements[name]): name for name in reversed(order)}
    others = [name for name in order if name not in largest.values()]
    return [*sorted(largest.values(), key=lambda name: -size[name]), *others][:SHOWN]


def picture(
    record: Record,
    response: Response | None,
    loops: tuple[Tensor, Tensor] | None,
    elements: Mapping[str, Element],
    pairs: Sequence[Sequence[str]] | None,
    title: str,
) -> dict[str, Figure]:
    """Pictures by name; none where there is nothing to compare with."""
    if record.truth is None or response is None or loops is None or pairs is None:
        return {}
    places = matched(elements, pairs)
    if not places or not torch.isfinite(response.a).all():
        return {}
    return {
        "identified": identified(record, response, loops, elements, places, title),
        "element_loops": loops_over_truth(record, loops, elements, places, title),
    }
