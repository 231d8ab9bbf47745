"""Whole structures simulated by OpenSees, learned by networks of named laws: other people's code.

    python -m benchmarks.unplanted.chains                       # all, accelerations with 2 % noise
    python -m benchmarks.unplanted.chains --cases "gaps, 2 storeys" --noise 0
    python -m benchmarks.unplanted.chains --cases "fibre frame, 3 floors" --model element_network
    python -m benchmarks.unplanted.chains --cases "fibre frame, 2 floors" \
        --model element_network_branch --elements frame --noise 0
    python -m benchmarks.unplanted.chains --cases "fibre frame, light roof" --model moment_frame
    python -m benchmarks.unplanted.chains --drawn Steel02 SelfCentering --seeds 60 61 --noise 0

Shear chains of OpenSees' own materials, chosen or drawn at random (drawn_chains.py), and frames of
fibre elements, under a shaken base (shaken.py); frames.py has more, which only --cases asks for.
Models are given six records of 30 s with accelerations against the base alone, with --noise 0 exact
displacements and velocities too, and, if they ask, the masses and which floors are joined (a chain;
in frames all, or what --elements says). They simulate four unseen motions from rest, and the same
with 1.5 times the ground motion. Errors are relative to the absolute accelerations without noise
[%]. The column `itself` is how far OpenSees is from these with steps twice as long: no model can be
told from one that is as near as that. Needs openseespy.
"""

from __future__ import annotations

import time

import torch

from benchmarks.unplanted.drawn import MATERIALS
from benchmarks.unplanted.drawn_chains import ISOLATED, drawn_chain
from benchmarks.unplanted.fits import fitted
from benchmarks.unplanted.frame import Frame
from benchmarks.unplanted.frames import FRAMES, HELD_BACK
from benchmarks.unplanted.isolated import Bearing, Isolated
from benchmarks.unplanted.opensees import opensees
from benchmarks.unplanted.shaken import Chain, Material, error, itself, record
from benchmarks.unplanted.structures import FARTHER, TRAINED, UNSEEN
from benchmarks.unplanted.unnamed import UNNAMED
from data.arguments import Parser
from data.record import stack
from runner.config.command_line import command_errors
from runner.config.compose import prepare_hydra


def steel(k: float, y: float, hardening: float, growth: float) -> list[Material]:
    shape = [hardening, 18.0, 0.925, 0.15, growth, 1.0, growth, 1.0]
    return [["Steel02", k * y, k, *shape]]


def leaning(steel: list[Material], share: float) -> list[Material]:
    """Beside a weight aloft, which takes so much of the stiffness away: more than it hardens by."""
    ((_, _, k, *_),) = steel
    assert isinstance(k, float)
    return [*steel, ["Elastic", -share * k]]


def slack(k: float) -> list[Material]:
    sides = [("ElasticPPGap", k, s * k * 0.007, s * 0.0015, 0.05, "damage") for s in (1.0, -1.0)]
    return [*sides, ["Elastic", 1.3 * k]]


def pinching(s: float) -> list[Material]:
    backbone = [9e4 * s, 0.005, 1.6e5 * s, 0.014, 1.9e5 * s, 0.035, 1.4e5 * s, 0.09]
    shape = [0.5, 0.25, 0.05, 0.3, 0.2, 0.3, 0.2, 0.6]
    lost = [0.2, 0.2, 0.2, 0.2, 0.3, 0.1, 0.1, 0.1, 0.1, 0.2, 10.0, "energy"]
    return [["Pinching4", *backbone, *shape, *lost]]


def degrading(s: float) -> list[Material]:
    side = [1.1e5 * s, 0.006, 1.5e5 * s, 0.02, 1.6e5 * s, 0.08]
    return [["Hysteretic", *side, *(-number for number in side), 0.6, 0.4, 0.0, 0.0, 0.2]]


CASES: dict[str, Chain | Frame] = {
    "Steel02, 3 storeys": Chain(
        [2.4e4, 2.2e4, 2.0e4], [steel(1.6e7 * s, 0.009, 0.03, 0.03) for s in (1.0, 0.85, 0.7)], 2.6
    ),
    "Steel02, 5 storeys": Chain(
        [2.4e4] * 5,
        [steel(2.6e7 * s, 0.008, 0.02, 0.02) for s in (1.0, 0.95, 0.85, 0.7, 0.55)],
        2.8,
        0.02,
    ),
    "Steel01, 3 storeys": Chain(
        [2.4e4] * 3, [[["Steel01", 1.3e5 * s, 1.6e7 * s, 0.05]] for s in (1.0, 0.85, 0.7)], 2.6
    ),
    "Steel02 with P-Delta, 3 storeys": Chain(
        [2.4e4] * 3,
        [leaning(steel(1.6e7 * s, 0.009, 0.01, 0.02), 0.03) for s in (1.0, 0.85, 0.7)],
        2.0,
    ),
    "SelfCentering, 3 storeys": Chain(
        [2.4e4] * 3,
        [[["SelfCentering", 2e7 * s, 1e6 * s, 1.4e5 * s, 0.6]] for s in (1.0, 0.85, 0.7)],
        2.6,
    ),
    "gaps, 2 storeys": Chain([2.4e4] * 2, [slack(1.2e7 * s) for s in (1.0, 0.8)], 2.6),
    "Pinching4, 2 storeys": Chain([2.0e4, 1.5e4], [pinching(s) for s in (1.0, 0.8)], 2.6),
    "Hysteretic, 3 storeys": Chain([2.4e4] * 3, [degrading(s) for s in (1.0, 0.85, 0.7)], 2.2),
    "isolated, 3 masses": Isolated(
        [3.0e4, 2.4e4, 2.4e4],
        [steel(3.0e7 * s, 0.006, 0.03, 0.02) for s in (1.0, 0.8)],
        4.0,
        bearing=Bearing(1.5, 0.04, 0.10, 20.0, 5e-4),
    ),
    "fibre frame, 3 floors": Frame([4.0e4, 4.0e4, 3.5e4], 4.0),
    "fibre frame, 2 floors": Frame(
        [3.0e4, 2.5e4],
        4.5,
        bays=1,
        height=4.0,
        width=7.0,
        damping=0.03,
        column=(0.28, 0.25, 0.014, 0.009),
        beam=(0.30, 0.15, 0.011, 0.007),
    ),
    "fibre frame, 4 floors": Frame(
        [5.0e4, 5.0e4, 4.5e4, 4.0e4],
        4.0,
        bays=3,
        height=3.3,
        width=5.0,
        damping=0.025,
        column=(0.36, 0.30, 0.020, 0.012),
        beam=(0.30, 0.15, 0.011, 0.007),
    ),
}


def told(model: str, topology: str, case: Chain | Frame) -> list[str]:
    """What a model that asks for it is told of a structure, as settings."""
    masses = f"model.masses={list(map(float, case.masses))}"
    if model.startswith("element_network"):
        return ["model.forced=base", f"model.elements={topology}", masses]
    return [masses] if model == "moment_frame" else []


def main() -> None:
    parser = Parser(description=(__doc__ or "").partition("\n\n")[0])
    add = parser.add_argument
    every = CASES | FRAMES | HELD_BACK
    drawn, usual = [*MATERIALS, ISOLATED, *UNNAMED], list(CASES)
    add("--cases", nargs="+", metavar="CASE", default=usual, choices=every, help="; ".join(every))
    add("--drawn", nargs="+", metavar="KIND", choices=drawn, help=f"drawn: {', '.join(drawn)}")
    add("--seeds", nargs="+", type=int, default=[60, 61], help="of what is drawn")
    add("--model", default="element_network_named")
    add("--noise", type=float, default=0.02, help="of the standard deviation of accelerations")
    add("--seed", type=int, default=0)
    add("--settings", nargs="+", default=[], help="of the model, such as model.prior=1e-3")
    add("--elements", help="chain, all or frame, in place of what suits the case")
    options = parser.parse_args()
    if opensees() is None:
        raise ValueError("openseespy is not installed: pip install openseespy")
    torch.set_num_threads(1)
    prepare_hydra()
    print("| structure | unseen | itself | 1.5 times | itself | s | laws |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | --- |")
    cases = [(name, every[name]) for name in options.cases]
    if options.drawn:
        cases = [drawn_chain(name, seed) for seed in options.seeds for name in options.drawn]
    for name, case in cases:
        train = [record(case, 300 + i, s, options.noise) for i, s in enumerate(TRAINED)]
        unseen, farther = (
            [record(case, 400 + i, times * s) for i, s in enumerate(UNSEEN)]
            for times in (1.0, FARTHER)
        )
        words = [f"model={options.model}", f"seed={options.seed}", *options.settings]
        words += told(options.model, options.elements or case.topology, case)
        begin = time.process_time()
        model, facts = fitted(words, stack(train))
        seconds = time.process_time() - begin
        numbers = (of for r in (unseen, farther) for of in (error(model, r), itself(case, r)))
        errors = " | ".join(f"{number:.2f}" for number in numbers)
        print(f"| {name} | {errors} | {seconds:.0f} | {facts.get('laws', '')} |", flush=True)


if __name__ == "__main__":
    with command_errors():
        main()
