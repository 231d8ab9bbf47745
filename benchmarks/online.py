"""Is an on-line VWNN fast, small and safe enough to run for hours?

    python -m benchmarks.online            # all parts
    python -m benchmarks.online update     # one: update, hour, paced or long
    python -m benchmarks.online --quick    # short, for CI

A VWNN of 3 DOFs and 91 features under recursive least squares, λ = 0.999, at 1 kHz; one thread.

update  time per sample of a whole step (guard, filters, features, estimate, law), of the law alone,
        of a textbook RLS in NumPy and of padasip's FilterRLS, which take one target and not three.
        Each in turn, in short blocks; the median block, and the fastest. Ratios within one run.
        Time of the thread: what else runs on the machine still costs it caches, but no waiting.
hour    3,600,000 steps of the compiled stream one after the other: those that took longer than the
        sample period of 1 ms, by the clock and by the processor time of the thread.
paced   the same at the pace of the data, for a minute (--seconds 3600: an hour): samples whose
        estimate and update were done later than the next one was due.
long    10,000,000 steps with silence, a single sine and tiny motion between: definiteness of P,
        its largest variance, and what memory grew.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import sys
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from itertools import cycle, islice
from statistics import median

import numpy as np
import torch
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from data.sample import Sample
from models.online.laws import laws_compiled as compiled
from models.online.laws.law import work_for
from models.online.laws.recursive_least_squares import RecursiveLeastSquares
from models.online.stream import Stream
from models.online.vwnn_stream import VWNNStream
from models.training.assemble import data_from
from models.vwnn import VWNN
from runner.command_line import composed

DT = 1e-3  # [s]
FORGETTING = 0.999
BLOCK, BLOCKS = 500, 12
INSTALL = "pip install 'structural-model-zoo[bench]'"


def motion(duration: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Accelerations and forces (T, 3) of the paper's yielding frame at 1 kHz."""
    cfg = composed("system=bilinear", f"data.dt={DT}", f"data.duration={duration}")
    data = data_from(cfg)
    data.setup()
    record = data.records["train"][0]
    return record.a, record.f


def samples_from(a: torch.Tensor, f: torch.Tensor) -> list[Sample]:
    return [Sample(f=u, a=y) for y, u in zip(a, f, strict=True)]


def new_stream(kind: type[Stream] = VWNNStream) -> Stream:
    return kind(VWNN(3, 3, DT), RecursiveLeastSquares(FORGETTING))


class Textbook:
    """RLS as books print it: P ← (P − K φᵀP)/λ, one target."""

    def __init__(self, features: int) -> None:
        self.P, self.w = 1e6 * np.eye(features), np.zeros(features)

    def step(self, phi: np.ndarray, y: float) -> None:
        g = self.P @ phi
        K = g / (FORGETTING + phi @ g)
        self.w += K * (y - phi @ self.w)
        self.P = (self.P - np.outer(K, g)) / FORGETTING


def contenders(a: torch.Tensor, f: torch.Tensor) -> Iterator[tuple[str, Callable[[int], None]]]:
    """Names and what takes the sample k."""
    samples, model = samples_from(a, f), VWNN(3, 3, DT)
    xi, _ = model.filters(torch.cat([a, f], dim=-1))
    phi, y = model.activation(xi), a
    P = phi.shape[1]
    law = RecursiveLeastSquares(FORGETTING)
    features, targets, estimate = phi.numpy(), y.numpy(), np.zeros((1, 3))
    own, S = np.zeros((P, 3)), law.start(torch.zeros(P, 3, dtype=torch.float64)).memory.numpy()
    settings, work = law.settings(), work_for(own)

    def law_alone(k: int) -> None:
        u, target = features[k : k + 1], targets[k : k + 1]
        compiled.follow(law.number, settings, u, target, 0, own, S, work, estimate)

    states = [law.start(torch.zeros(P, 3, dtype=torch.float64))]

    def law_in_torch(k: int) -> None:
        states[0] = law.adapt(states[0], phi[k], y[k] - phi[k] @ states[0].weights)

    fast, readable, book = new_stream(), new_stream(Stream), Textbook(P)
    yield "whole step, compiled", lambda k: fast.step(samples[k])
    yield "whole step, PyTorch", lambda k: readable.step(samples[k])
    yield "law alone, compiled", law_alone
    yield "law alone, PyTorch", law_in_torch
    yield "textbook in NumPy, one target", lambda k: book.step(features[k], targets[k, 0])
    try:
        peer = import_module("padasip").filters.FilterRLS(n=P, mu=FORGETTING, eps=1e-6, w="zeros")
    except ModuleNotFoundError:
        print(f"padasip is not there: {INSTALL}")
        return

    def padasip(k: int) -> None:
        peer.predict(features[k])
        peer.adapt(targets[k, 0], features[k])

    yield "padasip FilterRLS, one target", padasip


def update(console: Console, blocks: int) -> None:
    """The table of times per sample."""
    a, f = motion(BLOCK * blocks * DT)
    rows = dict(contenders(a, f))
    taken: dict[str, list[float]] = {name: [] for name in rows}
    for step in rows.values():
        step(0)  # compiles
    for block in range(blocks):
        for name, step in rows.items():
            begin = time.thread_time()
            for k in range(block * BLOCK, (block + 1) * BLOCK):
                step(k)
            taken[name].append((time.thread_time() - begin) / BLOCK * 1e6)
    table = Table(title=f"µs of processor time per sample, {blocks} blocks of {BLOCK} samples")
    for name in ("", "median", "fastest", "median × compiled step"):
        table.add_column(name, justify="right" if name else "left")
    base = median(taken["whole step, compiled"])
    for name, times in taken.items():
        middle = median(times)
        table.add_row(name, f"{middle:.1f}", f"{min(times):.1f}", f"{middle / base:.2f}")
    console.print(table)


def hour(count: int) -> None:
    """Steps that took longer than the sample period."""
    stream, samples = new_stream(), samples_from(*motion(50.0))
    stream.step(samples[0])
    walls, own = np.empty(count), np.empty(count)
    for k, sample in enumerate(islice(cycle(samples), count)):
        begin, used = time.perf_counter(), time.thread_time()
        stream.step(sample)
        own[k] = time.thread_time() - used
        walls[k] = time.perf_counter() - begin
    print(f"hour: {count} steps, {walls.sum():.0f} s of {count * DT:.0f} s")
    for name, times in (("by the clock", walls), ("of processor time", own)):
        late, percentile = int((times > DT).sum()), np.percentile(times, 99.99)
        print(
            f"  {name}: {late} longer than {DT * 1e3:g} ms; median {np.median(times) * 1e6:.1f}, "
            f"99.99 % below {percentile * 1e6:.0f}, longest {times.max() * 1e6:.0f} µs"
        )
    gaps = gaps_of_the_machine(walls.sum())
    print(
        f"  the machine alone: reading the clock in a loop stood still over {DT * 1e3:g} ms "
        f"{len(gaps)} times in as long, {max(gaps, default=0.0) * 1e6:.0f} µs at the longest"
    )


def gaps_of_the_machine(seconds: float) -> list[float]:
    """Between two looks at the clock, where they are longer than the sample period [s]."""
    gaps, now = [], time.perf_counter()
    end = now + seconds
    while now < end:
        before, now = now, time.perf_counter()
        if now - before > DT:
            gaps.append(now - before)
    return gaps


def paced(seconds: float) -> None:
    """Samples that were done after the next one was due, at the pace of the data."""
    stream, samples = new_stream(), samples_from(*motion(50.0))
    count = round(seconds / DT)
    late, begin = np.empty(count), time.perf_counter() + DT
    for k, sample in enumerate(islice(cycle(samples), count)):
        due = begin + k * DT
        while (left := due - time.perf_counter()) > 0.0:
            time.sleep(left)
        stream.step(sample)
        late[k] = time.perf_counter() - due
    middle, most, worst = (np.percentile(late, q) * 1e6 for q in (50.0, 99.0, 100.0))
    print(
        f"paced: {count} samples at {1.0 / DT:g} Hz: {int((late > DT).sum())} done after the next "
        f"was due; done within {middle:.0f} µs (median), {most:.0f} µs (99 %), {worst:.0f} µs (all)"
    )


def varied(a: torch.Tensor, f: torch.Tensor) -> list[Sample]:
    """The motion, then silence, a single sine and the motion a millionth as large."""
    t = DT * torch.arange(len(a), dtype=torch.float64)[:, None]
    sine, nothing = torch.sin(2.0 * torch.pi * t), torch.zeros_like(a)
    parts = [(a, f), (nothing, nothing), (sine.expand(-1, 3), 0.5 * sine.expand(-1, 3))]
    parts.append((1e-6 * a, 1e-6 * f))
    return [sample for part in parts for sample in samples_from(*part)]


def state_of(stream: Stream) -> str:
    """Definiteness and size of P = S Sᵀ, and of the weights."""
    root = stream.states[0].memory.numpy()
    singular = np.linalg.svd(root, compute_uv=False)
    largest = float(np.square(root).sum(axis=1).max())
    return (
        f"eigenvalues of P {singular[-1] ** 2:.2e} to {singular[0] ** 2:.2e}, variances up to "
        f"{largest:.3e}, weights up to {float(stream.weights[0].abs().max()):.2e}"
    )


def memory() -> tuple[float, int]:
    """Resident memory at its peak [MiB] and blocks that Python has allocated."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, sys.getallocatedblocks()


def long(count: int) -> None:
    """Definiteness and memory over many samples."""
    stream, samples = new_stream(), varied(*motion(25.0))
    begin, marks = time.perf_counter(), {}
    for k, sample in enumerate(islice(cycle(samples), count), start=1):
        stream.step(sample)
        if k in (count // 10, count):
            marks[k] = memory()
            print(
                f"long: after {k} steps, {time.perf_counter() - begin:.0f} s: {state_of(stream)}",
                flush=True,
            )
    (early_size, early_blocks), (size, blocks) = marks.values()
    print(
        f"  memory since {count // 10} steps: {size - early_size:+.2f} MiB resident at the peak, "
        f"{blocks - early_blocks:+d} Python blocks; {len(stream.events)} events"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", nargs="?", choices=("update", "hour", "paced", "long"))
    parser.add_argument("--quick", action="store_true", help="20,000 steps and short blocks")
    parser.add_argument("--seconds", type=float, default=60.0, help="of `paced`")
    options = parser.parse_args()
    torch.set_num_threads(1)
    threadpool_limits(1)
    machine = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, 1 thread"
    print(f"{machine}; torch {torch.__version__}")
    short = 20_000 if options.quick else None
    if options.part in (None, "update"):
        update(Console(width=110), 3 if options.quick else BLOCKS)
    if options.part in (None, "hour"):
        hour(short or 3_600_000)
    if options.part in (None, "paced"):
        paced(5.0 if options.quick else options.seconds)
    if options.part in (None, "long"):
        long(short or 10_000_000)


if __name__ == "__main__":
    main()
