"""Latent hysteresis network: no topology; directions of deformation and their laws are learned.

q̈ = −ω² q − 2ζω q̇ + Γ u − Dᵀ r(y, ẏ, z),   y = D q,   x = Φ q       (models/composition/simulate.py)

The linear core is modal, its damping positive by construction. Elements act along the directions
along which they are deformed (reciprocity), so that units with positive stiffness take up energy.
B records, T samples, n DOFs and modes, E elements, m excitations.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

from data.record import Record
from models.composition.coefficients import Coefficients, Numbering, Part
from models.composition.composite import Composite
from models.composition.laws import ElementLaws
from models.composition.simulate import Composition
from models.layers.least_squares import RankDeficientError
from models.linear import EquivalentLinear
from models.starts.judged import free_run_error
from models.starts.ladder import DOUBTFUL, STEEPEST
from models.starts.modes import NoModesError, modes_of
from models.starts.spectra import Spectra

MOST_ELEMENTS = 10_000
SMALLEST_DAMPING = 1e-3  # 2ζ of a mode at the start
SHARE = 0.5  # of the modal damping that elements have at the start, where it is least


class LatentHysteresisNetwork(Composite):
    """Modes from the equivalent linear system, then `elements` laws in directions of their own.

    hinges, tanhs, units: numbers of them in each law; cubic: each law has a cubic spring.
    from_accelerations: measured x and v are not used.
    """

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        elements: int = 12,
        hinges: int = 1,
        tanhs: int = 0,
        units: int = 1,
        cubic: bool = True,
        substeps: int = 2,
        prior: float = 1e-10,
        from_accelerations: bool = False,
    ) -> None:
        super().__init__(dofs, inputs, dt, substeps, prior, from_accelerations)
        if not isinstance(elements, int) or elements < 1:
            raise ValueError(f"model.elements={elements} must be at least 1")
        if elements > MOST_ELEMENTS:
            raise ValueError(f"model.elements={elements} must be {MOST_ELEMENTS} at most")
        self.stiffness = Coefficients(dofs, positive=True)  # ω²
        self.damping = Coefficients(dofs, positive=True)  # 2ζω
        self.inputs_to = Coefficients(dofs, inputs)  # Γ
        self.directions = Coefficients(elements, dofs)  # D
        self.shapes = Coefficients(dofs, dofs)  # Φ
        self.laws = ElementLaws(elements, hinges, tanhs, units, cubic, springs=False)

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
        nearest (models/starts/modes.py). Returns the way that was taken as `start`.
        """
        records = self.admitted(batches)
        for record in records:
            self.check(record)
        seen = [(record.dt, *states) for record in records for states in self.states(record)]
        self.moved = torch.cat([x for _, x, *_ in seen])
        if not torch.isfinite(self.moved).all():
            raise ValueError("the signals hold NaN or infinite values; mend the record first")
        equations = [Record(dt, a, u, x, v) for dt, x, v, a, u in seen]
        try:
            facts, start = self._equivalent(equations)
            off = self._begin(start, records)
            filtered = not all(self.has_states(record) for record in records)
            if filtered and off is not None and off >= DOUBTFUL:
                raise NoModesError(f"its response is {100 * off:.3g} % off")
        except NoModesError as reason:
            modes = modes_of(Spectra.of(records, int(self.measures[0])))
            squares, *rest = map(torch.from_numpy, list(vars(modes).values())[:4])
            self._begin((squares, *rest, squares.mean() / self.dofs), records)
            way = f"modes from spectra, {100 * modes.error:.3g} % off; not least squares: {reason}"
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

    @torch.no_grad()
    def restart(self, generator: torch.Generator) -> None:
        """Draw directions of deformation anew: differences of displacements of unit length."""
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
