"""Pictures of one run: acceleration measured against estimated, error over time, element loops.

Of an on-line model: running error and weights over time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from data.record import QUANTITIES, Record, Response, singles
from models.estimator import Estimator
from models.fit.metrics import displacement_of
from models.online.adaptive import Online
from models.online.scores import WINDOW, running_error
from models.online.stream import started
from models.uncertainty.bands import Signal
from report.style import (
    DASHES,
    DRAWN,
    ESTIMATED,
    MEASURED,
    NARROW,
    SERIES,
    TRUE,
    WIDE,
    finish_loop,
    one_legend,
    panels,
    placed,
    plain_decades,
    titled,
)

LEGEND = 3.0  # width [inches]


def acceleration(
    record: Record, estimate: Tensor, seconds: float | None = None, band: Tensor | None = None
) -> Figure:
    """Draw the measured and the estimated output of each DOF (Figs. 9–11), with a band (T, n)."""
    signals = {"measured": record.a, "estimated": estimate}
    return compared(record, signals, *_output(record), seconds, band)


def free_run_acceleration(record: Record, response: Response, band: Tensor | None = None) -> Figure:
    """Draw the output of each DOF against that of the free run.

    Against the measured one where there is a band (T, n), of which 95 % should lie in it.
    """
    known = {"measured": record.a}
    if record.truth is not None and band is None:
        known = {"true": record.truth.a}
    signals = {**known, "free run": response.a}
    return compared(record, signals, *_output(record), None, band)


def _output(record: Record) -> tuple[list[str], str]:
    """Names of what is measured, one for each DOF, and its unit."""
    symbol, unit = QUANTITIES[record.quantity]
    return [f"{symbol}{i}" for i in record.dof_numbers], unit


def free_run_displacement(record: Record, response: Response, band: Tensor | None = None) -> Figure:
    """Draw the displacement of each DOF against that of the free run, with a band (T, n)."""
    displacement = displacement_of(record)
    assert displacement is not None
    known = "measured" if record.truth is None else "true"
    signals = {known: displacement, "free run": response.x}
    names = [f"x{i}" for i in record.dof_numbers]
    return compared(record, signals, names, "m", None, band)


def element_forces(record: Record, forces: Signal, names: list[str]) -> Figure:
    """Draw the force of each element in the free run with its band, the true one if known.

    Of many elements those with the largest forces. names: of all elements, or none.
    """
    largest = forces.run.nan_to_num().abs().amax(dim=0)
    chosen = sorted(largest.argsort(descending=True)[:DRAWN].tolist())
    signals = {} if forces.truth is None else {"true": forces.truth[:, chosen]}
    own = {**signals, "free run": forces.run[:, chosen]}
    labels = [names[i] if names else f"element {i + 1}" for i in chosen]
    return compared(record, own, labels, "N", None, forces.half[:, chosen])


def error_over_time(errors: dict[str, Tensor], dt: float, warmup: int = 0) -> Figure:
    """Relative RMS error up to each time (Eq. 21 as a function of t), one line per split."""
    figure = Figure(figsize=(9.0, 3.2))
    axes = figure.add_subplot()
    styles = zip((MEASURED, ESTIMATED), (DASHES[1], "-"), strict=True)
    for (split, error), (color, dash) in zip(errors.items(), styles, strict=False):
        t = dt * (warmup + np.arange(len(error)))
        axes.plot(t, 100.0 * error.cpu().numpy(), color=color, linestyle=dash, label=split)
    later = torch.cat([error[len(error) // 10 :].cpu() for error in errors.values()])
    later = later[torch.isfinite(later)]
    if later.numel() > 0:  # the first instants divide by next to nothing
        axes.set_ylim(0.0, 130.0 * float(later.max()))
    axes.set_xlabel("time [s]")
    axes.set_ylabel("relative RMS error\nup to this time [%]")
    axes.margins(x=0.0)
    axes.legend(frameon=False)
    return figure


def element_loops(record: Record, names: list[str]) -> Figure:
    """Restoring force against deformation of each element, true signals (Figs. 6–8)."""
    assert record.truth is not None
    y, r = first_of(record.truth.y), first_of(record.truth.r)
    figure, drawn = panels(len(names), 3.0, 2.5)
    for i, (axes, name) in enumerate(zip(drawn, names, strict=True)):
        axes.plot(y[:, i], r[:, i], color=MEASURED, linewidth=0.5)
        finish_loop(axes, name, "true r [N]")
    return figure


def identified_loops(deformations: Tensor, forces: Tensor, names: list[str]) -> Figure:
    """Force against deformation (…, T, E) of a model's elements in its free run.

    Of many elements those with the largest forces, in the cycles in which most happens.
    names: of all elements, or none.
    """
    y, r = first_of(deformations), first_of(forces)
    chosen = np.sort(np.argsort(-np.abs(r).max(axis=0), kind="stable")[:DRAWN])
    part = few_cycles(y, slice(0, len(y)), LOOPS)
    y, r = y[part], r[part]
    figure, drawn = panels(len(chosen), 3.0, 2.5, more=(0.0, 0.4))
    for axes, i in zip(drawn, chosen, strict=True):
        axes.plot(y[:, i], r[:, i], color=ESTIMATED, linewidth=NARROW)
        finish_loop(axes, names[i] if names else f"element {i + 1}")
    return figure


def imposed_loops(record: Record, estimate: Tensor) -> Figure:
    """Force against imposed deformation of an element test, measured and by the model."""
    assert record.s is not None
    s, measured, own = (
        first_of(u[..., record.warmup :, :]) for u in (record.s, record.a, estimate)
    )
    figure, drawn = panels(record.dofs, 4.6, 3.8)
    for i, axes in enumerate(drawn):
        axes.plot(s[:, i], measured[:, i], color=TRUE, linewidth=0.5 * WIDE, label="measured")
        axes.plot(s[:, i], own[:, i], color=ESTIMATED, linewidth=NARROW, label="model")
        finish_loop(axes, "", f"force r{i + 1} [N]", f"imposed deformation s{i + 1} [m]")
        axes.legend(frameon=False)
    return figure


def finish(figures: Mapping[str, Figure], title: str) -> None:
    """Title the pictures of one model and record, and lay out their panels."""
    for figure in figures.values():
        if title:
            titled(figure, title, LEGEND if figure.legends else 0.0)
        placed(figure)


# A model's signals over the true or measured ones, and their error.
#
# What is drawn is the part of a record in which most happens; so few cycles of it, where lines lie
# over each other, that an eye can follow them.   T samples, n channels.

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
    before = record.warmup  # which is not scored
    span = strong_motion(first_of(record.a)[before:], record.dt, seconds)
    span = slice(before + span.start, before + span.stop)
    left = ~(np.abs(own) <= largest).all(axis=1)
    leaves, count = int(left.argmax()), span.stop - span.start
    if left.any() and leaves < span.start:
        start = max(before, leaves - count // 2)
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
    for place, (name, estimate) in enumerate(estimates.items()):
        error = running_error(estimate, record).cpu().numpy()
        error = np.where(np.isfinite(error), np.maximum(error, LEAST), np.nan)
        dash = DASHES[place % len(DASHES)]
        axes.plot(t, error, color=colours[name], linestyle=dash, linewidth=1.2, label=name)
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    plain_decades(axes.yaxis, [1.0] if high > 100.0 * low else [1.0, 2.0, 5.0])
    axes.set_xlabel("time [s]")
    axes.set_ylabel(f"error of the\nlast {WINDOW:g} s [%]")
    axes.margins(x=0.0)
    axes.grid(alpha=0.3)


def first_of(signal: Tensor) -> np.ndarray:
    """The first record of a batch (T, c)."""
    return signal.reshape(-1, *signal.shape[-2:])[0].detach().cpu().numpy()


COLOURS = {"from nothing": "#d1495b", "adapting": "#2e6f95", "frozen": "#222222"}
NAMED = 3  # weights of each DOF in colour, those with the largest share at the end
STRETCHES = 250  # points of a curve of weights


def online_figures(estimator: Estimator, batch: Record, on: str = "") -> dict[str, Figure]:
    """Figures of an on-line model by name, on the first record of a batch; {} for other models.

    on: the model's and the record's name.
    """
    if not isinstance(estimator, Online):
        return {}
    record = next(singles([batch.measured()]))
    return {
        "running_error": titled(running_errors(estimator, record), f"{on}, one step ahead"),
        "weights_over_time": titled(weights_over_time(estimator, record), f"{on}, from nothing"),
    }


def running_errors(model: Online, record: Record) -> Figure:
    """Draw the error of the last seconds against time, a line for each way of estimating."""
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    axes = figure.add_subplot()
    with torch.no_grad():
        found = model.estimates(record).items()
    estimates = {way.replace("_", " ") or "adapting": estimate for way, estimate in found}
    draw_running_errors(axes, record, estimates, COLOURS)
    axes.legend(frameon=False)
    return figure


def weights_over_time(model: Online, record: Record) -> Figure:
    """Draw every weight, from zero on, times its feature's RMS; a row for each DOF.

    The product is the weight's share in the estimated acceleration, and has its unit. Those with
    the largest share at the end are named by the places of their features.
    """
    heads, sizes = model.estimator.heads(), feature_sizes(model, record)
    outputs = [(j, i) for j, head in enumerate(heads) for i in range(head.shape[1])]
    states = started(model.estimator, model.law, from_nothing=True)
    longest = -(-record.samples // STRETCHES)
    history = [
        [state.weights for state in states]
        for _, states in model.stretches(record, model.law, states, longest)
    ]
    t = record.dt * np.linspace(longest, record.samples, len(history))
    figure = Figure(figsize=(9.0, 1.9 * len(outputs) + 0.8), layout="constrained")
    symbol, unit = QUANTITIES[record.quantity]
    what = f"{record.quantity} {symbol}"
    if len(heads) > 1:
        what, unit = "modal force h", "of its mode"
    for row, (j, i) in enumerate(outputs):
        axes = figure.add_subplot(len(outputs), 1, row + 1)
        curves = torch.stack([weights[j][:, i] for weights in history]) * sizes[j]  # (K, P)
        axes.plot(t, curves.cpu().numpy(), color=TRUE, linewidth=0.6)
        largest = curves[-1].abs().nan_to_num().argsort(descending=True)[:NAMED].tolist()
        for place, feature in enumerate(largest):
            curve, colour, dash = curves[:, feature].cpu().numpy(), SERIES[3 * place], DASHES[place]
            axes.plot(t, curve, color=colour, linestyle=dash, label=f"feature {feature + 1}")
        late = curves[len(curves) // 5 :]
        reach = 1.3 * float(late[torch.isfinite(late)].abs().max()) if late.numel() else 0.0
        axes.set_ylim(-(reach or 1.0), reach or 1.0)
        axes.set_ylabel(f"share in the\n{what}{row + 1} [{unit}]", fontsize="small")
        axes.margins(x=0.0)
        axes.tick_params(labelbottom=row == len(outputs) - 1)
        axes.grid(alpha=0.25)
        axes.legend(frameon=False, fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes.set_xlabel("time [s]; grey: all other weights, each times the RMS of its feature")
    return figure


def feature_sizes(model: Online, record: Record) -> list[Tensor]:
    """RMS (P_j,) of the features of each head over a record."""
    squares: list[Tensor] = []
    for _, phi in model.estimator.features_of(record):
        sums = [u.square().sum(dim=0) for u in phi]
        squares = [a + b for a, b in zip(squares, sums, strict=True)] if squares else sums
    return [torch.sqrt(u / record.samples) for u in squares]
