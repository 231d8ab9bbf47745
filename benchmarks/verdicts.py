"""Is a bad model ever called good? Records with wrong or useless content, and what a run says.

    python -m benchmarks.verdicts                # 64 records with such content, 64 without
    python -m benchmarks.verdicts --quick        # one of every fourth kind

A chain of two masses with elements that yield or harden, drawn at random, under random forces:
accelerations with 2 % noise of a record of 20 s to train on and one to test on, spoilt as a row
names. What a run says of these two is held against four more records of the same kind that it never
sees: a model is good if its free run errs there by less than that of every plain model, and than no
motion. Three kinds of models take turns. Prints how many were called good without a word beside it,
how many of these wrongly; of how many a plain model was said to be as good; how many were refused
or ended red (status 3), and how many of these were better than all plain models by a tenth.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from benchmarks.fitting import fit, free_run_error
from benchmarks.table import show
from data.arguments import Parser
from data.record import Record, stack
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.laws.bilinear import Bilinear
from data.simulation.laws.element import Element
from data.simulation.laws.polynomial import Polynomial
from data.simulation.records import Simulation
from data.simulation.scenario import FullState
from data.simulation.structure import Structure
from models.estimator import Estimator
from runner.config.command_line import command_errors
from runner.scores.verdict import OPPONENTS, compare_with, judgement

DT, DURATION, NOISE = 0.02, 20.0, 0.02  # [s], [s], of a channel's standard deviation
FRESH, MARGIN = 4, 0.9  # records; of the best plain error: better by a tenth
MODELS = (
    ("model=element_network", "model/reads=accelerations", "model.hinges=2", "objective.starts=1",
     "objective.finalists=1", "objective.horizons=[null]", "solver.iterations=25"),
    ("model=modal_network", "model.modes=2", "model.elements=1", "model.laws=[hysteretic]",
     "model.directions=6", "model.draws=1", "model.iterations=15"),
    ("model=vwnn_forward", "model.refinements=1", "model.cutoffs=[0.3,1,4,16,50,100]"),
)  # fmt: skip
HARDENS, NOISY, LONGER = "hardens", "yields, noise 10 %", "yields, twice as long"
SOUND = ("yields", HARDENS, NOISY, LONGER)
MASSES, SHORT = "wrong masses", "too short"
SPOILT = (
    *("noise alone", "another event", "another structure", "unrelated forces", "sensors swapped"),
    *("swapped in the test", "sign in the test", "scale in the test", "saturated", "drifting"),
    *("stuck", "halves swapped", "delayed", "in, out swapped", MASSES, SHORT),
)
COLUMNS = ("records", "good", "wrongly", "as good", "red", "wrongly red")


def chain(kind: str, rng: np.random.Generator, seed: int) -> list[Record]:
    """Records of a structure drawn at random, under the forces of a seed."""

    def spring(*between: str) -> Element:
        first, after = rng.uniform(60.0, 150.0), rng.uniform(10.0, 30.0)
        if kind == HARDENS:
            law = {"stiffness": first, "cubic_stiffness": 1e2 * after, "damping": 0.6}
            return Polynomial(between=between, **law)
        law = {"stiffness": first, "post_yield_stiffness": after, "damping": 0.3}
        return Bilinear(between=between, yield_displacement=rng.uniform(0.01, 0.03), **law)

    structure = Structure([1.0, 1.0], {"r1": spring("ground", "x1"), "r2": spring("x1", "x2")})
    excitation = Excitation(force=BandLimitedGaussian(std=2.0, band=(0.0, 5.0)))
    duration = DURATION * (2.0 if kind == LONGER else 1.0)
    simulation = Simulation(structure, excitation, FullState(), DT, duration)
    found, _ = simulation.records("train", 2 + FRESH, seed)
    return [replace(r.measured(), x=None, v=None) for r in found]


def spoilt(
    kind: str, i: int, own: Sequence[Record], other: Sequence[Record], noise: Tensor
) -> tuple[Tensor, Tensor]:
    """Accelerations and forces (T, 2) that somebody takes for record i, the first to train on.

    other: of another structure under the same forces. noise: as large as the motion.
    """
    a, f = own[i].a, own[i].f
    assert f is not None
    match "" if i == 0 and kind.endswith("in the test") else kind:
        case "noise alone":
            a = noise
        case "another event":
            a = own[i - 1].a
        case "another structure":
            a = other[i].a if i else a
        case "unrelated forces":
            f = noise
        case "sensors swapped" | "swapped in the test":
            a = a.flip(1)
        case "sign in the test":
            f = -f
        case "scale in the test":
            f = 9.81 * f
        case "saturated":
            a = a.clamp(-0.2 * a.std(), 0.2 * a.std())
        case "drifting":
            a = a.cumsum(0).clamp(-20.0, 5.0)
        case "stuck":
            a = 1.0 + 1e-3 * noise
        case "halves swapped":
            a = a.roll(len(a) // 2, 0)
        case "delayed":
            a = a.roll(25, 0)
        case "in, out swapped":
            a, f = f, a
    return a, f


def recorded(kind: str, rng: np.random.Generator) -> list[Record]:
    """Records as somebody has them, with noise: to train on, to test on, and fresh ones."""
    seed, share = int(rng.integers(2**31)), 0.1 if kind == NOISY else NOISE
    own, other = (chain(kind, rng, seed) for _ in range(2))
    found = []
    for i, record in enumerate(own):
        white = torch.from_numpy(rng.normal(size=(2, *record.a.shape)))
        a, f = spoilt(kind, i, own, other, white[0] * record.a.std())
        found.append(replace(record, a=a + share * white[1] * a.std(dim=0), f=f))
    return [found[0].window(0, 60) if kind == SHORT else found[0], *found[1:]]


def plain_models(train: Record) -> dict[str, Estimator | ValueError]:
    plain: dict[str, Estimator | ValueError] = {}
    for name, make in OPPONENTS.items():
        plain[name] = one = make(2, 2, DT)
        try:
            one.identify([train])
        except ValueError as error:
            plain[name] = error
    return plain


def outcome(kind: str, draw: int) -> Counter[str]:
    """What was said of one draw, and whether it is so."""
    rng = np.random.default_rng(((*SOUND, *SPOILT).index(kind), draw))
    train, test, *fresh = recorded(kind, rng)
    words = list(MODELS[0 if kind == MASSES else draw % len(MODELS)])
    words += ["model.masses=[4.0,0.3]"] * (kind == MASSES)
    torch.manual_seed(draw)
    try:
        model, _ = fit(words, stack([train]))
    except ValueError:
        if kind in SOUND:
            raise
        return Counter(["records", "red"])  # refused in a line of its own
    plain = plain_models(train)
    error = free_run_error(model, [train])
    scores = {"relative_rms_percent": error if np.isfinite(error) else None}
    verdict = judgement("free run", scores, False)
    verdict |= compare_with(model, plain, [train], {"test": [test]}, "free run")
    diverges = "test" not in verdict["opponents"]
    red = not verdict["identified"] or verdict["not_better"] or diverges
    said = "red" if red else "as good" if verdict["as_good"] else "good"
    others = [one for one in plain.values() if not isinstance(one, ValueError)]
    own, *beside = (free_run_error(one, fresh) for one in (model, *others))
    motion = torch.cat([r.a for r in fresh])
    still = 100.0 * float((motion - motion.mean(dim=0)).norm() / motion.norm())
    best = float(np.nanmin([still, *beside]))
    wrong = {"wrongly": said == "good" and not own < best}
    return Counter(["records", said]) + Counter(
        wrong | {"wrongly red": said == "red" and own < MARGIN * best}
    )


def rows(quick: bool) -> Iterator[list[object]]:
    for kinds, draws, sum_of in ((SOUND, 16, "all sound"), (SPOILT, 4, "all spoilt")):
        total: Counter[str] = Counter()
        for kind in kinds[:: 4 if quick else 1]:
            found = sum((outcome(kind, k) for k in range(1 if quick else draws)), Counter[str]())
            total += found
            yield [kind, *(found[column] for column in COLUMNS)]
        yield [sum_of, *(total[column] for column in COLUMNS)]


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="one of every fourth kind")
    options = parser.parse_args()
    torch.set_num_threads(1)
    show("", ("content", *COLUMNS), rows(options.quick))


if __name__ == "__main__":
    with command_errors():
        main()
