"""Element network: learned elements between DOFs, and from DOFs to ground.

M ẍ + Bᵀ r = f,   y = B x + B_s s,   r_e = law(y_e, ẏ_e, z_e)   (models/composition/coefficients.py)

The laws hold a linear spring and damper, a cubic spring, hinges, hysteretic units.
With hinges they contain bilinear, limited-slip, cubic and Bouc–Wen elements: on structures made of
those the identification is parametric.
B records, T samples, n DOFs, E elements, m excitations.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import torch
from torch import Tensor

from data.annotations import Whole
from data.memory import require_memory
from data.record import Record
from data.simulation.laws.polynomial import Polynomial
from models.composition.coefficients import Coefficients, Composition, Numbering, Part
from models.composition.composite import FromSprings
from models.composition.laws import SOFTEST, ElementLaws
from models.composition.priors import typed
from models.composition.states import (
    NOISY,
    are_of_one_motion,
    integrated_states,
    noise_of_deformations,
    smooth,
)
from models.composition.topology import (
    IN_WORDS,
    MOST_PAIRED,
    forced_of,
    incidence,
    is_open,
    nodes_of,
    rival_of,
    topology_of,
)
from models.estimator import ByLaws, Parameter
from models.fit.growing import grow
from models.fit.progress import sharing
from models.physical.parameters import composed_laws, numbers_of
from models.starts.equilibrium import forces_of
from models.starts.ladder import Equations, linear_start, nearest_structure
from models.starts.spectra import Layout, LinearStructure, Spectra

if TYPE_CHECKING:
    from data.datamodule import Data
    from data.simulation.laws.element import Element

Laws = Literal["units", "branch", "named"] | Sequence[str]

DAMPED = 0.02  # of ω: α at first; half of it is of the first mode's 2 ζ ω


class ElementNetwork(ByLaws, FromSprings):
    """Masses and elements from the motion, or from accelerations and forces alone.

    laws: "units", which this class describes; "branch" makes an `ElementNetworkBranch`; "named", or
    a list of names, an `ElementNetworkNamed`, each with settings of its own.
    elements: the pairs of nodes that are joined, such as [[ground, x1], [x1, x2]]; "chain" for
    ground, x1, x2, … one after the other; "all" for all n(n + 1)/2 pairs; "frame" for a chain that
    bends: three and four nodes in a row are joined, too (composition/topology.py); None for all
    where the motion can tell them apart, else the chain: beyond four DOFs, and where no force and
    no mass is known.  masses [kg]: None learns them, or one of them.  forced: numbers of the
    DOFs that carry the forces, None for all of them, "base" where f = −s̈ of a common support moves
    all of them by M ι f.  The channels beside the forces are displacements and velocities of moving
    supports; every DOF then has an element to each support instead of to ground.
    hinges, units: numbers of them in each law; cubic: each law has a cubic spring; rounded:
    units bend before they yield, as those of Bouc and Wen; without, they are elastoplastic.
    from_accelerations: measured x and v are not used.
    Where a base moves and no mass is known, springs between nodes that are no neighbours in a chain
    may be of either sign: columns that bend over several storeys look like negative ones.
    mass_damping: a chain has dampers α m from every mass to ground, which Rayleigh's damping
    has beside those of the elements; all pairs have them anyhow.
    sensors: numbers of the DOFs that the channels are of, such as [2, 5] of five; None: of all.
    The others are simulated only, in free runs from the first state.
    priors: {name of a parameter: [value in its unit, relative standard deviation]}.  ties: groups
    of elements, or of parameters of one kind, that are one (composition/priors.py).
    Raises ValueError for channels, masses, pairs of nodes, priors or ties that do not fit.
    """

    takes_other_inputs = False
    takes_either_sign = True
    takes_hidden = True  # DOFs without a sensor

    elements: list[list[str]]

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        elements: Sequence[Sequence[str]] | Literal["chain", "all", "frame"] | None = None,
        masses: Sequence[float | None] | None = None,
        forced: Sequence[int] | str | None = None,
        hinges: Whole = 2,
        units: Whole = 3,
        cubic: bool = True,
        substeps: int = 2,
        from_accelerations: bool = False,
        prior: float = 1e-10,
        priors: Mapping[str, Any] | None = None,
        ties: Sequence[Sequence[str]] | None = None,
        rounded: bool = True,
        mass_damping: bool = False,
        sensors: Sequence[int] | None = None,
        *,
        laws: Laws = "units",
    ) -> None:
        seen = list(range(1, dofs + 1)) if sensors is None else list(sensors)
        if not seen or seen != sorted(set(seen)) or not 1 <= seen[0] <= seen[-1] <= dofs:
            raise ValueError(
                f"sensors={seen}: expected ascending numbers of DOFs from 1 to model.dofs={dofs}; "
                "channels are numbered by their DOF, and model.dofs is the number of all of them"
            )
        alone = from_accelerations or len(seen) < dofs
        super().__init__(len(seen), inputs, dt, substeps, prior, alone)
        self.sensors, self.floors = seen, dofs
        if self.hidden and not self.takes_hidden:
            raise ValueError(
                f"DOFs {', '.join(map(str, self.hidden))} of {dofs} have no sensor: choose "
                "model.laws=named or units, which can be identified without"
            )
        if forced is None:
            forced = range(1, min(dofs, inputs) + 1) if inputs >= dofs else []
        self.base = forced == "base"
        self.forced = [] if isinstance(forced, str) else [number - 1 for number in forced]
        self.forces = 1 if self.base else len(self.forced)  # channels
        supports, rest = divmod(inputs - self.forces, 2)
        known = set(range(dofs)) >= set(self.forced) and len(set(self.forced)) == len(self.forced)
        if rest or supports < 0 or not known or (self.base and supports):
            highest = 1 + max(self.forced, default=0)
            remedy = "list the DOFs that carry the forces"
            if highest > dofs:  # as where sensors are on the lower ones alone
                remedy = f"model.dofs={highest}, or list the DOFs that carry the forces"
            raise ValueError(
                f"model.forced={forced} does not fit {dofs} DOFs and {inputs} channels of "
                "excitation: forces first, then displacement and velocity of every support; "
                f"{remedy}"
            )
        if masses is not None and (
            len(masses) != dofs or not all(m is None or 0.0 < m < float("inf") for m in masses)
        ):
            raise ValueError(
                f"model.masses={typed(masses)}: expected {dofs} positive masses in kg, null "
                "for one that is learned"
            )
        if masses is not None and all(m is None for m in masses):
            masses = None
        self.supports = supports
        self.topology = "as given"
        if elements is None:
            weightless = masses is None and not self.forced  # a base or a support moves
            of_storeys = len(seen) < dofs and not self.forced  # a building on a base
            unclear = dofs > MOST_PAIRED or weightless or of_storeys
            elements = self.topology = "chain" if unclear and supports <= 1 else "all"
        if isinstance(elements, str):
            self.topology = IN_WORDS.get(elements, elements)
        self.elements = nodes_of(elements, dofs, supports)
        if not self.elements:
            raise ValueError("model.elements is empty; give pairs of nodes, or chain, all, frame")
        require_memory(
            64.0 * len(self.elements) * (dofs + inputs),
            f"model.elements: {len(self.elements)} of {dofs} DOFs",
            "name the pairs that are joined",
        )
        B, B_s = incidence(self.elements, dofs, supports)
        self.register_buffer("B", B, persistent=False)  # (E, n)
        self.register_buffer("B_s", B_s, persistent=False)  # (E, p)
        self.known_masses: Tensor | None = None  # NaN where one is learned
        open_masses = torch.ones(dofs, dtype=torch.bool)
        if masses is not None:
            listed = [float("nan") if m is None else m for m in masses]
            self.known_masses = torch.tensor(listed, dtype=torch.float64)
            open_masses = self.known_masses.isnan()
        self.mass = Coefficients(dofs, positive=True, learned=bool(open_masses.any()))
        if self.mass.learned and not open_masses.all():
            self.mass.share(torch.where(open_masses, open_masses.cumsum(0) - 1, -1))
        self.laws = ElementLaws(
            len(self.elements), hinges, units, cubic, rounded=rounded,
            either=self._either() if self.base and masses is None else (),
        )  # fmt: skip
        damped = mass_damping and dofs > 1 and self.is_chain and not supports
        self.drag = Coefficients(1, positive=True) if damped else None  # α [1/s]
        self.hold_to(priors, ties, self.laws, self.mass)

    B: Tensor
    B_s: Tensor

    @property
    def hidden(self) -> list[int]:
        """Numbers of the DOFs without a sensor."""
        return sorted(set(range(1, self.floors + 1)) - set(self.sensors))

    def begins_anew(self, record: Record) -> bool:
        return not self.hidden and super().begins_anew(record)

    def seen(self, motion: Tensor) -> Tensor:
        """What a motion (n, …) of all DOFs has at those with a sensor."""
        return motion[[number - 1 for number in self.sensors]]

    @classmethod
    def topology_from(cls, settings: Mapping[str, Any], data: Data) -> str | None:
        """ "chain" or "all" pairs, where neither elements nor masses are given."""
        if not is_open(settings, data):
            return None
        data.setup()
        return topology_of(data.records["train"], forced_of(settings, data))

    @classmethod
    def rival_topology(cls, topology: str, error: float | None) -> str | None:
        return rival_of(topology, error)

    def composition(self) -> Composition:
        numbering, device = Numbering(self), self.B.device
        mass = numbering.part(self.mass)
        inverse, number = 1.0 / mass.value[:, None], mass.index[:, None]
        slope = -mass.slope[:, None] / mass.value.detach()[:, None] ** 2

        def over_mass(by: Tensor) -> Part:
            return Part(by * inverse, torch.where(by != 0.0, number, -1), by * slope)

        place = torch.zeros(self.floors, self.inputs, dtype=self.B.dtype, device=device)
        place[self.forced, torch.arange(len(self.forced))] = 1.0
        supports = self.B.new_zeros(2, len(self.elements), self.inputs)
        first = self.forces
        supports[0, :, first : first + self.supports] = self.B_s
        supports[1, :, first + self.supports :] = self.B_s
        core = Part.fixed(self.B.new_zeros(2, self.floors))
        if self.drag is not None:
            alpha = numbering.part(self.drag).map(lambda u: u.expand(self.floors))
            core = Part.stack([Part.fixed(torch.zeros_like(alpha.value.detach())), alpha], dim=0)
        return Composition(
            core=core,
            inputs=Part.fixed(torch.ones_like(place)) if self.base else over_mass(place),
            G=over_mass(self.B.T),
            D=Part.fixed(self.B),
            laws=self.laws.table(numbering),
            outputs=Part.fixed(
                self.seen(torch.eye(self.floors, dtype=self.B.dtype, device=device))
            ),
            supports=supports,
            counts=self.laws.counts,
            parameters=numbering.count,
            measures=self.measures,
        )

    @torch.no_grad()
    def identify(self, batches: Iterable[Record]) -> dict[str, float | str]:
        """Identify masses, springs and dampers of a linear structure to begin with.

        By least squares of the equation of motion where that gives a structure, else in the other
        ways of models/starts/ladder.py. Sets the units of θ. Without x and v the equation of motion
        is solved for filtered signals (Young 1981). Returns the way that was taken as `start`, and
        what the record leaves open.
        """
        records, smooth = self.with_smooth_states(self.admitted(batches))
        if self.hidden:
            return self._begin_at_spectra(records)
        unknown, target, largest = self._equations(records)
        layout = self._layout()
        found = linear_start(
            Equations(unknown, target, self._names()),
            Spectra.of(records, int(self.measures[0])),
            layout,
            self.dt / self.substeps,
            ["s_ddot1"] if self.base else [f"f{i + 1}" for i in self.forced],
            not all(self.has_states(record) for record in records),
        )
        typical = self._start(found.structure, largest, found.way.startswith("least squares"))
        told = {"topology": self.topology} if self.topology != "as given" else {}
        return {"linear_stiffness": float(typical), **found.facts(), **told, **smooth}

    def _layout(self) -> Layout:
        """What is known of the structure."""
        known = self.known_masses
        return Layout(
            self.B.cpu().numpy(),
            self.B_s.cpu().numpy(),
            self.forced,
            self.base,
            None if known is None else known.cpu().numpy(),
            np.array(self.laws.either) if self.laws.either else None,
            [number - 1 for number in self.sensors] if self.hidden else None,
        )

    def require_motion(self, records: list[Record]) -> None:
        """Raise ValueError where nothing moves or weighs the masses without a sensor."""
        if self.known_masses is None and not self.base:
            raise ValueError(
                f"model.masses=null: masses without a sensor ({_listed(self.hidden)}) cannot be "
                f"determined; give {self.floors} masses in kg"
            )
        if loose := [i for i in self.hidden if not self.B[:, i - 1].any()]:
            raise ValueError(
                f"model.elements={typed(self.elements)}: no element joins {_listed(loose)}; add "
                "one, or choose all"
            )
        if not any(bool(record.excitation.any()) for record in records):
            raise ValueError(
                "the excitation is zero throughout, and nothing else drives the motion; check the "
                "channel of the force or of the ground"
            )
        if any(not bool(record.a.any()) for record in records):
            raise ValueError(
                f"{_listed(self.sensors)} do not move against the ground in a whole record; check "
                "their channels and those of the excitation"
            )

    def _begin_at_spectra(self, records: list[Record]) -> dict[str, float | str]:
        """Begin at the linear structure that is nearest to the spectra of the masses seen.

        Its run tells the largest deformations, for hidden masses have no measured ones.
        """
        self.require_motion(records)
        layout, spectra = self._layout(), Spectra.of(records, int(self.measures[0]))
        structure = nearest_structure(spectra, layout)
        self._start(structure, self.B.new_ones(len(self.elements)))
        runs = [super(ElementNetwork, self).trace(r.drive()).deformations for r in records]
        peaks = [run.abs().reshape(-1, len(self.elements)).amax(dim=0) for run in runs]
        typical = self._start(structure, torch.stack(peaks).amax(dim=0))
        error = 100.0 * spectra.error(structure, layout)
        way = f"linear structure by spectra of the measured masses, error {error:.3g} %"
        return {"start": way, "linear_stiffness": float(typical)}

    def with_smooth_states(
        self, records: list[Record]
    ) -> tuple[list[Record], dict[str, float | str]]:
        """The records with x and v smoothed where they are noisy, and what there is to tell.

        Without v, x and the accelerations tell it. They stay as measured where they are not of one
        motion with the accelerations.
        """
        seen = all(r.x is not None and r.quantity == "acceleration" for r in records)
        if self.from_accelerations or not seen:
            return records, {}
        smoothed, kept = "v by x and ẍ", "by accelerations alone: x and ẍ do not agree"
        if all(self.has_states(r) for r in records):
            noise = max(share for record in records for share in self._noise_of_states(record))
            if not noise > NOISY:
                return records, {}
            told = f"noise of x is {100.0 * noise:.2g} % of a deformation"
            smoothed = f"smoothed; {told}"
            kept = f"as measured; {told}, and x, v and ẍ do not agree"
        found = [smooth(record) for record in records]
        agree = all(map(are_of_one_motion, records, found))
        return (found, {"states": smoothed}) if agree else (records, {"states": kept})

    def _noise_of_states(self, record: Record) -> Iterator[float]:
        """Noise of the deformations of every motion of a record, over their size."""
        for x, v, a, u in self.states(record):
            motion = x.numpy(), v.numpy(), a.numpy()
            y = self.deformations(x, v, u)[0].numpy()
            yield noise_of_deformations(*motion, record.dt, self.B.cpu().numpy(), y)

    def _start(self, structure: LinearStructure, largest: Tensor, raised: bool = False) -> Tensor:
        """Start at a structure; returns its typical stiffness.

        raised: springs and dampers may be of either sign, and are brought to some share of others.
        """
        structure = structure.times(self._stated_scale(structure))
        mass, stiffness, damping = (torch.from_numpy(part) for part in vars(structure).values())
        typical = stiffness[stiffness > 0.0].median()
        self.mass.start(mass)
        either = torch.tensor(self.laws.either or [False] * len(stiffness))
        if raised or not (either | (stiffness > 0.0)).all() or not (damping > 0.0).all():
            stiffness = torch.where(either, stiffness, stiffness.clamp_min(SOFTEST * typical))
            damping = damping.clamp_min(0.1 * damping.abs().median())
        self.linear = (stiffness, damping, largest)
        if self.drag is not None:
            B = self.B.cpu()
            squares = torch.linalg.eigvals((B.T * stiffness.clamp_min(0.0)) @ B / mass[:, None])
            self.drag.start(DAMPED * squares.real.min().clamp_min(0.0).sqrt())
        self.laws.start(*self.linear)
        self.start_as_stated()
        self.identified.fill_(1.0)
        return typical

    def _stated_scale(self, structure: LinearStructure) -> float:
        """What masses and forces, known but for a factor, are multiplied by to suit the priors."""
        if self.known_masses is not None or self.forced:
            return 1.0
        told = {f"x{i + 1}.mass": m for i, m in enumerate(structure.mass)}
        told |= {f"r{e + 1}.stiffness": k for e, k in enumerate(structure.stiffness)}
        told |= {f"r{e + 1}.damping": c for e, c in enumerate(structure.damping)}
        pairs = [(s, told[s.name]) for s in self.stated if told.get(s.name, 0.0) > 0.0]
        if not pairs:
            return 1.0
        weights = np.array([s.share**-2 for s, _ in pairs])
        logs = np.log([s.value / now for s, now in pairs])
        return float(np.exp(weights @ logs / weights.sum()))

    @torch.no_grad()
    def settle(self) -> None:
        if self.mass.learned:
            self.mass.start(self.mass())
        super().settle()

    def _names(self) -> list[str]:
        """Of the unknowns of the equations."""
        joined = ["–".join(pair) for pair in self.elements]
        masses = [f"mass of x{i + 1}" for i in range(self.floors)]
        return masses + [f"{part} {pair}" for part in ("spring", "damper") for pair in joined]

    def _equations(self, records: Sequence[Record]) -> tuple[Tensor, Tensor, Tensor]:
        """Rows of masses, springs and dampers (N, n + 2 E), forces (N,), largest y (E,) [m]."""
        B = self.B.cpu()
        rows, targets, largest = [], [], []
        for record in records:
            if record.f.shape[-1] != self.forces:
                raise ValueError(
                    f"the record has {record.f.shape[-1]} forces, model.forced names "
                    f"{self.forces}; list the DOFs that carry them"
                )
            for x, v, a, u in self.states(record):
                force, absolute = self._driving(a, u)
                require_memory(
                    16.0 * a.numel() * (self.dofs + 2 * len(self.elements)),
                    f"the identification of {len(self.elements)} elements on {len(a)} samples",
                    "take a shorter record or fewer elements",
                )
                y, rate = self.deformations(x, v, u)
                inertia = torch.diag_embed(absolute)  # (T, n, n)
                springs, dampers = B.T * y[:, None, :], B.T * rate[:, None, :]
                rows.append(torch.cat([inertia, springs, dampers], dim=2).flatten(0, 1))
                targets.append(force.flatten())
                largest.append(y.abs().amax(dim=0))
        farthest = torch.stack(largest).amax(dim=0)
        if not bool(farthest.all()):
            still = "–".join(self.elements[int(farthest.argmin())])
            raise ValueError(
                f"{still} does not deform in any record: check the wiring of these sensors, or "
                "leave the element out of model.elements"
            )
        return torch.cat(rows), torch.cat(targets), farthest

    def states_of_elements(self, record: Record) -> Iterable[tuple[Tensor, Tensor, Tensor, Tensor]]:
        """x, v, a, u (T, ·) of every motion, integrated where accelerations alone were measured."""
        measured = record.quantity != "acceleration" or self.has_states(record)
        return self.states(record) if measured else integrated_states(record, self.forces)

    def springs_of_tests(self) -> Tensor:
        """Stiffness (E,) of the linear start; a thousandth of the stiffest where it has none."""
        assert self.linear is not None
        return self.linear[0].clamp_min(1e-3 * self.linear[0].max())

    def element_tests(
        self, record: Record, stiffness: Tensor
    ) -> Iterable[tuple[Tensor, Tensor, Tensor, Tensor]]:
        """y, ẏ, r and drag (T, E) by equilibrium of every motion of a record; stiffness (E,).

        drag [N s]: what dampers m_j between the masses and the support would carry in the elements.
        """
        B, mass = self.B.cpu(), self.mass().detach().cpu()
        for y, rate, force, absolute, against in self.balances(record):
            drag = forces_of(B, mass * against, torch.zeros_like(y), stiffness)
            yield y, rate, forces_of(B, force - mass * absolute, y, stiffness), drag

    def tests_in_run(self, record: Record) -> Iterable[tuple[Tensor, Tensor, Tensor, Tensor]]:
        """y, ẏ, r and drag (T, E) of every motion in the model's free run of a record; no drag."""
        trace = self.trace(record.drive())
        y, r = (u.reshape(-1, *u.shape[-2:]) for u in (trace.deformations, trace.forces))
        rate = torch.gradient(y, spacing=record.dt, dim=1)[0]
        return zip(y, rate, r, torch.zeros_like(y), strict=True)

    def balances(self, record: Record) -> Iterable[Sequence[Tensor]]:
        """y, ẏ (T, E); f [N], ẍ and ẋ against the support (T, n) of every motion.

        ẍ is absolute. A damper α m_j between a mass and the support takes α m_j times the last.
        """
        for x, v, a, u in self.states_of_elements(record):
            force, absolute = self._driving(a, u)
            s_dot = u[:, self.forces + self.supports :]
            against = v - s_dot[:, :1] if self.supports else v
            yield *self.deformations(x, v, u), force, absolute, against

    def deformations(self, x: Tensor, v: Tensor, u: Tensor) -> tuple[Tensor, Tensor]:
        """y and ẏ (T, E) of the elements in a motion x, v (T, n) under an excitation (T, m)."""
        B, B_s = self.B.cpu(), self.B_s.cpu()
        s, s_dot = u[:, self.forces :].chunk(2, dim=1)
        return x @ B.T + s @ B_s.T, v @ B.T + s_dot @ B_s.T

    def _driving(self, a: Tensor, u: Tensor) -> tuple[Tensor, Tensor]:
        """Forces [N] on the masses and their absolute accelerations (T, n), of a motion."""
        force = torch.zeros_like(a)
        force[:, self.forced] = u[:, : len(self.forced)]
        return force, a - u[:, :1] if self.base else a

    @property
    def scale_is_open(self) -> bool:
        given = self.forced or any(prior.sets_scale for prior in self.stated)
        return self.known_masses is None and not given

    def _physical_parameters(self) -> Iterable[Parameter]:
        self.require_identified(self.identified)
        for i, mass in enumerate(self.mass().tolist(), start=1):
            yield Parameter(f"x{i}.mass", mass, "kg")
        yield from self._mass_damping()
        yield from self._laws([(f"r{e + 1}", "–".join(p)) for e, p in enumerate(self.elements)])

    def masses(self) -> Tensor | None:
        return None if self.scale_is_open else self.mass().detach()

    def _springs_and_dampers(self) -> tuple[Tensor, Tensor]:
        values = {p.name: p.value for p in self.physical_parameters()}
        numbers = range(1, len(self.elements) + 1)
        springs = [values[f"r{e}.stiffness"] for e in numbers]
        dampers = [values.get(f"r{e}.damping", 0.0) for e in numbers]
        return self.B.new_tensor(springs), self.B.new_tensor(dampers)

    def small_motion(self) -> tuple[Tensor, Tensor, Tensor] | None:
        """Of all masses, those without a sensor, too."""
        found = super().small_motion()
        return None if found is None else (*found[:2], torch.eye(self.floors).to(found[0]))

    def named_elements(self, e: int) -> Sequence[Element] | None:
        """The parts of named laws that element e is made of; None where its law is learned."""
        return None

    def mass_dampers(self) -> Mapping[str, Element]:
        """Dampers between the masses and a support by names, where the model has any."""
        if self.drag is None:
            return {}
        sizes = (self.drag() * self.mass()).detach().tolist()
        return {
            f"d{i}": Polynomial(between=("ground", f"x{i}"), stiffness=0.0, damping=size)
            for i, size in enumerate(sizes, start=1)
        }

    def _mass_damping(self) -> Iterable[Parameter]:
        """Damping of the masses, where the model has any."""
        if self.drag is not None and (alpha := float(self.drag().detach())) > 0.0:
            yield Parameter("mass_damping", alpha, "1/s", "of Rayleigh's")

    def _laws(self, parts: Sequence[tuple[str, str]]) -> Iterable[Parameter]:
        """Physical parameters of all laws, by names of the elements and what each joins."""
        laws = numbers_of(self.laws)
        for e, part in enumerate(parts):
            yield from composed_laws(laws, e, *part)

    @property
    def is_chain(self) -> bool:
        """Whether the elements are a chain from the ground up."""
        return self.supports <= 1 and self.elements == nodes_of("chain", self.floors, self.supports)

    @property
    def shared(self) -> bool:
        """Whether equilibrium of the measured masses leaves forces of elements open."""
        return len(self.elements) > self.dofs

    @property
    def weighs_from_the_top(self) -> bool:
        """Whether a chain has no known mass: each law tells the mass at its head."""
        return self.known_masses is None and self.is_chain

    def with_units(self, records: list[Record]) -> tuple[ElementNetwork, dict[str, Any]]:
        """A network of units of the same topology, fitted to accelerations; its error in words.

        Integrals of accelerations drift with their noise; the free run of the network does not.
        """
        masses = None if self.known_masses is None else self.known_masses.tolist()
        masses = masses and [None if math.isnan(m) else m for m in masses]
        forced = "base" if self.base else [i + 1 for i in self.forced]
        units = ElementNetwork(
            self.floors, self.inputs, self.dt, self.elements, masses, forced,
            from_accelerations=True, sensors=self.sensors,
        )  # fmt: skip
        with sharing(2):
            units.identify(records)
            error = grow(units, records)
        facts = {"states": f"free run of a network of units, relative error {100.0 * error:.2g} %"}
        return units, facts

    def with_run_of(self, network: ElementNetwork, records: list[Record]) -> list[Record]:
        """The records with x and v of a network's free run; unchanged where the run diverges."""
        runs = [network.run_of(record) for record in records]
        if not all(bool(torch.isfinite(part).all()) for run in runs for part in (run.x, run.a)):
            return records
        pairs = zip(records, runs, strict=True)
        return [replace(record, x=run.x, v=run.v) for record, run in pairs]

    @contextmanager
    def reading_states(self) -> Iterator[None]:
        """Use x and v of the records within this block, whatever `from_accelerations` says."""
        before, self.from_accelerations = self.from_accelerations, False
        try:
            yield
        finally:
            self.from_accelerations = before

    def _either(self) -> list[bool]:
        """Which springs may be of either sign; () where that is none."""
        order = nodes_of("chain", self.floors, self.supports)
        either = [len(nodes) == 2 and nodes not in order for nodes in self.elements]
        return either if self.takes_either_sign and any(either) else []


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(f"x{number}" for number in numbers)
