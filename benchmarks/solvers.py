"""How long do our solvers and their peers take to reach a given training error?

    python -m benchmarks.solvers            # 8 s at most for each solver, network and start
    python -m benchmarks.solvers --quick    # 0.3 s for each, one start, 10 s of motion, for CI

The same network, training motion and starting weights for all, full batch, float64, one thread, one
run at a time. All minimise mean(e²) of models/fit/problem.py, whose root is Eq. 21. A solver
stops at the smallest error of the table, where it finds no lower one, or at the limit of time:
limits of iterations are lifted. Time spent on noting an error does not count. An error is reached
when a point with it has been evaluated, whether the solver then goes on from there (an iterate of
Levenberg–Marquardt) or not (a trial of a line search).
"""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from statistics import median

import numpy as np
import torch
from scipy.optimize import least_squares
from threadpoolctl import threadpool_limits
from torch import Tensor
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from benchmarks.table import show
from data.arguments import Parser
from data.record import Record
from models.experiment import Experiment
from models.fit.problem import Problem
from models.fit.trainable import Trainable
from runner.config.choices import plain
from runner.config.command_line import command_errors
from runner.config.compose import composed
from runner.job import quiet_lightning

NETWORKS = {  # choices; errors [%], the paper's among them: 2.4, 0.12
    "residual MLP 12-15-3, bilinear": ("residual_mlp", "bilinear", (4.0, 3.0, 2.4, 2.2)),
    "global MLP 9-10-10-3, polynomial": ("global_mlp", "polynomial", (3.0, 1.0, 0.5, 0.12)),
}
UNLIMITED = 10**9  # iterations
WARM_UP = 0.5  # s at most of every solver before the first measurement: imports, first calls


class Done(Exception):  # noqa: N818
    """The smallest error is reached, or the time is over."""


class Watch:
    """Error [%] against seconds: every evaluated point that is better than all before."""

    def __init__(self, limit: float, goal: float) -> None:
        self.limit, self.goal, self.start, self.ran = limit, goal, time.perf_counter(), 0.0
        self.points: list[tuple[float, float]] = [(0.0, math.inf)]

    def note(self, loss: float) -> None:
        now = time.perf_counter()
        self.ran, percent = now - self.start, 100.0 * math.sqrt(loss)
        if self.ran <= self.limit and percent < self.best:
            self.points.append((self.ran, percent))
        if self.ran > self.limit or percent <= self.goal:
            raise Done
        self.start += time.perf_counter() - now

    @property
    def best(self) -> float:
        return self.points[-1][1]

    def reached(self, percent: float) -> float:
        """Seconds until the error was `percent`; infinite where it never was."""
        return next((seconds for seconds, error in self.points if error <= percent), math.inf)


class WatchedProblem(Problem):
    """Our problem, which tells the watch every loss."""

    def __init__(self, estimator: Trainable, record: Record, watch: Watch) -> None:
        super().__init__(estimator, record)
        self.watch = watch
        self.free = [self.module.get_parameter(name) for name in self.names]

    def loss(self) -> Tensor:
        value = super().loss()
        self.watch.note(float(value.detach()))
        return value

    def slopes(self) -> tuple[Tensor, Tensor]:
        value, slopes = super().slopes()
        self.watch.note(float(value.detach()))
        return value, slopes


def ours(problem: WatchedProblem, *choices: str) -> None:
    """A solver of conf/solver with its defaults, bar the limits of iterations and of progress."""
    unlimited = [f"solver.iterations={UNLIMITED}", "solver.change=0"]
    experiment = Experiment.of(plain(composed(*choices, *unlimited, "seed=0")))
    solver = experiment.make_solver()(problem.free)
    problem.watch.start = time.perf_counter()
    while not solver.finished:
        solver.solve(problem)


def torch_lbfgs(problem: WatchedProblem) -> None:
    """PyTorch's own, in one call, on N mean(e²) with our length of history."""
    # step length, iterations, evaluations, tolerances of gradient and change, history
    settings = (1.0, UNLIMITED, UNLIMITED, 0.0, 0.0, 50)
    solver = torch.optim.LBFGS(problem.free, *settings, line_search_fn="strong_wolfe")

    def closure() -> Tensor:
        solver.zero_grad()
        loss = problem.y.numel() * problem.loss()
        loss.backward()
        return loss

    problem.watch.start = time.perf_counter()
    solver.step(closure)


@torch.no_grad()
def scipy_least_squares(problem: WatchedProblem, method: str) -> None:
    """x_scale=1; errors and Jacobian are ours, so that it need not take finite differences."""

    def errors(theta: np.ndarray) -> np.ndarray:
        vector_to_parameters(torch.tensor(theta), problem.free)
        e = problem.errors()
        problem.watch.note(float(e @ e) / e.numel())
        return e.numpy()

    def jacobian(theta: np.ndarray) -> np.ndarray:
        vector_to_parameters(torch.tensor(theta), problem.free)
        named: dict[str, Tensor] = dict(zip(problem.names, problem.free, strict=True))
        return problem.weight * torch.cat(list(problem._blocks(named, 1))).numpy()

    start = parameters_to_vector(problem.free).numpy()
    options = {"x_scale": 1.0, "max_nfev": UNLIMITED, "ftol": 1e-15, "xtol": 1e-15, "gtol": 1e-15}
    problem.watch.start = time.perf_counter()
    least_squares(errors, start, jacobian, method=method, **options)


SOLVERS: dict[str, tuple[Callable[..., None], tuple[str, ...]]] = {
    "our LM, every=4": (ours, ("solver=levenberg_marquardt", "solver.every=4")),
    "our LM, every=1": (ours, ("solver=levenberg_marquardt", "solver.every=1")),
    "our LBFGS": (ours, ("solver=lbfgs",)),
    "torch.optim.LBFGS": (torch_lbfgs, ()),
    "scipy least_squares, trf": (scipy_least_squares, ("trf",)),
    "scipy least_squares, lm": (scipy_least_squares, ("lm",)),
}


def identified(
    model: str, system: str, seed: int, settings: Sequence[str]
) -> tuple[Trainable, Record]:
    """The study's first motion; weights as `python train.py` draws them with this seed."""
    cfg = composed(f"model={model}", f"system={system}", "seed=0", *settings)
    experiment = Experiment.of(plain(cfg))
    data = experiment.set_up_data()
    torch.manual_seed(seed)
    estimator = experiment.model.estimator(data)
    estimator.identify(data.loader("train"))
    assert isinstance(estimator, Trainable)
    return estimator, next(iter(data.loader("train")))


def measure(name: str, start: tuple[Trainable, Record], limit: float, goal: float) -> Watch:
    """One run of a solver on a copy of the estimator."""
    watch, (solve, settings) = Watch(limit, goal), SOLVERS[name]
    with suppress(Done):
        solve(WatchedProblem(copy.deepcopy(start[0]), start[1], watch), *settings)
    return watch


def rows(title: str, seeds: range, limit: float, settings: Sequence[str]) -> Iterator[list[str]]:
    """Of every solver the median seconds to each error, and the smallest error that it reached."""
    model, system, errors = NETWORKS[title]
    starts = [identified(model, system, seed, settings) for seed in seeds]
    for name in SOLVERS:
        measure(name, starts[0], min(WARM_UP, limit / 2.0), 0.0)
        watches = [measure(name, start, limit, min(errors)) for start in starts]
        taken = [median(watch.reached(error) for watch in watches) for error in errors]
        got = f"{median(watch.best for watch in watches):.3g} %"
        yield [name, *(f"{s:.2f} s" if math.isfinite(s) else "–" for s in taken), got]


def main() -> None:
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="0.3 s each, one start, short data")
    options = parser.parse_args()
    torch.set_num_threads(1)
    threadpool_limits(1)
    seeds, limit = (range(1), 0.3) if options.quick else (range(2), 8.0)
    settings = ["data.duration=10"] if options.quick else []
    with quiet_lightning():
        for title, (_, _, errors) in NETWORKS.items():
            head = ("solver", *(f"{error:g} %" for error in errors), "got")
            show(f"{title}: time to an error", head, rows(title, seeds, limit, settings))


if __name__ == "__main__":
    with command_errors():
        main()
