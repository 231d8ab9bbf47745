"""Pictures of one run: acceleration measured against estimated, error over time, element loops."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from data.record import Record

MEASURED, ESTIMATED = "#222222", "#d1495b"


def acceleration(record: Record, estimate: Tensor, seconds: float = 10.0) -> Figure:
    """Measured and estimated acceleration of each DOF, `seconds` from the middle (Figs. 9–11)."""
    measured, estimated = _first(record.a), _first(estimate)
    count = min(record.samples, max(2, round(seconds / record.dt)))
    start = (record.samples - count) // 2
    span = slice(start, start + count)
    t = record.dt * np.arange(record.samples)[span]
    figure = Figure(figsize=(9.0, 1.9 * record.dofs + 0.8), layout="constrained")
    for i, axes in enumerate(_rows(figure, record.dofs)):
        axes.plot(t, measured[span, i], color=MEASURED, linewidth=1.6, label="measured")
        axes.plot(t, estimated[span, i], color=ESTIMATED, linewidth=1.0, label="estimated")
        axes.set_ylabel(f"ẍ{i + 1} [m/s²]")
        axes.margins(x=0.0)
    axes.set_xlabel("time [s]")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=2, frameon=False)
    return figure


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
    record: Record, estimate: Tensor, errors: dict[str, Tensor], elements: list[str]
) -> dict[str, Figure]:
    """The pictures of a run, by name, for a batch of records and its estimate."""
    figures = {
        "acceleration": acceleration(record, estimate),
        "error_over_time": error_over_time(errors, record.dt, record.warmup),
    }
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
