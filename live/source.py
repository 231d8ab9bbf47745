"""Sources of a live run's samples: a simulation, a record, standard input, a socket."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace

from torch import Tensor

from data.datamodule import Data
from data.record import Record, dof_numbers
from data.sample import INPUTS, Sample, Sensors
from data.stream import SampleLines, one_client, paced, standard_input
from live.command_line import RECORDED
from models.experiment import Experiment

FASTEST = 1e6  # [Hz]
OF_LINES = {  # options of lines of text → the same of a record
    "rate": "data.dt=0.01",
    "channels": "data.channels.a1=COLUMN",
    "units": "data.units.a=g",
}


@dataclass(frozen=True)
class Source:
    """Samples, each with the time [s] at which it was due, and their sensors."""

    sensors: Sensors
    samples: Iterable[tuple[float, Sample]]
    period: float  # [s] from one sample to the next, at the speed at which samples come
    lines: SampleLines | None = None


def recorded(kind: str, args: argparse.Namespace, experiment: Experiment) -> tuple[Record, Sensors]:
    """The record that is replayed, less its truth. Raises ValueError for other quantities.

    A simulation of a finished run has the seed after the run's, unless seed= names another.
    """
    data = _data(kind, args, experiment)
    data.setup()
    records = data.records["train" if kind == "replay" else "test"]
    if kind == "replay" and len(records) > 1:
        raise ValueError(f"--replay {args.replay} holds {len(records)} records; name one of them")
    record = records[0].measured()
    if record.quantity != "acceleration":
        raise ValueError(f"the record holds {record.quantity}; live, accelerations are estimated")
    channels = [*(f"a{i}" for i in record.dof_numbers), *record.others]
    inputs = record.excitation.shape[-1]
    return record, Sensors(record.dt, record.dofs, inputs, data.forced, channels=channels)


def _data(kind: str, args: argparse.Namespace, experiment: Experiment) -> Data:
    if kind == "simulation":
        stated = args.run is None or any(word.startswith("seed=") for word in args.words)
        seed = experiment.seed if stated else experiment.seed + 1
        return replace(experiment, seed=seed).make_simulated_data()
    if kind == "test":
        return experiment.make_data()
    records = experiment.data
    if not records.target.endswith(".MeasuredData"):
        raise ValueError(f"--replay reads records of data=measured, not of {records.target}")
    whole = {"_target_": "data.WholeRecords", "train": None, "test": None}
    records = records.with_values({**whole, "path": args.replay})
    return replace(experiment, data=records).make_data()


def source_of(
    kind: str, args: argparse.Namespace, experiment: Experiment, dt: float | None, stack: ExitStack
) -> Source:
    """Open a source; waits for its first line of text. `dt` [s]: of the run, where there is one."""
    if kind in (*RECORDED, "replay"):
        for name in OF_LINES:
            if getattr(args, name):
                raise ValueError(f"--{name} is for lines of text; a record takes {OF_LINES[name]}")
        record, sensors = recorded(kind, args, experiment)
        samples = paced(record, args.speed)
        period = record.dt if math.isinf(args.speed) else record.dt / args.speed
        return Source(sensors, samples, period)
    if args.rate is not None and not 0.0 < args.rate <= FASTEST:
        raise ValueError(f"--rate {args.rate:g} Hz must be positive, and at most {FASTEST:g}")
    if args.rate is None and dt is None:
        raise ValueError("say how many samples a second the lines hold: --rate HZ")
    step = 1.0 / args.rate if args.rate is not None else dt
    assert step is not None
    if dt is not None and abs(step / dt - 1.0) < 1e-2:
        step = dt  # a rate such as 120 for a step of 8.333 ms
    file = standard_input() if kind == "-" else stack.enter_context(one_client(args.listen))
    lines = SampleLines(file, step, args.channels, args.units)
    return Source(lines.sensors, lines, step, lines)


# A record as lines of text, such as sensors give them.


def lines_of(record: Record, base: bool, speed: float) -> Iterator[str]:
    """A header, then a line for each sample, every number to its last digit.

    base: the support's acceleration is the excitation; a line then holds this acceleration and the
    absolute ones, as sensors give them, and no integrated signals.
    """
    first = True
    for k, (_, sample) in enumerate(paced(record, speed)):
        signals = _signals(sample, base)
        if first:
            own = dict.fromkeys("xva", record.dof_numbers)
            sizes = [(name, u.numel()) for name, u in signals.items()]
            heads = [
                f"{name}{i}" for name, size in sizes for i in dof_numbers(own.get(name, ()), size)
            ]
            yield ",".join(["t", *heads, *record.others])
            first = False
        signals |= {} if sample.o is None else {"o": sample.o}
        values = [value for u in signals.values() for value in u.tolist()]
        yield ",".join(map(repr, [round(k * record.dt, 9), *values]))


def _signals(sample: Sample, base: bool) -> dict[str, Tensor]:
    assert sample.a is not None
    if base:
        return {"s_ddot": -sample.f, "a": sample.a - sample.f}
    named = {name: getattr(sample, name) for name in (*INPUTS, "a")}
    return {name: u for name, u in named.items() if u is not None}
