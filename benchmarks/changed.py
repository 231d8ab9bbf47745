"""Does a comparison find what changed, and only that? False alarms, and losses found and placed.

    python -m benchmarks.changed                 # 200 undamaged pairs, 200 with a loss
    python -m benchmarks.changed --pairs 20      # in small
    python -m benchmarks.changed --quick         # 3 of each

A chain of two or three storeys, under forces or on a shaken base, masses known or not; two records
of 16 s before, one after under another motion, of half, the same or twice the size; accelerations
with 2, 5 or 10 % of noise, each side its own. Storeys are bilinear, or of Bouc and Wen, as the
laws of the model, or of steel (Menegotto and Pinto), which the model does not contain. The loss is
a quarter of the stiffness and strength of one storey. The model of before is fitted from values
that are up to 10 % off. Drawn from the seed, the number of the pair and whether it has a loss.
Prints how often something is called changed where nothing is, and how often a loss is found, and
comes first. A pair that is refused finds nothing; those are counted, too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from joblib import Parallel, delayed

from benchmarks.table import show
from data import Bilinear, BoucWen, MenegottoPinto, Polynomial, Record, Structure
from data.arguments import Parser
from data.simulation.motion import simulate
from models import ElementNetwork
from models.uncertainty.change import compare, refit
from runner.config.command_line import command_errors

DT, SAMPLES, LOSS = 0.02, 800, 0.25
STIFFNESS, DAMPER = (320.0, 260.0, 200.0), 0.5  # N/m, N s/m, of storeys of 1 kg
YIELD, AFTER = 0.02, 0.15  # m, and the share of the stiffness after yielding
SIZE = 0.45  # m/s² of each of twelve sines: storeys go to one to three times their yield point
LAWS = ("bilinear", "Bouc–Wen", "steel")


def structure(law: str, factors: np.ndarray) -> Structure:
    """A chain whose storeys have so many times their stiffness and strength."""
    springs: dict[str, Any] = {}
    for i, factor in enumerate(factors):
        k, between = factor * STIFFNESS[i], ("ground" if i == 0 else f"x{i}", f"x{i + 1}")
        own: dict[str, Any] = {"between": between, "damping": DAMPER}
        if law == "Bouc–Wen":
            rest, half = (1.0 - AFTER) * k, 0.5 / YIELD
            springs[f"b{i}"] = BoucWen(between=between, stiffness=rest, beta=half, gamma=half)
            springs[f"r{i}"] = Polynomial(**own, stiffness=AFTER * k)
        elif law == "steel":
            own |= {"yield_displacement": YIELD, "hardening_ratio": AFTER}
            springs[f"r{i}"] = MenegottoPinto(**own, stiffness=k)
        else:
            after = {"post_yield_stiffness": AFTER * k, "post_yield_damping": DAMPER}
            springs[f"r{i}"] = Bilinear(**own, stiffness=k, yield_displacement=YIELD, **after)
    return Structure([1.0] * len(factors), springs)


def record_of(
    shaken: Structure, base: bool, size: float, noise: float, rng: np.random.Generator
) -> Record:
    """Accelerations of all storeys under an earthquake of its own, relative to the base."""
    t, n = DT * np.arange(SAMPLES), shaken.dofs
    w, phases = 2.0 * np.pi * rng.uniform(0.4, 6.0, (2, 12, 1 if base else n))
    envelope = (t / 3.0 * np.exp(1.0 - t / 3.0)) ** 1.5
    f = size * envelope[:, None] * np.sin(t[:, None, None] * w + phases).sum(axis=1)
    a = simulate(shaken, np.broadcast_to(f, (SAMPLES, n)).copy(), DT).a
    a = a + noise * a.std(axis=0) * rng.standard_normal(a.shape)
    return Record(DT, torch.from_numpy(a), torch.from_numpy(f))


def model_of(law: str, n: int, base: bool, known: bool, rng: np.random.Generator) -> ElementNetwork:
    """A model of the chain whose values are up to 10 % off."""
    model = ElementNetwork(
        n, 1 if base else n, DT, hinges=0, units=1, cubic=False, elements="chain", substeps=4,
        forced="base" if base else None, rounded=law != "bilinear",
        masses=[1.0] * n if known else None,
    )  # fmt: skip

    def about(*values: float) -> torch.Tensor:
        return torch.tensor(values).double() * torch.from_numpy(rng.uniform(0.9, 1.1, n))

    k, limit = about(*STIFFNESS[:n]), about(*[YIELD] * n)
    if not known:
        model.mass.start(about(*[1.0] * n))
    model.laws.start(k, about(*[DAMPER] * n), limit, (0.5, 0.5))
    model.laws.unit_stiffness.start((1.0 - AFTER) * k[:, None], 1.0)
    model.laws.unit_limit.start(limit[:, None])
    if law == "Bouc–Wen":
        model.laws.unit_rising.start(1.0 / limit[:, None], -1.0)
        model.laws.unit_limit.start(10.0 * limit[:, None])
    model.identified.fill_(1.0)
    return model


def pair(loss: bool, number: int, seed: int) -> dict[str, Any]:
    """One pair: what was called changed, the most certain first; the storey of a loss, or 0."""
    torch.set_num_threads(1)
    rng = np.random.default_rng((seed, number, loss))
    law, n = LAWS[number % len(LAWS)], int(rng.integers(2, 4))
    base, known = rng.integers(2, size=2).astype(bool)
    times, noises = rng.choice([0.5, 1.0, 2.0]), rng.choice([0.02, 0.05, 0.1], 2)
    storey = int(rng.integers(n)) + 1 if loss else 0
    sound = np.ones(n)
    later = sound - LOSS * (np.arange(1, n + 1) == storey)
    before = [record_of(structure(law, sound), base, SIZE, noises[0], rng) for _ in range(2)]
    after = record_of(structure(law, later), base, SIZE * times, noises[1], rng)
    model = model_of(law, n, base, known, rng)
    result = {"law": law, "motion": f"{times:g} times", "storey": storey, "refused": ""}
    result |= {"driven": "base" if base else "forces", "masses": "known" if known else "unknown"}
    noise = float(sum(noises[0] ** 2 * r.a.var() for r in before)) / 2
    try:
        refit(model, before, noise, masses=True)
        places = compare(model, before, [after]).places
    except ValueError as refused:
        return {**result, "places": [], "refused": str(refused)}
    return {**result, "places": places}


def cells(rows: list[dict[str, Any]]) -> list[str]:
    """Shares of pairs: called changed of those that are not; found, and placed, of the others."""
    sound, lost = ([r for r in rows if bool(r["storey"]) == loss] for loss in (False, True))
    counts = (
        (sum(bool(r["places"]) for r in sound), len(sound)),
        (sum(bool(r["places"]) for r in lost), len(lost)),
        (sum(r["places"][:1] == [r["storey"]] for r in lost), len(lost)),
    )
    shares = [f"{100 * part / all_:.1f} %" if all_ else "" for part, all_ in counts]
    return [f"{len(sound)}+{len(lost)}", *shares, str(sum(bool(r["refused"]) for r in rows))]


def main() -> None:
    parser = Parser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="3 pairs of each kind")
    parser.add_argument("--pairs", type=int, default=200, help="of each kind")
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    asked = parser.parse_args()
    numbers = range(3 if asked.quick else asked.pairs)
    work = (delayed(pair)(loss, i, asked.seed) for i in numbers for loss in (False, True))
    rows = list(Parallel(n_jobs=asked.jobs)(work))
    head = ["", "pairs", "alarms", "found", "placed", "refused"]
    lines = [["all", *cells(rows)]]
    for key in ("law", "motion", "driven", "masses"):
        for value in sorted({row[key] for row in rows}):
            lines.append([f"{key}: {value}", *cells([row for row in rows if row[key] == value])])
    show("Undamaged + damaged pairs", head, lines)


if __name__ == "__main__":
    with command_errors():
        main()
