"""What predict.py does: the response of a run's model to some motions, as files and pictures."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console

from data.parallel import take_threads
from data.record import HOLDS, QUANTITIES, Drive, require_bearable
from data.terminal import Line, terminal
from data.whole_file import whole_file, write_text
from export.passport import hold_of
from models.composition.composite import Composite
from models.estimator import Estimator
from models.fit.metrics import FREE_RUNS
from models.stored.run import StoredRun, read_run
from models.uncertainty.draws import draws_of
from models.uncertainty.parameters import set_free_vector
from report.output import as_csv, save_figure
from report.prediction.fragility import (
    ENDS,
    FEWEST,
    Curve,
    curves_of,
    draw_curves,
    intensities_of,
    limits_of,
    peaks_of_runs,
    print_curves,
    print_peaks,
)
from report.prediction.interface import GROUND, SUPPORTS, Interface
from report.prediction.motions import Motion, motions_of, stem
from report.prediction.peaks import (
    MOST_ROWS,
    largest,
    leading,
    peaks_of,
    print_one,
    print_runs,
    row_of,
)
from report.prediction.runs import Prediction, Runner, Signal, parts_of
from report.run.building import write_storeys
from report.run.table import print_verdict
from report.style import APART, DASHES, DRAWN, ESTIMATED, MEASURED, finish_loop, panels, titled
from report.uncertainty.command import Finished, finished_of
from runner.config.settings import Wanted, Written
from runner.folder.run import restore
from runner.scores.conformal import FREE_RUN, stored_band
from runner.scores.grade import NOTHING, SIMULATES
from runner.scores.verdict import divergence

FEW = 10  # runs whose histories are written unless that is asked for, and responses of storeys
MOST = 100_000


def predict(
    folder: Path, wanted: Wanted, written: Written, output: Path
) -> tuple[list[Prediction], list[Curve]]:
    """Free runs of a finished run's model under the motions that are wanted, printed and written.

    With `limits`, also fragility curves. Raises ValueError for a model that is not identified,
    unless `anyway`, for motions that do not fit the model, and for limits and samples of what it
    does not have.
    """
    scales = _scales(wanted.scale)
    run = read_run(folder)
    metrics, estimator = run.metrics, restore(run)
    if not written.anyway:
        require_usable(metrics, folder)
    interface = Interface.of(estimator, run.sensors)
    any_step = isinstance(estimator, Composite) or _takes(estimator, 2.0 * estimator.dt)
    motions = motions_of(wanted, run.experiment, interface, estimator.dt, any_step)
    if len(motions) * len(scales) > MOST:
        raise ValueError(f"{len(motions)} motions at {len(scales)} scales are more than {MOST}")
    hold = wanted.hold or hold_of(run.experiment.data.values)
    if hold not in HOLDS:
        raise ValueError(f"excitation.hold={hold}: choose {', '.join(HOLDS)}")
    trained = metrics.get("trained_range", {})
    band = stored_band(metrics.get("uncertainty", {}), FREE_RUN)
    own, numbers = run.sensors.quantity, run.sensors.numbers
    few = len(motions) * len(scales) <= FEW
    runner = Runner(estimator, interface, own, trained, hold, wanted.lag, band, numbers, few)
    about = f"{metrics['model']} identified on {metrics['system']}"
    results = Results(terminal(), estimator, about, written, output)
    console = results.console
    _print_motions(console, motions, interface, estimator, metrics)
    cores = written.threads or len(os.sched_getaffinity(0))
    for motion in motions:
        for channel, values in motion.channels.items():
            most = max(abs(scale) for scale in scales)
            require_bearable(f"{motion.name}: {channel} × {most:g}", most * values)
    whole, count = (motions, scales, max(1, cores)), len(motions) * len(scales)
    predictions = runner.many(*whole)
    first = next(predictions)
    limits = limits_of(written.limits, first, getattr(estimator, "heights", None))
    intensities = intensities_of(motions, estimator, interface.others) if limits else []
    still = [motions[i].name for _, _, sizes in intensities for i in np.flatnonzero(sizes == 0.0)]
    if still:
        raise ValueError(f"limits= need motions of some intensity: {still[0]} is zero throughout")
    earthquakes = [m.name[:-1] if wanted.events is not None else m.name for m in motions]
    if limits and len(set(earthquakes)) < FEWEST:
        raise ValueError(
            f"limits= needs {FEWEST} earthquakes at least, for a curve over the intensity; there "
            f"are {len(set(earthquakes))}: give more in excitation.events or excitation.path"
        )
    finished = None
    if written.samples and next(estimator.likely(), None) is None:
        try:
            finished = finished_of(run)
        except ValueError as error:
            raise ValueError(f"samples={written.samples}: {error}; or leave samples out") from None
    output.mkdir(parents=True, exist_ok=True)
    if count == 1:
        found = [first]
        results.finish_one(first)
    else:
        found = results.finish_many(chain([first], predictions), count)
    storeys = [row for prediction in found for row in prediction.storeys]
    write_storeys(storeys, estimator, output, written.figures)
    runs: Iterator[Prediction] = iter(found)
    if written.samples:
        models = _draw(results, finished, run)
        runs = _counting(runner.many(*whole, models), len(found) * len(models))
    curves: list[Curve] = []
    if written.samples or limits or len(found) > MOST_ROWS:
        peaks = peaks_of_runs(runs, len(motions), scales)
        print_peaks(console, peaks, about)
        write_text(output / "statistics.csv", as_csv(peaks.rows()))
    if limits:
        curves = curves_of(peaks, limits, intensities, earthquakes)
        results.finish_curves(curves)
    if first.integrated:
        console.print(
            "displacements and velocities are integrals of the simulated accelerations, and add "
            "up their errors: they drift"
        )
    if metrics.get("verdict", {}).get("grade", {}).get("grade") != SIMULATES:
        print_verdict(console, metrics)
    console.print(f"written to {output}", soft_wrap=True)
    return found, curves


@dataclass(frozen=True)
class Results:
    """What is printed, written and drawn of a model's responses, in a folder."""

    console: Console
    estimator: Any
    about: str  # the model and its structure, of which it was identified
    written: Written
    folder: Path

    def finish_one(self, prediction: Prediction) -> None:
        """Peaks and the time history of a single run."""
        times = "" if prediction.scale == 1.0 else f" × {prediction.scale:g}"
        title = f"{prediction.name}{times}: {self.about}"
        print_one(self.console, prediction, self.estimator, title)
        write_text(self.folder / "peaks.csv", as_csv(peaks_of(prediction, self.estimator)))
        write_history(prediction, self.folder / "history.csv")
        if self.written.figures:
            for name, figure in draw_one(prediction, self.estimator, title).items():
                save_figure(figure, self.folder, name)

    def finish_many(self, predictions: Iterator[Prediction], count: int) -> list[Prediction]:
        """A row for each run; histories too where there are few, or on request."""
        histories = self.written.histories
        whole = histories if histories is not None else count <= FEW
        found, rows, places = [], [], list[str]()
        for prediction in predictions:
            row = row_of(prediction, self.estimator)
            rows.append(row)
            if whole:
                place = f"{stem(prediction.name)}_x{prediction.scale:g}"
                places.append(place)
                more = f"_{places.count(place)}" if places.count(place) > 1 else ""
                write_history(prediction, self.folder / f"{place}{more}.csv")
            found.append(replace(prediction.slim(), row=row))
        if len(found) <= MOST_ROWS:
            print_runs(self.console, found, self.about)
        write_text(self.folder / "predictions.csv", as_csv(rows))
        if not whole:
            self.console.print(
                "only peaks were written; histories=true writes the history of each run"
            )
        if self.written.figures:
            save_figure(draw_many(found, self.about), self.folder, "predictions")
        return found

    def finish_curves(self, curves: list[Curve]) -> None:
        """Fragility curves."""
        print_curves(self.console, curves, self.written.samples is not None)
        write_text(self.folder / "fragility.csv", as_csv([curve.row for curve in curves]))
        if self.written.figures:
            save_figure(draw_curves(curves, self.about), self.folder, "fragility")


def _draw(results: Results, finished: Finished | None, run: StoredRun) -> list[Estimator]:
    """Models that the training records leave as likely as the identified one.

    finished: with its records; None of a model that keeps its likely laws itself.
    """
    estimator, written, console = results.estimator, results.written, results.console
    count = written.samples or 0
    if finished is None:
        laws = list(estimator.likely())[:count]
        console.print(f"draws: {len(laws)} laws that are as likely, of {count} asked for")
        return [estimator.with_laws(one) for one in laws]
    begun, line = time.monotonic(), Line()
    line.tell("draws: searching the likeliest parameters".__str__)

    def note(steps: int, most: int) -> None:
        left = (time.monotonic() - begun) * (most - steps) / steps
        line.tell(f"draws: step {steps} of at most {most}, at most {left:.0f} s left".__str__)

    batches = finished.data.loader("train")
    take_threads(written.threads)
    draws = draws_of(finished.model, batches, finished.found, count, written.seed, note)
    take_threads(1)  # for each of the runs side by side
    line.clear()
    low, high = (100.0 * (ratio - 1.0) for ratio in np.quantile(draws.misfit, (0.025, 0.975)))
    console.print(
        f"draws: {count}; the error of 95 % of them on the training records is {low:.2g} to "
        f"{high:.2g} % larger than that of the likeliest parameters"
    )
    beware = ["draws spread too little in directions that the records do not determine"]
    beware += [] if draws.settled else ["the chains of draws had not converged"]
    few = f"intervals of fewer than {ENDS} draws are too narrow"
    beware += [few] if count < ENDS else []
    lacks = run.metrics.get("uncertainty", {}).get("model_lacks_terms")
    beware += ["the model lacks terms, and draws do not contain that error"] if lacks else []
    console.print(f"beware: {'; '.join(beware)}")
    models: list[Estimator] = []
    for theta in draws.theta:
        set_free_vector(finished.model, torch.from_numpy(theta))
        models.append(deepcopy(finished.model))
    return models


def _counting(runs: Iterator[Prediction], total: int) -> Iterator[Prediction]:
    """Show how many runs are done, and for how long others will last."""
    begun, line = time.monotonic(), Line()
    for done, run in enumerate(runs, start=1):
        left = (time.monotonic() - begun) * (total - done) / done
        line.tell(f"{done} of {total} runs, {left:.0f} s left".__str__)
        yield run
    line.clear()


def require_usable(metrics: Mapping[str, Any], folder: Path) -> None:
    """Raise ValueError for a run whose model identified nothing, cannot simulate, or diverges."""
    verdict = metrics.get("verdict", {})
    anyway = "train another, or say anyway=true"
    own = metrics.get(FREE_RUNS["train"], {})
    if verdict.get("identified") is False:
        raise ValueError(f"{folder}: its model is not identified: {verdict['reason']}; {anyway}")
    grade = verdict.get("grade", {})
    if grade.get("grade") == NOTHING:
        raise ValueError(f"{folder}: its model is not identified: {grade['reason']}; {anyway}")
    if "no_free_run" in own:
        raise ValueError(f"{folder}: its model cannot simulate: {own['no_free_run']}")
    if lost := divergence(metrics):
        raise ValueError(f"{folder}: {lost}; {anyway}")


def _takes(estimator: Estimator, dt: float) -> bool:
    """Whether a model runs at another time step than its own."""
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
        own = (re.sub(r"^times \S+, ", "", n) if len(motions) > 1 else n for n in motion.notes)
        notes.setdefault(tuple(dict.fromkeys(own)), []).append(motion.name)
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


# Pictures of predictions: histories and loops of one run; peaks over the scale of many.

MOST_DRAWN = 8  # rows that are drawn, those with the largest peaks


def draw_one(prediction: Prediction, estimator: Estimator, title: str) -> dict[str, Figure]:
    """Histories of excitation and outputs; loops of the elements where there are any."""
    drawn = {"history": _histories(prediction, estimator, title)}
    y, r = prediction.signal("deformation"), prediction.signal("loop")
    if y is not None and r is not None:
        drawn["loops"] = _loops(y, r, parts_of(r, estimator), title)
    imposed = [s for s in prediction.signals if s.symbol == "s"]
    force = prediction.signal("force")
    if force is not None and len(imposed) == force.values.shape[1]:
        s = Signal("deformation", "s", "m", force.names, np.hstack([u.values for u in imposed]))
        drawn["loops"] = _loops(s, force, parts_of(force, estimator), title)
    return drawn


def _histories(prediction: Prediction, estimator: Estimator, title: str) -> Figure:
    """The excitation above, then positions and drifts of storeys, or else all outputs."""
    inputs = [s for s in prediction.signals if s.kind == "input" and s.symbol != "s_dot"]
    kinds = {*QUANTITIES, *(["deformation"] if prediction.storeys else [])}
    outputs = [s for s in prediction.signals if s.kind in kinds and s.symbol != "v"]
    panels = [*inputs, *outputs]
    if len(inputs) > 2:  # forces on many DOFs share a panel
        values = np.hstack([s.values for s in inputs])
        numbers = [f"{s.symbol}{s.names[0]}" for s in inputs]
        panels = [Signal("input", "", inputs[0].unit, numbers, values), *outputs]
    figure = Figure(figsize=(8.0, 1.0 + 1.9 * len(panels)), layout="constrained")
    axes = np.atleast_1d(figure.subplots(len(panels), 1, sharex=True))
    t = prediction.dt * np.arange(len(panels[0].values))
    for ax, signal in zip(axes, panels, strict=True):
        _history(ax, t, signal, parts_of(signal, estimator))
    axes[-1].set_xlabel("time [s]")
    titled(figure, title)
    return figure


def _history(ax: Axes, t: np.ndarray, signal: Signal, names: Sequence[str]) -> None:
    sizes = np.abs(np.nan_to_num(signal.values, posinf=0.0, neginf=0.0)).max(axis=0)
    shown = sorted(np.argsort(-sizes, kind="stable")[:MOST_DRAWN].tolist())
    for place, i in enumerate(shown):
        alone = MEASURED if signal.kind == "input" else ESTIMATED
        colour = alone if len(shown) == 1 else APART[place % len(APART)]
        dash = DASHES[place % len(DASHES)]
        ax.plot(t, signal.values[:, i], color=colour, linestyle=dash, linewidth=0.8, label=names[i])
        if signal.half is not None:
            low, high = (signal.values[:, i] + way * signal.half[:, i] for way in (-1.0, 1.0))
            ax.fill_between(t, low, high, color=colour, alpha=0.2, linewidth=0.0)
    unit = f" [{signal.unit.replace('^2', '²')}]" if signal.unit else ""
    words = {"input": "excitation", "deformation": "drift"}.get(signal.kind, signal.kind)
    ax.set_ylabel(f"{words}\n{unit.strip()}", fontsize=8)
    ax.set_xlim(t[0], t[-1])
    ax.grid(alpha=0.25)
    ax.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    if len(sizes) > len(shown):
        ax.set_title(f"the {len(shown)} largest of {len(sizes)}", fontsize=7, loc="right")


def _loops(y: Signal, r: Signal, names: Sequence[str], title: str) -> Figure:
    """Force over deformation, an element each."""
    sizes = np.abs(np.nan_to_num(r.values)).max(axis=0)
    shown = sorted(np.argsort(-sizes, kind="stable")[:DRAWN].tolist())
    figure, drawn = panels(len(shown), 2.6, 2.3, more=(1.5, 0.8), layout="constrained")
    for ax, i in zip(drawn, shown, strict=True):
        ax.plot(y.values[:, i], r.values[:, i], color=ESTIMATED, linewidth=0.7)
        finish_loop(ax, names[i], "", "")
        ax.tick_params(labelsize=7)
        ax.ticklabel_format(scilimits=(-3, 4))
    figure.supxlabel("deformation [m]", fontsize=8)
    figure.supylabel("force [N]", fontsize=8)
    titled(figure, title)
    return figure


def draw_many(predictions: Sequence[Prediction], title: str) -> Figure:
    """The largest deformation, or output, of each motion over its scale, or by name at one scale.

    Lines join the runs of a motion.
    """
    kind, words, unit = leading(predictions)
    names = list(dict.fromkeys(p.name for p in predictions))
    scales = sorted({p.scale for p in predictions})
    alone = len(scales) == 1
    height = max(2.0, 0.9 + 0.19 * len(names)) if alone else 4.6
    figure = Figure(figsize=(6.4, height), layout="constrained")
    ax = figure.subplots()
    inside, outside = ("inside the trained range", ".", "#0072B2"), ("outside it", "x", ESTIMATED)
    for beyond, (label, mark, colour) in enumerate((inside, outside)):
        own = [p for p in predictions if p.left is None and bool(p.outside) == beyond]
        at = [names.index(p.name) if alone else p.scale for p in own]
        sizes = np.array([largest(p, kind) for p in own], dtype=float)
        ax.plot(sizes, at, mark, color=colour, markersize=5, label=label)
    if alone:
        ax.set_yticks(range(len(names)), names, fontsize=7)
        ax.invert_yaxis()
    else:
        peaks = {(p.name, p.scale): largest(p, kind) for p in predictions}
        table = np.array([[peaks[n, s] for s in scales] for n in names], dtype=float)
        ax.plot(table.T, scales, color="#bbbbbb", linewidth=0.7, zorder=1)
        median = np.quantile(np.nan_to_num(table, nan=np.inf), 0.5, axis=0, method="lower")
        finite = np.where(np.isinf(median), np.nan, median)
        ax.plot(finite, scales, color=MEASURED, linewidth=1.8, label="median")
        ax.set_ylabel("scale of the motion")
        ax.set_ylim(bottom=0.0)
    ax.set_xlabel(f"largest {words} [{unit}]")
    ax.set_xlim(left=0.0)
    ax.legend(fontsize=7, loc="lower right")
    ax.grid(alpha=0.25)
    titled(figure, title)
    return figure
