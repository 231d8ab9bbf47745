"""How much sooner do fits of networks of elements end than in an earlier checkout, at what error?

    python -m benchmarks.fits OLD_TREE                          # and this checkout
    python -m benchmarks.fits OLD_TREE NEW_TREE --quick
    python -m benchmarks.fits OLD_TREE --python-old OLD_TREE/.venv/bin/python

Both trees do each fit by turns, on the cores that they take by default, after a short one that
compiles. Prints seconds and free-run errors of each, and the median of their ratios. Results lie in
--output, where a fit that has one is not repeated: the command goes on where it stopped.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from statistics import median

from benchmarks.same_numbers import run_in, two_trees
from benchmarks.table import show
from data.arguments import Parser
from runner.config.command_line import command_errors

SYSTEMS = ("bilinear", "polynomial", "bouc_wen")
ROWS = [  # of the leaderboard: model, system, records
    *(("element_network", system, records) for system in SYSTEMS for records in (1, 8)),
    *(("latent_hysteresis_network", system, 8) for system in SYSTEMS),
]
ALIKE = ("figures=false", "baselines=none")


def measure(tree: Path, python: Path, words: Sequence[str], folder: Path) -> tuple[float, float]:
    """Seconds of a fit and its error in free run [%]. Raises RuntimeError where it fails."""
    path = folder / "metrics.json"
    if not path.is_file():
        reason = run_in(tree, python, [*ALIKE, *words], folder)
        if reason is not None:
            raise RuntimeError(f"{tree}: {' '.join(words)}: {reason}")
    metrics = json.loads(path.read_text("utf-8"))
    return metrics["fit_seconds"], metrics["free_run"]["relative_rms_percent"]


def rows(trees: dict[Path, Path], seeds: int, output: Path, shorter: Sequence[str]) -> Iterator:
    """A row for each fit in both trees {tree: its interpreter}, the old tree first."""
    sides = list(zip(("old", "new"), trees.items(), strict=True))
    ratios = []
    for side, (tree, python) in sides:
        words = [f"model={ROWS[0][0]}", "data.duration=5"]
        measure(tree, python, words, output / f"{side}-compiles")
    for seed, (model, system, records) in product(range(seeds), ROWS):
        words = [f"model={model}", f"system={system}", f"data.train_records={records}"]
        words += [f"seed={seed}", *shorter]
        (before, error), (now, error_now) = (
            measure(tree, python, words, output / f"{side}-{model}-{system}-{records}-{seed}")
            for side, (tree, python) in sides
        )
        ratios.append(before / now)
        numbers = f"{before:.1f}", f"{now:.1f}", f"{before / now:.2f}"
        yield [f"{model}, {system}, {records}", *numbers, f"{error:.3g}", f"{error_now:.3g}"]
    yield ["median of the ratios", "", "", f"{median(ratios):.2f}", "", ""]


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--output", type=Path, default=Path("runs/fits"))
    parser.add_argument("--quick", action="store_true", help="a seed, records of 10 s")
    options, trees = two_trees(parser)
    seeds, shorter = (1, ["data.duration=10"]) if options.quick else (options.seeds, [])
    head = ("model, system, records", "old [s]", "new [s]", "ratio", "old [%]", "new [%]")
    show("", head, rows(trees, seeds, options.output.resolve(), shorter))


if __name__ == "__main__":
    with command_errors():
        main()
