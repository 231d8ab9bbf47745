"""How well do models of structures learn laws that nobody planted, in free run?

    python -m benchmarks.unplanted.suite --page docs/unplanted.md   # all, and the page
    python -m benchmarks.unplanted.suite --cases "flag, 3 storeys" --models element_network_branch
    python -m benchmarks.unplanted.suite --quick                    # a minute, once all is compiled

Every model is fitted to six motions of every structure (structures.py) and simulates four unseen
ones, and those with 1.5 times the ground motion. Results lie in --output, a file for each fit; a
fit with a file is not repeated, so the command goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from benchmarks.unplanted import structures
from benchmarks.unplanted.fits import error, fitted
from benchmarks.unplanted.page import table, write_page
from benchmarks.unplanted.structures import CASES, HELD_BACK, Case, records
from data.record import Record, stack
from models.baselines import Zero
from runner.config.command_line import command_errors
from runner.config.compose import prepare_hydra
from runner.folder.run_folder import write_json

CHAIN = ("model.elements=chain", "model.forced=[]")
STIFFER = "the structure, 1 % stiffer"
MODELS = {  # of conf/model, with settings; masses are given to those that take a chain
    STIFFER: (),
    "zero": (),
    "linear": (),
    "element_network": CHAIN,
    "element_network_branch": CHAIN,
    "element_network_branch, less memory": (
        *CHAIN,
        *("model.force_memory=false", "model.ramps=10", "model.bends=3"),
    ),
}
SEEDED = [name for name, words in MODELS.items() if words]
QUICK = {
    "element_network": ("objective.starts=1", "objective.finalists=1", "solver.iterations=2"),
    "element_network_branch": (
        *("model.ramps=4", "model.bends=1", "model.law_starts=1", "solver.iterations=2"),
    ),
}
Result = dict[str, Any]


def measured(
    name: str,
    case: Case,
    model: str,
    seed: int,
    more: Sequence[str],
    motions: dict[str, list[Record]],
) -> Result:
    """Errors of one fit [%], its processor time [s] and its parameters; why, where it failed."""
    words = [f"model={model.split(',')[0]}", f"seed={seed}", *MODELS[model], *more]
    if MODELS[model]:
        words.append(f"model.masses={list(map(float, case.masses))}")
    result: Result = {"structure": name, "model": model, "seed": seed, "settings": list(more)}
    begin = time.process_time()
    if model == STIFFER:
        others = records(case, changed=True)
        errors = {part: apart(others[part], those) for part, those in motions.items()}
        return {**result, **errors, "seconds": 0.0, "parameters": 0, "remark": ""}
    try:
        batch = stack(motions["train"])
        inputs = batch.excitation.shape[-1]
        still = Zero(batch.dofs, inputs, batch.dt) if model == "zero" else None
        estimator = still or fitted(words, batch)
    except ValueError as wrong:
        none = dict.fromkeys(motions)
        seconds = time.process_time() - begin
        return {**result, **none, "seconds": seconds, "parameters": 0, "remark": str(wrong)}
    seconds = time.process_time() - begin
    errors = {part: error(estimator, those) for part, those in motions.items()}
    finite = {part: value if math.isfinite(value) else None for part, value in errors.items()}
    count = sum(p.numel() for p in estimator.parameters() if p.requires_grad)
    return {**result, **finite, "seconds": seconds, "parameters": count, "remark": ""}


def apart(some: Sequence[Record], others: Sequence[Record]) -> float:
    """Relative RMS difference of motions [%]."""
    pairs = list(zip(some, others, strict=True))
    difference = sum(float(((one.a - other.a) ** 2).sum()) for one, other in pairs)
    return 100.0 * (difference / sum(float((other.a**2).sum()) for _, other in pairs)) ** 0.5


def stored(path: Path, settings: Sequence[str]) -> Result | None:
    """The result in a file. Raises ValueError for other settings."""
    if not path.exists():
        return None
    result: Result = json.loads(path.read_text("utf-8"))
    if result["settings"] != list(settings):
        raise ValueError(f"{path} was measured with other settings; choose another --output")
    return result


def results(options: argparse.Namespace) -> list[Result]:
    found = []
    known = {**CASES, **HELD_BACK}
    for name in options.cases:
        motions: dict[str, list[Record]] = {}
        for model in options.models:
            for seed in options.seeds if model in SEEDED else options.seeds[:1]:
                more = QUICK.get(model.split(",")[0], ()) if options.quick else ()
                label = f"{model}-{name}-seed{seed}".replace(", ", "-").replace(" ", "_")
                label = label.replace("%", "percent")
                path = options.output / f"{label}.json"
                result = stored(path, more)
                if result is None:
                    motions = motions or records(known[name])
                    result = measured(name, known[name], model, seed, more, motions)
                    write_json(path, result)
                found.append(result)
                print(table([result], head=len(found) == 1), flush=True)
    return found


def arguments(given: list[str] | None = None) -> argparse.Namespace:
    """The options. Raises ValueError for names that are not known."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.unplanted.suite", description=(__doc__ or "").splitlines()[0]
    )
    add = parser.add_argument
    add("--output", type=Path, default=Path("runs/unplanted"), help="folder of the results")
    add("--cases", nargs="+", default=[*CASES, *HELD_BACK], help="structures, all but for named")
    add("--models", nargs="+", default=list(MODELS), choices=list(MODELS))
    add("--seeds", nargs="+", type=int, default=[0, 1])
    add("--page", type=Path, help="write the page, from page.md here")
    add("--quick", action="store_true", help="one small structure, 6 s of motion, short fits")
    options = parser.parse_args(given)
    if options.quick:
        options.cases, options.seeds = ["slack braces, 2 storeys"], [0]
        options.output = options.output / "quick"
        structures.SAMPLES = 600
    missing = [name for name in options.cases if name not in (*CASES, *HELD_BACK)]
    if missing:
        raise ValueError(f"--cases {missing}: expected some of {[*CASES, *HELD_BACK]}")
    return options


def main() -> None:
    options = arguments()
    torch.set_num_threads(1)
    prepare_hydra()
    options.output.mkdir(parents=True, exist_ok=True)
    found = results(options)
    if options.page is not None:
        write_page(options.page, found)


if __name__ == "__main__":
    with command_errors():
        main()
