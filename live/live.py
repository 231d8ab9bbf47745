"""Follow a source of samples: estimate, learn and show, until it ends."""

from __future__ import annotations

import argparse
import gc
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from time import perf_counter

import torch
from omegaconf import DictConfig

from data.terminal import Terminal
from live.alarm import ResidualAlarm
from live.log import EstimatesFile, Scalars
from live.model import stream_from_nothing, stream_of_run
from live.monitor import LiveMonitor
from live.source import Source, source_of
from live.view import LiveView, no_sound_sample, summary
from models.online.stream import Stream
from runner.folder.run_files import run_folder

INTERRUPTED = 130


@torch.no_grad()
def live(args: argparse.Namespace, kind: str, settings: Sequence[str], cfg: DictConfig) -> int:
    """Follow a source to its end, or to Ctrl-C; the exit status. Raises ValueError, OSError."""
    torch.set_num_threads(1)
    console = Terminal()
    with ExitStack() as stack:
        source, stream = _opened(args, kind, settings, cfg, stack)
        dofs, dt = stream.estimator.dofs, stream.estimator.dt
        alarm = None if args.sound is None else ResidualAlarm(dofs, dt, args.sound)
        monitor = LiveMonitor(stream, source.period)
        view = LiveView(monitor, source.lines, console, args.every)
        logs: list[EstimatesFile | Scalars] = []
        if args.output is not None:
            logs.append(EstimatesFile(Path(args.output), dofs, args.force))
        if args.log is not None:
            logs.append(Scalars(Path(args.log), monitor, alarm))
        for log in logs:
            stack.callback(log.close)
        status = _watch(source, monitor, alarm, logs, view)
        view.tell()
        if status == 0 and not monitor.sound:
            raise ValueError(no_sound_sample(monitor, source.lines))
    for line in summary(monitor, source.lines):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    return status


def _opened(
    args: argparse.Namespace,
    kind: str,
    settings: Sequence[str],
    cfg: DictConfig,
    stack: ExitStack,
) -> tuple[Source, Stream]:
    """The source, and a stream of the run or from nothing that fits the source."""
    if args.run is None:
        source = source_of(kind, args, cfg, None, stack)
        return source, stream_from_nothing(cfg, source.sensors)
    new_law = any(word.startswith("adaptation") for word in settings)
    stream = stream_of_run(cfg, run_folder(args.run), new_law)
    source = source_of(kind, args, cfg, stream.estimator.dt, stack)
    source.sensors.check(stream.estimator)
    return source, stream


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
        return INTERRUPTED
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
