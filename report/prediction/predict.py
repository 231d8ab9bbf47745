"""What predict.py does: the response of a run's model to some motions."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.console import Console

from data.record import HOLDS, require_bearable
from data.terminal import terminal
from data.whole_file import whole_file, write_text
from models.composition.composite import Composite
from models.estimator import Estimator
from models.fit.metrics import FREE_RUNS
from models.stored.run import read_run
from report.output import as_csv, save_figure
from report.prediction.figures import draw_many, draw_one
from report.prediction.interface import GROUND, SUPPORTS, Interface
from report.prediction.motions import Motion, Wanted, motions_of, stem
from report.prediction.peaks import peaks_of, print_many, print_one, row_of
from report.prediction.runs import Prediction, Runner
from report.run.table import WIDTH
from runner.folder.run import restore
from runner.scores.conformal import FREE_RUN, stored_band

FEW = 10  # runs whose histories are written unless that is asked for
MOST = 100_000


@dataclass(frozen=True)
class Written:
    """What is written, and whether of any model: settings of conf/predict.yaml."""

    figures: bool = True
    histories: bool | None = None
    threads: int | None = None
    anyway: bool = False


def predict(folder: Path, wanted: Wanted, written: Written, output: Path) -> list[Prediction]:
    """Free runs of a finished run's model under the motions that are wanted, printed and written.

    Raises ValueError for a model that is not identified, unless `anyway`, and for motions that do
    not fit the model.
    """
    scales = _scales(wanted.scale)
    run = read_run(folder)
    metrics, estimator = run.metrics, restore(run)
    if not written.anyway:
        require_usable(metrics, folder)
    interface = Interface.of(estimator, run.sensors)
    any_step = isinstance(estimator, Composite) or _takes(estimator, interface, 2.0 * estimator.dt)
    motions = motions_of(wanted, run.experiment, interface, estimator.dt, any_step)
    if len(motions) * len(scales) > MOST:
        raise ValueError(f"{len(motions)} motions at {len(scales)} scales are more than {MOST}")
    hold = wanted.hold or run.experiment.data.values.get("hold") or "linear"
    if hold not in HOLDS:
        raise ValueError(f"excitation.hold={hold}: choose {', '.join(HOLDS)}")
    trained = metrics.get("trained_range", {})
    band = stored_band(metrics.get("uncertainty", {}), FREE_RUN)
    runner = Runner(estimator, interface, run.sensors.quantity, trained, hold, wanted.lag, band)
    console = terminal(WIDTH)
    _print_motions(console, motions, interface, estimator, metrics)
    about = f"{metrics['model']} identified on {metrics['system']}"
    cores = written.threads or len(os.sched_getaffinity(0))
    predictions = runner.many(motions, scales, max(1, cores))
    for motion in motions:
        for channel, values in motion.channels.items():
            largest = max(abs(scale) for scale in scales)
            require_bearable(f"{motion.name}: {channel} × {largest:g}", largest * values)
    output.mkdir(parents=True, exist_ok=True)
    if len(motions) * len(scales) == 1:
        found = [next(predictions)]
        _finish_one(console, found[0], estimator, about, written, output)
    else:
        found = _finish_many(
            console, predictions, len(motions) * len(scales), estimator, about, written, output
        )
    console.print(f"written to {output}", soft_wrap=True)
    return found


def require_usable(metrics: Mapping[str, Any], folder: Path) -> None:
    """Raise ValueError for a run whose model identified nothing, cannot simulate, or diverges."""
    verdict = metrics.get("verdict", {})
    anyway = "train another, or say anyway=true"
    own = metrics.get(FREE_RUNS["train"], {})
    if verdict.get("identified") is False:
        raise ValueError(f"{folder}: its model is not identified: {verdict['reason']}; {anyway}")
    if "no_free_run" in own:
        raise ValueError(f"{folder}: its model cannot simulate: {own['no_free_run']}")
    for split, words in (("train", "training"), ("test", "test")):
        left = metrics.get(FREE_RUNS[split], {}).get("diverged_after_s")
        if left:
            raise ValueError(
                f"{folder}: the free run of its own {words} motion diverges after "
                f"{min(left):.3g} s; {anyway}"
            )


def _takes(estimator: Estimator, interface: Interface, dt: float) -> bool:
    """Whether a model runs at another time step than its own."""
    from data.record import Drive

    rest = torch.zeros(estimator.dofs, dtype=torch.float64)
    try:
        estimator.check(Drive(dt, torch.zeros(4, estimator.inputs).double(), rest, rest))
    except ValueError:
        return False
    return True


def _scales(scale: float | Sequence[float]) -> list[float]:
    """The scale factors. Raises ValueError for one that is no positive number, or comes twice."""
    scales = [float(s) for s in ([scale] if isinstance(scale, int | float) else scale)]
    for value in scales:
        if not 0.0 < abs(value) < float("inf"):
            raise ValueError(f"excitation.scale={value:g} must be a factor other than 0")
    if not scales or len(set(scales)) < len(scales):
        raise ValueError(f"excitation.scale={scales}: expected factors, each once")
    return scales


def _print_motions(
    console: Console,
    motions: Sequence[Motion],
    interface: Interface,
    estimator: Estimator,
    metrics: Mapping[str, Any],
) -> None:
    """Print what was done to the motions, and the reference of displacements."""
    notes: dict[tuple[str, ...], list[str]] = {}
    for motion in motions:
        notes.setdefault(tuple(dict.fromkeys(motion.notes)), []).append(motion.name)
    for done, names in notes.items():
        if done:
            listed = ", ".join(names[:4]) + (f" … ({len(names)} motions)" if names[4:] else "")
            console.print(f"{listed}: {'; '.join(done)}")
    if any(GROUND in motion.channels for motion in motions) and interface.kind != SUPPORTS:
        how = " (applied as forces −m s̈)" if interface.masses is not None else ""
        console.print(
            f"the ground moves{how}: displacements and velocities are relative to it, "
            "accelerations absolute"
        )
    elif interface.kind == SUPPORTS:
        console.print("supports move: displacements, velocities and accelerations are absolute")
    if estimator.scale_is_open:
        console.print(
            "no force and no mass was given in training: forces of elements are known up to a "
            "common factor"
        )
    if "trained_range" not in metrics:
        console.print("this older run has no trained range to compare with; repeat it")


def _finish_one(
    console: Console,
    prediction: Prediction,
    estimator: Estimator,
    about: str,
    written: Written,
    output: Path,
) -> None:
    times = "" if prediction.scale == 1.0 else f" × {prediction.scale:g}"
    title = f"{prediction.name}{times}: {about}"
    print_one(console, prediction, estimator, title)
    write_text(output / "peaks.csv", as_csv(peaks_of(prediction, estimator)))
    write_history(prediction, output / "history.csv")
    if written.figures:
        for name, figure in draw_one(prediction, estimator, title).items():
            save_figure(figure, output, name)


def _finish_many(
    console: Console,
    predictions: Iterator[Prediction],
    count: int,
    estimator: Estimator,
    about: str,
    written: Written,
    output: Path,
) -> list[Prediction]:
    """Print and write a row for each run; histories too where there are few, or on request."""
    whole = written.histories if written.histories is not None else count <= FEW
    found, rows = [], []
    for prediction in predictions:
        rows.append(row_of(prediction, estimator))
        if whole:
            place = f"{stem(prediction.name)}_x{prediction.scale:g}.csv"
            write_history(prediction, output / place)
        found.append(prediction.slim())
    print_many(console, found, about)
    write_text(output / "predictions.csv", as_csv(rows))
    if not whole:
        console.print("only peaks were written; histories=true writes the history of each run")
    if written.figures:
        save_figure(draw_many(found, about), output, "predictions")
    return found


# The time history of a prediction as a file: a column each, with its unit, in SI.


def columns_of(prediction: Prediction) -> dict[str, np.ndarray]:
    """{"time [s]": (T,), "x1 [m]": …}, names that a measured record may have.

    Half widths of the 95 % band, where there is one, are under "half_a1 [m/s^2]".
    """
    samples = len(prediction.signals[0].values)
    columns = {"time [s]": prediction.dt * np.arange(samples)}
    for signal in prediction.signals:
        unit = f" [{signal.unit}]" if signal.unit else ""
        for number, values in zip(signal.names, signal.values.T, strict=True):
            columns[f"{signal.symbol}{number}{unit}"] = values
        if signal.half is not None:
            for number, half in zip(signal.names, signal.half.T, strict=True):
                columns[f"half_{signal.symbol}{number}{unit}"] = half
    return columns


def write_history(prediction: Prediction, path: Path) -> None:
    """Write all columns of a prediction as CSV."""
    columns = columns_of(prediction)
    head = ",".join(columns)
    table = np.column_stack(list(columns.values()))
    with whole_file(path) as aside:
        np.savetxt(aside, table, fmt="%.9g", delimiter=",", header=head, comments="")
