"""A single element under an imposed motion: its force from deformation and rate.

r = law(s, ṡ, z),   ż by increments of s          (models/composition/coefficients.py)

The law is that of the element network: spring, damper, cubic spring, hinges, hysteretic units.
Other inputs, such as the voltage of a damper, weigh laws side by side
(models/composition/other_inputs.py).
T samples, E elements side by side, each under its own motion; J laws of an element.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

import torch
from torch import Tensor

from data.annotations import Range, Whole
from data.record import Drive, Record, Response, singles
from models.composition.coefficients import Coefficients, Composition, Numbering, Part
from models.composition.composite import FromSprings
from models.composition.laws import ElementLaws
from models.composition.other_inputs import OtherInputs
from models.composition.trace import Trace, traced
from models.element_test import NIL, REMEDY, ElementTest
from models.estimator import Parameter
from models.physical.parameters import composed_laws, numbers_of


class HystereticElement(ElementTest, FromSprings):
    """Forces r (T, E) from imposed deformations s and rates ṡ, the excitation [s, ṡ] (T, 2 E).

    Every estimate is a free run: no measured force is read. x and v of the response hold nothing of
    use, as the motion is imposed.
    hinges, units: numbers of them in each law; cubic: each law has a cubic spring; rounded:
    units bend before they yield, as those of Bouc and Wen; without, they are elastoplastic.
    other_inputs: number k of channels e after s and ṡ, (T, 2 E + k). Each has a law at up to so
    many `nodes` in its range, over which hinges and units are spread, and in which that many
    `rates` are forces that saturate with the rate. The units then begin at rest, and the first
    samples of a record, which tell of its beginning, let them forget.
    priors, ties: as for `ElementNetwork`, without other inputs.
    Raises ValueError for other channels than an element test's, and for priors and ties that do
    not fit.
    """

    takes_other_inputs = True
    differentiated: ClassVar[dict[str, int | None]] = {"a": None}  # x and v are imposed

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        hinges: Whole = 2,
        units: Whole = 3,
        cubic: bool = True,
        prior: float = 1e-8,
        other_inputs: int | None = None,
        nodes: Annotated[int, Range(2)] = 3,
        rates: Whole = 2,
        priors: Mapping[str, Any] | None = None,
        ties: Sequence[Sequence[str]] | None = None,
        rounded: bool = True,
        *,
        laws: Literal["units"] = "units",
    ) -> None:
        super().__init__(dofs, inputs, dt, 1, prior, from_accelerations=True)
        others = other_inputs or 0
        if inputs != 2 * dofs + others:
            raise ValueError(
                f"an element test has a deformation s and a rate s_dot for each of {dofs} forces; "
                f"there are {inputs} channels, {others} of them other inputs: {REMEDY}"
            )
        self.others = OtherInputs(dofs, others, nodes, rates) if others else None
        self.estimates_beginning = self.others is None
        self.parallel = self.others.laws if self.others else 1
        counts = (hinges, units)
        if self.others:
            counts = (-(-hinges // nodes), -(-units // nodes))
        if self.others and (priors or ties):
            raise ValueError(
                "model.priors and model.ties are of elements with one law; under other inputs an "
                "element has several: leave them out"
            )
        self.laws = ElementLaws(dofs * self.parallel, *counts, cubic, rounded=rounded)
        self.hold_to(priors, ties, self.laws)

    def composition(self) -> Composition:
        """Elements without a structure: coordinates q̈ = r that act on nothing."""
        numbering, n = Numbering(self), self.dofs * self.parallel
        none, one = torch.zeros(2, n, dtype=torch.float64), torch.eye(n, dtype=torch.float64)
        none, one = none.to(self.identified.device), one.to(self.identified.device)
        zero = one.new_zeros(n, self.inputs)
        own = torch.eye(self.dofs).to(one).repeat(self.parallel, 1)  # (n, E)
        left = one.new_zeros(n, self.inputs - 2 * self.dofs)
        supports = torch.stack(
            [torch.cat([own, 0 * own, left], 1), torch.cat([0 * own, own, left], 1)]
        )
        return Composition(
            core=Part.fixed(none),
            inputs=Part.fixed(zero),
            G=Part.fixed(-one),
            D=Part.fixed(0.0 * one),
            laws=self.laws.table(numbering),
            outputs=Part.fixed(one),
            supports=supports,
            counts=self.laws.counts,
            parameters=numbering.count,
            measures=self.measures.repeat(self.parallel),
        )

    def small_motion(self) -> None:
        """None: the motion is imposed."""
        return None

    def run_with_loops(self, drive: Drive) -> tuple[Response, tuple[Tensor, Tensor] | None]:
        return self.free_run(drive), None

    def _physical_parameters(self) -> Iterable[Parameter]:
        self.require_identified(self.identified)
        if self.others is not None:
            yield from self._under_other_inputs(self.others)
            return
        laws = numbers_of(self.laws)
        for e in range(self.dofs):
            yield from composed_laws(laws, e, f"r{e + 1}", "under s and its rate")

    def _under_other_inputs(self, others: OtherInputs) -> Iterable[Parameter]:
        """Laws at values of the other inputs, between which the force is interpolated."""
        for i, lag in enumerate(others.lag().tolist(), start=1):
            yield Parameter(f"u{i}.lag", lag, "s", "")
        for e, offset in enumerate(others.offset().tolist(), start=1):
            yield Parameter(f"r{e}.offset", offset, "N", "under s and its rate")
        nodes, laws = others.places.shape[1], numbers_of(self.laws)
        places = others.range.centre[:, None] + others.range.reach[:, None] * others.places
        for j in range(others.laws):
            i, node = divmod(j, nodes)
            if node >= int(others.used[i]):  # no data were near it
                continue
            value = float(places[i, node])
            for e in range(self.dofs):
                row, name = j * self.dofs + e, f"r{e + 1}.law_{j + 1}"
                about = f"under s and its rate, at u{i + 1} = {value:.3g}"
                yield from composed_laws(laws, row, name, about)
                pairs = zip(others.rate_force()[row], others.rate_knee()[row], strict=True)
                for m, (force, knee) in enumerate(pairs, start=1):
                    yield Parameter(f"{name}.rate_{m}.force", float(force), "N", about)
                    yield Parameter(f"{name}.rate_{m}.saturates_at", float(knee), "m/s", about)
                yield Parameter(f"{name}.rate_lag", float(others.rate_lag()[row]), "s", about)

    @torch.no_grad()
    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        """Identify spring and damper of each element by least squares; set units of θ."""
        records = [record.to("cpu") for record in singles(batches)]
        for record in records:
            self.require_force(record)
        self.bind(records)
        u = torch.cat([record.excitation[record.warmup :] for record in records])
        E, r = self.dofs, torch.cat([record.a[record.warmup :] for record in records])
        s, rate = u[:, :E], u[:, E : 2 * E]
        pairs = torch.stack([s, rate], dim=2).movedim(1, 0)  # (E, N, 2)
        fitted = torch.linalg.lstsq(pairs, r.T[..., None], driver="gelsd").solution[..., 0]
        largest, fastest = s.abs().amax(dim=0), rate.abs().amax(dim=0)
        if not bool(largest.all() and r.any(dim=0).all()):
            raise ValueError(NIL)
        secant = r.abs().amax(dim=0) / largest
        stiffness = torch.where(fitted[:, 0] > 0.05 * secant, fitted[:, 0], 0.05 * secant)
        least = 0.01 * r.abs().amax(dim=0) / fastest
        damping = torch.maximum(fitted[:, 1], least)
        damping = torch.where(fastest > 0.0, damping, 0.0)  # no rates, no damper
        if self.others:
            self.others.start(u[:, 2 * E :], r.abs().amax(dim=0), fastest, self.dt)
        J = self.parallel
        self.linear = stiffness.repeat(J), damping.repeat(J), largest.repeat(J)
        self.laws.start(*self.linear)
        self.start_as_stated()
        self.identified.fill_(1.0)
        return {"linear_stiffness": float(stiffness.mean())}

    def restart(self, generator: torch.Generator) -> None:
        super().restart(generator)
        if self.others:
            self.others.restart()

    def _beyond(self) -> list[Coefficients]:
        return super()._beyond() + (self.others.beyond if self.others else [])

    def _sound(self) -> dict[Coefficients, float]:
        # b > 0 is free: what makes energy cannot run away under an imposed motion
        return {c: sign for c, sign in super()._sound().items() if sign > 0.0}

    def traced(self, composition: Composition, drive: Drive, *settings: Any, **more: Any) -> Trace:
        """The compiled run: of all laws side by side, which other inputs then weigh."""
        if self.others is None:
            return traced(composition, drive, *settings, **more)
        run = traced(composition, self._side_by_side(drive), *settings, **more)
        return self.others.weighed(run, drive)

    def _side_by_side(self, drive: Drive) -> Drive:
        """The drive of all laws, whose initial state is of no effect."""
        rest = drive.x0.new_zeros(self.dofs * self.parallel)
        return replace(drive, x0=rest, v0=rest)
