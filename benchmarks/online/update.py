"""What does a sample cost, beside a textbook's recursive least squares and padasip's?

Each in turn, in short blocks; the median block, and the fastest. Ratios within one run. Time of the
thread: other programs of the machine still cost caches, but no waiting.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from importlib import import_module
from statistics import median

import numpy as np
import torch
from rich.console import Console
from rich.table import Table

from benchmarks.online.streams import DT, FORGETTING, motion, new_stream, samples_from
from models.online.laws import laws_compiled as compiled
from models.online.laws.law import work_for
from models.online.laws.recursive_least_squares import RecursiveLeastSquares
from models.online.stream import Stream
from models.vwnn import VWNN

BLOCK, BLOCKS = 500, 12
INSTALL = "pip install -c constraints.txt -e '.[bench]'"


class Textbook:
    """RLS as books print it: P ← (P − K φᵀP)/λ, one target."""

    def __init__(self, features: int) -> None:
        self.P, self.w = 1e6 * np.eye(features), np.zeros(features)

    def step(self, phi: np.ndarray, y: float) -> None:
        g = self.P @ phi
        K = g / (FORGETTING + phi @ g)
        self.w += K * (y - phi @ self.w)
        self.P = (self.P - np.outer(K, g)) / FORGETTING


def contenders(a: torch.Tensor, f: torch.Tensor) -> Iterator[tuple[str, Callable[[int], object]]]:
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
