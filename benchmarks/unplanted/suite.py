"""How well do models of structures learn laws that nobody planted, in free run?

    python -m benchmarks.unplanted.suite --page docs/unplanted.md   # all, and the page
    python -m benchmarks.unplanted.suite --cases "flag, 3 storeys" --models element_network_branch
    python -m benchmarks.unplanted.suite --stored --page docs/unplanted.md   # what there is so far
    python -m benchmarks.unplanted.suite --quick                    # a minute, once all is compiled

Every model is fitted to six motions of every structure (structures.py) and simulates four unseen
ones, and those with 1.5 times the ground motion. Results lie in --output, a file for each fit, and
the loops of its first unseen motion; a fit with a file is not repeated, so the command goes on
where it stopped. What a page was made of is kept beside it, from where --stored takes what does not
lie in --output. A fit is counted as late beyond --limit seconds of the processor.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.unplanted import structures
from benchmarks.unplanted.figures import draw_loops
from benchmarks.unplanted.fits import Facts, error, fitted
from benchmarks.unplanted.page import table, write_page
from benchmarks.unplanted.structures import CASES, HELD_BACK, Case, records
from data.arguments import Parser
from data.record import Record, stack
from data.whole_file import write_text
from models.baselines import Zero
from models.composition.branch_law import learned
from models.element_network_branch import ElementNetworkBranch
from models.element_network_named import ElementNetworkNamed
from models.estimator import Estimator
from runner.config.command_line import command_errors
from runner.config.compose import prepare_hydra
from runner.folder.run_folder import write_json

CHAIN = ("model.elements=chain", "model.forced=[]")
STIFFER = {  # twins: by how much their elements are stiffer
    "the structure, 0.1 % stiffer": 1.001,
    "the structure, 1 % stiffer": 1.01,
}
NOISE = 0.02  # of the standard deviation of every measured acceleration
NOISY = "element_network_branch, accelerations with 2 % noise"
NAMED_NOISY = "element_network_named, accelerations with 2 % noise"
WEIGHTLESS = "element_network_named, masses unknown"
FEW = (
    "steel, 3 storeys",
    "flag, 3 storeys",
)  # structures that slow or further models are fitted to
MODELS = {  # of conf/model, with settings; masses are given to most that take a chain
    **dict.fromkeys(STIFFER, ()),
    "zero": (),
    "linear": (),
    "element_network": CHAIN,
    "element_network_branch": CHAIN,
    "element_network_named": CHAIN,
    NOISY: CHAIN,
    NAMED_NOISY: CHAIN,
    WEIGHTLESS: CHAIN,
}
ON_FEW = ("element_network", NOISY, WEIGHTLESS)
SEEDED = [name for name, words in MODELS.items() if words]
QUICK = {
    "element_network_named": ("model.laws=[SlackBrace]",),
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
    picture: Path,
) -> Result:
    """Errors of one fit [%], its processor time [s] and its parameters; why, where it failed.

    picture: where the loops of a network of branches go.
    """
    result: Result = {"structure": name, "model": model, "seed": seed, "settings": list(more)}
    if model in STIFFER:
        others = records(case, STIFFER[model])
        errors = {part: apart(others[part], those) for part, those in motions.items()}
        return {**result, **errors, "seconds": 0.0, "parameters": 0, "chosen": "", "remark": ""}
    begin = time.process_time()
    try:
        estimator, facts = trained(case, model, seed, more, motions["train"])
    except ValueError as wrong:
        none = dict.fromkeys(motions)
        seconds = time.process_time() - begin
        gone = {"seconds": seconds, "parameters": 0, "chosen": "", "remark": str(wrong)}
        return {**result, **none, **gone}
    seconds = time.process_time() - begin
    errors = {part: error(estimator, those) for part, those in motions.items()}
    finite = {part: value if math.isfinite(value) else None for part, value in errors.items()}
    if isinstance(estimator, ElementNetworkBranch):
        np.savez(picture, signals=loops(case, estimator, motions["unseen"][0]))
    told = {key: str(value) for key, value in facts.items()}
    words = {"chosen": words_of(facts), "identified": told, "remark": ""}
    return {**result, **finite, "seconds": seconds, "parameters": parameters(estimator), **words}


def trained(
    case: Case, model: str, seed: int, more: Sequence[str], train: list[Record]
) -> tuple[Estimator, Facts]:
    """The model fitted to the training motions, and what its identification tells."""
    if model in (NOISY, NAMED_NOISY):
        train = [noisy(record, 1000 * (seed + 1) + i) for i, record in enumerate(train)]
    batch = stack(train)
    if model == "zero":
        return Zero(batch.dofs, batch.excitation.shape[-1], batch.dt), {}
    words = [f"model={model.split(',')[0]}", f"seed={seed}", *MODELS[model], *more]
    if MODELS[model] and model != WEIGHTLESS:
        words.append(f"model.masses={list(map(float, case.masses))}")
    return fitted(words, batch)


def noisy(record: Record, seed: int) -> Record:
    """The accelerations alone, with noise."""
    drawn = torch.randn(record.a.shape, generator=torch.Generator().manual_seed(seed)).double()
    return replace(record, a=record.a + NOISE * record.a.std(dim=0) * drawn, x=None, v=None)


def parameters(estimator: Estimator) -> int:
    """Number of free parameters."""
    if isinstance(estimator, ElementNetworkNamed):
        return estimator.identified_parameters
    count = sum(p.numel() for p in estimator.parameters() if p.requires_grad)
    if isinstance(estimator, ElementNetworkBranch):
        count -= int((~learned(estimator.theta, estimator.sizes)).sum())
    return count


def words_of(facts: Facts) -> str:
    """What was chosen on motion held back: the memory of every law, the weight of the polish."""
    if "memory" not in facts:
        return ""
    return f"{facts['memory']}; {facts['prior']:g}" if "prior" in facts else str(facts["memory"])


@torch.no_grad()
def loops(case: Case, estimator: ElementNetworkBranch, record: Record) -> np.ndarray:
    """Drifts and forces of a motion, true and as the model simulates them (4, T, storeys)."""
    motion = structures.motion(case.structure(), record)
    y, r = (np.zeros((record.samples, len(case.storeys))) for _ in range(2))
    first = 0
    for storey, laws in enumerate(case.storeys):
        y[:, storey] = motion.y[:, first]
        r[:, storey] = motion.r[:, first : first + len(laws)].sum(axis=1)
        first += len(laws)
    own_y, own_r = estimator.element_loops(record)
    return np.stack([y, r, own_y.numpy(), own_r.numpy()])


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


def kept(page: Path | None) -> dict[tuple[str, str, int], Result]:
    """Results of the page as it is, by structure, model and seed."""
    path = None if page is None else page.with_suffix(".json")
    rows = json.loads(path.read_text("utf-8")) if path is not None and path.exists() else []
    return {(row["structure"], row["model"], row["seed"]): row for row in rows}


def keep(page: Path, results: Sequence[Result]) -> None:
    """Write the results that a page was made of, but for what was identified."""
    rows = [{k: v for k, v in row.items() if k != "identified"} for row in results]
    lines = ",\n".join(json.dumps(row) for row in rows)
    write_text(page.with_suffix(".json"), f"[\n{lines}\n]\n")


def wanted(options: argparse.Namespace) -> list[tuple[str, str, int]]:
    """Structures, models and seeds, those of one seed on all structures before the next."""
    fits = []
    for seed in options.seeds:
        for name in options.cases:
            for model in options.models:
                few = model in ON_FEW and name not in FEW and not options.quick
                if not few and (model in SEEDED or seed == options.seeds[0]):
                    fits.append((name, model, seed))
    return fits


def results(options: argparse.Namespace) -> list[Result]:
    """Results of all fits, the stored ones and, unless those alone are asked for, the others."""
    found = []
    known = {**CASES, **HELD_BACK}
    before = kept(options.page) if options.stored else {}
    for name, model, seed in wanted(options):
        more = QUICK.get(model.split(",")[0], ()) if options.quick else ()
        label = f"{model}-{name}-seed{seed}".replace(", ", "-").replace(" ", "_")
        path = options.output / f"{label.replace('%', 'percent')}.json"
        result = stored(path, more) or before.get((name, model, seed))
        if result is None and options.stored:
            continue
        if result is None:
            motions = records(known[name])
            picture = path.with_suffix(".npz")
            result = measured(name, known[name], model, seed, more, motions, picture)
            write_json(path, result)
        found.append(result)
        print(table([result], head=len(found) == 1), flush=True)
    return found


def arguments(given: list[str] | None = None) -> argparse.Namespace:
    """The options. Raises ValueError for names that are not known."""
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    add = parser.add_argument
    add("--output", type=Path, default=Path("runs/unplanted"), help="folder of the results")
    add("--cases", nargs="+", default=[*CASES, *HELD_BACK], help="structures, all but for named")
    add(
        "--models",
        nargs="+",
        default=list(MODELS),
        metavar="MODEL",
        choices=list(MODELS),
        help="; ".join(MODELS).replace("%", "%%"),
    )
    add("--seeds", nargs="+", type=int, default=[0, 1])
    add("--page", type=Path, help="write the page, from page.md here, and its pictures")
    add("--limit", type=float, default=300.0, help="seconds of a fit at most; more are told")
    add("--stored", action="store_true", help="fit nothing: a page of what there is and was kept")
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
        pictures = draw_loops(options.page.parent / "figures", options.output, found)
        write_page(options.page, found, wanted(options), pictures, options.limit)
        keep(options.page, found)


if __name__ == "__main__":
    with command_errors():
        main()
