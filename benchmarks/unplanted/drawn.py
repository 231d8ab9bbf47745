"""Materials of OpenSees whose numbers nobody chose: drawn at random, in any units.

    python -m benchmarks.unplanted.drawn --materials Pinching4 --seeds 0 1 2 3 4 5
    python -m benchmarks.unplanted.drawn --materials Steel02 --noise 0.05 --models branch_element
    python -m benchmarks.unplanted.drawn --materials ConcreteAndSteel SAWS --models branch_element
    python -m benchmarks.unplanted.drawn --materials singleFPBearing

Motions are those of `python -m benchmarks.unplanted`. A seed draws the numbers and the units of a
material; a model is fitted to six motions and simulates four unseen ones, and the same 1.5 times as
large: relative RMS errors of the force without noise [%]. The column `itself` is how far the
material is from these forces with finer steps: no model can be told to be nearer than that. Needs
openseespy.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from statistics import median

import numpy as np
import torch
from scipy.interpolate import CubicHermiteSpline

from benchmarks.unplanted.fits import error, fitted
from benchmarks.unplanted.isolated import alone, drawn_bearing
from benchmarks.unplanted.laws import Law
from benchmarks.unplanted.motions import DT, training, unseen
from benchmarks.unplanted.opensees import material, opensees
from benchmarks.unplanted.unnamed import UNNAMED, Drawn, Words
from data.arguments import Parser
from data.record import Record, stack
from runner.config.command_line import command_errors
from runner.config.compose import prepare_hydra

FARTHER, FINER = 1.5, 64  # times the unseen motions; steps of a sample
BEARING = "singleFPBearing"  # an element of OpenSees, no material


def pinching4(
    rng: np.random.Generator, yielded: float, force: float, uneven: bool = False
) -> Drawn:
    """Every fourth law loses nothing; of the others' losses some are none."""
    draw = rng.uniform
    points, shares = _side(rng, yielded, force)
    size = points[-1]
    if uneven:
        more, other = _side(rng, yielded * draw(0.6, 1.6), force * draw(0.5, 1.5))
        points, shares = points + [-n for n in more], shares + other
        size = max(size, more[-1])
    losing = rng.random() < 0.75
    losses: Words = []
    for _ in range(3):
        first, second = (losing and rng.random() < 0.7 for _ in range(2))
        both = [first * draw(0.05, 0.5), second * draw(0.05, 0.5)]
        losses += [*both, draw(0.2, 1.5), draw(0.2, 1.5), draw(0.3, 0.9)]
    words: Words = ["Pinching4", 1, *points, *shares, *losses, draw(2.0, 15.0), "energy"]
    return [words], float(size * draw(0.3, 1.0))


def _side(
    rng: np.random.Generator, yielded: float, force: float
) -> tuple[list[float], list[float]]:
    """Forces and places of four points, the last place last; shares of pinching."""
    draw = rng.uniform
    places = yielded * np.cumprod([1.0, draw(1.5, 5.0), draw(1.5, 4.0), draw(1.5, 4.0)])
    strengths = force * np.cumprod([1.0, draw(1.1, 2.2), draw(0.95, 1.3), draw(0.4, 1.1)])
    unloading = draw(-0.2, 0.3)
    points = [float(n) for pair in zip(strengths, places, strict=True) for n in pair]
    return points, [draw(0.1, 0.7), max(unloading, 0.0) + draw(0.1, 0.5), unloading]


def hysteretic(rng: np.random.Generator, yielded: float, force: float) -> Drawn:
    """Three lines on either side, pinching; every other law is damaged by ductility or energy."""
    words: Words = ["Hysteretic", 1]
    draw = rng.uniform
    places: np.ndarray = np.zeros(3)
    for side in (1.0, -1.0):
        first, size = yielded * draw(0.8, 1.3), force * draw(0.7, 1.3)
        places = first * np.cumprod([1.0, draw(2.0, 5.0), draw(2.0, 4.0)])
        strengths = size * np.cumprod([1.0, draw(1.1, 1.6), draw(0.8, 1.2)])
        words += [side * float(n) for p in zip(strengths, places, strict=True) for n in p]
    damage = [draw(0.0, 0.02), draw(0.0, 0.05)] if rng.random() < 0.5 else [0.0, 0.0]
    words += [draw(0.3, 0.9), draw(0.2, 0.7), *damage, draw(0.0, 0.5)]
    return [words], float(places[-1] * draw(0.3, 0.9))


def steel02(rng: np.random.Generator, yielded: float, force: float) -> Drawn:
    """Its yield lines grow by an amount of their own on either side."""
    draw = rng.uniform
    shape = [draw(0.01, 0.1), draw(10.0, 20.0), draw(0.85, 0.93), draw(0.1, 0.2)]
    growth = [draw(0.0, 0.06), 1.0, draw(0.0, 0.06), 1.0]
    words: Words = ["Steel02", 1, force, force / yielded, *shape, *growth]
    return [words], float(yielded * draw(3.0, 9.0))


def self_centering(rng: np.random.Generator, yielded: float, force: float) -> Drawn:
    draw, k = rng.uniform, force / yielded
    words: Words = ["SelfCentering", 1, k, k * draw(0.02, 0.2), force, draw(0.3, 0.95)]
    return [words], float(yielded * draw(3.0, 9.0))


def gaps(rng: np.random.Generator, yielded: float, force: float) -> Drawn:
    """Two braces that grow slack, one pulled and one pushed, beside a spring."""
    draw = rng.uniform
    k, slack, hardening = force / yielded, yielded * draw(0.1, 0.5), draw(0.02, 0.1)
    sides = (1.0, -1.0)
    words: list[Words] = [
        ["ElasticPPGap", 1, k, side * force, side * slack, hardening, "damage"] for side in sides
    ]
    return [*words, ["Elastic", 1, k * draw(0.1, 1.0)]], float(yielded * draw(3.0, 9.0))


# of random numbers, where a material yields, and the force there
MATERIALS: dict[str, Callable[[np.random.Generator, float, float], Drawn]] = {
    "Pinching4": pinching4,
    "UnevenPinching4": partial(pinching4, uneven=True),
    "Hysteretic": hysteretic,
    "Steel02": steel02,
    "SelfCentering": self_centering,
    "ElasticPPGap": gaps,
}


def drawn(name: str, seed: int) -> tuple[Law, float]:
    """A material and the largest deformation of its training motions."""
    rng = np.random.default_rng(seed)
    yielded, force = 10.0 ** rng.uniform(-3.0, 1.0), 10.0 ** rng.uniform(0.0, 7.0)
    if name == BEARING:
        return alone(drawn_bearing(rng, yielded), force), yielded
    parts, size = (MATERIALS | UNNAMED)[name](rng, yielded, force)
    laws = [material(words) for words in parts]

    def law(y: np.ndarray, rate: np.ndarray) -> np.ndarray:
        return np.sum([one(y, rate) for one in laws], axis=0)

    return law, size


def itself(law: Law, records: Sequence[Record]) -> float:
    """How far a material is from records without noise in steps that are finer [%]."""
    squares = 0.0
    for record in records:
        assert record.s is not None
        assert record.s_dot is not None
        y, rate, t = (
            record.s[:, 0].numpy(),
            record.s_dot[:, 0].numpy(),
            DT * np.arange(len(record.a)),
        )
        fine = np.linspace(0.0, t[-1], FINER * (len(t) - 1) + 1)
        curve = CubicHermiteSpline(t, y, rate)
        r = law(curve(fine), curve(fine, 1))[::FINER]
        squares += float(((r - record.a[:, 0].numpy()) ** 2).sum())
    return 100.0 * (squares / sum(float((one.a**2).sum()) for one in records)) ** 0.5


def one_fit(words: list[str], law: tuple[Law, float], noise: float) -> tuple[list[float], str]:
    """Errors [%]: training, unseen, itself, 1.5 times, itself; seconds; the law's name."""
    train = training(*law, noise)
    begin = time.process_time()
    estimator, facts = fitted(words, stack(train))
    seconds = time.process_time() - begin
    errors = [error(estimator, training(*law))]
    for times in (1.0, FARTHER):
        records = unseen(*law, times)
        errors += [error(estimator, records), itself(law[0], records)]
    return [*errors, seconds], str(facts.get("laws", ""))


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    add = parser.add_argument
    add(
        "--materials",
        nargs="+",
        default=[*MATERIALS, BEARING],
        metavar="NAME",
        choices=[*MATERIALS, BEARING, *UNNAMED],
        help=", ".join([*MATERIALS, BEARING, *UNNAMED]),
    )
    add("--models", nargs="+", default=["named_element"])
    add("--seeds", nargs="+", type=int, default=[0, 1, 2, 3])
    add("--noise", type=float, default=0.0, help="of the training force, a share")
    add("--settings", nargs="*", default=[], help="of the model, as model.laws=[Pinching4]")
    options = parser.parse_args()
    if opensees() is None:
        raise ValueError("openseespy is not installed: pip install openseespy")
    torch.set_num_threads(1)
    prepare_hydra()
    print("| material | model | seed | training | unseen | itself | 1.5 times | itself | s | law |")
    print("| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | --- |")
    for name in options.materials:
        for model in options.models:
            rows = []
            for seed in options.seeds:
                words = [f"model={model}", f"seed={seed}", *options.settings]
                numbers, law = one_fit(words, drawn(name, seed), options.noise)
                rows.append(numbers)
                _print(name, model, str(seed), numbers, law)
            _print(name, model, "median", [median(of) for of in zip(*rows, strict=True)], "")


def _print(name: str, model: str, seed: str, numbers: list[float], law: str) -> None:
    *errors, seconds = numbers
    columns = " | ".join(f"{e:.2f}" for e in errors)
    print(f"| {name} | `{model}` | {seed} | {columns} | {seconds:.0f} | {law} |", flush=True)


if __name__ == "__main__":
    with command_errors():
        main()
