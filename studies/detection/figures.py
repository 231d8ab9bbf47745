"""Pictures of the detectors: levels over time of one motion, and damage found against delay."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from report.style import DASHES, MARKERS, one_legend, plain_decades, titled
from studies.detection.motions import BLOCK, DURATION, FRACTION, TIME, Outcome, delays_of

COLOURS = ("#999999", "#222222", "#E69F00", "#D55E00", "#CC79A7", "#009E73", "#56B4E9", "#0072B2")
LEAST = 0.05  # level that is drawn
DAMAGE = f"{100.0 * FRACTION:.0f} % of the stiffness of one element lost at {TIME:.0f} s"
Outcomes = dict[str, dict[str, Outcome]]  # by system and watch


def line_of(place: int, name: str, points: int) -> dict[str, Any]:
    """Colour, dash and mark of a watch: frozen models dashed, adaptive ones in full lines."""
    dash = DASHES[1] if name.startswith("frozen") else "-"
    every = max(1, points // 8)
    return {
        **{"label": name, "color": COLOURS[place % len(COLOURS)], "linestyle": dash},
        **{"marker": MARKERS[place % len(MARKERS)], "markersize": 5, "markerfacecolor": "none"},
        "markevery": (place * every // len(MARKERS), every),
    }


def delays_figure(outcomes: Outcomes) -> Figure:
    """Share of the damaged motions found, against the time since the damage, for each system."""
    columns = min(2, len(outcomes))
    rows = math.ceil(len(outcomes) / columns)
    figure = Figure(figsize=(4.6 * columns, 3.0 * rows + 1.3), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    time = np.arange(0.0, DURATION - TIME + BLOCK, BLOCK)
    for axes, (system, by_watch) in zip(grid.flat, outcomes.items(), strict=False):
        for place, (name, outcome) in enumerate(by_watch.items()):
            delays = np.array([d for d in delays_of(outcome.damaged) if d > 0.0])
            share = (delays[None, :] <= time[:, None]).sum(axis=1) / max(1, len(delays))
            line = line_of(place, name, len(time))
            axes.step(time, 100.0 * share, where="post", linewidth=1.2, **line)
        axes.set_title(system, fontsize="medium")
        axes.set_xlabel("time since the damage [s]")
        axes.set_ylabel("damages found [%]")
        axes.tick_params(labelbottom=True, labelleft=True)
        axes.set_xlim(0.0, DURATION - TIME)
        axes.grid(alpha=0.25)
    one_legend(figure, grid.flat, loc="outside lower center", ncols=columns)
    return titled(figure, f"Damages found by each watch: {DAMAGE}")


def levels_figure(outcomes: Outcomes) -> Figure:
    """Largest level of each watch over time, of every system's first damaged motion."""
    figure = Figure(figsize=(9.2, 2.3 * len(outcomes) + 1.3), layout="constrained")
    grid = figure.subplots(len(outcomes), 1, squeeze=False, sharex=True)
    for axes, (system, by_watch) in zip(grid.flat, outcomes.items(), strict=True):
        for place, (name, outcome) in enumerate(by_watch.items()):
            level = outcome.damaged[0].amax(dim=-1).numpy()
            t = BLOCK * np.arange(1, len(level) + 1)
            level = np.where(level > LEAST, level, np.nan)
            axes.plot(t, level, linewidth=1.0, **line_of(place, name, len(t)))
        axes.axhline(1.0, color="black", linewidth=0.8)
        axes.axvline(TIME, color="black", linewidth=0.8, linestyle=":")
        axes.set_yscale("log")
        axes.set_ylim(LEAST, None)
        plain_decades(axes.yaxis, [1.0, 3.0])
        axes.set_title(system, fontsize="medium")
        axes.set_ylabel("level, of its\nthreshold [–]")
        axes.margins(x=0.0)
    axes.set_xlabel("time [s]; dotted: the damage; line: the threshold")
    one_legend(figure, grid.flat, loc="outside lower center", ncols=2)
    return titled(figure, f"Levels of each watch in one motion: {DAMAGE}")
