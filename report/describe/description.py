"""Describe a run's model: what it reads, its physical parameters, modes of small motions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

from data.record import QUANTITIES
from data.sample import Sensors
from data.terminal import terminal
from export.modes import Modes, modes_of
from models.estimator import Estimator, Parameter
from models.fit.metrics import FREE_RUNS
from report.describe.tables import WIDTH, print_elements, print_modes, print_rest
from report.output import save_figure
from report.prediction.interface import Interface
from report.style import ESTIMATED, MEASURED, one_legend
from runner.folder.run import restore, sensors_of
from runner.folder.run_files import results_folder
from runner.folder.run_folder import read_run, write_json
from runner.scores.headline import interval_in


def describe(folder: Path, output: Path | None) -> dict[str, Any]:
    """Print what a run's model is; write all of it as JSON to `output`, shapes as a picture.

    Returns what the JSON holds. Raises ValueError for a folder that holds no finished run.
    """
    run, metrics = read_run(folder)
    estimator = restore(run, folder)
    sensors = sensors_of(run, folder)
    parameters, modes = estimator.physical_parameters(), modes_of(estimator)
    console = terminal(WIDTH)
    _print_about(console, metrics, estimator, sensors)
    _print_parameters(console, parameters, estimator, metrics)
    if modes is not None:
        print_modes(console, modes)
    content = _content(metrics, estimator, parameters, modes)
    if output is not None:
        output.parent.mkdir(parents=True, exist_ok=True)
        write_json(output, content)
        console.print(f"all {len(parameters)} parameters: {output}", soft_wrap=True)
    elif parameters:
        console.print(f"output=FILE.json writes all {len(parameters)} parameters")
    if modes is not None and len(modes.frequencies):
        place = results_folder(folder) / "description" if output is None else output.parent
        name = "modes" if output is None else f"{output.stem}_modes"
        title = f"small motions of {metrics['model']} on {metrics['system']}"
        place.mkdir(parents=True, exist_ok=True)
        save_figure(draw_modes(modes, title), place, name)
        console.print(f"shapes: {place / name}.png", soft_wrap=True)
    return content


def _print_about(
    console: Console, metrics: Mapping[str, Any], estimator: Estimator, sensors: Sensors
) -> None:
    """Which model it is, how good, what it reads and what it estimates."""
    console.print(f"{metrics['model']} identified on {metrics['system']}, {metrics['scenario']}")
    verdict = metrics.get("verdict", {})
    if verdict.get("identified") is False:
        console.print(f"not identified: {verdict['reason']}")
    free = metrics.get(FREE_RUNS["test"], {})
    error = free.get("relative_rms_percent")
    if error is not None:
        console.print(f"free-run error of the test motion: {error:.3g} %")
    elif free:
        console.print(f"free run of the test motion: {free.get('none', 'diverges')}")
    symbol, unit = QUANTITIES[sensors.quantity]
    read = Interface.of(estimator, sensors).channels
    listed = ", ".join(read[:8]) + (f", … ({len(read)})" if len(read) > 8 else "")
    console.print(
        f"driven by {listed}; estimates the {sensors.quantity} {symbol} [{unit}] of "
        f"{sensors.dofs} {'DOF' if sensors.dofs == 1 else 'DOFs'} every {sensors.dt:g} s"
    )


def _print_parameters(
    console: Console,
    parameters: list[Parameter],
    estimator: Estimator,
    metrics: Mapping[str, Any],
) -> None:
    if not parameters:
        signals = {"a": "measured accelerations", "f": "the excitation", "x": "displacements",
                   "v": "velocities"}  # fmt: skip
        read = ", ".join(signals.get(name, name) for name in estimator.reads)
        console.print(
            f"a black box of {estimator.identified_parameters} identified parameters: it reads "
            f"{read} and has no physical parameters"
        )
        return
    if estimator.scale_is_open:
        console.print(
            "no force and no mass was given in training: masses, stiffnesses and forces are known "
            "up to a common factor; model.masses sets it"
        )
    if estimator.laws_are_curves:
        console.print("laws are general curves; the values below are of a slow monotonic push")
    trained = metrics.get("trained_range", {})
    print_elements(console, parameters, trained)
    print_rest(console, parameters, trained)


def _content(
    metrics: Mapping[str, Any],
    estimator: Estimator,
    parameters: list[Parameter],
    modes: Modes | None,
) -> dict[str, Any]:
    """All of it as plain data; numbers that are not finite are null."""
    sure = {p["name"]: p for p in metrics.get("uncertainty", {}).get("parameters", [])}
    listed = [
        asdict(p) | {"value": _finite(p.value)} | interval_in(sure.get(p.name)) for p in parameters
    ]
    content: dict[str, Any] = {
        "model": metrics["model"],
        "system": metrics["system"],
        "identified": metrics.get("verdict", {}).get("identified"),
        "free_run_percent": metrics.get(FREE_RUNS["test"], {}).get("relative_rms_percent"),
        "identified_parameters": estimator.identified_parameters,
        "common_factor_is_open": estimator.scale_is_open,
        "parameters": listed,
    }
    if modes is not None:
        content["modes"] = [
            {
                "frequency_hz": _finite(f),
                "damping_ratio": _finite(d),
                "shape_real": [_finite(s.real) for s in shape],
                "shape_imaginary": [_finite(s.imag) for s in shape],
            }
            for f, d, shape in zip(modes.frequencies, modes.damping, modes.shapes.T, strict=True)
        ]
    return content


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


# A picture of the shapes of small motions, DOF over DOF, a mode each.

MOST = 12  # modes that are drawn, the slowest


def draw_modes(modes: Modes, title: str) -> Figure:
    """Displacement of every DOF in each mode; faint: the part that is out of phase."""
    count, dofs = min(MOST, len(modes.frequencies)), len(modes.shapes)
    columns = min(6, count)
    rows = -(-count // columns)
    height = 1.2 + 0.22 * min(max(dofs, 4), 12)
    figure = Figure(figsize=(0.8 + 1.5 * columns, 0.7 + rows * height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    place = np.arange(dofs + 1)
    for i, ax in enumerate(axes[:count]):
        shape = np.concatenate([[0.0], modes.shapes[:, i]])
        ax.axvline(0.0, color="#bbbbbb", linewidth=0.8)
        if np.abs(shape.imag).max() > 0.02:
            ax.plot(shape.imag, place, ":", color=ESTIMATED, linewidth=1.0, label="out of phase")
        ax.plot(
            shape.real, place, ".-", color=MEASURED, linewidth=1.2, markersize=6, label="in phase"
        )
        hertz, share = modes.frequencies[i], 100.0 * modes.damping[i]
        ax.set_title(f"{hertz:.3g} Hz, {share:.2g} %", fontsize=8)
        ax.set_xlim(-1.15, 1.15)
        ax.tick_params(labelsize=7)
        step = -(-dofs // 12)
        ax.set_yticks(place[::step], ["rest", *(f"x{j}" for j in place[1:])][::step])
    for ax in axes[count:]:
        ax.set_visible(False)
    more = (
        f", the slowest {count} of {len(modes.frequencies)}"
        if count < len(modes.frequencies)
        else ""
    )
    figure.suptitle(f"{title}{more}", fontsize=9)
    for ax in axes[max(0, count - columns) : count]:
        ax.set_xlabel("shape [–]", fontsize=8)
        ax.tick_params(labelbottom=True)
    one_legend(figure, axes[:count], loc="outside lower center", ncols=2, fontsize=8)
    return figure
