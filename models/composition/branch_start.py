"""A start of the branch law: its envelope by least squares from forces far along their branches.

Of many ramps drawn at random, those that explain most are taken one after another (orthogonal
matching pursuit).   S samples, all in units of the data's largest.
"""

from __future__ import annotations

import math

import numpy as np

from models.composition.branch_law import Sizes, counts, is_larger, is_unsymmetric
from models.composition.branch_law_compiled import CORNER, EDGE, SHARE, TAIL

FAR = 0.2  # of the largest deformation: the way after which a force is near the envelope
DRAWN, RIDGE = 80, 3e-3  # ramps to choose from; of their weights
STEEPEST, FLATTEST = 5.0, 0.7  # of their arguments
LEAST = (0.02, 0.4)  # y₀, of the largest deformation
STIFFER = (0.0, 2.5)  # log k/k₀
Steps = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # of `with_turning_points`


def envelope_samples(
    steps: Steps, r: np.ndarray, of: Sizes
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inputs of E (S, memories + 2) by the measured forces, s r (S,) and the ways p (S,)."""
    y, rate, turns, place = steps
    rows, forces, ways = [], [], []
    highest, lowest, path, energy = max(y[0], 0.0), min(y[0], 0.0), 0.0, 0.0
    y_turn, y_before, r_before, side, memory = y[0], y[0], 0.0, 0.0, np.zeros(of[1])
    for n in range(len(y)):
        highest, lowest = max(highest, y[n]), min(lowest, y[n])
        if place[n] >= 0:
            now = r[place[n]]
            energy += 0.5 * (r_before + now) * (y[n] - y_before)
            y_before, r_before = y[n], now
            if side:
                g = 1.0 - math.exp(-abs(rate[n]))
                rows.append(np.concatenate([[side * y[n]], memory, [g]]))
                forces.append(side * now)
                ways.append(side * (y[n] - y_turn))
        if turns[n]:
            side, path, y_turn = float(turns[n]), path + abs(y[n] - y_turn), y[n]
            excursions = (highest, -lowest) if side > 0.0 else (-lowest, highest)
            grown = SHARE * math.copysign(math.log1p(abs(energy)), energy)
            kept = [*excursions, SHARE * math.log1p(path)]
            kept += [side * y_turn, side * r_before, grown] if is_larger(of) else []
            memory = np.array([*kept, side] if is_unsymmetric(of) else kept)
    return np.array(rows), np.array(forces), np.array(ways)


def drawn_start(
    rng: np.random.Generator,
    of: Sizes,
    samples: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> np.ndarray:
    """Parameters θ (P,) of a start."""
    _, memories, ramps, bends = of
    of_E, of_k = counts(of)
    x, r, ways = samples
    theta: np.ndarray = np.zeros(of_E + 2 * of_k + TAIL)
    tail = theta[of_E + 2 * of_k :]
    tail[0] = rng.uniform(*np.log(LEAST))
    tail[4] = rng.uniform(-1.0, 0.5)  # v₀ about the median of |ẏ|
    far = ways > min(FAR, float(np.median(ways)))
    x = x[far].copy()
    h = x[:, 1:3] - math.exp(tail[0])
    x[:, 1:3] = 0.5 * (h + np.sqrt(h**2 + EDGE**2))
    theta[:of_E] = _envelope(rng, ramps, x, r[far], is_unsymmetric(of))
    for first, (low, high) in ((of_E, STIFFER), (of_E + of_k, (-0.3, 1.0))):
        theta[first] = rng.uniform(low, high)
        rest = theta[first + 1 + memories : first + of_k].reshape(bends, memories + 2)
        for row in rest:
            row[1:-1] = rng.standard_normal(memories)
            row[0] = -row[1:-1] @ rng.uniform(0.0, 1.0, memories)
            row[-1] = 0.05 * rng.standard_normal()
    return theta


def _envelope(
    rng: np.random.Generator, ramps: int, x: np.ndarray, r: np.ndarray, unsymmetric: bool
) -> np.ndarray:
    """Parameters of E: a line and the ramps that explain most of what is left."""
    inputs, drawn = x.shape[1], 2 * DRAWN if unsymmetric else DRAWN
    arguments = np.array(  # (D, 1 + inputs)
        [_ramp_across(rng, i, x, unsymmetric and i < DRAWN) for i in range(drawn)]
    )
    steepness = np.abs(arguments[:, 1])
    h = arguments[:, :1] + arguments[:, 1:] @ x.T
    columns = (0.5 * (h + np.sqrt(h**2 + CORNER**2)) / steepness[:, None]).T  # (S, D)
    table, chosen = np.column_stack([np.ones(len(x)), x]), []
    for _ in range(ramps):
        Q, _ = np.linalg.qr(table)
        left, new = r - Q @ (Q.T @ r), columns - Q @ (Q.T @ columns)
        size, whole = np.linalg.norm(new, axis=0), np.linalg.norm(columns, axis=0)
        gain = np.where(size > 0.02 * whole, np.abs(left @ new) / (size + 1e-9), -1.0)
        chosen.append(int(np.argmax(gain)))
        table = np.column_stack([table, columns[:, chosen[-1]]])
    ridge = RIDGE * len(x) * np.array([0.1] * (1 + inputs) + [1.0] * ramps)
    weights = np.linalg.solve(table.T @ table + np.diag(ridge), table.T @ r)
    of_ramps = [
        np.concatenate([arguments[i], [weight / steepness[i]]])
        for i, weight in zip(chosen, weights[1 + inputs :], strict=True)
    ]
    return np.concatenate([weights[: 1 + inputs], *of_ramps])


def _ramp_across(rng: np.random.Generator, number: int, x: np.ndarray, one_way: bool) -> np.ndarray:
    """b, a of a ramp along ±ŷ, its corner at a sample; half of the corners move with excursions.

    one_way: the corner lies elsewhere in the other direction.
    """
    tilt = 0.1 if rng.uniform() < 0.5 else 0.0
    a: np.ndarray = tilt * rng.standard_normal(int(x.shape[1]))
    share = 1.0 if rng.uniform() < 0.5 else rng.uniform()
    a[0] = 1.0 if number % 2 else -1.0  # of ŷ
    if number % 4 < 2:
        a[1 if number % 2 else 2] -= share
    if one_way:
        a[-2] = rng.uniform(-1.0, 1.0)
    a *= float(np.exp(rng.uniform(math.log(FLATTEST), math.log(STEEPEST))))
    return np.concatenate([[-a @ x[rng.integers(len(x))]], a])
