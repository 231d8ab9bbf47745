"""An on-line model beside a shaking structure: measured against estimated, sample by sample.

python -m live simulation --run FOLDER                a finished run, its system anew
python -m live simulation system=bouc_wen             a model that begins from nothing
python -m live test --run FOLDER --speed 10           the run's test record
python -m live --replay record.csv --speed inf        as data=measured reads it
python -m live - --rate 120                           CSV or JSON lines, standard input
python -m live --listen 5000 --run FOLDER             the same from a socket on 127.0.0.1
"""

from __future__ import annotations

import argparse
import gc
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from time import perf_counter

import torch
from rich.console import Console

from data.arguments import Parser
from live.alarm import ResidualAlarm
from live.log import EstimatesFile, Scalars
from live.model import fresh_config, run_config, stream_from_nothing, stream_of_run
from live.monitor import LiveMonitor
from live.source import Source, add_lines, add_source, source_of, split_words
from live.view import LiveView, summary
from models.online.stream import Stream
from runner.command_line import command_errors

INTERRUPTED = 130


def parser() -> Parser:
    """The options of the command line."""
    options = Parser("python -m live", description=(__doc__ or "").splitlines()[0])
    add_source(options)
    add_lines(options)
    options.add_argument(
        "--sound", type=float, metavar="S", help="undamaged seconds at the start; then an alarm"
    )
    options.add_argument("--log", metavar="FOLDER", help="TensorBoard scalars")
    options.add_argument("--output", metavar="CSV", help="every estimate, a line each")
    options.add_argument("--force", action="store_true", help="overwrite --output")
    options.add_argument(
        "--every", type=float, default=5.0, metavar="S", help="between lines, without a terminal"
    )
    return options


@torch.no_grad()
def live(words: Sequence[str] | None = None) -> int:
    """Follow a source to its end, or to Ctrl-C; the exit status. Raises ValueError, OSError."""
    args = parser().parse_intermixed_args(words)
    torch.set_num_threads(1)
    console = Console()
    with ExitStack() as stack:
        source, stream = _opened(args, stack)
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
    for line in summary(monitor, source.lines):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    return status


def _opened(args: argparse.Namespace, stack: ExitStack) -> tuple[Source, Stream]:
    """The source, and a stream of the run or from nothing that fits the source."""
    kind, settings = split_words(args)
    if args.run is None:
        cfg = fresh_config(settings, kind == "replay")
        source = source_of(kind, args, cfg, None, stack)
        return source, stream_from_nothing(cfg, source.sensors)
    cfg = run_config(Path(args.run), settings)
    new_law = any(word.startswith("adaptation") for word in settings)
    stream = stream_of_run(cfg, Path(args.run), new_law)
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
        estimate = stream.estimate(sample)
        stream.update(sample.a)
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


def main(words: Sequence[str] | None = None) -> None:
    """Bad input ends in one line and exit status 1, Ctrl-C in a summary and 130."""
    with command_errors():
        status = live(words)
    sys.exit(status)


if __name__ == "__main__":
    main()
