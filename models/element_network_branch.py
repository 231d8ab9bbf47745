"""Element network whose elements follow the learned branch law: any hysteresis, between DOFs.

M ẍ + Bᵀ r = f,   y = B x + B_s s,   r_e = F law(y_e/Y, ẏ_e/V; θ_e)    (composition/branch_law.py)

It starts by equilibrium (models/starts/equilibrium.py), where the law of every element is fitted as
that of an element under an imposed motion, and is polished on its free run with exact derivatives.
Where elements share forces, which equilibrium then leaves open, all laws are fitted together
(models/starts/equilibrium.py). Where accelerations alone are known, x and v are those of the free
run of a network of units (element_network.py). Masses are damped, too, by α m against the base or
the ground: of Rayleigh's damping no element has that part (models/element_network_branch.py). They
are not on supports whose motion is an input, nor where elements share forces, but in a frame that
bends on a shaken base.
B records, T samples, n DOFs, E elements, m excitations, L parameters of a law.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, Literal

import torch
from torch import Tensor, nn

from data.annotations import Count, Whole
from data.record import Drive, Record, singles
from models.branch_element import BranchElement
from models.composition.branch_law import (
    Branches,
    branch_law,
    learned,
    of_sizes,
    sizes,
)
from models.composition.branch_law_compiled import law_size
from models.composition.coefficients import Coefficients, Composition
from models.composition.trace import Trace, traced
from models.element_network import DAMPED, ElementNetwork
from models.element_network_named import ElementNetworkNamed
from models.estimator import Parameter
from models.fit.growing import lack_states
from models.fit.held_back import hold_back_record
from models.fit.minimise import minimise
from models.fit.problem import Joint
from models.fit.progress import announce
from models.starts.branch_laws import (
    BY_DEFAULT,
    SETTINGS,
    Choice,
    Chosen,
    Test,
    are_reconstructed,
    choose_law,
    dominant,
    facts_of,
    fit_law,
    fit_until_bounded,
    grow,
    largest_motion,
    of_element,
    polish_weight,
    records_of,
    start_law,
)
from models.starts.equilibrium import fit_together

OWN, SHARED = (14, 4), (6, 2)  # ramps and bends of laws that have, or share, their forces
LEAST_DAMPED = 1e-4  # of ω: α, where masses have next to none


class ElementNetworkBranch(ElementNetwork):
    """Masses and branch laws from the motion, or from accelerations and forces alone.

    elements, masses, forced, from_accelerations: as for `ElementNetwork`. ramps, bends,
    force_memory, law_starts, unsymmetric: of every law, as for `BranchElement`.
    prior: weight of Σ (θ − θ₀)², relative to the squared error; θ₀ is a law's start, and then
    the law by equilibrium. None: chosen on motion held back, for each law and then for the free
    run, in which a strong prior leaves the laws as equilibrium has them
    (models/starts/branch_laws.py). With more elements than DOFs equilibrium leaves open the
    forces that would judge a law: the free run's is chosen, and laws have less memory and equal
    sides unless more is asked for; equal sides, too, where the motion is an integral. ramps, bends:
    None: 14 and 4, or, of elements that share forces, 6 and 2, which go less astray in larger
    motions.
    Raises ValueError for channels, masses or pairs of nodes that do not fit.
    """

    later = (*ElementNetwork.later, "weight")
    takes_either_sign = False
    laws_are_curves = True
    scale: Tensor  # (4, E): Y [m], V [m/s], F [N] and log k₀
    weight: Tensor  # of the prior on the free run
    begun: Tensor  # (E, L): θ₀

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        elements: Sequence[Sequence[str]] | Literal["chain", "all", "frame"] | None = None,
        masses: Sequence[float | None] | None = None,
        forced: Sequence[int] | str | None = None,
        ramps: int | None = None,
        bends: int | None = None,
        force_memory: bool | None = None,
        law_starts: Count = 4,
        seed: Whole = 0,
        substeps: int = 2,
        from_accelerations: bool = False,
        prior: float | None = None,
        unsymmetric: bool | None = None,
        sensors: Sequence[int] | None = None,
        *,
        laws: Literal["branch"] = "branch",
    ) -> None:
        super().__init__(
            dofs, inputs, dt, elements, masses, forced, 0, 0, False, substeps,
            from_accelerations, BY_DEFAULT if prior is None else prior, sensors=sensors,
        )  # fmt: skip
        self.choice = Choice(force_memory, prior, law_starts, seed, unsymmetric)
        E = len(self.elements)
        usual = SHARED if self.shared else OWN
        self.ramps, self.bends = (
            u if given is None else given for given, u in zip((ramps, bends), usual, strict=True)
        )
        larger = bool(force_memory) if self.shared else force_memory is not False
        sides = bool(unsymmetric) if self.shared else unsymmetric is not False
        self.sizes = sizes(larger, self.ramps, self.bends, sides)
        L = law_size(self.sizes)
        bent = self.base and any(len(nodes) > 2 for nodes in self.elements)
        damped = bent or not (self.shared or self.supports)
        self.drag = Coefficients(1, positive=True) if damped else None  # α [1/s]
        self.laws.requires_grad_(False)  # the branch laws hold spring and damper
        self.theta = nn.Parameter(torch.zeros(E, L, dtype=torch.float64))
        self.register_buffer("begun", torch.zeros(E, L, dtype=torch.float64))
        self.register_buffer("scale", torch.full((4, E), torch.nan, dtype=torch.float64))
        self.register_buffer("weight", torch.tensor(self.prior, dtype=torch.float64))
        self.records: list[Record] = []
        self.tests: list[Test] = []

    takes_hidden = False

    @property
    def branches(self) -> Branches:
        return Branches(self.theta, self.sizes, self.scale)

    @torch.no_grad()
    def identify(self, batches: Iterable[Record]) -> dict[str, float | str]:
        """Start at a linear structure, then fit the law of every element to equilibrium.

        Returns what was chosen on motion held back, and how far each law is from the forces by
        equilibrium, beside the linear start's facts.
        """
        records, smooth = self.with_smooth_states(self.admitted(batches))
        named = self._named(records)
        if lack_states(self, records):
            units, smooth = self.with_units(records)
            records = self.with_run_of(units, records)
        self.records = records
        with self.reading_states():
            facts = self._begun_at(named)
        return {**facts, **smooth, **self._fit(self.choice.seed)}

    def _begun_at(self, named: ElementNetworkNamed | None) -> dict[str, Any]:
        """Take a linear structure, the masses of named laws, and tests of all elements."""
        facts: dict[str, Any] = super().identify(self.records)
        if self.linear is None:
            raise ValueError("the records gave no linear structure to begin with")
        if named is not None and self.mass.learned:
            self.mass.start(named.mass().detach())
        stiffness = self.springs_of_tests()
        tests = [m for record in self.records for m in self.element_tests(record, stiffness)]
        self.tests, drags = [test[:3] for test in tests], [test[3] for test in tests]
        if self.drag is not None:
            rate = 2.0 * math.pi * min(dominant(m.a, m.dt) for m in singles(self.records))
            alpha = DAMPED * rate
            if not self.shared:
                settled = replace(self.choice.settled(True, BY_DEFAULT), starts=2)
                alpha = mass_damping(self._single, self.tests, drags, settled)
                alpha = max(alpha, LEAST_DAMPED * rate)
                facts |= {"mass_damping": alpha}
            self.drag.start(torch.tensor(alpha, dtype=torch.float64))
            self.tests = without(self.tests, drags, alpha)
        return facts

    def _named(self, records: list[Record]) -> ElementNetworkNamed | None:
        """The nearest named laws of a chain, which tell its masses where x and v are known.

        None where masses are known, or forces act, that tell them.
        """
        weighed = self.weighs_from_the_top and not self.forced and not self.from_accelerations
        if not weighed or not all(self.has_states(record) for record in records):
            return None
        forced = "base" if self.base else [i + 1 for i in self.forced]
        sensors = self.dofs, self.inputs, self.dt
        named = ElementNetworkNamed(*sensors, self.elements, None, forced, seed=self.choice.seed)
        named.searched(records, polished=False)
        return named

    @torch.no_grad()
    def restart(self, generator: torch.Generator) -> None:
        """Fit the laws to equilibrium again, from other starts."""
        if not self.tests:
            raise ValueError(
                "ElementNetworkBranch restarts from its identification; identify it first"
            )
        self._fit(int(torch.randint(2**31, (1,), generator=generator)))

    def _fit(self, seed: int) -> dict[str, float | str]:
        """Fit the laws; from other starts where they run away under motions like those measured."""
        with self.reading_states():
            return fit_until_bounded(self, self.records, self._fit_from, seed)

    def _fit_from(self, seed: int) -> dict[str, float | str]:
        """Choose every law and how the free run is polished; then fit the laws to all motions."""
        choice, blurred = replace(self.choice, seed=seed), are_reconstructed(self, self.records)
        if blurred and choice.unsymmetric is None:  # noise of a derivative looks like such sides
            choice = replace(choice, unsymmetric=False)
        facts = self._fit_shared(choice) if self.shared else self._fit_each(choice)
        if blurred:
            grow(self, list(singles(self.records)), float(self.weight))
        return facts

    def _fit_each(self, choice: Choice) -> dict[str, float | str]:
        """Choose and fit the law of every element by its own force."""
        tests = [of_element(self.tests, e) for e in range(len(self.elements))]
        found, facts = self._choose(choice, tests) if choice.open else ([], {})
        errors, drawn = [], torch.Generator().manual_seed(choice.seed)
        for e, those in enumerate(tests):
            own = replace(choice, seed=int(torch.randint(2**31, (1,), generator=drawn)))
            law, error = fit_law(self._single, those, own, found[e] if found else None)
            self._take(e, law)
            errors.append(error)
        self.begun.copy_(self.theta)
        return {**facts, "force_error_percent": ", ".join(f"{100.0 * e:.2f}" for e in errors)}

    def _fit_shared(self, choice: Choice) -> dict[str, float | str]:
        """Begin with laws that share forces as linear springs do; then fit them together.

        How the free run is polished is chosen after a fit to all but the motion held back.
        """
        motions, place = list(singles(self.records)), largest_motion([y for y, *_ in self.tests])
        settled, facts = choice.settled(False, BY_DEFAULT), dict[str, float | str]()
        drawn = torch.Generator().manual_seed(choice.seed)
        for e in range(len(self.elements)):
            own = replace(settled, seed=int(torch.randint(2**31, (1,), generator=drawn)))
            self._take(e, start_law(self._single, of_element(self.tests, e), own))
        if choice.prior is None:
            fit_together(self, hold_back_record(motions, place)[0])
            self.begun.copy_(self.theta)
            weight, facts = polish_weight(self, self.records, place)
            self.weight.fill_(weight)
        error = fit_together(self, motions)
        self.begun.copy_(self.theta)
        return {**facts, "force_error_percent": f"{100.0 * error:.2f}"}

    def _choose(
        self, choice: Choice, tests: list[list[Test]]
    ) -> tuple[list[Chosen], dict[str, float | str]]:
        """Laws that are nearest to the motion held back, and the polish; what there is to tell."""
        place = largest_motion([y for y, *_ in self.tests])
        found = [choose_law(self._single, those, place, choice) for those in tests]
        facts = facts_of(found)
        if choice.prior is None:
            for e, one in enumerate(found):
                self._take(e, one.law)
            self.begun.copy_(self.theta)
            weight, polished = polish_weight(self, self.records, place)
            self.weight.fill_(weight)
            facts |= polished
        return found, facts

    def _single(self, larger: bool, unsymmetric: bool, prior: float) -> BranchElement:
        return BranchElement(
            1, 2, self.dt, self.ramps, self.bends, larger, prior, unsymmetric=unsymmetric
        )

    def _take(self, e: int, law: BranchElement) -> None:
        self.theta.data[e] = of_sizes(law.theta.detach()[0], law.sizes, self.sizes)
        self.scale[:, e] = law.scale[:4, 0]

    def _laws(self, parts: Sequence[tuple[str, str]]) -> Iterable[Parameter]:
        for e, part in enumerate(parts):
            yield from branch_law(self.branches, e, *part)

    def pull(
        self, last: bool, prior: float | None = None, noise: float = 0.0
    ) -> tuple[float | Tensor, Tensor]:
        parts = [(self.theta - self.begun).reshape(-1)]
        for more in (self.mass, self.drag):
            if more is not None and more.theta.requires_grad:
                parts.append((more.theta - (more.end if last else more.begin)).reshape(-1))
        return self.weight if prior is None else prior, torch.cat(parts)

    def compiled_branches(self) -> Any:
        return self.branches.compiled()

    def traced(self, composition: Composition, drive: Drive, *settings: Any, **more: Any) -> Trace:
        more["branches"] = self.compiled_branches()
        trace = traced(composition, drive, *settings, **more)
        P = trace.jacobian.shape[-1]
        if P:  # a law of less memory stays one
            stays = ~learned(self.theta, self.sizes).reshape(-1).to(trace.jacobian.device)
            trace.jacobian[..., : len(stays)].masked_fill_(stays, 0.0)
        return trace


# Damping that goes with the masses, told apart from the laws of elements.
#
# r_e = law(y_e, ẏ_e; θ_e) + α d_e: dampers α m_j between the masses and the support, as
# Rayleigh's damping has, are in no element of a chain, but all elements below carry them, as d_e.
# α is what suits all elements best, each weighted by how well its law follows it, where every law
# may yet move as its derivatives have it: what a law's own damper can do says nothing of α. Laws
# and α are found in turns. T samples, E elements, P parameters of a law.

Law = Any  # a BranchElement of one element
Drags = Sequence[Tensor]  # (T, E) [N s] of every motion
ROUNDS, ITERATIONS = 3, 12
LEAST = 1e-8  # of the squared forces: what is left of them at least
HELD = 1e-6  # weight of Σ Δθ² relative to the squared relative error


def mass_damping(
    make: Callable[[bool, bool, float], Law], tests: Sequence[Test], drags: Drags, choice: Choice
) -> float:
    """α [1/s], not negative. choice: of settled laws."""
    announce("damping of the masses")
    alpha, elements = 0.0, range(tests[0][0].shape[1])
    laws = [start_law(make, of_element(tests, e), choice) for e in elements]
    for number in range(ROUNDS):
        for e, law in enumerate(laws if number else ()):
            records = records_of(of_element(without(tests, drags, alpha), e), law.dt)
            minimise(Joint.of(law, records), SETTINGS, iterations=ITERATIONS)
        each = [_damping_sums(law, tests, drags, e, alpha) for e, law in enumerate(laws)]
        told = torch.stack(each).sum(dim=0)
        alpha = float((told[0] / told[1]).clamp_min(0.0)) if bool(told[1] > 0.0) else 0.0
    return alpha


def without(tests: Sequence[Test], drags: Drags, alpha: float) -> list[Test]:
    """The tests, less what so much damping of the masses has in their forces."""
    return [(y, rate, r - alpha * d) for (y, rate, r), d in zip(tests, drags, strict=True)]


def _damping_sums(law: Law, tests: Sequence[Test], drags: Drags, e: int, alpha: float) -> Tensor:
    """dᵀ Q (r − law) and dᵀ Q d (2,) over what is left of r with α; Q: without what θ can do."""
    F, P, size = law.scale[2, 0], law.theta.numel(), 0.0
    normal = torch.zeros(P + 2, P + 2, dtype=torch.float64)
    records = records_of(of_element(tests, e), law.dt)
    for record, drag in zip(records, drags, strict=True):
        run, slopes = law.restarted_jacobian(record, None)
        columns = torch.cat([slopes[:, 0], drag[:, e : e + 1], record.a - run], dim=1) / F
        normal += columns.T @ columns
        size += float((record.a / F).square().sum())
    normal[:P, :P] += HELD * size * torch.eye(P, dtype=torch.float64)
    by_law = torch.linalg.solve(normal[:P, :P], normal[:P, P])
    told = torch.stack([normal[P, at] - by_law @ normal[:P, at] for at in (P + 1, P)])
    left = torch.tensor([-alpha, 1.0], dtype=torch.float64)
    return told / (left @ normal[P:, P:] @ left + LEAST * size)
