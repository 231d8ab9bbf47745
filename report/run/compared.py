"""A model's signals over the true or measured ones, and their error.

What is drawn is the part of a record in which most happens; so few cycles of it, where lines lie
over each other, that an eye can follow them.   T samples, n channels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from data.record import Record
from models.online.scores import WINDOW, running_error
from report.style import DASHES, ESTIMATED, NARROW, TRUE, WIDE, one_legend, plain_decades

SHORTEST, LONGEST = 10.0, 20.0  # of the strong motion that is drawn [s]
SHARES = (0.05, 0.95)  # of the power of a motion, between which it is strong
CYCLES, LOOPS = 16, 6  # of the fastest channel: in a time history, in a picture of loops
LEFT = 3.0  # times the largest value: from here on a model has left the picture
LEAST = 1e-3  # of an error [%] on a logarithmic axis


def strong_motion(a: np.ndarray, dt: float, seconds: float | None = None) -> slice:
    """The samples of a (T, n) in which most happens, `seconds` of them.

    None: from 5 to 95 % of the power of the motion, 10 s at least and 20 s at most.
    """
    power = np.concatenate([[0.0], np.cumsum((a**2).sum(axis=1))])
    if seconds is None:
        begins, ends = np.searchsorted(power, np.multiply(SHARES, power[-1]))
        seconds = min(max(float(ends - begins) * dt, SHORTEST), LONGEST)
    count = min(len(a), max(2, round(seconds / dt)))
    start = int(np.argmax(power[count:] - power[: len(power) - count]))
    return slice(start, start + count)


def few_cycles(signal: np.ndarray, span: slice, cycles: int = CYCLES) -> slice:
    """The strongest part of a span of signals (T, n) with `cycles` cycles of the fastest."""
    inside = signal[span] - signal[span].mean(axis=0)
    rises = ((inside[:-1] < 0.0) & (inside[1:] >= 0.0)).sum(axis=0).max()
    count = len(inside) if rises <= cycles else max(2, round(len(inside) * cycles / int(rises)))
    part = strong_motion(inside, 1.0, float(count))
    return slice(span.start + part.start, span.start + part.stop)


def compared(
    record: Record,
    signals: Mapping[str, Tensor],
    labels: Sequence[str],
    unit: str,
    seconds: float | None = None,
    band: Tensor | None = None,
) -> Figure:
    """Draw the strong part of signals (…, T, n), the model's last; the first sets the ranges.

    Of two, their difference too. band: half widths (T, n) of the 95 % band about the model's.
    A model that leaves the range before that part is drawn around the time when it leaves.
    """
    curves = {name: first_of(signal) for name, signal in signals.items()}
    first, own = next(iter(curves.values())), list(curves.values())[-1]
    largest = LEFT * np.abs(first).max(axis=0)
    span = strong_motion(first_of(record.a), record.dt, seconds)
    left = ~(np.abs(own) <= largest).all(axis=1)
    leaves, count = int(left.argmax()), span.stop - span.start
    if left.any() and leaves < span.start:
        start = max(0, leaves - count // 2)
        span = near = slice(start, start + count)
    else:
        near = few_cycles(first, span)
    half = None if band is None else band.numpy()
    t = record.dt * np.arange(record.samples)
    both = len(curves) > 1
    figure = Figure(figsize=(9.0, 1.9 * len(labels) + 0.8))
    grid = figure.subplots(
        len(labels), 1 + both, sharex="col", squeeze=False, width_ratios=(3, 2)[: 1 + both]
    )
    for i, row in enumerate(grid):
        for (name, curve), style in zip(curves.items(), _styles(len(curves)), strict=True):
            row[0].plot(t[near], within(curve[near, i], largest[i]), label=name, **style)
        if half is not None:
            low, high = (within(own[near, i] + w * half[near, i], largest[i]) for w in (-1.0, 1.0))
            row[0].fill_between(t[near], low, high, color=ESTIMATED, alpha=0.25, linewidth=0.0,
                                label="95 % band")  # fmt: skip
        row[0].set_ylabel(f"{labels[i]} [{unit}]")
        if both:
            error = within(own[span, i], largest[i]) - first[span, i]
            _error(row[1], t[span], error, None if half is None else half[span, i])
            row[1].set_ylabel(f"error [{unit}]")
            if near != span:
                row[1].axvspan(t[near.start], t[near.stop - 1], color=TRUE, alpha=0.3, linewidth=0)
    for axes in grid.flat:
        axes.margins(x=0.0)
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    if both and near != span:
        grid[-1, 1].set_xlabel("time [s]; shaded: drawn at the left")
    one_legend(figure, [grid[0, 0]], loc="upper right", ncols=3)
    return figure


def _styles(count: int) -> list[dict[str, Any]]:
    """Of what should be, beneath, and of the model's."""
    beneath: dict[str, Any] = {"color": TRUE, "linewidth": WIDE}
    return [beneath, {"color": ESTIMATED, "linewidth": NARROW}][-count:]


def _error(axes: Axes, t: np.ndarray, error: np.ndarray, half: np.ndarray | None) -> None:
    """An error (T,) on a separate axis, and the band in which 95 % of it should lie."""
    axes.axhline(0.0, color=TRUE, linewidth=0.8)
    axes.plot(t, error, color=ESTIMATED, linewidth=0.6)
    if half is not None:
        axes.fill_between(t, -half, half, color=ESTIMATED, alpha=0.25, linewidth=0.0)
        finite = np.abs(np.concatenate([error, half]))
        reach = 1.05 * float(finite[np.isfinite(finite)].max(initial=0.0))
        axes.set_ylim(-(reach or 1.0), reach or 1.0)


def within(curve: np.ndarray, largest: float) -> np.ndarray:
    """A curve up to where it leaves the picture."""
    return np.where(np.abs(curve) <= largest, curve, np.nan)


def draw_running_errors(
    axes: Axes, record: Record, estimates: Mapping[str, Tensor], colours: Mapping[str, str]
) -> None:
    """The error of the last seconds of estimates (T, n), a line each: they differ where they hide
    each other in a picture of the motion.
    """
    t = record.dt * np.arange(record.samples)
    for dash, (name, estimate) in zip(_dashes(len(estimates)), estimates.items(), strict=True):
        error = running_error(estimate, record).cpu().numpy()
        error = np.where(np.isfinite(error), np.maximum(error, LEAST), np.nan)
        axes.plot(t, error, color=colours[name], linestyle=dash, linewidth=1.2, label=name)
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    plain_decades(axes.yaxis, [1.0] if high > 100.0 * low else [1.0, 2.0, 5.0])
    axes.set_xlabel("time [s]")
    axes.set_ylabel(f"error of the\nlast {WINDOW:g} s [%]")
    axes.margins(x=0.0)
    axes.grid(alpha=0.3)


def _dashes(count: int) -> list[object]:
    return [DASHES[i % len(DASHES)] for i in range(count)]


def first_of(signal: Tensor) -> np.ndarray:
    """The first record of a batch (T, c)."""
    return signal.reshape(-1, *signal.shape[-2:])[0].detach().cpu().numpy()
