"""Linear – static – linear as data and one function: parameters in a list, run, derivatives.

x = G₁ u,   w = f(x),   y = G₂ w + o₀;   all in units of the records' sizes.
All of it works at R times the sampling rate, lest what the curve adds above half of that be folded
back.   T samples, p₁ and p₂ sections, K ramps, P learned parameters, S numbers of a first state.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from models.block_structured.chain_compiled import chain_run
from models.layers.named_parts import NamedParts


@dataclass(frozen=True)
class Motion:
    """A record in units of the model: u (R (T − 1) + 1,), y (T,), what is held back."""

    u: np.ndarray
    y: np.ndarray
    unknown: bool  # how it begins; else at rest
    stop: int  # samples before this one are fitted

    @property
    def rate(self) -> int:
        """R, numbers of u for each of y."""
        return (len(self.u) - 1) // (len(self.y) - 1)

    def drive(self, samples: int) -> np.ndarray:
        """u of the first so many samples."""
        return self.u[: self.rate * (samples - 1) + 1]

    def first(self, samples: int, end: int | None = None) -> Motion:
        """The first so many samples, that are fitted, and those up to `end`, that are not."""
        stop = min(samples, self.stop)
        last = stop if end is None else min(end, len(self.y))
        return Motion(self.drive(last), self.y[:last], self.unknown, stop)


@dataclass(frozen=True)
class Layout(NamedParts):
    """Numbers of sections before and after the curve, and of its ramps; R."""

    before: int
    after: int
    ramps: int
    rate: int = 1

    @cached_property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        one, two = self.before, self.after
        first = {"d1": (1,), "c1": (one, 2), "a1": (one, 2)}
        curved = {"beta": (1,), "laws": (self.ramps, 3)}
        return first | curved | {"d2": (1,), "c2": (two, 2), "a2": (two, 2), "o0": (1,)}

    @property
    def states(self) -> int:
        return 2 * (self.before + self.after)

    def states_of(self, begin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """s[−1], s[−2] of the sections before (p₁, 2) and after (p₂, 2) the curve."""
        return begin[: 2 * self.before].reshape(-1, 2), begin[2 * self.before :].reshape(-1, 2)


@dataclass
class Chain:
    """A model in training: its numbers, first states (motions, S), error on what is held back."""

    layout: Layout
    values: np.ndarray
    begins: np.ndarray
    error: float = np.inf
    told: dict[str, float] = field(default_factory=dict)

    @property
    def parts(self) -> dict[str, np.ndarray]:
        return self.layout.split(self.values)

    def copy(self) -> Chain:
        return replace(self, values=self.values.copy(), begins=self.begins.copy())


def chain_of(parts: dict[str, np.ndarray], motions: int, rate: int = 1) -> Chain:
    """A chain with these parts, all motions at rest."""
    layout = Layout(len(parts["a1"]), len(parts["a2"]), len(parts["laws"]), rate)
    return Chain(layout, layout.join(parts), np.zeros((motions, layout.states)))


def learned(chain: Chain, linear: bool = False) -> np.ndarray:
    """Which parameters (size,) are learned: not those that fix the units of x and w.

    linear: the curve and what comes after it stay as they are.
    """
    parts = chain.parts
    mask = {name: np.ones(part.shape, dtype=bool) for name, part in parts.items()}
    for d, c, a in (("d1", "c1", "a1"), ("d2", "c2", "a2")):
        single = parts[a][:, 1] == 0.0
        mask[a][single, 1] = mask[c][single, 1] = False
        if linear and d == "d1":
            continue
        numerator = np.r_[parts[d], parts[c].ravel()]
        fixed = int(np.abs(numerator).argmax())
        if fixed == 0:
            mask[d][0] = False
        else:
            mask[c].reshape(-1)[fixed - 1] = False
    if linear:
        for name in ("beta", "laws", "d2", "c2", "a2"):
            mask[name][...] = False
    return chain.layout.join(mask).astype(bool)


def run(
    layout: Layout, values: np.ndarray, u: np.ndarray, begin: np.ndarray, derived: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """y (T,), x, and where `derived` the derivatives of y (T, size + S): by all, then by `begin`.

    u and x have R (T − 1) + 1 numbers.
    """
    p = layout.split(np.ascontiguousarray(values, dtype=np.float64))
    laws = p["laws"].copy()
    laws[:, 2] = np.exp(laws[:, 2])
    one = p["d1"][0], p["c1"], p["a1"]
    two = p["d2"][0], p["c2"], p["a2"], p["o0"][0]
    found: tuple[np.ndarray, np.ndarray, np.ndarray] = chain_run(
        np.ascontiguousarray(u), layout.rate, one, (p["beta"][0], laws), two, begin, derived
    )
    return found
