"""Pictures of one run: acceleration measured against estimated, error over time, element loops."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from data.record import Record, Response
from models.training.metrics import displacement_of

MEASURED, ESTIMATED = "#222222", "#d1495b"


def acceleration(record: Record, estimate: Tensor, seconds: float = 10.0) -> Figure:
    """Measured and estimated acceleration of each DOF, `seconds` from the middle (Figs. 9–11)."""
    return _compared(record, {"measured": record.a, "estimated": estimate}, "ẍ{} [m/s²]", seconds)


def free_run_acceleration(record: Record, response: Response, seconds: float = 10.0) -> Figure:
    """Acceleration of each DOF against that of the free run, as in `acceleration`."""
    true = {"measured": record.a} if record.truth is None else {"true": record.truth.a}
    return _compared(record, {**true, "free run": response.a}, "ẍ{} [m/s²]", seconds)


def free_run_displacement(record: Record, response: Response, seconds: float = 10.0) -> Figure:
    """The same for the displacement, where the record has one."""
    signals = {"free run": response.x}
    displacement = displacement_of(record)
    if displacement is not None:
        signals = {"measured" if record.truth is None else "true": displacement, **signals}
    return _compared(record, signals, "x{} [m]", seconds)


def _compared(record: Record, signals: dict[str, Tensor], label: str, seconds: float) -> Figure:
    """Signals (…, T, n), the last of them the model's; the first sets the range of each axis.

    A model that leaves the range before the middle is shown as it does.
    """
    curves = {name: _first(signal) for name, signal in signals.items()}
    count = min(record.samples, max(2, round(seconds / record.dt)))
    largest = 3.0 * np.abs(next(iter(curves.values()))).max(axis=0)
    outside = ~(np.abs(list(curves.values())[-1]) <= largest).all(axis=1)
    leaves = int(outside.argmax()) if outside.any() else record.samples
    start = max(0, min(record.samples, 2 * leaves) - count) // 2
    span = slice(start, start + count)
    t = record.dt * np.arange(record.samples)[span]
    figure = Figure(figsize=(9.0, 1.9 * record.dofs + 0.8), layout="constrained")
    for i, axes in enumerate(_rows(figure, record.dofs)):
        for (name, curve), color, width in zip(
            curves.items(), (MEASURED, ESTIMATED)[-len(curves) :], (1.6, 1.0), strict=True
        ):
            axes.plot(
                t, _within(curve[span, i], largest[i]), color=color, linewidth=width, label=name
            )
        axes.set_ylabel(label.format(i + 1))
        axes.margins(x=0.0)
    axes.set_xlabel("time [s]")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=2, frameon=False)
    return figure


def _within(curve: np.ndarray, largest: float) -> np.ndarray:
    """A diverging curve is drawn until it leaves the picture."""
    return np.where(np.abs(curve) <= largest, curve, np.nan)


def error_over_time(errors: dict[str, Tensor], dt: float, warmup: int = 0) -> Figure:
    """Relative RMS error up to each time (Eq. 21 as a function of t), one line per split."""
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    axes = figure.add_subplot()
    for (split, error), color in zip(errors.items(), (MEASURED, ESTIMATED), strict=False):
        t = dt * (warmup + np.arange(len(error)))
        axes.plot(t, 100.0 * error.cpu().numpy(), color=color, label=split)
    settled = max(float(error[len(error) // 10 :].max()) for error in errors.values())
    axes.set_ylim(0.0, 130.0 * settled)  # the first instants divide by next to nothing
    axes.set_xlabel("time [s]")
    axes.set_ylabel("relative RMS error [%]")
    axes.margins(x=0.0)
    axes.legend(frameon=False)
    return figure


def element_loops(record: Record, names: list[str]) -> Figure:
    """Restoring force against deformation of each element, true signals (Figs. 6–8)."""
    assert record.truth is not None
    y, r = _first(record.truth.y), _first(record.truth.r)
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(3.0 * columns, 2.5 * rows), layout="constrained")
    for i, name in enumerate(names):
        axes = figure.add_subplot(rows, columns, i + 1)
        axes.plot(y[:, i], r[:, i], color=MEASURED, linewidth=0.5)
        axes.set_title(name, fontsize="medium")
        axes.set_xlabel("y [m]")
        axes.set_ylabel("r [N]")
        axes.grid(alpha=0.25)
    return figure


def run_figures(
    record: Record,
    estimate: Tensor,
    errors: dict[str, Tensor],
    elements: list[str],
    free_run: Response | None = None,
) -> dict[str, Figure]:
    """The pictures of a run, by name, for a batch of records, its estimate and its free run."""
    figures = {
        "acceleration": acceleration(record, estimate),
        "error_over_time": error_over_time(errors, record.dt, record.warmup),
    }
    if free_run is not None:
        figures["free_run_acceleration"] = free_run_acceleration(record, free_run)
        figures["free_run_displacement"] = free_run_displacement(record, free_run)
    if record.truth is not None:
        figures["element_loops"] = element_loops(record, elements)
    return figures


def save_figure(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write a figure as PNG and PDF."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{name}.{kind}" for kind in ("png", "pdf")]
    for path in paths:
        figure.savefig(path, dpi=150)
    return paths


def _first(signal: Tensor) -> np.ndarray:
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
