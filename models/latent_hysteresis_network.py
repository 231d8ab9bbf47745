"""Latent hysteresis network: no topology; directions of deformation and their laws are learned.

q̈ = −ω² q − 2ζω q̇ + Γ u − Dᵀ r(y, ẏ, z),   y = D q,   x = Φ q   (models/composition/coefficients.py)

The linear core is modal, its damping positive by construction. Elements act along the directions
along which they are deformed (reciprocity), so that units with positive stiffness take up energy.
B records, T samples, n DOFs and modes, E elements, m excitations.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from data.annotations import MOST as MOST_ELEMENTS
from data.annotations import Range, Whole
from data.record import Record
from models.composition.coefficients import Coefficients, Composition, Numbering, Part
from models.composition.composite import Composite
from models.composition.laws import ElementLaws
from models.estimator import Parameter
from models.fit.extrapolation import free_run_error
from models.fit.response_spectrum import DAMPING
from models.layers.least_squares import RankDeficientError
from models.linear import EquivalentLinear
from models.linear_motion import LEAST_DAMPING
from models.physical.parameters import composed_laws, modal, numbers_of
from models.starts.ladder import DOUBTFUL, STEEPEST
from models.starts.spectra import EVALUATIONS, Layout, Spectra, typical

SMALLEST_DAMPING = 1e-3  # 2ζ of a mode at the start
SHARE = 0.5  # of the modal damping that elements have at the start, where it is least


class LatentHysteresisNetwork(Composite):
    """Modes from the equivalent linear system, then `elements` laws in directions of their own.

    hinges, units: numbers of them in each law; cubic: each law has a cubic spring.
    from_accelerations: measured x and v are not used.
    """

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        elements: Annotated[int, Range(1, MOST_ELEMENTS)] = 12,
        hinges: Whole = 1,
        units: Whole = 1,
        cubic: bool = True,
        substeps: int = 2,
        prior: float = 1e-10,
        from_accelerations: bool = False,
    ) -> None:
        super().__init__(dofs, inputs, dt, substeps, prior, from_accelerations)
        self.stiffness = Coefficients(dofs, positive=True)  # ω²
        self.damping = Coefficients(dofs, positive=True)  # 2ζω
        self.inputs_to = Coefficients(dofs, inputs)  # Γ
        self.directions = Coefficients(elements, dofs)  # D
        self.shapes = Coefficients(dofs, dofs)  # Φ
        self.laws = ElementLaws(elements, hinges, units, cubic, springs=False)

    def composition(self) -> Composition:
        numbering = Numbering(self)
        D = numbering.part(self.directions)
        E = D.value.shape[0]
        return Composition(
            core=Part.stack([numbering.part(self.stiffness), numbering.part(self.damping)], dim=0),
            inputs=numbering.part(self.inputs_to),
            G=D.map(lambda t: t.T),
            D=D,
            laws=self.laws.table(numbering),
            outputs=numbering.part(self.shapes),
            supports=D.value.new_zeros(2, E, self.inputs),
            counts=self.laws.counts,
            parameters=numbering.count,
            measures=self.measures,
        )

    @torch.no_grad()
    def identify(self, batches: Iterable[Record]) -> dict[str, float | str]:
        """Identify the modes to begin with; set units of θ.

        Of the equivalent linear system (Eq. 8), or, where that has none, those whose response is
        nearest (models/latent_hysteresis_network.py). Returns the way that was taken as `start`.
        Raises ValueError where nothing drives the motion, or nothing moves.
        """
        records = self.admitted(batches)
        driven = [record for record in records if record.excitation.any() and record.a.any()]
        if self.inputs and not driven:
            raise ValueError(
                "the excitation, or the motion, is zero throughout every record: check its channels"
            )
        seen = [(record.dt, *states) for record in records for states in self.states(record)]
        self.moved = torch.cat([x for _, x, *_ in seen])
        equations = [Record(dt, a, u, x, v) for dt, x, v, a, u in seen]
        try:
            facts, start = self._equivalent(equations)
            off = self._begin(start, records)
            filtered = not all(self.has_states(record) for record in records)
            if filtered and off is not None and off >= DOUBTFUL:
                raise NoModesError(f"its response is {100 * off:.3g} % off")
        except NoModesError as reason:
            modes, error = modes_of(Spectra.of(records, int(self.measures[0])))
            squares, *rest = map(torch.from_numpy, modes)
            self._begin((squares, *rest, squares.mean() / self.dofs), records)
            way = f"modes from spectra, {100 * error:.3g} % off; not least squares: {reason}"
            return {"start": way}
        return {**facts, "start": "least squares"}

    def _begin(self, start: tuple[Tensor, ...], records: list[Record]) -> float | None:
        """Start at modes; returns the error of the free run, where one can begin."""
        self._start(*start)
        self.identified.fill_(1.0)
        self.restart(torch.Generator().manual_seed(0))
        return free_run_error(self, [record.to(self.identified.device) for record in records])

    def _equivalent(self, records: list[Record]) -> tuple[dict[str, float], tuple[Tensor, ...]]:
        """Facts and modes of the equivalent linear system. Raises NoModesError if it has none."""
        linear = EquivalentLinear(self.dofs, self.inputs, self.dt)
        try:
            facts = linear.identify(records)
        except RankDeficientError as error:
            raise NoModesError(str(error).partition(";")[0]) from None
        damping, stiffness, inputs = linear.matrices()
        mass = self._mass(inputs)
        spring = _symmetric(mass @ stiffness)
        root = torch.linalg.cholesky(mass)
        half = torch.linalg.solve(root, torch.linalg.solve(root, spring).T)
        squares, turned = torch.linalg.eigh(_symmetric(half))
        if not squares[0] > 0.0:
            listed = ", ".join(f"{value:.3g}" for value in squares.tolist()[:8])
            raise NoModesError(f"ω² = {listed} 1/s²")
        if not squares[-1].sqrt() * self.dt / self.substeps < STEEPEST:
            raise NoModesError(f"ω = {float(squares[-1].sqrt()):.3g} rad/s, too fast for the steps")
        shapes = torch.linalg.solve(root.T, turned)  # Φᵀ M Φ = I
        modal_damping = (shapes.T @ mass @ damping @ shapes).diagonal()
        typical = spring.diagonal().mean() / self.dofs  # of an element's stiffness [N/m]
        driven = torch.linalg.solve(shapes, inputs)
        return facts, (squares, modal_damping, shapes, driven, typical)

    def _start(
        self, squares: Tensor, damping: Tensor, shapes: Tensor, inputs: Tensor, typical: Tensor
    ) -> None:
        """Start at modes: ω² (n,), 2ζω (n,), Φ (n, n) and Γ (n, m)."""
        self.stiffness.start(squares)
        self.modal_damping = damping.clamp_min(SMALLEST_DAMPING * squares.sqrt())
        _start_at(self.inputs_to, inputs)
        _start_at(self.shapes, shapes)
        self.typical = typical

    def _physical_parameters(self) -> Iterable[Parameter]:
        self.require_identified(self.identified)
        rates = zip(self.stiffness().tolist(), self.damping().tolist(), strict=True)
        for i, (square, rate) in enumerate(rates, start=1):
            yield from modal(f"mode_{i}", square, rate, "without the elements")
        laws = numbers_of(self.laws)
        for e, direction in enumerate(self.directions().tolist()):
            along = "along " + ", ".join(f"{d:.3g}" for d in direction[:4])
            yield from composed_laws(laws, e, f"r{e + 1}", along)

    @torch.no_grad()
    def restart(self, generator: torch.Generator) -> None:
        """Draw directions of deformation again: differences of displacements of unit length."""
        self.require_identified(self.identified)
        E, shapes = self.directions.theta.shape[0], self.shapes().cpu()
        drawn = torch.randn(E, self.dofs, generator=generator, dtype=torch.float64)
        drawn = drawn / torch.linalg.vector_norm(drawn, dim=1, keepdim=True)
        _start_at(self.directions, drawn @ shapes)
        largest = (self.moved @ drawn.T).abs().amax(dim=0)
        places = torch.rand(2, generator=generator, dtype=torch.float64).tolist()
        typical = self.typical.expand(E)
        turned = (self.directions().cpu() ** 2).sum(dim=0)  # of a unit damper in each element
        damper = SHARE * float((self.modal_damping / turned).min())
        self.damping.start(self.modal_damping - damper * turned)
        self.laws.start(typical, torch.full_like(typical, damper), largest, places)
        self.laws.stiffness.start(torch.zeros_like(typical))

    def _mass(self, inputs: Tensor) -> Tensor:
        """Mass matrix (n, n) where every DOF has its force; else the unit matrix."""
        if self.inputs == self.dofs:
            mass = _symmetric(torch.linalg.inv(inputs))
            if (torch.linalg.eigvalsh(mass) > 0.0).all():
                return mass
        return torch.eye(self.dofs, dtype=inputs.dtype, device=inputs.device)


def _symmetric(matrix: Tensor) -> Tensor:
    return 0.5 * (matrix + matrix.T)


def _start_at(coefficients: Coefficients, value: Tensor) -> None:
    """Start at a value; its typical size is the unit, so that θ is of the order of one."""
    size = value.square().mean().sqrt()
    coefficients.start(size.expand_as(value), value / size)


# Modes from the spectra of a motion, where least squares gives none; of no topology.
#
# A = Σ (iω)² Φ_r Γ_r U / (ω_r² − ω² + 2 i ζ_r ω_r ω)    Φ_r Γ_r by least squares, ω_r, ζ_r sought
# F frequencies, n DOFs and modes, m channels of excitation.

PLACES, POLISHED = 40, 3
MOST_ROWS = 600  # frequencies, so that a search stays quick
ALIKE = 1e-6  # singular values of the shapes, of the largest, below which modes are the same


class NoModesError(ValueError):
    """Raised where least squares gives no modes; the message says what it gives."""


def modes_of(spectra: Spectra) -> tuple[list[np.ndarray], float]:
    """The modes, as many as there are outputs, whose response is nearest to a motion.

    ω² (n,) [1/s²], 2ζω (n,) [1/s], shapes (n, n) in columns of unit length, Γ (n, m), and the
    relative error of the response.
    """
    some = slice(None, None, max(1, len(spectra.omega) // MOST_ROWS))
    spectra = Spectra(
        spectra.omega[some], spectra.outputs[some], spectra.inputs[some], spectra.measured
    )
    n = spectra.outputs.shape[1]
    low, high = 0.5 * spectra.omega.min(), 2.0 * spectra.omega.max()
    begins = [_chain(n, spectra, w) for w in [*np.geomspace(low, high, PLACES), spectra.dominant]]
    begins.sort(key=lambda theta: float(np.linalg.norm(_missing(theta, spectra))))
    ends = [_polished(theta, spectra, low, high) for theta in begins[:POLISHED]]
    best = min(ends, key=lambda theta: float(np.linalg.norm(_missing(theta, spectra))))
    return _modes(best, spectra)


def _chain(n: int, spectra: Spectra, first: float) -> np.ndarray:
    """Logarithms of frequencies and ratios (2n,) of a uniform chain with this first frequency."""
    layout = Layout(np.eye(n) - np.eye(n, k=-1), np.zeros((n, 0)), [], True)
    squares = typical(spectra, layout, first**2, np.ones(n)).frequencies(layout.B)
    return np.log(np.concatenate([np.sqrt(squares), np.full(n, DAMPING)]))


def _columns(theta: np.ndarray, spectra: Spectra) -> np.ndarray:
    """(F, n m): the response of each mode to each channel."""
    omega, ratio = np.split(np.exp(theta), 2)
    w = spectra.omega[:, None]
    response = (1j * w) ** spectra.measured / (omega**2 - w**2 + 2j * ratio * omega * w)
    each = response[:, :, None] * spectra.inputs[:, None, :]
    return np.asarray(each.reshape(len(w), -1))


def _residues(theta: np.ndarray, spectra: Spectra) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Φ_r Γ_r (n m, n) of all modes, and columns and outputs as real numbers."""
    columns = _columns(theta, spectra)
    phi = np.concatenate([columns.real, columns.imag])
    target = np.concatenate([spectra.outputs.real, spectra.outputs.imag])
    length = np.linalg.norm(phi, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    return np.linalg.lstsq(phi / length, target, rcond=1e-8)[0] / length[:, None], phi, target


def _missing(theta: np.ndarray, spectra: Spectra) -> np.ndarray:
    residues, phi, target = _residues(theta, spectra)
    return np.asarray((phi @ residues - target).ravel() / np.linalg.norm(target))


def _polished(theta: np.ndarray, spectra: Spectra, low: float, high: float) -> np.ndarray:
    from scipy.optimize import least_squares  # slow to import

    n = len(theta) // 2
    lowest = np.log(np.concatenate([np.full(n, low), np.full(n, LEAST_DAMPING)]))
    highest = np.log(np.concatenate([np.full(n, 2.0 * high), np.ones(n)]))  # critical damping
    begin = np.clip(theta, lowest + 1e-6, highest - 1e-6)
    found = least_squares(
        _missing, begin, bounds=(lowest, highest), max_nfev=EVALUATIONS, args=(spectra,)
    )
    return np.asarray(found.x)


def _modes(theta: np.ndarray, spectra: Spectra) -> tuple[list[np.ndarray], float]:
    omega, ratio = np.split(np.exp(theta), 2)
    n, m = len(omega), spectra.inputs.shape[1]
    residues = _residues(theta, spectra)[0].reshape(n, m, n)
    shapes, inputs = np.empty((n, n)), np.empty((n, m))
    for r, residue in enumerate(residues):  # of rank one where modes lie apart
        U, size, V = np.linalg.svd(residue.T, full_matrices=False)
        shapes[:, r], inputs[r] = U[:, 0], size[0] * V[0]
    U, size, V = np.linalg.svd(shapes)
    shapes = U @ np.diag(np.maximum(size, ALIKE * size[0])) @ V
    error = float(np.linalg.norm(_missing(theta, spectra)))
    return [omega**2, 2.0 * ratio * omega, shapes, inputs], error
