"""Polynomial restoring forces in modal coordinates, on top of the equivalent linear system.

u = Φ⁻¹ x,  h_i = Σ C_kl T_k(u_i') T_l(u̇_i')    Brewick & Masri (2016), Sect. 2.2, Eqs. 8–17
    on the residual:         h = Φᵀ M⁻¹ f_NL,   ẍ̂ = linear − Φ⁻ᵀ h      (Eqs. 9, 11a)
    on the restoring force:  h = Φᵀ r,          ẍ̂ = M⁻¹ (f − Φ⁻ᵀ h)     (Eqs. 10, 11b)

n DOFs, T samples, P terms per mode: (order + 1)² for one pair of coordinates.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Literal

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import linear

from data.annotations import Count, NotNegative
from data.record import Drive, Record, Response
from data.sample import Sample
from models import polynomial_compiled
from models.estimator import weight_matrix
from models.layers.integrate import Acceleration, differentiated, run_compiled, runge_kutta
from models.layers.least_squares import CHUNK, LeastSquares
from models.layers.scaling import Extents
from models.layers.series import BASES, double_series, double_series_terms, require_order
from models.linear import EquivalentLinear, state_of
from models.polynomial_compiled import Parts


class ModalPolynomial(EquivalentLinear):
    """A double series per mode, fitted to the residual or to the whole restoring force.

    fits: "residual" or "restoring_force"; basis: "power" or "chebyshev"; order: highest power of
    each coordinate.  pairs: None, each h_i on its own mode's (u_i, u̇_i); or a list of pairs such as
    [["u1", "u1_dot"], ["u1", "u2"]], every h_i on the sum of their series (Eq. 13).
    The identified M⁻¹K is not symmetric and may have complex modes; a complex pair is replaced by
    its real and imaginary part, which span the same motion.  Coordinates are normalised by their
    extents in training (Eq. 23), which unseen motion may exceed.  forced: "base" where f = −s̈ of a
    common support is the one excitation: masses are then unknown and h = Φᵀ M⁻¹ r, by unit mass.
    Raises ValueError unless every DOF has its force or all have that one, and where the identified
    mass matrix or the modes are singular.
    """

    modes: Tensor

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        fits: Literal["residual", "restoring_force"] = "restoring_force",
        basis: Literal["power", "chebyshev"] = "power",
        order: Count = 5,
        pairs: Sequence[Sequence[str]] | None = None,
        ridge: NotNegative = 0.0,
        forced: Sequence[int] | str | None = None,
    ) -> None:
        super().__init__(dofs, inputs, dt, ridge)
        self.base = forced == "base"
        if inputs != (1 if self.base else dofs):
            raise ValueError(
                f"polynomial methods need one force per DOF to identify the mass matrix; there are "
                f"{inputs} channels of excitation for {dofs} DOFs"
            )
        if pairs is not None and not pairs:
            raise ValueError("pairs is empty; give null for each mode's own pair")
        self.fits, self.basis, self.order = fits, basis, order
        self.register_buffer("modes", torch.eye(dofs, dtype=torch.float64))  # Φ
        self.scale = Extents(2 * dofs)
        own = [[(i, dofs + i)] for i in range(dofs)]
        chosen = own if pairs is None else [[self._pair(pair) for pair in pairs]] * dofs
        require_order(order, 1 if pairs is None else len(pairs), dofs)
        self.terms = [double_series_terms(of_mode, order) for of_mode in chosen]
        self.coefficients = nn.ParameterList([weight_matrix(len(t), 1) for t in self.terms])

    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        super().identify(batches)
        self.modes.copy_(real_modes(self.matrices()[1]))
        self._require_regular()
        self.scale.fit(r.counted(self._modal(r.x, r.v)) for r in batches)
        fits = [LeastSquares(self.ridge) for _ in range(self.dofs)]
        for record in batches:
            h = record.counted(self._target(record))
            for i, terms in enumerate(self._terms(record.x, record.v)):
                fits[i].add(record.counted(terms), h[..., i : i + 1])
        solutions = [fit.solve() for fit in fits]
        for weights, solution in zip(self.coefficients, solutions, strict=True):
            weights.copy_(solution.weights)
        return {
            "rank": min(s.rank for s in solutions),
            "condition": max(s.condition for s in solutions),
        }

    def forward(self, record: Record) -> Tensor:
        self.require_identified(self.coefficients[0])
        assert record.x is not None
        assert record.v is not None
        return self.acceleration(record.x, record.v, record.f)

    def acceleration(self, x: Tensor, v: Tensor, u: Tensor) -> Tensor:
        """ẍ (…, n) of a state and an excitation (…, n)."""
        return self.law()(x, v, u)

    def law(self) -> Acceleration:
        """The identified ẍ = [ẋ, x, u] L + [T_k T_l] H as a function of x, ẋ, u, all modes at once.

        The modal transform and its scaling are one affine map S; all that does not depend on the
        state is computed here, once.
        """
        L, rows, offset, B = self._equation()
        S = torch.block_diag(*rows)
        H = torch.block_diag(*self.coefficients) @ B  # (P of all, n)
        first, second = self._places(L.device)

        def acceleration(x: Tensor, v: Tensor, u: Tensor) -> Tensor:
            scaled = linear(torch.cat([x, v], dim=-1), S, offset.flatten())  # (…, 2n)
            table = BASES[self.basis](scaled, self.order).flatten(-2)
            products = table.index_select(-1, first) * table.index_select(-1, second)
            return torch.cat([v, x, u], dim=-1) @ L + products @ H

        return acceleration

    def _equation(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """L (2n + m, n), S (2, n, n), s₀ (2, n) and B (n, n).

        q = S [x ẋ] + s₀, h = C T(q), ẍ = [ẋ x u] L + h B
        """
        n, inverse = self.dofs, torch.linalg.inv(self.modes)
        reach, centre = self.scale.reach.view(2, n), self.scale.centre.view(2, n)
        L: Tensor = self.weights
        B = -inverse
        if self.fits == "restoring_force":
            driven, inverse_mass = self._inertia()
            L = torch.cat([torch.zeros_like(L[: 2 * n]), driven.T])
            B = B @ inverse_mass.T
        return L, inverse / reach[:, :, None], -centre / reach, B

    def parts(self) -> Parts:
        """The numbers of the compiled law."""
        equation = [u.detach().cpu().contiguous().numpy() for u in self._equation()]
        modes = np.repeat(np.arange(self.dofs), [len(terms) for terms in self.terms])
        places = [place.numpy() for place in self._places(torch.device("cpu"))]
        terms, C = np.stack([modes, *places], axis=1), torch.cat([*self.coefficients])[:, 0]
        L, S, offset, B = equation
        weights = C.detach().cpu().numpy()
        return Parts(
            L, S, offset, terms, weights, B, self.order + 1, int(self.basis == "chebyshev")
        )

    def _places(self, device: torch.device) -> list[Tensor]:
        """Where the two factors of every term of every mode are in T_k(q_a), a after a."""
        terms = torch.tensor([term for of_mode in self.terms for term in of_mode], device=device)
        a, k, b, ell = terms.unbind(dim=1)
        return [a * (self.order + 1) + k, b * (self.order + 1) + ell]

    def prepare(self, batches: Iterable[Record]) -> dict[str, float]:
        """Identify linear part, modes and extents, on which the terms of the series depend."""
        return self.identify(batches)

    def heads(self) -> list[nn.Parameter]:
        return list(self.coefficients)

    def features_of(self, record: Record) -> Iterator[tuple[slice, list[Tensor]]]:
        assert record.x is not None
        assert record.v is not None
        step = max(1, CHUNK // record.a[..., 0, 0].numel())
        for start in range(0, record.samples, step):
            span = slice(start, min(start + step, record.samples))
            yield span, list(self._terms(record.x[..., span, :], record.v[..., span, :]))

    def features_at(self, sample: Sample, memory: Tensor) -> list[Tensor]:
        return list(self._terms(sample.x, sample.v))

    def known(self, signals: Record | Sample) -> Tensor:
        """The estimate (…, n) without the series: the linear one, or that of the forces alone."""
        if self.fits == "residual":
            return state_of(signals) @ self.weights
        return signals.f @ self._inertia()[0].T

    def mixing(self) -> Tensor:
        inverse = -torch.linalg.inv(self.modes)
        return inverse if self.fits == "residual" else inverse @ self._inertia()[1].T

    def free_run(self, drive: Drive) -> Response:
        self.require_identified(self.coefficients[0])
        if differentiated(drive.u, drive.x0, drive.v0, *self.parameters()):
            return runge_kutta(self.law(), drive)
        run, parts = polynomial_compiled.run, self.parts()
        return run_compiled(run, parts, drive, self.identified_parameters)

    def _check_record(self, record: Record) -> None:
        super()._check_record(record)
        if record.s is not None or record.f.shape[-1] != self.inputs:
            raise ValueError(
                f"polynomial methods need one force per DOF and supports at rest; the record has "
                f"{record.f.shape[-1]} forces for {self.dofs} DOFs"
                f"{' and moving supports' if record.s is not None else ''}"
            )

    def _target(self, record: Record) -> Tensor:
        """h (…, T, n), from the measured acceleration of the training motion."""
        if self.fits == "residual":  # M⁻¹ f_NL is what the linear estimate is off
            return (super().forward(record) - record.a) @ self.modes
        driven, inverse_mass = self._inertia()
        missing = record.f @ driven.T - record.a  # M⁻¹ r
        return torch.linalg.solve(inverse_mass, missing.mT).mT @ self.modes

    def _inertia(self) -> tuple[Tensor, Tensor]:
        """Accelerations by unit excitations (n, m), and M⁻¹ (n, n), or 1 by unit mass."""
        inverse_mass = self.matrices()[2]
        if not self.base:
            return inverse_mass, inverse_mass
        return torch.ones_like(inverse_mass), torch.eye(self.dofs).to(inverse_mass)

    def _modal(self, x: Tensor | None, v: Tensor | None) -> Tensor:
        """[u, u̇] (…, 2n)."""
        assert x is not None
        assert v is not None
        modal = torch.linalg.solve(self.modes, torch.stack([x, v], dim=-1))  # (…, n, 2)
        return torch.cat([modal[..., 0], modal[..., 1]], dim=-1)

    def _terms(self, x: Tensor | None, v: Tensor | None) -> Iterator[Tensor]:
        """For each mode the terms of its series (…, P)."""
        scaled = self.scale(self._modal(x, v))
        for terms in self.terms:
            yield double_series(self.basis, self.order, terms, scaled)

    def _pair(self, pair: Sequence[str]) -> tuple[int, int]:
        """Places of two coordinates, named u1, u2, … and u1_dot, u2_dot, …"""
        names = [f"u{i + 1}" for i in range(self.dofs)]
        names += [f"{name}_dot" for name in names]
        if len(pair) != 2 or pair[0] == pair[1] or not set(pair) <= set(names):
            raise ValueError(
                f"pairs holds {list(pair)}: expected two different ones of {', '.join(names)}"
            )
        return names.index(pair[0]), names.index(pair[1])

    def _require_regular(self) -> None:
        named = {"inverse mass matrix": self._inertia()[1], "mode matrix": self.modes}
        for name, matrix in named.items():
            condition = float(torch.linalg.cond(matrix))
            if not condition < 1e10:
                raise ValueError(
                    f"the identified {name} is singular (condition {condition:.1e}); the motion "
                    "does not determine it: use more or stronger data"
                )


# Real modes of a matrix that need not be symmetric, such as an identified M⁻¹K.


def real_modes(matrix: Tensor) -> Tensor:
    """Real basis Φ (n, n) of the eigenvectors of a real matrix, columns of unit length.

    Ordered by the eigenvalues' real part. A complex pair gives its real and imaginary part.
    """
    values, vectors = torch.linalg.eig(matrix)
    columns, order = [], torch.argsort(values.real)
    for i in order.tolist():
        if values[i].imag == 0.0:
            columns.append(vectors[:, i].real)
        elif values[i].imag > 0.0:
            columns += [vectors[:, i].real, vectors[:, i].imag]
    modes = torch.stack(columns, dim=1)
    return modes / torch.linalg.vector_norm(modes, dim=0)
