"""Is a stream in time for hours, and does its state stay sound over ten million samples?"""

from __future__ import annotations

import resource
import sys
import time
from itertools import cycle, islice

import numpy as np
import torch

from benchmarks.online.streams import DT, motion, new_stream, samples_from
from data.sample import Sample
from models.online.stream import Stream


def hour(count: int) -> None:
    """Count the steps that took longer than the sample period."""
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
    """Gaps between two readings of the clock that are longer than the sample period [s]."""
    gaps, now = [], time.perf_counter()
    end = now + seconds
    while now < end:
        before, now = now, time.perf_counter()
        if now - before > DT:
            gaps.append(now - before)
    return gaps


def paced(seconds: float) -> None:
    """Count the samples, at the pace of the data, that were done after the next one was due."""
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
    """Print definiteness and memory over many samples."""
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
