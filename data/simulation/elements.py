"""Restoring-force laws: deformation y [m], velocity ẏ [m/s] and state z → force r [N] and ż.

Every law is written branch by branch (elastic, yielded, gap closed, ...), and is smooth within a
branch; the integrator finds the instants at which a branch ends. A law is three small compiled
functions and a dataclass of its parameters:

    force(p, e, branch, y, ẏ, z, work) → (r, ż)   work = ∫ r ẏ dt, the energy element e took up [J]
    margin(p, e, branch, y, ẏ, z)                 ≥ 0 while the branch holds, < 0 past its end
    next_branch(p, e, branch, y, ẏ, z) → (branch, z)   what holds past that end

Brewick & Masri (2016), Sect. 3.1, Table 1, Eqs. 19–20. Branch 0 is the branch at rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import ClassVar

from data.checked import checked
from data.numba_cache import compilers

HERE = Path(__file__)
# with the integrator, which calls the laws: a change in either compiles both anew
compiled, inlined = compilers(HERE, HERE.with_name("integrator.py"))

BILINEAR, LIMITED_SLIP, POLYNOMIAL, BOUC_WEN = range(4)


# Elastoplastic slider, shared by the bilinear and the limited-slip law: sticks (0) while |z| < z_y,
# slides (+1, −1) at z = ±z_y until the velocity turns round.


@inlined
def _slider_margin(sliding, yield_displacement, ydot, z):
    if sliding != 0:
        return sliding * ydot
    return yield_displacement - abs(z)


@inlined
def _slider_next(sliding, yield_displacement, ydot, z):
    """Side after the end of a branch, and z exactly on the yield surface if it got there."""
    if _slider_margin(sliding, yield_displacement, ydot, z) >= 0.0:
        return sliding, z
    if sliding != 0:
        return 0, z
    return (1, yield_displacement) if z > 0.0 else (-1, -yield_displacement)


# A side is stored in two bits: 00 neither, 01 the positive, 10 the negative. Limited slip keeps the
# slider's side in bits 0–1 and the gap's in bits 2–3.


@inlined
def _side(branch):
    return (branch & 1) - ((branch >> 1) & 1)


@inlined
def _bits(side):
    return 1 if side > 0 else (2 if side < 0 else 0)


@inlined
def force(law, p, e, branch, y, ydot, z, work):
    if law == BILINEAR:  # p = z_y, k1, k2, c1, c2
        yielded = min(branch, 1)  # as a number: a processor guesses jumps badly that change often
        r = p[e, 2] * y + (p[e, 1] - p[e, 2]) * z + p[e, 3 + yielded] * ydot
        return r, (1 - yielded) * ydot
    if law == LIMITED_SLIP:  # p = z_y, k1, k2, c1, c2, z_g
        slider, gap = branch & 3, _side(branch >> 2)
        spring = 0.0 if gap == 0 else p[e, 2] * (y - gap * p[e, 5])
        if slider == 0:
            return p[e, 1] * z + spring + p[e, 3] * ydot, ydot
        return p[e, 1] * z + spring + p[e, 4] * ydot, 0.0
    if law == POLYNOMIAL:  # p = p1, p2, p3
        return p[e, 0] * y + p[e, 1] * ydot + p[e, 2] * y**3, 0.0
    # Bouc–Wen: the force is the state.  p = A, β, γ, n, η, ν, dη/dwork, dν/dwork
    speed = -ydot if branch & 1 else ydot  # |ẏ| on this branch
    size = -z if branch & 2 else z  # |r| on this branch
    power = size if p[e, 3] == 1.0 else max(size, 0.0) ** p[e, 3]
    eta, nu = p[e, 4] + p[e, 6] * work, p[e, 5] + p[e, 7] * work
    loading = p[e, 1] * speed * (-power if branch & 2 else power) - p[e, 2] * ydot * power
    return z, (p[e, 0] * ydot - nu * loading) / eta


@inlined
def margin(law, p, e, branch, y, ydot, z):
    if law == POLYNOMIAL:
        return 1.0
    if law == BOUC_WEN:
        if p[e, 0] == 0.0:  # all its fibres are broken: no force, no branches
            return 1.0
        return min(-ydot if branch & 1 else ydot, -z if branch & 2 else z)
    if law == BILINEAR:
        return _slider_margin(_side(branch), p[e, 0], ydot, z)
    slider, gap = _side(branch), _side(branch >> 2)
    to_gap = p[e, 5] - abs(y) if gap == 0 else gap * y - p[e, 5]
    return min(to_gap, _slider_margin(slider, p[e, 0], ydot, z))


@inlined
def next_branch(law, p, e, branch, y, ydot, z):
    if law == POLYNOMIAL:
        return 0, z
    if law == BOUC_WEN:
        return (1 if ydot < 0.0 else 0) + (2 if z < 0.0 else 0), z
    slider, z = _slider_next(_side(branch), p[e, 0], ydot, z)
    if law == BILINEAR:
        return _bits(slider), z
    gap = 0.0 if abs(y) < p[e, 5] else y
    return _bits(slider) | _bits(gap) << 2, z


@dataclass(frozen=True, kw_only=True)
class Element:
    """One restoring-force element between two nodes: y = position(second) − position(first).

    A node is a degree of freedom (`x1`, `x2`, ...), a support (`s1`, ...) or `ground`.
    """

    between: Sequence[str]
    law: ClassVar[int]
    fibres: ClassVar[tuple[str, ...]]  # parameters that grow with the number of parallel fibres

    def __post_init__(self) -> None:
        if len(self.between) != 2 or self.between[0] == self.between[1]:
            raise ValueError(
                f"between={list(self.between)}: an element joins two different nodes, "
                "for example [s1, x1]"
            )
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name != "between" and not math.isfinite(value):
                raise ValueError(f"{type(self).__name__}.{field.name}={value} is not finite")

    def _require(self, condition: str, *names: str) -> None:
        """Check parameters against `positive` or `not negative`."""
        for name in names:
            value = getattr(self, name)
            if value < 0.0 or (condition == "positive" and value == 0.0):
                raise ValueError(f"{type(self).__name__}.{name}={value} must be {condition}")

    @property
    def parameters(self) -> tuple[float, ...]:
        """Parameters p in the order the compiled law reads them."""
        return tuple(float(getattr(self, f.name)) for f in fields(self) if f.name != "between")

    def weakened(self, kept: float) -> tuple[float, ...]:
        """Parameters p of what is left when only a share `kept` of the element's fibres hold.

        See data/simulation/damage.py.
        """
        named = [f.name for f in fields(self) if f.name != "between"]
        return tuple(
            kept * value if name in self.fibres else value
            for name, value in zip(named, self.parameters, strict=True)
        )

    def tangent(self) -> tuple[float, float]:
        """Stiffness [N/m] and damping [N s/m] for small motions about rest."""
        raise NotImplementedError


@checked
@dataclass(frozen=True, kw_only=True)
class Bilinear(Element):
    """Bilinear hysteresis: r = k2 y + (k1 − k2) z + c ẏ, z elastoplastic at ±z_y (Fig. 5a)."""

    law = BILINEAR
    fibres = ("stiffness", "post_yield_stiffness")
    yield_displacement: float  # z_y [m]
    stiffness: float  # k1 [N/m]
    post_yield_stiffness: float  # k2 [N/m]
    damping: float = 0.0  # c1 [N s/m], elastic
    post_yield_damping: float = 0.0  # c2 [N s/m], yielded

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("positive", "yield_displacement", "stiffness")
        self._require("not negative", "damping", "post_yield_damping")

    def tangent(self) -> tuple[float, float]:
        return self.stiffness, self.damping


@checked
@dataclass(frozen=True, kw_only=True)
class LimitedSlip(Element):
    """Slider (k1, ±z_y) in parallel with a spring k2 beyond a gap ±z_g, plus c ẏ (Fig. 5b)."""

    law = LIMITED_SLIP
    fibres = ("stiffness", "gap_stiffness")
    yield_displacement: float  # z_y [m]
    stiffness: float  # k1 [N/m]
    gap_stiffness: float  # k2 [N/m]
    damping: float = 0.0  # c1 [N s/m], sticking
    slip_damping: float = 0.0  # c2 [N s/m], slipping
    gap: float  # z_g [m]

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("positive", "yield_displacement", "stiffness", "gap")
        self._require("not negative", "gap_stiffness", "damping", "slip_damping")

    def tangent(self) -> tuple[float, float]:
        return self.stiffness, self.damping


@checked
@dataclass(frozen=True, kw_only=True)
class Polynomial(Element):
    """Cubic spring and linear damper: r = p1 y + p2 ẏ + p3 y³ (Eq. 19)."""

    law = POLYNOMIAL
    fibres = ("stiffness", "cubic_stiffness")
    stiffness: float  # p1 [N/m]
    damping: float = 0.0  # p2 [N s/m]
    cubic_stiffness: float = 0.0  # p3 [N/m³], hardening > 0 > softening

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("not negative", "damping")

    def tangent(self) -> tuple[float, float]:
        return self.stiffness, self.damping


@checked
@dataclass(frozen=True, kw_only=True)
class BoucWen(Element):
    """Bouc–Wen hysteresis: ṙ = [A ẏ − ν (β |ẏ| |r|ⁿ⁻¹ r − γ ẏ |r|ⁿ)] / η (Eq. 20, printed sign).

    η and ν may grow with the energy E = ∫ r ẏ dt that the element took up, η = η₀ + η' E, and so
    degrade its stiffness and strength (Baber & Wen 1981). The paper has η' = ν' = 0.
    """

    law = BOUC_WEN
    fibres = ("stiffness",)
    stiffness: float  # A [N/m]
    beta: float  # β [N^(1−n)·1/m]
    gamma: float  # γ [N^(1−n)·1/m]
    exponent: float = 1.0  # n
    eta: float = 1.0  # η₀
    nu: float = 1.0  # ν₀
    eta_rate: float = 0.0  # η' [1/J]
    nu_rate: float = 0.0  # ν' [1/J]

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("positive", "stiffness", "eta", "nu")
        self._require("not negative", "eta_rate", "nu_rate")
        if self.exponent < 1.0:
            raise ValueError(
                f"BoucWen.exponent={self.exponent} must be at least 1; "
                "below 1 the law has no unique solution at r = 0"
            )

    def weakened(self, kept: float) -> tuple[float, ...]:
        # each fibre goes on under r / kept, so that β and γ, which multiply |r|ⁿ, change too
        A, beta, gamma, *rest = super().weakened(kept)
        factor = kept ** (1.0 - self.exponent) if kept > 0.0 else 0.0
        return A, factor * beta, factor * gamma, *rest

    def tangent(self) -> tuple[float, float]:
        return self.stiffness / self.eta, 0.0
