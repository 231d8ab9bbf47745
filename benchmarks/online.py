"""Is an on-line VWNN fast enough, and sound over millions of samples?

    python -m benchmarks.online            # ten minutes
    python -m benchmarks.online update     # one part: update or long
    python -m benchmarks.online --quick    # a few seconds of each

A VWNN of three DOFs and 91 features under recursive least squares, at 1 kHz. update: µs of
processor time of a whole step, of the law alone, and of a textbook's recursive least squares in
NumPy. long: ten million steps, with silence and tiny motion between: eigenvalues of P, weights,
memory.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Iterator
from itertools import cycle, islice
from statistics import median

import numpy as np
import torch

from benchmarks.table import show
from data.arguments import Parser
from data.sample import Sample
from models.experiment import Experiment
from models.online.laws import laws_compiled as compiled
from models.online.laws.law import work_for
from models.online.laws.recursive_least_squares import RecursiveLeastSquares
from models.online.stream import Stream
from models.online.vwnn_stream import VWNNStream
from models.vwnn import VWNN
from runner.config.choices import plain
from runner.config.command_line import command_errors
from runner.config.compose import composed

DT, FORGETTING = 1e-3, 0.999  # [s]
BLOCK = 500  # samples that are timed at once


def motion(duration: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Accelerations and forces (T, 3) of the paper's yielding frame at 1 kHz."""
    words = ("system=bilinear", f"data.dt={DT}", f"data.duration={duration}")
    record = Experiment.of(plain(composed(*words))).set_up_data().records["train"][0]
    return record.a, record.f


def samples_from(a: torch.Tensor, f: torch.Tensor) -> list[Sample]:
    return [Sample(f=u, a=y) for y, u in zip(a, f, strict=True)]


def new_stream() -> Stream:
    return VWNNStream(VWNN(3, 3, DT), RecursiveLeastSquares(FORGETTING))


def update(blocks: int) -> Iterator[list[str]]:
    """Time of the thread per sample: other programs still cost caches, but no waiting."""
    a, f = motion(BLOCK * blocks * DT)
    samples, model, stream = samples_from(a, f), VWNN(3, 3, DT), new_stream()
    phi = model.activation(model.filters(torch.cat([a, f], dim=-1))[0])
    features, targets, estimate = phi.numpy(), a.numpy(), np.zeros((1, 3))
    law, own = RecursiveLeastSquares(FORGETTING), np.zeros((phi.shape[1], 3))
    S, work = law.start(torch.from_numpy(own)).memory.numpy(), work_for(own)
    P, w = 1e6 * np.eye(len(own)), np.zeros(len(own))

    def law_alone(k: int) -> None:
        u, y = features[k : k + 1], targets[k : k + 1]
        compiled.follow(law.number, law.settings(), u, y, 0, own, S, work, estimate)

    def textbook(k: int) -> None:
        nonlocal P, w
        g = P @ features[k]
        gain = g / (FORGETTING + features[k] @ g)
        w = w + gain * (targets[k, 0] - features[k] @ w)
        P = (P - np.outer(gain, g)) / FORGETTING

    steps: dict[str, Callable[[int], object]] = {
        "whole step": lambda k: stream.step(samples[k]),
        "law alone": law_alone,
        "textbook in NumPy, one target": textbook,
    }
    taken: dict[str, list[float]] = {name: [] for name in steps}
    for step in steps.values():
        step(0)  # compiles
    for block in range(blocks):
        for name, step in steps.items():
            begin = time.thread_time()
            for k in range(block * BLOCK, (block + 1) * BLOCK):
                step(k)
            taken[name].append((time.thread_time() - begin) / BLOCK * 1e6)
    for name, times in taken.items():
        yield [name, f"{median(times):.1f}", f"{min(times):.1f}"]


def long(count: int) -> Iterator[list[str]]:
    """The motion, silence, a sine and the motion a millionth as large, again and again."""
    a, f = motion(25.0)
    sine = torch.sin(2.0 * torch.pi * DT * torch.arange(len(a)))[:, None].double().expand(-1, 3)
    parts = [(a, f), (0.0 * a, 0.0 * f), (sine, 0.5 * sine), (1e-6 * a, 1e-6 * f)]
    samples, stream = [s for part in parts for s in samples_from(*part)], new_stream()
    for k, sample in enumerate(islice(cycle(samples), count), start=1):
        stream.step(sample)
        if k in (count // 10, count):
            singular = np.linalg.svd(stream.states[0].memory.numpy(), compute_uv=False)
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            numbers = f"{singular[-1] ** 2:.1e}", f"{singular[0] ** 2:.1e}"
            weights = f"{float(stream.weights[0].abs().max()):.1e}"
            yield [f"{k} steps", *numbers, weights, f"{peak:.1f}"]


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "part", nargs="?", choices=("update", "long"), help="one of them; all without"
    )
    parser.add_argument("--quick", action="store_true", help="a few seconds of each")
    options = parser.parse_args()
    torch.set_num_threads(1)
    if options.part != "long":
        show("", ("µs a sample", "median", "fastest"), update(2 if options.quick else 12))
    if options.part != "update":
        head = ("long", "P from", "to", "weights", "MiB peak")
        show("", head, long(20_000 if options.quick else 10_000_000))


if __name__ == "__main__":
    with command_errors():
        main()
