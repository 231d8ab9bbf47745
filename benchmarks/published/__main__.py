"""How do published packages do on the zoo's records, in the free run that the zoo is scored by?

    python -m benchmarks.published            # seeds 40–47, 8 records and 1; some hours
    python -m benchmarks.published --packages sindy --seeds 0 1 --models linear global_mlp
    python -m benchmarks.published --page docs/published.md   # and the page, from page.md here
    python -m benchmarks.published --quick    # 10 s of motion, one record and seed

Every package gets the forces and the measured motion of the same training records, with the
settings in its file here, and simulates the acceleration of the unseen record from rest. Results
lie in --output, a file for each fit; a fit with a file is not repeated.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path

import torch
from rich.console import Console
from threadpoolctl import threadpool_limits

from benchmarks.published.measure import (
    PACKAGES,
    Case,
    Result,
    measure_package,
    measure_zoo,
    require,
    version,
)
from benchmarks.published.page import write_page
from benchmarks.published.table import report
from data.arguments import Parser
from data.terminal import Terminal
from runner.config.command_line import command_errors, one_line_errors
from runner.config.compose import composed
from runner.folder.run_folder import write_json
from runner.job import quiet_lightning

SYSTEMS = ("bilinear", "polynomial", "bouc_wen")
SEEDS = range(40, 48)  # took part in no choice; those of the zoo's free runs too


def arguments(given: list[str] | None = None) -> argparse.Namespace:
    """The options. Raises ValueError, before any work, for those that would fail after hours."""
    about = (__doc__ or "").splitlines()[0]
    parser = Parser(description=about)
    add = parser.add_argument
    add("--output", type=Path, default=Path("runs/published"), help="folder of the results")
    packages, known = list(PACKAGES), ", ".join(PACKAGES)
    add("--packages", nargs="*", metavar="NAME", default=packages, choices=packages, help=known)
    add("--models", nargs="*", default=["linear"], help="estimators of the zoo, see conf/model")
    systems, known = list(SYSTEMS), ", ".join(SYSTEMS)
    add("--systems", nargs="+", metavar="SYSTEM", default=systems, choices=systems, help=known)
    add("--records", nargs="+", type=int, default=[8, 1], help="training motions")
    add("--seeds", nargs="+", type=int, default=list(SEEDS))
    add("--seconds", type=float, default=120.0, help="of processor, for the fit of a package")
    add("--page", type=Path, help="write the page, from page.md here")
    add("--quick", action="store_true", help="10 s of motion, one record, seed 0, 5 s for a fit")
    options = parser.parse_args(given)
    options.duration = 50.0  # s, of conf/data/simulated.yaml
    if options.quick:
        options.records, options.seeds, options.duration, options.seconds = [1], [0], 10.0, 5.0
    if not 0.0 < options.seconds < float("inf"):
        raise ValueError(f"--seconds={options.seconds} must be positive")
    require(options.packages)
    for model in options.models:
        composed(f"model={model}")  # stops at a misspelt one
    return options


def stored(path: Path, settings: Result, measure: Callable[[], Result]) -> Result:
    """The result in a file, or a new one put there. Raises ValueError for other settings."""
    if not path.exists():
        write_json(path, {**settings, **measure()})
    result: Result = json.loads(path.read_text(encoding="utf-8"))
    for name, value in settings.items():
        if result.get(name) != value:
            raise ValueError(
                f"{path} was measured with {name}={result.get(name)}, now it is {value}; "
                "choose another --output"
            )
    return result


def measured(options: argparse.Namespace, console: Console) -> list[Result]:
    """Results of all cases, packages and models of the options."""
    results = []
    for chosen in product(options.systems, options.records, options.seeds):
        case = Case(*chosen, options.duration)
        for name in (*options.packages, *options.models):
            label = f"{name}-{case.system}-{case.records}-seed{case.seed}"
            if name in PACKAGES:
                package, seconds = version(name), options.seconds
                measure = partial(measure_package, name, case, seconds)
            else:
                package, seconds = "zoo", None
                measure = partial(measure_zoo, name, case, options.output / "zoo" / label)
            settings = {"model": name, "version": package, **vars(case), "seconds": seconds}
            with console.status(label):
                path = options.output / "results" / f"{label}.json"
                results.append(stored(path, settings, measure))
    return results


def main() -> None:
    with one_line_errors("train"):
        options = arguments()
        torch.set_num_threads(1)
        threadpool_limits(1)
        quiet_lightning()
        (options.output / "results").mkdir(parents=True, exist_ok=True)
        console = Terminal(width=120)
        results = measured(options, console)
        report(results, options.output, console)
        if options.page is not None:
            write_page(options.page, results, SEEDS)


if __name__ == "__main__":
    with command_errors():
        main()
