"""Pictures of one run: acceleration measured against estimated, error over time, element loops."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from matplotlib.figure import Figure
from torch import Tensor

from data.record import QUANTITIES, Record, Response
from models.fit.metrics import displacement_of
from models.uncertainty.unmeasured import DISPLACEMENT, FORCE, Signal
from report.run.compared import LOOPS, compared, few_cycles, first_of
from report.style import DASHES, ESTIMATED, MEASURED, NARROW, TRUE, WIDE, placed, titled

LEGEND = 3.0  # width [inches]
MOST_LOOPS = 12  # elements that are drawn, those with the largest forces


def acceleration(
    record: Record, estimate: Tensor, seconds: float | None = None, band: Tensor | None = None
) -> Figure:
    """Draw the measured and the estimated output of each DOF (Figs. 9–11), with a band (T, n)."""
    signals = {"measured": record.a, "estimated": estimate}
    return compared(record, signals, *_output(record), seconds, band)


def free_run_acceleration(
    record: Record, response: Response, seconds: float | None = None, band: Tensor | None = None
) -> Figure:
    """Draw the output of each DOF against that of the free run.

    Against the measured one where there is a band (T, n), of which 95 % should lie in it.
    """
    known = {"measured": record.a}
    if record.truth is not None and band is None:
        known = {"true": record.truth.a}
    signals = {**known, "free run": response.a}
    return compared(record, signals, *_output(record), seconds, band)


def _output(record: Record) -> tuple[list[str], str]:
    """Names of what is measured, one for each DOF, and its unit."""
    symbol, unit = QUANTITIES[record.quantity]
    return [f"{symbol}{i + 1}" for i in range(record.dofs)], unit


def free_run_displacement(
    record: Record, response: Response, seconds: float | None = None, band: Tensor | None = None
) -> Figure:
    """Draw the displacement of each DOF against that of the free run, with a band (T, n)."""
    displacement = displacement_of(record)
    assert displacement is not None
    known = "measured" if record.truth is None else "true"
    signals = {known: displacement, "free run": response.x}
    names = [f"x{i + 1}" for i in range(record.dofs)]
    return compared(record, signals, names, "m", seconds, band)


def element_forces(record: Record, forces: Signal, names: list[str]) -> Figure:
    """Draw the force of each element in the free run with its band, the true one if known.

    Of many elements those with the largest forces. names: of all elements, or none.
    """
    largest = forces.run.nan_to_num().abs().amax(dim=0)
    chosen = sorted(largest.argsort(descending=True)[:MOST_LOOPS].tolist())
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
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(3.0 * columns, 2.5 * rows))
    for i, name in enumerate(names):
        axes = figure.add_subplot(rows, columns, i + 1)
        axes.plot(y[:, i], r[:, i], color=MEASURED, linewidth=0.5)
        axes.set_title(name, fontsize="medium")
        axes.set_xlabel("y [m]")
        axes.locator_params(axis="x", nbins=4)  # numbers such as −0.0025 are wide
        axes.set_ylabel("true r [N]")
        axes.grid(alpha=0.25)
    return figure


def identified_loops(deformations: Tensor, forces: Tensor, names: list[str]) -> Figure:
    """Force against deformation (…, T, E) of a model's elements in its free run.

    Of many elements those with the largest forces, in the cycles in which most happens.
    names: of all elements, or none.
    """
    y, r = first_of(deformations), first_of(forces)
    chosen = np.sort(np.argsort(-np.abs(r).max(axis=0), kind="stable")[:MOST_LOOPS])
    part = few_cycles(y, slice(0, len(y)), LOOPS)
    y, r = y[part], r[part]
    columns = min(3, len(chosen))
    rows = -(-len(chosen) // columns)
    figure = Figure(figsize=(3.0 * columns, 2.5 * rows + 0.4))
    for place, i in enumerate(chosen, start=1):
        axes = figure.add_subplot(rows, columns, place)
        axes.plot(y[:, i], r[:, i], color=ESTIMATED, linewidth=NARROW)
        axes.set_title(names[i] if names else f"element {i + 1}", fontsize="medium")
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
    figure = Figure(figsize=(4.6 * record.dofs, 3.8))
    for i in range(record.dofs):
        axes = figure.add_subplot(1, record.dofs, i + 1)
        axes.plot(s[:, i], measured[:, i], color=TRUE, linewidth=0.5 * WIDE, label="measured")
        axes.plot(s[:, i], own[:, i], color=ESTIMATED, linewidth=NARROW, label="model")
        axes.set_xlabel(f"imposed deformation s{i + 1} [m]")
        axes.set_ylabel(f"force r{i + 1} [N]")
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
            titled(figure, title, LEGEND if figure.legends else 0.0)
        placed(figure)
    return figures
