"""At which sizes does a GPU pay?

    python -m benchmarks.on_gpu            # the work of one iteration
    python -m benchmarks.on_gpu --quick    # of short records

Milliseconds of what a fit repeats, on one thread, on all threads and on the GPU: loss and gradient
of networks, all of the least squares of a VWNN. Then free runs a second of an element network with
18 units, each reduced to a sum. B records of T samples, three masses. Without a GPU its column is
empty; its free runs also need the extra [gpu].
"""

from __future__ import annotations

import math
import os
import statistics
from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from unittest.mock import patch

import numpy as np
import torch

from benchmarks.table import seconds_of, show
from data.arguments import Parser
from data.parallel import take_threads
from data.record import Drive, Record
from models.composition.many_runs import ManyRuns
from models.fit.trainable import Trainable
from models.mlp import GlobalMLP
from models.neural_state_space import NeuralStateSpace
from models.vwnn import VWNN
from runner.config.command_line import command_errors
from tests.export.networks import network

DOFS, DT = 3, 0.01
Work = Callable[[], object]
Make = Callable[[torch.device], Work]


def record(B: int, T: int) -> Record:
    """Noise: the cost does not depend on the values."""
    draw = torch.Generator().manual_seed(0)
    a, f, x, v = torch.randn(4, B, T, DOFS, generator=draw, dtype=torch.float64)
    return Record(DT, a, f, x, v)


def gradient(make: Callable[[], Trainable], B: int, T: int) -> Make:
    """Loss and gradient of a network."""

    def on(device: torch.device) -> Work:
        torch.manual_seed(0)
        model, given = make(), record(B, T)
        model.identify([given])
        model, given = model.to(device), given.to(device)
        free = [p for p in model.parameters() if p.requires_grad]

        def work() -> object:
            loss = (model(given) - given.a).square().mean()
            return torch.autograd.grad(loss, free, allow_unused=True)

        return work

    return on


def least_squares(order: int, B: int, T: int) -> Make:
    """All of a VWNN's identification."""

    def on(device: torch.device) -> Work:
        model, given = VWNN(DOFS, DOFS, DT, order=order).to(device), [record(B, T).to(device)]
        return partial(model.identify, given)

    return on


def cases(T: int) -> dict[str, Make]:
    mlp = partial(partial, GlobalMLP, DOFS, DOFS, DT)
    states = partial(partial, NeuralStateSpace, DOFS, DOFS, DT)
    return {
        "MLP, 10-10, 1 record": gradient(mlp(hidden=(10, 10)), 1, T),
        "MLP, 64-64, 16 records": gradient(mlp(hidden=(64, 64)), 16, T),
        "neural state space, 16 neurons, 16 windows of 100": gradient(states(hidden=16), 16, 100),
        "VWNN of second order, 1 record": least_squares(2, 1, T),
        "VWNN of third order, 16 records": least_squares(3, 16, T),
    }


def milliseconds(make: Make, device: torch.device, threads: int, repeats: int) -> float:
    torch.set_num_threads(threads)
    work = make(device)

    def whole() -> None:
        work()
        if device.type == "cuda":
            torch.cuda.synchronize()

    return 1e3 * statistics.median(seconds_of(whole, repeats))


def rows(quick: bool, cores: int) -> Iterator[list[str]]:
    for name, make in cases(500 if quick else 8000).items():
        here = [milliseconds(make, torch.device("cpu"), count, 2) for count in (1, cores)]
        cells = [f"{took:.1f}" for took in here]
        if torch.cuda.is_available():
            gpu = milliseconds(make, torch.device("cuda"), 1, 3)
            cells += [f"{gpu:.1f}", f"{min(here) / gpu:.1f}"]
        yield [name, *cells, *["–"] * (4 - len(cells))]


def free_runs(quick: bool, count: int) -> float:
    """Runs a second, of `count` at once."""
    model, rest = network(DOFS, "all"), torch.zeros(DOFS, dtype=torch.float64)
    u = 300.0 * torch.randn(
        500 if quick else 5000, DOFS, generator=torch.Generator().manual_seed(0)
    )
    runs = ManyRuns(model, Drive(DT, u.double(), rest, rest))
    theta = np.random.default_rng(0).normal(size=(count, len(runs.theta)))
    theta = runs.theta.numpy() + 0.05 * theta

    def work() -> None:
        runs(theta, lambda some: some.square().sum(dim=(1, 2)))

    work()
    return count / min(seconds_of(work, 2))


def many(quick: bool, cores: int) -> Iterator[list[str]]:
    """Free runs a second on all cores, and on the GPU, which is given more of them."""
    there = torch.cuda.is_available() and import_module("models.composition.gpu").is_there()
    few, most = (32, 1024) if quick else (64, 131_072)
    take_threads(cores)
    with patch.object(torch.cuda, "is_available", lambda: False):
        own = free_runs(quick, few * cores)
    gpu = free_runs(quick, most) if there else math.nan
    yield ["free runs", *("–" if u != u else f"{u:,.0f}" for u in (own, gpu, gpu / own))]


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="short records")
    quick, cores = parser.parse_args().quick, os.cpu_count() or 1
    title = torch.cuda.get_device_name() if torch.cuda.is_available() else ""
    head = ("an iteration, ms", "1 thread", f"{cores} threads", "GPU", "times faster")
    show(title, head, rows(quick, cores))
    show("", ("runs a second", f"{cores} threads", "GPU", "times faster"), many(quick, cores))


if __name__ == "__main__":
    with command_errors():
        main()
