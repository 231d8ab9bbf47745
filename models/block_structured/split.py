"""The start of linear – static – linear: a best linear approximation, shared out.

Behind a Gaussian input the best linear approximation is G₁ G₂ but for a factor (Bussgang 1952), so
its poles and zeros are theirs. Each allocation is judged by a least-squares fit: with G₁ and G₂
given, the curve is linear in its weights (Sjöberg & Schoukens 2012).   N poles, T samples.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from models.block_structured import curve, filters
from models.block_structured.chain import Chain, Motion, chain_of
from models.block_structured.problem import judged, minimised
from models.modal.rational import Lines, relocated

RELOCATIONS, POLISHED = 12, 12  # iterations by spectra and in time
SEARCHED = 8192  # samples, on which allocations are judged
SETTLED = 0.1  # share of them that is not counted: motions begin at rest here
RAMPS = 7  # of the curve there
MOST = 1024  # allocations; beyond, those that a search from random ones comes to
RIDGE = 1e-10
POINTS, FAINT = 400, 1e-3  # of the unit circle, at which filters are fitted; least weight of one
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # of the approximation that come before the curve


def linear(motions: Sequence[Motion], poles: int) -> Chain:
    """The best linear approximation with so many poles, as a chain whose curve is straight."""
    motions = [replace(motion, u=motion.u[:: motion.rate]) for motion in motions]
    lines = [Lines.of(m.u[: m.stop, None], m.y[: m.stop, None]) for m in motions]
    found = relocated(lines, _first_poles(lines, poles), RELOCATIONS)
    a = filters.sections_of(found)
    z = np.concatenate([one.z for one in lines])
    U, Y = (np.concatenate([getattr(one, name)[:, 0] for one in lines]) for name in "UY")
    d, c = filters.fitted_to(Y / np.where(U == 0.0, 1.0, U), a, z, np.abs(U))
    parts = {"d1": np.array([d]), "c1": c, "a1": a, "beta": np.ones(1), "laws": np.empty((0, 3))}
    parts |= {"d2": np.ones(1), "c2": np.empty((0, 2)), "a2": np.empty((0, 2)), "o0": np.zeros(1)}
    return minimised(chain_of(parts, len(motions)), motions, POLISHED, linear=True)


def _first_poles(lines: Sequence[Lines], poles: int) -> np.ndarray:
    """Pairs spread over the band in which there is power, and a real one for an odd number."""
    highest = max(float(np.angle(one.z).max()) for one in lines)
    angle = (np.arange(poles // 2) + 0.5) / max(poles // 2, 1) * highest
    s = angle * (-0.1 + 1j)
    real = [np.exp(-0.5 * highest)] * (poles % 2)
    return np.concatenate([np.exp(s), np.exp(s.conj()), real])


def _groups(roots: np.ndarray) -> list[np.ndarray]:
    """Complex pairs and single real roots."""
    pairs = [np.array([r, r.conj()]) for r in roots if r.imag > 1e-9]
    return pairs + [np.array([r.real + 0j]) for r in roots if abs(r.imag) <= 1e-9]


def _polynomial(groups: Sequence[np.ndarray]) -> np.ndarray:
    roots = np.concatenate([*groups, np.empty(0)])
    whole: np.ndarray = np.atleast_1d(np.poly(roots)).real
    return whole


class Allocations:
    """The ways to share out the poles and zeros of a linear chain, each judged in milliseconds."""

    def __init__(self, approximation: Chain, motion: Motion) -> None:
        p = approximation.parts
        self.poles = _groups(filters.poles_of(p["a1"]))
        self.zeros = _groups(filters.zeros_of(p["d1"][0], p["a1"], p["c1"]))
        some = motion.first(SEARCHED)
        self.u, self.y = some.u[:: motion.rate], some.y
        self.first = int(SETTLED * len(self.y))
        self.seen: dict[bytes, float] = {}

    def filters(self, way: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """b and a of both filters; way: of each group, poles first, whether it is behind."""
        both = []
        for side in (False, True):
            chosen = [g for g, behind in zip(self.poles, way, strict=False) if behind == side]
            others = way[len(self.poles) :]
            zeros = [g for g, behind in zip(self.zeros, others, strict=True) if behind == side]
            both.append((_scaled(_polynomial(zeros)), _polynomial(chosen)))
        return both

    def error(self, way: np.ndarray) -> float:
        """Mean square error of the best curve between the filters."""
        key = way.tobytes()
        if key not in self.seen:
            self.seen[key] = self._error(way)
        return self.seen[key]

    def _error(self, way: np.ndarray) -> float:
        from scipy.signal import lfilter  # slow to import

        (b1, a1), (b2, a2) = self.filters(way)
        x = lfilter(b1, a1, self.u)
        laws = curve.begun(x[self.first :], RAMPS)
        rows = np.concatenate([x[None], [curve.ramp(x, k, np.exp(s)) for _, k, s in laws]])
        rows -= rows[:, :1]
        rows = np.concatenate([lfilter(b2, a2, rows, axis=-1), np.ones((1, len(x)))])
        rows, y = rows[:, self.first :], self.y[self.first :]
        weights, left = _least_squares(rows, y)
        return left if np.isfinite(weights).all() else np.inf

    def best(self, rng: np.random.Generator, count: int) -> list[np.ndarray]:
        """The best ways, best first, each with another allocation of poles."""
        groups = len(self.poles) + len(self.zeros)
        if 2**groups <= MOST:
            for number in range(2**groups):
                self.error(_bits(number, groups))
        else:
            while len(self.seen) < MOST:
                self._descend(rng.random(groups) < 0.5)
        chosen: dict[bytes, np.ndarray] = {}
        for key in sorted(self.seen, key=lambda key: self.seen[key]):
            way = np.frombuffer(key, dtype=bool)
            chosen.setdefault(way[: len(self.poles)].tobytes(), way)
        return list(chosen.values())[:count]

    def _descend(self, way: np.ndarray) -> None:
        """From a way to better ones, a group moved at a time, until none is better."""
        better = True
        while better and len(self.seen) < MOST:
            better, here = False, self.error(way)
            for i in range(len(way)):
                other = way.copy()
                other[i] = not other[i]
                if self.error(other) < here:
                    way, here, better = other, self.error(other), True


def _bits(number: int, count: int) -> np.ndarray:
    return np.array([bool(number >> i & 1) for i in range(count)])


def _scaled(b: np.ndarray) -> np.ndarray:
    """A numerator with coefficients of the size of one, whatever its zeros."""
    return b / np.abs(b).max()


def _least_squares(rows: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, float]:
    """Weights of rows (n, T) that are nearest y (T,), and the mean square of what is left."""
    with np.errstate(all="ignore"):
        size = np.sqrt((rows**2).mean(axis=1))
        size = np.where(size > 0.0, size, 1.0)
        gram = (rows @ rows.T) / size / size[:, None] / len(y)
        if not np.isfinite(gram).all():
            return np.full(len(rows), np.nan), np.inf
        side = rows @ y / size / len(y)
        weights = np.linalg.solve(gram + RIDGE * np.eye(len(gram)), side)
        left = float((y @ y) / len(y) - 2.0 * weights @ side + weights @ gram @ weights)
    return weights / size, left


def starts(
    approximation: Chain,
    motions: Sequence[Motion],
    ramps: int,
    rng: np.random.Generator,
    count: int,
) -> Iterator[Chain]:
    """Chains to train, both filters with all poles of the approximation and weights for each.

    First the approximation G split as Gᵅ and G¹⁻ᵅ (Vanbeylen 2014), then the best allocation of
    zeros for each of the `count` best of poles. A pole that belongs to one filter alone has a zero
    upon it in the other, which training moves where it is better.
    """
    longest = max(motions, key=lambda motion: motion.stop)
    rate, u = longest.rate, longest.drive(longest.stop)
    angles = np.linspace(0.0, np.pi, POINTS)
    p, z = approximation.parts, np.exp(1j * angles)
    weight, finer = _weight(u[::rate]), np.exp(1j * angles / rate)
    sections = filters.sections_of(_at_rate(filters.poles_of(p["a1"]), rate))
    G = filters.response(p["d1"][0], p["a1"], p["c1"], z)
    angle = np.unwrap(np.angle(G))
    pairs = [[np.abs(G) ** e * np.exp(1j * e * angle) for e in (part, 1 - part)] for part in SHARES]
    allocations = Allocations(approximation, longest)
    for way in allocations.best(rng, count):
        both = allocations.filters(way)
        pairs.append([np.polyval(b[::-1], 1 / z) / np.polyval(a[::-1], 1 / z) for b, a in both])
    for pair in pairs:
        parts: dict[str, np.ndarray] = {}
        for number, H in enumerate(pair, start=1):
            gain = np.sqrt(((np.abs(H) * weight) ** 2).sum() / (weight**2).sum())
            d, c = filters.fitted_to(H / gain, sections, finer, weight)
            own = {"d": np.array([d]), "c": c, "a": sections.copy()}
            parts |= {f"{name}{number}": part for name, part in own.items()}
        x = filters.driven(parts["d1"][0], parts["a1"], parts["c1"], u)
        parts |= {"beta": np.ones(1), "laws": curve.begun(x, ramps), "o0": np.zeros(1)}
        yield judged(with_curve(chain_of(parts, len(motions), rate), motions), motions)


def _at_rate(poles: np.ndarray, rate: int) -> np.ndarray:
    """Poles of the same decay and frequency where samples are `rate` times as close."""
    size, angle = np.abs(poles) ** (1.0 / rate), np.angle(poles) / rate
    real = np.abs(poles.imag) < 1e-9  # negative ones have no counterpart: their decay is kept
    moved: np.ndarray = np.where(real, size + 0j, size * np.exp(1j * angle))
    return moved


def _weight(u: np.ndarray) -> np.ndarray:
    """The amplitude (POINTS,) of u between no frequency and half the sampling rate; never nil."""
    power = np.abs(np.fft.rfft(u - u.mean())) ** 2
    edges = np.linspace(0, len(power), POINTS + 1).astype(int)
    amplitude = np.sqrt([power[i : max(j, i + 1)].mean() for i, j in itertools.pairwise(edges)])
    weight: np.ndarray = amplitude / amplitude.max() + FAINT
    return weight


def with_curve(chain: Chain, motions: Sequence[Motion]) -> Chain:
    """The chain with the weights of the curve, and the offset, that suit its filters."""
    chain, p = chain.copy(), chain.parts
    chain = chain_of(
        {name: part.copy() for name, part in p.items()}, len(motions), chain.layout.rate
    )
    p = chain.parts
    rows, y = [], []
    for motion in motions:
        u = motion.drive(motion.stop)
        x = filters.driven(p["d1"][0], p["a1"], p["c1"], u)
        columns = curve.columns(x, p["laws"])
        through = filters.driven(p["d2"][0], p["a2"], p["c2"], columns)
        through = through[:, :: chain.layout.rate]
        first = int(SETTLED * motion.stop) if motion.unknown else 0
        rows.append(np.concatenate([through, np.ones((1, motion.stop))])[:, first:])
        y.append(motion.y[first : motion.stop])
    weights, _ = _least_squares(np.concatenate(rows, axis=1), np.concatenate(y))
    if np.isfinite(weights).all():
        p["beta"][0], p["laws"][:, 0], p["o0"][0] = weights[0], weights[1:-1], weights[-1]
    return chain
