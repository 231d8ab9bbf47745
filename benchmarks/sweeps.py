"""What does a sweep over seeds cost, run by run and side by side?

    python -m benchmarks.sweeps            # 1,000 runs of the VWNN; 250 of them in a row
    python -m benchmarks.sweeps --quick    # 40 runs

Whole commands are timed, imports included, beside an empty sweep of the same command (all of its
runs finished before), which is the cost of a sweep without its runs. A run's own work is to
simulate, fit and score; all time beyond it is overhead. The second table is an upper limit of the
gain by training networks side by side: loss and gradient of S global MLPs one after the other, and
stacked under torch.func; the last line is what each network's solver does beside that.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import torch
from torch import Tensor
from torch.func import functional_call, grad, stack_module_state, vmap

from benchmarks.timing import seconds_of
from data.arguments import Parser
from models.mlp import GlobalMLP
from models.training.assemble import assembled, data_from, estimator_from
from models.training.identification import SPLITS
from models.training.metrics import free_run_score, score
from models.training.problem import Problem
from runner.config.command_line import command_errors
from runner.config.compose import composed

ROOT = Path(__file__).parent.parent
WORDS = [
    *("model=vwnn", "baselines=none", "figures=false", "trainer.enable_progress_bar=false"),
    "data.calibration_records=0",
]


def sweep(runs: int, launcher: str, folder: Path) -> float:
    """Seconds that a sweep takes. Raises CalledProcessError where a run fails."""
    words = [*WORDS, f"seed=range({runs})", f"hydra/launcher={launcher}"]
    command = [sys.executable, "train.py", "-m", *words, f"hydra.sweep.dir={folder}"]
    start = time.perf_counter()
    subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def own_work(runs: int) -> float:
    """Seconds a run takes to simulate, fit and score, one step ahead and in free run."""
    torch.set_num_threads(1)
    cfg = composed(*WORDS)
    took = []
    for seed in range(runs + 1):
        cfg.seed = seed
        start = time.perf_counter()
        data = data_from(cfg)
        data.setup()
        data.own_error()
        estimator = estimator_from(cfg.model, data)
        estimator.identify(data.loader("train"))
        for split in SPLITS:
            score(estimator, data.loader(split))
            free_run_score(estimator, data.loader(split))
        took.append(time.perf_counter() - start)
    return statistics.mean(took[1:])  # the first loads what is compiled


def sweeps(runs: int) -> None:
    """Print the time of a run by every launcher, the slow one with a quarter of the runs."""
    own = 1e3 * own_work(runs // 10)
    print(f"the VWNN on the bilinear system, {os.cpu_count()} cores")
    print(f"own work of a run: {own:.0f} ms on one core\n")
    print("| launcher | runs | s | s, nothing to do | ms a run, less that |")
    print("|---|---:|---:|---:|---:|")
    of_run = {}
    for launcher, count in (("basic", runs // 4), ("joblib", runs), ("batched", runs)):
        with tempfile.TemporaryDirectory() as folder:
            took = sweep(count, launcher, Path(folder))
            empty = sweep(count, launcher, Path(folder))
            done = len(list(Path(folder).glob("*/metrics.json")))
        assert done == count, f"{done} of {count} runs are finished"
        of_run[launcher] = 1e3 * (took - empty) / count
        cells = (launcher, count, *(f"{value:.1f}" for value in (took, empty, of_run[launcher])))
        print(f"| {' | '.join(map(str, cells))} |", flush=True)
    print(f"\noverhead of a run beyond its own work: {of_run['basic'] - own:.0f} ms")
    basic, joblib = (of_run[name] / of_run["batched"] for name in ("basic", "joblib"))
    print(
        f"a run by batched is {basic:.1f} times faster than by basic, {joblib:.1f} than by joblib\n"
    )


def networks(counts: list[int], repeats: int) -> None:
    """Print times of loss and gradient of S networks on S records, one by one and stacked."""
    torch.set_num_threads(1)
    cfg = composed("model=global_mlp", "system=bilinear")
    print("global MLPs, loss and gradient of each, one thread")
    print("| networks | one by one, ms | stacked, ms | times faster |")
    print("|---:|---:|---:|---:|")
    for count in counts:
        problems, estimators = [], []
        for seed in range(count):
            cfg.seed = seed
            data = data_from(cfg)
            data.setup()
            (record,) = data.train_dataloader()
            estimator = GlobalMLP(data.dofs, data.inputs, data.dt)
            estimator.identify([record])
            estimators.append(estimator.network)
            problems.append(Problem(estimator, record))
        u, y = (torch.stack([getattr(p, name) for p in problems]) for name in ("u", "y"))
        one_by_one = seconds_of(partial(_gradients, problems), repeats)
        theta, fixed = stack_module_state(estimators)

        def loss(weights, scales, u, y, network=estimators[0]):  # type: ignore[no-untyped-def]
            return ((functional_call(network, (weights, scales), (u,)) - y) ** 2).mean()

        every = vmap(grad(loss))
        stacked = seconds_of(lambda: every(theta, fixed, u, y), repeats)  # noqa: B023
        alone, together = (1e3 * statistics.median(times) for times in (one_by_one, stacked))
        print(f"| {count} | {alone:.1f} | {together:.1f} | {alone / together:.1f} |", flush=True)


def solver_alone(iterations: int) -> None:
    """Print what an iteration of L-BFGS takes beside loss and gradient, of one global MLP."""
    cfg = composed("model=global_mlp", "system=bilinear", f"solver.iterations={iterations}")
    data, module, _ = assembled(cfg)
    data.setup()
    (record,) = data.train_dataloader()
    module.estimator.identify([record])
    assert module.make_solver is not None
    solver = module.make_solver(module.free_parameters().values())
    problem = Counted(module.trainable, record)
    start = time.perf_counter()
    while not solver.finished:
        solver.solve(problem)
    whole = 1e3 * (time.perf_counter() - start) / solver.done
    every = problem.evaluated / solver.done
    gradient = 1e3 * statistics.median(seconds_of(partial(_gradients, [problem]), 11))
    print(
        f"\nan iteration of L-BFGS: {whole:.2f} ms, of which {every:.2f} losses and gradients take "
        f"{every * gradient:.2f} ms"
    )


class Counted(Problem):
    """A problem that knows how often its loss was asked for."""

    evaluated = 0

    def loss(self) -> Tensor:
        self.evaluated += 1
        return super().loss()


def _gradients(problems: Sequence[Problem]) -> None:
    for problem in problems:
        free = [p for p in problem.module.parameters() if p.requires_grad]
        torch.autograd.grad(problem.loss(), free)


def main() -> None:
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="some 40 runs")
    quick = parser.parse_args().quick
    sweeps(40 if quick else 1000)
    networks([4] if quick else [1, 4, 16, 64], 3 if quick else 11)
    solver_alone(40 if quick else 400)


if __name__ == "__main__":
    with command_errors():
        main()
