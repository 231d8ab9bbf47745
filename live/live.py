"""Follow a source of samples: estimate, learn and show, until it ends."""

from __future__ import annotations

import argparse
import gc
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import torch

from data.sample import Sample, Sensors
from data.terminal import Terminal
from live.monitor import LiveMonitor, ResidualAlarm, TimedAlarm
from live.source import Source, source_of
from live.view import LiveView, no_sound_sample, summary
from models.choice import Choice
from models.experiment import Experiment
from models.layers.features import SigmoidProducts
from models.linear_in_weights import require_linear
from models.online.adaptive import Online, stream_of
from models.online.guard import Guard
from models.online.laws.frozen import Frozen
from models.online.laws.law import Law
from models.online.stream import Stream, started
from models.stored.run import StoredRun, read_run
from runner.folder.run import restore
from runner.folder.run_folder import run_folder


@torch.no_grad()
def live(
    args: argparse.Namespace, kind: str, settings: Sequence[str], experiment: Experiment
) -> int:
    """Follow a source to its end, or to Ctrl-C; the exit status. Raises ValueError, OSError.

    experiment: choices of the finished run, or of a model that begins from nothing.
    """
    torch.set_num_threads(1)
    console = Terminal()
    with ExitStack() as stack:
        source, stream, trained = _opened(args, kind, settings, experiment, stack)
        dofs, dt = stream.estimator.dofs, stream.estimator.dt
        alarm = None if args.sound is None else ResidualAlarm(dofs, dt, args.sound)
        monitor = LiveMonitor(stream, source.period, trained)
        view = LiveView(monitor, source.lines, console, args.every)
        logs: list[EstimatesFile | Scalars] = []
        if args.output is not None:
            logs.append(EstimatesFile(Path(args.output), stream, args.force))
        if args.log is not None:
            logs.append(Scalars(Path(args.log), monitor, alarm))
        for log in logs:
            stack.callback(log.close)
        status = _watch(source, monitor, alarm, logs, view)
        view.tell()
        if status == 0 and not monitor.sound:
            raise ValueError(no_sound_sample(monitor, source.lines))
    for line in summary(monitor, source.lines):
        console.tell(line)
    return status


def _opened(
    args: argparse.Namespace,
    kind: str,
    settings: Sequence[str],
    experiment: Experiment,
    stack: ExitStack,
) -> tuple[Source, Stream, Mapping[str, Any]]:
    """The source, a stream of the run or from nothing that fits it, and the trained range."""
    if args.run is None:
        source = source_of(kind, args, experiment, None, stack)
        stream = stream_from_nothing(experiment, source.sensors)
        stream.watch.numbers = source.sensors.numbers
        return source, stream, {}
    new_law = any(word.startswith("adaptation") for word in settings)
    law = experiment.adaptation if new_law else None
    run = read_run(run_folder(args.run))
    stream = stream_of_run(run, law)
    source = source_of(kind, args, experiment, stream.estimator.dt, stack)
    source.sensors.check(stream.estimator)
    source.sensors.require_dofs_of(run.sensors)
    stream.watch.numbers = source.sensors.numbers
    for left, why in source.sensors.unread(stream.estimator).items():
        print(f"{left}: {why[0]}", file=sys.stderr)
    return source, stream, run.metrics.get("trained_range", {})


def _watch(
    source: Source,
    monitor: LiveMonitor,
    alarm: ResidualAlarm | None,
    logs: Sequence[EstimatesFile | Scalars],
    view: LiveView,
) -> int:
    gc.freeze()  # garbage is not searched for among all that is loaded: that takes milliseconds
    try:
        with view:
            follow(source, monitor, alarm, logs, view)
    except KeyboardInterrupt:
        return 130  # the status of a program that Ctrl-C ended
    finally:
        gc.unfreeze()
    return 0


def follow(
    source: Source,
    monitor: LiveMonitor,
    alarm: ResidualAlarm | None,
    logs: Sequence[EstimatesFile | Scalars],
    view: LiveView,
) -> None:
    """Estimate, learn and show, sample after sample."""
    stream, watch = monitor.stream, monitor.stream.watch
    for due, sample in source.samples:
        begin, before = perf_counter(), watch.sample
        estimate = stream.step(sample)
        if watch.sample == before:  # the sample came twice
            continue
        values = estimate.numpy()
        monitor.add_sample(sample, values)
        raised = None
        if alarm is not None and sample.a is not None and not (watch.bad or watch.unsettled):
            new = alarm.update(sample.a - estimate)
            raised = None if new is None else monitor.add_alarm(new)
        for log in logs:
            log.write(monitor.time, sample, values, raised)
        if raised is not None:
            view.alarm(raised)
        view.tick()
        done = perf_counter()
        monitor.add_time(done - begin, done - due)


# The stream of a live model: of a finished run, or beginning from nothing.

LAMBDA = 0.05  # λ [1/unit] of a VWNN that no record tells the sizes of its channels


def stream_from_nothing(experiment: Experiment, sensors: Sensors) -> Stream:
    """A stream of zero weights. Raises ValueError for models that need training first."""
    if experiment.model.target != "models.Online":
        raise ValueError(
            f"model={experiment.model.name} cannot begin from nothing; choose model=online_vwnn or "
            "another on-line model, or train it and give --run"
        )
    model = experiment.model.estimator(sensors)
    assert isinstance(model, Online)
    activation = getattr(model.estimator, "activation", None)
    if isinstance(activation, SigmoidProducts) and activation.weight.isnan().any():
        activation.weight.fill_(LAMBDA)
    return model.stream(from_nothing=True)


def stream_of_run(run: StoredRun, new_law: Choice | None) -> Stream:
    """A finished run's stream; the run's records may be gone.

    new_law: by which it adapts, as `adaptation=` names it. Without, an on-line run adapts by its
    own law, and a run of batch training keeps its weights. Raises ValueError for a run whose
    weights do not all enter linearly.
    """
    model = restore(run)
    own: Callable[[], Stream] | None = getattr(model, "stream", None)
    if own is not None and new_law is None:
        return own()
    inner = model.estimator if isinstance(model, Online) else model
    guard = model.guard if isinstance(model, Online) else Guard()
    linear = require_linear(inner, f"{run.folder} is a run of {run.experiment.model.name}")
    law: Law = Frozen() if new_law is None else new_law.build(Law)
    return stream_of(linear, law, started(linear, law), guard)


# Files of a live run: every estimate as a line of CSV, scalars for TensorBoard.
#
# A line is written at once, so that an interrupted run keeps its lines.

SCALARS = 20.0  # a second: measured and estimated acceleration


class EstimatesFile:
    """Columns time [s], a1 …, estimate1 … [m/s²], alarm (a DOF, mostly empty). NaN: not measured.

    Before the alarm is what else the stream estimates, such as drifts [m]. A file without an
    estimate does not stay. Raises OSError where the file exists, unless `force`.
    """

    def __init__(self, path: Path, stream: Stream, force: bool = False) -> None:
        self.path, self.stream, self.written = path, stream, False
        numbers = stream.watch.numbers
        self.file = path.open("w" if force else "x", encoding="utf-8", buffering=1)
        heads = ["time", *(f"a{i}" for i in numbers), *(f"estimate{i}" for i in numbers)]
        heads += [*stream.numbers, "alarm"]
        self.file.write(",".join(heads) + "\n")

    def write(
        self, time: float, sample: Sample, estimate: np.ndarray, raised: TimedAlarm | None
    ) -> None:
        """Append the line of a sample."""
        a = np.full_like(estimate, np.nan) if sample.a is None else sample.a.numpy()
        values = [round(time, 9), *a.tolist(), *estimate.tolist(), *self.stream.numbers.values()]
        dof = "" if raised is None else str(raised.alarm.dof)
        self.file.write(",".join(map(repr, values)) + f",{dof}\n")
        self.written = True

    def close(self) -> None:
        self.file.close()
        if not self.written:
            self.path.unlink()


class Scalars:
    """Measured and estimated accelerations, running error, norm of the weights, alarm level."""

    def __init__(self, folder: Path, monitor: LiveMonitor, alarm: ResidualAlarm | None) -> None:
        from torch.utils.tensorboard import SummaryWriter  # slow to import, seldom needed

        self.writer: Any = SummaryWriter(str(folder), max_queue=1000, flush_secs=1)
        self.monitor, self.alarm = monitor, alarm
        self.next_signals = self.next_rest = 0.0  # [s]

    def write(
        self, time: float, sample: Sample, estimate: np.ndarray, raised: TimedAlarm | None
    ) -> None:
        """Add the scalars of a sample that are due."""
        step, add = self.monitor.stream.watch.sample, self.writer.add_scalar
        if raised is not None:
            add("alarm/dof", raised.alarm.dof, step)
        if time < self.next_signals:
            return
        self.next_signals = time + 1.0 / SCALARS
        numbers = self.monitor.stream.watch.numbers
        for at, (i, value) in enumerate(zip(numbers, estimate.tolist(), strict=True)):
            if sample.a is not None:
                add(f"a{i}/measured", float(sample.a[at]), step)
            add(f"a{i}/estimated", value, step)
        if time < self.next_rest:
            return
        self.next_rest = time + 1.0
        add("error/running_percent", self.monitor.running_error()[0], step)
        weights = torch.cat([w.flatten() for w in self.monitor.stream.weights])
        add("weights/norm", float(torch.linalg.vector_norm(weights)), step)
        level = None if self.alarm is None else self.alarm.level()
        for i, value in zip(numbers, [] if level is None else level.tolist(), strict=False):
            add(f"alarm/level{i}", value, step)

    def close(self) -> None:
        self.writer.close()
