"""Elements of five classes drawn at random, and the motions that are imposed on them.

Every number is drawn before anything is fitted. `Ranges` says between which bounds; HELD_BACK has
others than DEVELOPED, and other motions; SHARP are elements of Bouc and Wen that are nearly
bilinear.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from data.simulation.elements import BaberNoori, Bilinear, BoucWen, Element, LimitedSlip, Polynomial

Pair = tuple[float, float]
BETWEEN = ("ground", "x1")


@dataclass(frozen=True)
class Ranges:
    """Bounds of what is drawn; deformations as the largest imposed one over them.

    yields, gaps: how many times the largest deformation is that at which the element yields, its
    gap closes. damping: c ω/k. post_yield, beyond_gap: stiffness over that of small motions.
    cubic: |k₃| y²/k at the largest deformation, where it softens `softens` at most. exponent: n of
    Bouc and Wen's law. lean: γ/(β + γ). samples, cycles: of a record.
    """

    yields: Pair
    gaps: Pair
    damping: Pair
    post_yield: Pair
    beyond_gap: Pair
    cubic: Pair
    softens: float
    exponent: Pair
    lean: Pair
    samples: tuple[int, int]
    cycles: Pair
    motions: tuple[str, ...]


DEVELOPED = Ranges(
    yields=(1.5, 5.0),
    gaps=(1.4, 4.0),
    damping=(0.01, 0.1),
    post_yield=(0.02, 0.7),
    beyond_gap=(0.3, 1.5),
    cubic=(0.1, 1.0),
    softens=0.3,
    exponent=(1.0, 2.0),
    lean=(-0.3, 0.5),
    samples=(1200, 2000),
    cycles=(10.0, 30.0),
    motions=("noise", "sweep", "cycles"),
)
HELD_BACK = Ranges(
    yields=(1.5, 8.0),
    gaps=(1.4, 6.0),
    damping=(0.002, 0.2),
    post_yield=(0.0, 0.8),
    beyond_gap=(0.2, 3.0),
    cubic=(0.08, 3.0),
    softens=0.25,
    exponent=(1.0, 2.5),
    lean=(-0.45, 0.5),
    samples=(1000, 3000),
    cycles=(6.0, 30.0),
    motions=("beats", "ramps", "quake"),
)
SHARP = replace(DEVELOPED, exponent=(3.0, 10.0))


@dataclass(frozen=True)
class Units:
    """Of a case, drawn over decades: length [m], stiffness [N/m], angular frequency [rad/s]."""

    length: float
    stiffness: float
    omega: float


def units(rng: np.random.Generator) -> Units:
    exponents = rng.uniform((-4.0, 2.0, -1.0), (0.0, 8.0, 1.0))
    length, stiffness, frequency = 10.0**exponents
    return Units(float(length), float(stiffness), float(2.0 * np.pi * frequency))


def linear(rng: np.random.Generator, own: Ranges, of: Units) -> Element:
    return Polynomial(between=BETWEEN, stiffness=of.stiffness, damping=_damping(rng, own, of))


def cubic(rng: np.random.Generator, own: Ranges, of: Units) -> Element:
    share = float(np.exp(rng.uniform(*np.log(own.cubic))))
    softens = rng.uniform() < 0.5 and share < own.softens
    return Polynomial(
        between=BETWEEN,
        stiffness=of.stiffness,
        damping=_damping(rng, own, of),
        cubic_stiffness=(-share if softens else share) * of.stiffness / of.length**2,
    )


def bilinear(rng: np.random.Generator, own: Ranges, of: Units) -> Element:
    c = _damping(rng, own, of)
    return Bilinear(
        between=BETWEEN,
        yield_displacement=of.length / rng.uniform(*own.yields),
        stiffness=of.stiffness,
        post_yield_stiffness=of.stiffness * rng.uniform(*own.post_yield),
        damping=c,
        post_yield_damping=c,
    )


def slip(rng: np.random.Generator, own: Ranges, of: Units) -> Element:
    c = _damping(rng, own, of)
    return LimitedSlip(
        between=BETWEEN,
        yield_displacement=of.length / rng.uniform(*own.yields),
        stiffness=of.stiffness,
        gap_stiffness=of.stiffness * rng.uniform(*own.beyond_gap),
        damping=c,
        slip_damping=c,
        gap=of.length / rng.uniform(*own.gaps),
    )


def bouc_wen(rng: np.random.Generator, own: Ranges, of: Units) -> Element:
    """Half of them beside a spring, half alone, with the force as their state."""
    yields, lean = of.length / rng.uniform(*own.yields), rng.uniform(*own.lean)
    n, post_yield = rng.uniform(*own.exponent), rng.uniform(*own.post_yield)
    if rng.uniform() < 0.5:
        return BaberNoori(
            between=BETWEEN,
            stiffness=of.stiffness,
            post_yield_ratio=post_yield,
            beta=(1.0 - lean) / yields**n,
            gamma=lean / yields**n,
            exponent=n,
        )
    size = of.stiffness / (of.stiffness * yields) ** n
    return BoucWen(
        between=BETWEEN,
        stiffness=of.stiffness,
        beta=(1.0 - lean) * size,
        gamma=-lean * size,  # the law is printed with this sign
        exponent=n,
    )


def _damping(rng: np.random.Generator, own: Ranges, of: Units) -> float:
    return of.stiffness / of.omega * rng.uniform(*own.damping)


CLASSES: Mapping[str, Callable[[np.random.Generator, Ranges, Units], Element]] = {
    "linear": linear,
    "cubic": cubic,
    "bilinear": bilinear,
    "slip": slip,
    "bouc_wen": bouc_wen,
}


def motion(rng: np.random.Generator, kind: str, samples: int, cycles: float) -> np.ndarray:
    """A deformation (T,) from rest whose largest size is 1, of about so many cycles."""
    t = np.linspace(0.0, 1.0, samples)
    begin = np.minimum(1.0, 10.0 * t) ** 2
    y = begin * MOTIONS[kind](rng, t, 2.0 * np.pi * cycles)
    return np.asarray(y / np.abs(y).max())


def _noise(rng: np.random.Generator, t: np.ndarray, omega: float) -> np.ndarray:
    """Random phases and sizes at frequencies from a fifth of ω to 1.6 ω."""
    frequencies = omega * rng.uniform(0.2, 1.6, 30)
    sizes, phases = rng.standard_normal(30), rng.uniform(0.0, 2.0 * np.pi, 30)
    return np.asarray((sizes * np.sin(np.outer(t, frequencies) + phases)).sum(axis=1))


def _sweep(rng: np.random.Generator, t: np.ndarray, omega: float) -> np.ndarray:
    rate = rng.uniform(0.5, 1.5)
    return np.asarray(np.sin(omega * (0.3 * t + 0.7 * rate * t**2)) * rng.uniform(0.7, 1.0))


def _cycles(rng: np.random.Generator, t: np.ndarray, omega: float) -> np.ndarray:
    """Cycles that grow, or shrink."""
    size = 0.1 + 0.9 * (t if rng.uniform() < 0.5 else 1.0 - t)
    return np.asarray(size * np.sin(omega * t))


def _beats(rng: np.random.Generator, t: np.ndarray, omega: float) -> np.ndarray:
    """Three sinusoids."""
    frequencies = omega * rng.uniform(0.5, 1.5, 3)
    sizes, phases = rng.uniform(0.5, 1.0, 3), rng.uniform(0.0, 2.0 * np.pi, 3)
    return np.asarray((sizes * np.sin(np.outer(t, frequencies) + phases)).sum(axis=1))


def _ramps(rng: np.random.Generator, t: np.ndarray, omega: float) -> np.ndarray:
    """Slow strokes between turning points drawn at random, rounded at their ends."""
    count = max(6, round(omega / np.pi))
    turns = rng.uniform(0.2, 1.0, count + 1) * (-1.0) ** np.arange(count + 1)
    turns[0] = 0.0
    place = t * count
    i = np.minimum(place.astype(int), count - 1)
    share = 0.5 - 0.5 * np.cos(np.pi * (place - i))
    return np.asarray(turns[i] + (turns[i + 1] - turns[i]) * share)


def _quake(rng: np.random.Generator, t: np.ndarray, omega: float) -> np.ndarray:
    """Noise that rises and dies away."""
    return np.asarray(_noise(rng, t, omega) * t * np.exp(-rng.uniform(3.0, 7.0) * t))


MOTIONS: Mapping[str, Callable[[np.random.Generator, np.ndarray, float], np.ndarray]] = {
    "noise": _noise,
    "sweep": _sweep,
    "cycles": _cycles,
    "beats": _beats,
    "ramps": _ramps,
    "quake": _quake,
}
