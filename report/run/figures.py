"""Pictures of one run: acceleration measured against estimated, error over time, element loops.

Signals are drawn over the part of a record in which most happens.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from data.record import QUANTITIES, Record, Response
from models.training.metrics import displacement_of
from models.uncertainty.unmeasured import DISPLACEMENT, FORCE, Signal
from report.style import ESTIMATED, MEASURED

SHORTEST, LONGEST = 10.0, 20.0  # of the strong motion that is drawn [s]
LEGEND, LETTERS = 3.0, 11.0  # width [inches], letters of a title in an inch
MOST_LOOPS = 12  # elements that are drawn, those with the largest forces
SHARES = (0.05, 0.95)  # of the power of a motion, between which it is strong


def acceleration(
    record: Record, estimate: Tensor, seconds: float | None = None, band: Tensor | None = None
) -> Figure:
    """Draw the measured and the estimated output of each DOF (Figs. 9–11), with a band (T, n)."""
    signals = {"measured": record.a, "estimated": estimate}
    return _compared(record, signals, _label(record), seconds, band)


def free_run_acceleration(
    record: Record, response: Response, seconds: float | None = None, band: Tensor | None = None
) -> Figure:
    """Draw the output of each DOF against that of the free run.

    Against the measured one where there is a band (T, n), of which 95 % should lie in it.
    """
    known = {"measured": record.a}
    if record.truth is not None and band is None:
        known = {"true": record.truth.a}
    return _compared(record, {**known, "free run": response.a}, _label(record), seconds, band)


def _label(record: Record) -> str:
    symbol, unit = QUANTITIES[record.quantity]
    return f"{symbol}{{}} [{unit}]"


def free_run_displacement(
    record: Record, response: Response, seconds: float | None = None, band: Tensor | None = None
) -> Figure:
    """Draw the displacement of each DOF against that of the free run, with a band (T, n)."""
    displacement = displacement_of(record)
    assert displacement is not None
    known = "measured" if record.truth is None else "true"
    signals = {known: displacement, "free run": response.x}
    return _compared(record, signals, "x{} [m]", seconds, band)


def element_forces(record: Record, forces: Signal, names: list[str]) -> Figure:
    """Draw the force of each element in the free run with its band, the true one if known.

    Of many elements those with the largest forces. names: of all elements, or none.
    """
    largest = forces.run.nan_to_num().abs().amax(dim=0)
    chosen = sorted(largest.argsort(descending=True)[:MOST_LOOPS].tolist())
    signals = {} if forces.truth is None else {"true": forces.truth[:, chosen]}
    own = {**signals, "free run": forces.run[:, chosen]}
    figure = _compared(record, own, "r{} [N]", None, forces.half[:, chosen])
    for axes, i in zip(figure.axes, chosen, strict=True):
        axes.set_ylabel(f"{names[i] if names else f'element {i + 1}'} [N]")
    return figure


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


def _compared(
    record: Record,
    signals: dict[str, Tensor],
    label: str,
    seconds: float | None,
    band: Tensor | None = None,
) -> Figure:
    """Draw the strong part of signals (…, T, n), the model's last; the first sets the ranges.

    band: half widths (T, n) of the 95 % band about the model's, shaded.
    A model that leaves the range before that part is drawn around the time when it leaves.
    """
    curves = {name: first_of(signal) for name, signal in signals.items()}
    span = strong_motion(first_of(record.a), record.dt, seconds)
    largest = 3.0 * np.abs(next(iter(curves.values()))).max(axis=0)
    outside = ~(np.abs(list(curves.values())[-1]) <= largest).all(axis=1)
    leaves, count = int(outside.argmax()), span.stop - span.start
    if outside.any() and leaves < span.start:
        start = max(0, leaves - count // 2)
        span = slice(start, start + count)
    t = record.dt * np.arange(record.samples)[span]
    rows = len(largest)
    figure = Figure(figsize=(9.0, 1.9 * rows + 0.8), layout="constrained")
    for i, axes in enumerate(_rows(figure, rows)):
        lines = ((MEASURED, 1.6), (ESTIMATED, 1.0))[-len(curves) :]
        for (name, curve), (color, width) in zip(curves.items(), lines, strict=True):
            axes.plot(
                t, _within(curve[span, i], largest[i]), color=color, linewidth=width, label=name
            )
        if band is not None:
            middle, half = list(curves.values())[-1][span, i], band[span, i].numpy()
            low, high = (_within(middle + way * half, largest[i]) for way in (-1.0, 1.0))
            axes.fill_between(t, low, high, color=ESTIMATED, alpha=0.25, linewidth=0.0,
                              label="95 % band")  # fmt: skip
        axes.set_ylabel(label.format(i + 1))
        axes.margins(x=0.0)
    axes.set_xlabel("time [s]")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=len(labels), frameon=False)
    return figure


def _within(curve: np.ndarray, largest: float) -> np.ndarray:
    """A curve up to where it leaves the picture."""
    return np.where(np.abs(curve) <= largest, curve, np.nan)


def error_over_time(errors: dict[str, Tensor], dt: float, warmup: int = 0) -> Figure:
    """Relative RMS error up to each time (Eq. 21 as a function of t), one line per split."""
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    axes = figure.add_subplot()
    for (split, error), color in zip(errors.items(), (MEASURED, ESTIMATED), strict=False):
        t = dt * (warmup + np.arange(len(error)))
        axes.plot(t, 100.0 * error.cpu().numpy(), color=color, label=split)
    later = torch.cat([error[len(error) // 10 :].cpu() for error in errors.values()])
    later = later[torch.isfinite(later)]
    if later.numel() > 0:  # the first instants divide by next to nothing
        axes.set_ylim(0.0, 130.0 * float(later.max()))
    axes.set_xlabel("time [s]")
    axes.set_ylabel("relative RMS error [%]")
    axes.margins(x=0.0)
    axes.legend(frameon=False)
    return figure


def element_loops(record: Record, names: list[str]) -> Figure:
    """Restoring force against deformation of each element, true signals (Figs. 6–8)."""
    assert record.truth is not None
    y, r = first_of(record.truth.y), first_of(record.truth.r)
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(3.0 * columns, 2.5 * rows), layout="constrained")
    for i, name in enumerate(names):
        axes = figure.add_subplot(rows, columns, i + 1)
        axes.plot(y[:, i], r[:, i], color=MEASURED, linewidth=0.5)
        axes.set_title(name, fontsize="medium")
        axes.set_xlabel("y [m]")
        axes.locator_params(axis="x", nbins=4)  # numbers such as −0.0025 are wide
        axes.set_ylabel("r [N]")
        axes.grid(alpha=0.25)
    return figure


def identified_loops(deformations: Tensor, forces: Tensor, names: list[str]) -> Figure:
    """Force against deformation (…, T, E) of a model's elements in its free run.

    Of many elements those with the largest forces. names: of all elements, or none.
    """
    y, r = first_of(deformations), first_of(forces)
    chosen = np.sort(np.argsort(-np.abs(r).max(axis=0), kind="stable")[:MOST_LOOPS])
    columns = min(3, len(chosen))
    rows = -(-len(chosen) // columns)
    figure = Figure(figsize=(3.0 * columns, 2.5 * rows + 0.4), layout="constrained")
    for place, i in enumerate(chosen, start=1):
        axes = figure.add_subplot(rows, columns, place)
        axes.plot(y[:, i], r[:, i], color=ESTIMATED, linewidth=0.5)
        axes.set_title(names[i] if names else f"element {i + 1}", fontsize="medium")
        axes.locator_params(axis="x", nbins=4)
        axes.set_xlabel("y [m]")
        axes.locator_params(axis="x", nbins=4)  # numbers such as −0.0025 are wide
        axes.set_ylabel("r [N]")
        axes.grid(alpha=0.25)
    return figure


def imposed_loops(record: Record, estimate: Tensor) -> Figure:
    """Force against imposed deformation of an element test, measured and by the model."""
    assert record.s is not None
    s, measured, own = (
        first_of(u[..., record.warmup :, :]) for u in (record.s, record.a, estimate)
    )
    figure = Figure(figsize=(4.6 * record.dofs, 3.8), layout="constrained")
    for i in range(record.dofs):
        axes = figure.add_subplot(1, record.dofs, i + 1)
        axes.plot(s[:, i], measured[:, i], color=MEASURED, linewidth=0.8, label="measured")
        axes.plot(s[:, i], own[:, i], color=ESTIMATED, linewidth=0.6, label="model")
        axes.set_xlabel(f"s{i + 1} [m]")
        axes.set_ylabel(f"r{i + 1} [N]")
        axes.grid(alpha=0.25)
        axes.legend(frameon=False)
    return figure


def run_figures(
    record: Record,
    estimate: Tensor,
    errors: dict[str, Tensor],
    elements: list[str],
    free_run: Response | None = None,
    loops: tuple[Tensor, Tensor] | None = None,
    title: str = "",
    band: Tensor | None = None,
    one_step_band: Tensor | None = None,
    unmeasured: Mapping[str, Signal] | None = None,
    joined: list[str] | None = None,
) -> dict[str, Figure]:
    """Pictures of a run by name, from a batch of records, its estimate and its free run.

    elements: names; loops: deformations and forces of a model's elements, drawn where the true ones
    are not known. title: of the pictures in which the model is compared with the record. band: half
    widths (T, n) about the free run; one_step_band: about the estimate. unmeasured: signals that no
    sensor measured, with bands; joined: names of the model's elements.
    """
    known = unmeasured or {}
    figures = {
        "acceleration": acceleration(record, estimate, band=one_step_band),
        "error_over_time": error_over_time(errors, record.dt, record.warmup),
    }
    if record.quantity == "force" and record.s is not None:
        best = estimate if free_run is None else free_run.a
        figures["element_loops"] = imposed_loops(record, best)
    if free_run is not None:
        figures["free_run_acceleration"] = free_run_acceleration(record, free_run, band=band)
    moved = record.quantity == "acceleration" and displacement_of(record) is not None
    if free_run is not None and moved:
        moved_by = known[DISPLACEMENT].half if DISPLACEMENT in known else None
        figures["free_run_displacement"] = free_run_displacement(record, free_run, band=moved_by)
    if FORCE in known and torch.isfinite(known[FORCE].half[record.warmup :]).all():
        figures["free_run_element_forces"] = element_forces(record, known[FORCE], joined or [])
    if record.truth is not None:
        figures["element_loops"] = element_loops(record, elements)
    elif loops is not None and "element_loops" not in figures and torch.isfinite(loops[1]).all():
        figures["element_loops"] = identified_loops(*loops, elements)
    for figure in figures.values():
        if title:
            figure.suptitle(_wrapped(title, figure), fontsize="medium", x=0.01, ha="left")
    return figures


def _wrapped(title: str, figure: Figure) -> str:
    """A title in lines that end before the legend beside it."""
    free = figure.get_figwidth() - (LEGEND if figure.legends else 0.0)
    return "\n".join(textwrap.wrap(title, max(20, int(LETTERS * free))))


def first_of(signal: Tensor) -> np.ndarray:
    """The first record of a batch (T, c)."""
    return signal.reshape(-1, *signal.shape[-2:])[0].detach().cpu().numpy()


def _rows(figure: Figure, count: int) -> Iterator[Axes]:
    first: Axes | None = None
    for i in range(count):
        first_or_next = figure.add_subplot(count, 1, i + 1, sharex=first)
        first = first or first_or_next
        if i < count - 1:
            first_or_next.tick_params(labelbottom=False)
        yield first_or_next
