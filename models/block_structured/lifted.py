"""Starts behind an even curve, such as a modulus, of which no linear approximation tells.

With poles given, x = cᵀφ is linear in the sections' signals φ, so that x², and any parabola of x,
is linear in c cᵀ: least squares find the whole matrix, whose first eigenvector is c. The poles are
drawn, many times, and each is judged by the best curve of x.   N poles, T samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from models.block_structured import curve, filters
from models.block_structured.chain import Chain, Motion, chain_of
from models.block_structured.problem import judged
from models.block_structured.split import RAMPS, SETTLED, _least_squares, with_curve

DRAWS = 300  # of poles
SLOWEST = 8.0  # time constants of the slowest pole in a motion, at least
FASTEST = 2.5  # radians a sample
LIGHTEST = 0.05  # ratio of damping
EDGE = 0.01  # share of the samples beyond what is taken for the output's end


def drawn(poles: int, samples: int, rate: int, rng: np.random.Generator) -> np.ndarray:
    """Poles (N,) at R times the sampling rate: pairs, and a real one for an odd number."""
    pairs = rng.integers(poles // 2 + 1) if poles % 2 == 0 and rng.random() < 0.3 else poles // 2
    low = np.log(SLOWEST / samples)
    omega = np.exp(rng.uniform(low, np.log(FASTEST), pairs)) / rate
    ratio = np.exp(rng.uniform(np.log(LIGHTEST), 0.0, pairs))
    s = omega * (-ratio + 1j * np.sqrt(1.0 - ratio**2))
    real = -np.exp(rng.uniform(low, np.log(FASTEST), poles - 2 * pairs)) / rate
    return np.exp(np.concatenate([s, s.conj(), real + 0j]))


def targets(y: np.ndarray) -> list[np.ndarray]:
    """What may be a parabola of x: the output, and squares of its distance from either end."""
    low, high = np.quantile(y, [EDGE, 1.0 - EDGE])
    return [y, (y - low) ** 2, (high - y) ** 2]


def _signals(a: np.ndarray, u: np.ndarray) -> np.ndarray:
    """φ (2p, T): the sections' states now and a sample before, which is nil of a single pole."""
    from scipy.signal import lfilter  # slow to import

    rows = []
    for one in a:
        s = lfilter([1.0], np.r_[1.0, one], u)
        rows += [s, np.r_[0.0, s[:-1]] * (one[1] != 0.0)]
    return np.stack(rows)


def direction(phi: np.ndarray, target: np.ndarray) -> np.ndarray:
    """c (m,) of the x = cᵀφ whose parabola is nearest a target (T,); φ (m, T)."""
    size = np.sqrt((phi**2).mean(axis=1))
    used = np.flatnonzero(size > 0.0)
    if not len(used):
        return np.zeros(len(phi))
    scaled = phi[used] / size[used, None]
    i, j = np.triu_indices(len(used))
    rows = np.concatenate([np.ones((1, phi.shape[1])), scaled, scaled[i] * scaled[j]])
    weights, _ = _least_squares(rows, target)
    c = np.zeros(len(phi))
    if np.isfinite(weights).all():
        matrix = np.zeros((len(used), len(used)))
        matrix[i, j] = weights[1 + len(used) :]
        values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
        c[used] = vectors[:, np.abs(values).argmax()] / size[used]
    return c


def _curve_error(x: np.ndarray, y: np.ndarray) -> float:
    """Mean square error of the best curve of x (T,)."""
    if not x.std() > 0.0:
        return np.inf
    laws = curve.begun(x, RAMPS)
    rows = np.stack([x, *(curve.ramp(x, k, np.exp(s)) for _, k, s in laws), np.ones_like(x)])
    return _least_squares(rows, y)[1]


def starts(
    motions: Sequence[Motion],
    poles: int,
    ramps: int,
    rng: np.random.Generator,
    count: int,
) -> Iterator[Chain]:
    """The best chains of all draws: all that filters is before the curve, as training begins."""
    rate, samples = motions[0].rate, max(motion.stop for motion in motions)
    first = [int(SETTLED * motion.stop) for motion in motions]
    y = np.concatenate([m.y[n : m.stop] for m, n in zip(motions, first, strict=True)])
    found: list[tuple[float, np.ndarray, np.ndarray]] = []
    for _ in range(DRAWS):
        a = filters.sections_of(drawn(poles, samples, rate, rng))
        phi = np.concatenate(
            [
                _signals(a, m.drive(m.stop))[:, :: m.rate][:, n:]
                for m, n in zip(motions, first, strict=True)
            ],
            axis=1,
        )
        for target in targets(y):
            c = direction(phi, target)
            found.append((_curve_error(c @ phi, y), a, c))
    found.sort(key=lambda one: one[0])
    for error, a, c in found[:count]:
        if np.isfinite(error):
            yield _chain(a, c, motions, ramps)


def _chain(a: np.ndarray, c: np.ndarray, motions: Sequence[Motion], ramps: int) -> Chain:
    """A chain of a first filter and the curve that suits it."""
    longest = max(motions, key=lambda motion: motion.stop)
    u = longest.drive(longest.stop)
    c = c.reshape(-1, 2)
    c = c / max(float(filters.driven(0.0, a, c, u).std()), 1e-30)
    parts = {"d1": np.zeros(1), "c1": c, "a1": a, "beta": np.ones(1), "d2": np.ones(1)}
    parts |= {"laws": curve.begun(filters.driven(0.0, a, c, u), ramps), "o0": np.zeros(1)}
    parts |= {"c2": np.zeros_like(c), "a2": a.copy()}
    return judged(with_curve(chain_of(parts, len(motions), longest.rate), motions), motions)
