"""How well do models learn the force of elements whose law nobody planted?

    python -m benchmarks.unplanted                  # every law, three models, four seeds
    python -m benchmarks.unplanted --quick          # two laws, one seed, short fits
    python -m benchmarks.unplanted --laws slack flag --models branch_element --noise 0.05

Structures of such laws: benchmarks/unplanted/suite.py.

Each law is simulated here (laws.py) or by OpenSees where openseespy is installed. A model is fitted
to six motions; its free run is compared with the true force of four unseen ones, and of the same
1.5 times as large: relative RMS errors in percent, over all four, as medians over the seeds.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from statistics import median

import torch

from benchmarks.unplanted import opensees
from benchmarks.unplanted.fits import error, fitted
from benchmarks.unplanted.laws import HELD_BACK, LAWS, SIZES, Law
from benchmarks.unplanted.motions import training, unseen
from data.arguments import Parser
from data.record import stack
from runner.config.command_line import command_errors
from runner.config.compose import prepare_hydra

FARTHER = 1.5  # times the unseen motions
MODELS = {  # of conf/model, with what differs
    "branch_element": (),
    "named_element": (),
    "branch_element, less memory": ("model.force_memory=false",),
    "hysteretic_element": (),
}
SEARCHED = ("named_element",)  # a search of its own, without an objective and a solver
QUICK = ("objective.starts=2", "objective.finalists=1", "solver.iterations=15")


@dataclass(frozen=True)
class Fit:
    train: float  # errors [%]
    unseen: float
    farther: float
    seconds: float  # of the processor


def one_fit(
    model: str, law: tuple[Law, float], seed: int, noise: float, settings: tuple[str, ...]
) -> Fit:
    train = training(*law, noise)
    begin = time.process_time()
    words = [f"model={model.split(',')[0]}", f"seed={seed}", *MODELS[model]]
    words += [] if model in SEARCHED else settings
    estimator, _ = fitted(words, stack(train))
    seconds = time.process_time() - begin
    near, farther = unseen(*law), unseen(*law, FARTHER)
    return Fit(error(estimator, train), error(estimator, near), error(estimator, farther), seconds)


def laws(chosen: list[str] | None, held_back: bool, quick: bool) -> dict[str, tuple[Law, float]]:
    """Laws and their largest deformations."""
    own = {**LAWS, **(HELD_BACK if held_back or chosen else {})}
    known = {name: (law, SIZES[name]) for name, law in own.items()}
    if opensees.opensees() is not None:
        known |= opensees.laws()
    else:
        print("without OpenSees' materials: pip install -c constraints.txt -e '.[opensees]'")
    if chosen is None:
        return dict(list(known.items())[:2]) if quick else known
    missing = [name for name in chosen if name not in known]
    if missing:
        raise ValueError(f"--laws {' '.join(missing)}: expected some of {', '.join(known)}")
    return {name: known[name] for name in chosen}


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--laws", nargs="+", help="names of laws; all where none is named")
    parser.add_argument(
        "--models",
        nargs="+",
        metavar="MODEL",
        choices=list(MODELS),
        default=list(MODELS),
        help="; ".join(MODELS),
    )
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--noise", type=float, default=0.0, help="of the training force, a share")
    parser.add_argument("--held-back", action="store_true", help="also the laws held back")
    parser.add_argument("--quick", action="store_true")
    args = parser.parse_args()
    torch.set_num_threads(1)
    prepare_hydra()
    settings, seeds = (QUICK, 1) if args.quick else ((), args.seeds)
    print(f"{'law':24}{'model':30}{'training':>10}{'unseen':>10}{'1.5 times':>12}{'s a fit':>9}")
    for name, law in laws(args.laws, args.held_back, args.quick).items():
        for model in args.models:
            fits = [one_fit(model, law, seed, args.noise, settings) for seed in range(seeds)]
            middle = [median(getattr(f, k) for f in fits) for k in Fit.__dataclass_fields__]
            each = "   ".join(f"{f.unseen:.2f}/{f.farther:.2f}" for f in fits)
            numbers = "{:10.2f}{:10.2f}{:12.2f}{:9.0f}".format(*middle)
            print(f"{name:24}{model:30}{numbers}   seeds {each}", flush=True)


if __name__ == "__main__":
    with command_errors():
        main()
