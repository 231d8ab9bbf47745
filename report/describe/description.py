"""Describe a run's model: what it reads, its physical parameters, modes of small motions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console

from data.record import QUANTITIES
from data.sample import Sensors
from data.terminal import terminal
from export.modes import Modes, modes_of
from models.branch_element import BranchElement
from models.element_network_branch import ElementNetworkBranch
from models.estimator import Estimator
from models.physical.parameters import Parameter, parameters_of, scale_is_open
from models.training.metrics import FREE_RUNS
from report.describe.figure import draw_modes
from report.describe.tables import WIDTH, print_elements, print_modes, print_rest
from report.output import save_figure
from report.prediction.interface import Interface
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
    parameters, modes = parameters_of(estimator), modes_of(estimator)
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
        console.print(f"all {len(parameters)} parameters, as numbers: output=FILE.json")
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
        console.print(f"its free run of the test motion errs by {error:.3g} %")
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
            f"{read}, and holds no physical parameter"
        )
        return
    if scale_is_open(estimator):
        console.print(
            "no force and no mass was given in training: masses, stiffnesses and forces are known "
            "but for a common factor; model.masses sets it"
        )
    if isinstance(estimator, BranchElement | ElementNetworkBranch):
        console.print("laws are curves; below, what they are under a slow push from rest")
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
        "common_factor_is_open": scale_is_open(estimator),
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
