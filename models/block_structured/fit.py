"""Training of linear – static – linear: many starts, the best of which stay, by motion held back.

For some numbers of poles, beginning with the least whose best linear approximation is nearly as
good as any: all starts are trained for some iterations on a part of the motion, the best of them
for longer, the best one with a finer curve; at last all of the motion is fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from models.block_structured import curve, lifted
from models.block_structured.chain import Chain, Motion, chain_of, learned, run
from models.block_structured.problem import minimised
from models.block_structured.split import linear, starts

ORDERS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12)  # numbers of poles of the best linear approximation
AS_GOOD = 1.01  # times the least error of any approximation: then its order is the first tried
PATIENCE = 2  # orders without gain, after which no more are tried
GAIN = 0.97  # of the error before, that another order may leave at most
FEWEST = 4.0  # samples for each parameter
SHORT, LONGER = 10_000, 20_000  # samples of a start's first training and of what follows
ROUNDS = ((10, 4), (25, 2), (40, 1))  # iterations, and how many chains stay after them
COARSE = 8  # ramps of the curve, until few chains are left
NOT_LINEAR = 0.4  # of the output, which the best linear approximation leaves: a curve may be even
LIFTED = 12  # starts then


@dataclass(frozen=True)
class Plan:
    """What is tried: orders, ramps, allocations of poles; iterations of the last fit."""

    orders: Sequence[int] = ORDERS
    ramps: int = 16
    allocations: int = 5
    iterations: int = 120
    prior: float = 1e-9
    seed: int = 0


def parts_of(motions: Sequence[Motion], samples: int) -> list[Motion]:
    """The beginning of each motion: so many samples together, and a fifth more to judge on."""
    share = min(1.0, samples / sum(motion.stop for motion in motions))
    found = []
    for motion in motions:
        stop = max(2, round(share * motion.stop))
        found.append(motion.first(stop, max(stop + 1, round(1.25 * stop))))
    return found


def finer(chain: Chain, motions: Sequence[Motion], ramps: int) -> Chain:
    """The chain with so many ramps, the new ones without effect."""
    more = ramps - chain.layout.ramps
    if more <= 0:
        return chain
    motion = motions[0]
    _, x, _ = run(chain.layout, chain.values, motion.drive(motion.stop), chain.begins[0])
    p = chain.parts
    parts = p | {"laws": np.concatenate([p["laws"], curve.begun(x, more)])}
    wider = chain_of(parts, len(motions), chain.layout.rate)
    return replace(wider, begins=chain.begins, error=chain.error)


def of_order(poles: int, approximation: Chain, motions: Sequence[Motion], plan: Plan) -> Chain:
    """The best chain whose filters have so many poles each."""
    rng = np.random.default_rng([plan.seed, poles])
    some = parts_of(motions, SHORT)
    ramps = min(plan.ramps, COARSE)
    chains = list(starts(approximation, some, ramps, rng, plan.allocations))
    if approximation.error > NOT_LINEAR:
        chains += lifted.starts(some, poles, ramps, rng, LIFTED)
    for number, (iterations, stay) in enumerate(ROUNDS):
        if number == len(ROUNDS) - 1:
            chains = [finer(chain, some, plan.ramps) for chain in chains]
        chains = [minimised(chain, some, iterations, plan.prior) for chain in chains]
        chains = sorted(chains, key=lambda chain: chain.error)[:stay]
        some = parts_of(motions, LONGER)
    return chains[0]


def _possible(poles: int, motions: Sequence[Motion], plan: Plan) -> bool:
    """Whether the samples outnumber the parameters of both filters and the curve well enough."""
    return FEWEST * (8 * poles + 3 * plan.ramps) < sum(motion.stop for motion in motions)


def fitted(motions: Sequence[Motion], plan: Plan) -> tuple[Chain, dict[str, Any]]:
    """A chain of the motions, and what is to be told of it.

    Raises ValueError where the samples are too few, or nothing linear follows the motion.
    """
    orders = [n for n in plan.orders if _possible(n, motions, plan)]
    if not orders:
        raise ValueError(
            f"{sum(len(m.y) for m in motions)} samples are too few for {plan.ramps} ramps and "
            f"{min(plan.orders)} poles; give longer records, or lower model.ramps"
        )
    some = parts_of(motions, LONGER)
    approximations = {n: linear(some, n) for n in orders}
    least = min(one.error for one in approximations.values())
    if not np.isfinite(least):
        raise ValueError("no linear system follows the motion; look for outliers in the record")
    enough = AS_GOOD * least if least <= NOT_LINEAR else np.inf  # else they tell no order
    first = min(n for n, one in approximations.items() if one.error <= enough)
    best: tuple[int, Chain] | None = None
    without_gain = 0
    for n in orders[orders.index(first) :]:
        chain = of_order(n, approximations[n], motions, plan)
        if best is None or chain.error < GAIN * best[1].error:
            best, without_gain = (n, chain), 0
        else:
            without_gain += 1
        if without_gain == PATIENCE:
            break
    assert best is not None
    poles, chain = best
    facts = {"poles": poles, "held_back_linear_percent": 100.0 * least}
    facts |= {"held_back_percent": 100.0 * chain.error}
    whole = [replace(motion, stop=len(motion.y)) for motion in motions]
    return minimised(chain, whole, plan.iterations, plan.prior), facts


def count(chain: Chain) -> int:
    """Learned parameters."""
    return int(learned(chain).sum())
