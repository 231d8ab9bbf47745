"""What a network of elements found, in one picture: its free run, and its loops over the true ones.

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
from data.simulation.elements.element import Element
from report.paper.signals import behaviour
from report.run.figures import first_of, strong_motion
from report.style import ESTIMATED

TRUE = "#b8b8b8"  # wide and pale, so that a line upon it shows both
WIDE, NARROW = 4.0, 0.9
LOOPS = 2  # of the widest, each of another behaviour where there are any


def matched(
    elements: Mapping[str, Element], pairs: Sequence[Sequence[str]]
) -> dict[str, tuple[int, float]]:
    """Of each element of a structure, which of a model's joins its nodes, and in which direction.

    Elements that the model has not are left out.
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
    """Supports that stand still are ground."""
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
    figure = Figure(figsize=(10.5, 4.6), layout="constrained")
    figure.suptitle(title, fontsize="medium", x=0.01, ha="left")
    grid = figure.add_gridspec(2, 3, height_ratios=(1.6, 1.0))
    motion, left = figure.add_subplot(grid[0, :2]), figure.add_subplot(grid[1, :2])
    true, own = (first_of(a)[span, last] for a in (truth.a, response.a))
    motion.plot(t, true, color=TRUE, linewidth=WIDE, label="true")
    motion.plot(t, own, color=ESTIMATED, linewidth=NARROW, label="free run")
    motion.set_ylabel(f"ẍ{last + 1} [m/s²]")
    motion.legend(frameon=False, ncols=2, loc="upper right", fontsize="small")
    left.plot(t, own - true, color=ESTIMATED, linewidth=NARROW)
    left.set_ylabel("error [m/s²]")
    left.set_xlabel("time [s]")
    for axes in (motion, left):
        axes.margins(x=0.0)
    y, r, true_y, true_r = (first_of(u)[span] for u in (*loops, truth.y, truth.r))
    for row, name in enumerate(_shown(true_r, elements, places)):
        axes, (e, sign) = figure.add_subplot(grid[row, 2]), places[name]
        i = list(elements).index(name)
        axes.plot(true_y[:, i], true_r[:, i], color=TRUE, linewidth=WIDE)
        axes.plot(sign * y[:, e], sign * r[:, e], color=ESTIMATED, linewidth=NARROW)
        _named(axes, f"{name}: {behaviour(elements[name])}")
    return figure


def _shown(
    r: np.ndarray, elements: Mapping[str, Element], places: Mapping[str, tuple[int, float]]
) -> list[str]:
    """Names of the elements with the largest forces, of different behaviour where there are any."""
    size = dict(zip(elements, np.abs(r).max(axis=0).tolist(), strict=True))
    order = sorted(places, key=lambda name: -size[name])
    largest = {behaviour(elements[name]): name for name in reversed(order)}
    others = [name for name in order if name not in largest.values()]
    return [*sorted(largest.values(), key=lambda name: -size[name]), *others][:LOOPS]


def _named(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize="small")
    axes.set_xlabel("y [m]")
    axes.set_ylabel("r [N]")
    axes.grid(alpha=0.25)


def picture(
    record: Record,
    response: Response | None,
    loops: tuple[Tensor, Tensor] | None,
    elements: Mapping[str, Element],
    pairs: Sequence[Sequence[str]] | None,
    title: str,
) -> dict[str, Figure]:
    """The picture by its name; none where there is nothing to compare with."""
    if record.truth is None or response is None or loops is None or pairs is None:
        return {}
    places = matched(elements, pairs)
    if not places or not torch.isfinite(response.a).all():
        return {}
    return {"identified": identified(record, response, loops, elements, places, title)}
