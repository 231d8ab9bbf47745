"""Pictures of the detectors: levels over time of one motion, and damage found against delay."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from studies.detection.motions import BLOCK, DURATION, TIME, Outcome, delays_of

COLOURS = ("#aaaaaa", "#555555", "#edae49", "#d1495b", "#9b5de5", "#6a994e", "#219ebc", "#023047")
Outcomes = dict[str, dict[str, Outcome]]  # by system and watch


def delays_figure(outcomes: Outcomes) -> Figure:
    """Share of the damaged motions found, against the time since the damage, for each system."""
    columns = min(2, len(outcomes))
    rows = math.ceil(len(outcomes) / columns)
    figure = Figure(figsize=(4.6 * columns, 3.0 * rows + 1.0), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axes, (system, by_watch) in zip(grid.flat, outcomes.items(), strict=False):
        for (name, outcome), colour in zip(by_watch.items(), COLOURS, strict=False):
            delays = np.sort([d for d in delays_of(outcome.damaged) if d > 0.0])
            finite = delays[np.isfinite(delays)]
            share = np.arange(1, len(finite) + 1) / max(1, len(delays))
            steps = np.concatenate([[0.0], finite, [DURATION - TIME]])
            shares = np.concatenate([[0.0], share, share[-1:] if len(share) else [0.0]])
            axes.step(steps, 100.0 * shares, where="post", color=colour, label=name)
        axes.set_title(system)
        axes.set_xlabel("time since the damage [s]")
        axes.set_ylabel("found [%]")
        axes.margins(x=0.0)
    handles, labels = grid.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    return figure


def levels_figure(outcomes: Outcomes) -> Figure:
    """Largest level of each watch over time, of every system's first damaged motion."""
    figure = Figure(figsize=(9.2, 2.0 * len(outcomes) + 1.0), layout="constrained")
    grid = figure.subplots(len(outcomes), 1, squeeze=False, sharex=True)
    for axes, (system, by_watch) in zip(grid.flat, outcomes.items(), strict=True):
        for (name, outcome), colour in zip(by_watch.items(), COLOURS, strict=False):
            level = outcome.damaged[0].amax(dim=-1).numpy()
            t = BLOCK * np.arange(1, len(level) + 1)
            axes.plot(t, np.where(level > 0.0, level, np.nan), color=colour, label=name)
        axes.axhline(1.0, color="black", linewidth=0.8)
        axes.axvline(TIME, color="black", linewidth=0.8, linestyle=":")
        axes.set_yscale("log")
        axes.set_ylim(0.05, None)
        axes.set_ylabel(f"level, {system}")
        axes.margins(x=0.0)
    axes.set_xlabel("time [s]; dotted: the damage; line: the threshold")
    handles, labels = grid.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    return figure
