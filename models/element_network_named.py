"""Element network whose elements follow laws of a name: steel, flags, pendulums, concrete.

M ẍ + Bᵀ r = f,   y = B x + B_s s,   r_e = law_e(y_e, ẏ_e; q_e)          (models/named_laws)

Forces by equilibrium (models/starts/equilibrium.py) make a test of every element, for which laws
race (models/named_laws/choice.py). Where accelerations alone are known, laws of a chain are found
by runs of single elements, coupled to the measured motion (models/named_laws/storey.py), which need
the masses, but no x and v. Where masses are unknown, x and v come from the free run of a network of
units, and later of the laws found so far. At last all laws, unknown masses and mass-proportional
damping are fitted together to the motion from rest, simulated by the integrator of data/simulation,
which finds the instants of yielding. No solver is needed.
B records, T samples, n DOFs, E elements, m excitations.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from data.annotations import Fraction, shown
from data.measured.channels import signal_of
from data.record import Drive, Record, Response
from data.simulation.laws.candidate import Units
from data.simulation.laws.element import Element
from data.simulation.motion import Motion, simulate
from data.simulation.structure import Structure
from models.composition.coefficients import measured_of
from models.composition.priors import typed
from models.composition.trace import Trace
from models.element_network import ElementNetwork
from models.estimator import Estimator, Parameter
from models.fit.blocks import smooth_part
from models.fit.growing import lack_states
from models.fit.progress import announce, is_out_of_time, leaves_out, sharing
from models.named_laws.alike import Search
from models.named_laws.candidates import CANDIDATES, PAIRS
from models.named_laws.choice import HALF, choose_law
from models.named_laws.differences import Spread
from models.named_laws.fit import Fit, joined, units_of
from models.named_laws.fit import Motion as ElementTest
from models.named_laws.free_run import FreeRuns, Laws, Shaking, linear, mass_dampers, smaller
from models.named_laws.information import Information, require_modes, undetermined
from models.named_laws.learned import MOST, LearnedLaws, named_law, require_laws, told
from models.named_laws.storey import Storeys
from models.online.drift_stream import DriftStream
from models.starts.spectra import LinearStructure
from models.stored.schema import HEIGHTS

FAR = 0.1  # relative error of a free run whose x and v are too far off for a race of laws
SIZES = (8, 16)  # parameters of laws at most, one race after the other
DRAWN = 32  # laws about those found: the spread of results is known to an eighth of itself
UNSURE = 0.05  # of given masses, a standard deviation: what drawings and live loads leave open
GUESSED = 0.2  # of a mass, or of a factor: it is taken to be no smaller


class ElementNetworkNamed(ElementNetwork):
    """Masses and named laws from the motion, or from accelerations and forces alone.

    elements, masses, forced, from_accelerations: as for `ElementNetwork`. laws, seed: as for
    `NamedElement`. heights [m]: of the storeys of a chain from the ground up, or one for all, for
    drifts in percent of them. others: channels beside what is estimated: x5 is the displacement
    of floor 5 against the ground, drift2 that of floor 2 against floor 1. rows: of those that
    measure something else, such as a strain, what that is: {strain1: {drift2: 0.35, drift3: -0.1}},
    1/m. masses_within: share by which masses that are given, or taken as equal, are uncertain, as
    a standard deviation; None: UNSURE where floors are hidden, and where masses contradict what
    all floors do. Forces by equilibrium are those of the elements where there are no more of them
    than DOFs, as in a chain. Raises ValueError for channels, masses, nodes, heights or laws that do
    not fit, and for a free run that does not begin at rest.
    """

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        elements: Sequence[Sequence[str]] | Literal["chain", "all"] | None = None,
        masses: Sequence[float | None] | None = None,
        forced: Sequence[int] | str | None = None,
        laws: Literal["named"] | Sequence[str] | None = "named",
        seed: int = 0,
        from_accelerations: bool = False,
        sensors: Sequence[int] | None = None,
        heights: Sequence[float] | float | None = None,
        others: Sequence[str] = (),
        rows: Mapping[str, Mapping[str, float]] | None = None,
        masses_within: Fraction | None = None,
    ) -> None:
        if masses is not None and None in masses:
            raise ValueError(
                f"model.masses={typed(masses)}: named laws need all masses or none; give "
                "numbers, or choose model.laws=units"
            )
        if inputs == 0:
            raise ValueError(
                "nothing drives this motion, which goes on from a first state, and named laws are "
                "fitted from rest: choose model.laws=units"
            )
        if heights is not None and elements is None:
            elements = "chain"  # which alone has storeys
        super().__init__(
            dofs, inputs, dt, elements, masses, forced, 0, 0, False,
            from_accelerations=from_accelerations, sensors=sensors,
        )  # fmt: skip
        self.heights, self.masses_within = self._heights(heights), masses_within
        self.others = list(others)
        self.of_others = self._rows(self.others, rows or {})
        if any(len(nodes) > 2 for nodes in self.elements):
            raise ValueError(
                "model.elements: a named law joins two nodes; give pairs, or choose "
                "model.laws=branch for a frame that bends"
            )
        self.candidates, self.seed = require_laws(laws), seed
        self.named = LearnedLaws(len(self.elements))
        self.register_buffer("mass_damping", torch.zeros((), dtype=torch.float64))
        shape = DRAWN, len(self.elements), 4 + MOST
        self.register_buffer("drawn", torch.zeros(shape, dtype=torch.float64))
        self.register_buffer("drawn_damping", torch.zeros(DRAWN, dtype=torch.float64))
        self.register_buffer("off", torch.zeros(shape, dtype=torch.float64))
        self.register_buffer("off_damping", torch.zeros(DRAWN, dtype=torch.float64))
        for name in ("drawn_masses", "off_masses"):
            heavy = torch.zeros(DRAWN, self.floors, dtype=torch.float64)
            self.register_buffer(name, heavy)
        self.register_buffer("noise_of_ground", torch.zeros((), dtype=torch.float64))
        noise = torch.zeros(self.dofs + len(self.others), dtype=torch.float64)
        self.register_buffer("noise_of_sensors", noise)
        self.foot = "s1" if self.supports else "ground"
        self.requires_grad_(False)

    mass_damping: Tensor  # α [1/s]: dampers α m between the masses and the support
    drawn: Tensor  # units and numbers of laws that are as likely; 0 where none were drawn
    drawn_damping: Tensor  # α [1/s] of these
    drawn_masses: Tensor  # (·, n) [kg]
    off: Tensor  # the same of laws that are a deviation off, by directions
    off_damping: Tensor
    off_masses: Tensor
    noise_of_ground: Tensor  # [m/s²], as in the records of training
    noise_of_sensors: Tensor  # (S + others,) [m/s²] and [m], as there
    later = (
        "mass_damping", "drawn", "drawn_damping", "off", "off_damping", "noise_of_ground",
        "noise_of_sensors", "drawn_masses", "off_masses",
    )  # fmt: skip
    takes_either_sign = False
    takes_hidden = True
    estimates_beginning = False

    def _heights(self, heights: Sequence[float] | float | None) -> list[float] | None:
        """Of the storeys [m]. Raises ValueError unless all are positive, one for each storey."""
        if heights is None:
            return None
        found = [heights] * self.floors if isinstance(heights, int | float) else list(heights)
        if not self.is_chain:
            raise ValueError(
                f"model.heights={shown(heights)}: only a chain has storeys; choose "
                "model.elements=chain, or leave the heights out"
            )
        low, high = HEIGHTS
        if len(found) != self.floors or not all(low < height < high for height in found):
            raise ValueError(
                f"model.heights={shown(heights)}: expected {self.floors} heights of {low:g} to "
                f"{high:g} m, of the storeys from the ground up, or one for all of them"
            )
        return found

    def _rows(
        self, channels: Sequence[str], stated: Mapping[str, Mapping[str, float]]
    ) -> np.ndarray:
        """What channels are (k, n) of the displacements of all floors, as stated or as called.

        Raises ValueError for other channels, weights that are no numbers, a strain without any.
        """
        if odd := sorted(stated.keys() - set(channels)):
            raise ValueError(
                f"model.rows.{odd[0]}: there is no such channel beside what is estimated; there "
                f"are {', '.join(channels) or 'none'}"
            )
        rows = np.zeros((len(channels), self.floors))
        for row, name in zip(rows, channels, strict=True):
            own = stated.get(name, {name: 1.0})
            if not any(own.values()) or not all(map(math.isfinite, own.values())):
                raise ValueError(
                    f"model.rows.{name}={shown(own)}: expected weights of drifts, in 1/m of a "
                    f"strain, such as model.rows.{name}={{drift2: 0.35, drift3: -0.1}}"
                )
            row += sum(weight * self._row(part) for part, weight in own.items())
        return rows

    def _row(self, channel: str) -> np.ndarray:
        """What a displacement or drift is (n,) of the displacements of all floors.

        Raises ValueError for other channels, floors that there are not, and a drift of the first
        storey above a support that moves.
        """
        signal, row = signal_of(channel), np.zeros(self.floors)
        number = channel.removeprefix(signal)
        floor = int(number) if number.isdecimal() else 0
        if signal not in ("x", "drift") or not 1 <= floor <= self.floors:
            raise ValueError(
                f"{channel}: expected displacements x1 … x{self.floors} and drifts drift1 … "
                f"drift{self.floors}, as of model.dofs={self.floors} floors; of a strain, or a "
                "wire over several storeys, say what it measures, or leave it out: "
                "model.rows.strain1={drift2: 0.35, drift3: -0.1}"
            )
        row[floor - 1] = 1.0
        if signal == "drift" and floor > 1:
            row[floor - 2] = -1.0
        elif signal == "drift" and self.supports:
            raise ValueError(
                "drift1 is against a support that moves: leave it out, or give the "
                "acceleration of the ground, s_ddot1, in place of s1"
            )
        return row

    def check(self, signals: Record | Drive) -> None:
        super().check(signals)
        if signals.hold != "linear":
            raise ValueError(
                f"hold={signals.hold}: named laws follow an excitation that is linear between "
                "samples; set data.hold=linear, or choose model.laws=units"
            )

    @property
    def identified_parameters(self) -> int:
        masses = 0 if self.hidden or self.known_masses is not None else self.floors
        return self.named.count + masses + int(self.mass_damping > 0.0)

    @torch.no_grad()
    def identify(self, batches: Iterable[Record]) -> dict[str, Any]:
        """Start at a linear structure, then give every element its law, then fit all together.

        Raises ValueError for records of another time step, and for those that begin in motion.
        """
        records = self.admitted(batches)
        for record in records:
            self._check_record(record)
            _require_rest(record.drive(), record.initial_state == "periodic")
        if self.hidden and self.is_chain:
            return self._by_floors_seen(records)
        records, smooth = self.with_smooth_states(records)
        if lack_states(self, records) or self.shared:
            facts = self._alternated(records)
        else:
            facts = {**self.searched(records)[1], **smooth}
        asked = self.heights is not None or self.hidden or self.others
        if asked and not leaves_out("intervals of the storeys"):
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                laws = self.found_laws()
                runs = self._runs_of_all(records, pool.map, laws)
                facts |= self._told_of_others(runs, laws, records)
                known = self._draw(Search(runs, laws, self.sensors, self.seed), laws)
                if self.hidden:
                    facts |= {
                        "sensors_do_not_determine": "; ".join(undetermined(known, runs, "element"))
                    }
        return facts

    def _alternated(self, records: list[Record]) -> dict[str, Any]:
        """Laws of accelerations alone.

        Storeys of a chain are searched by themselves, which needs no displacements, but masses:
        where these are unknown, only if what comes first leaves more than noise. There x and v are
        of the free run of a network, the first one of units. If the free run of the laws found errs
        by less than FAR, laws of more parameters race with its x and v. Where equilibrium leaves
        forces open, they are those of the network.
        """
        by_storeys = self.is_chain and not self.shared
        if by_storeys and self.known_masses is not None and not is_out_of_time():
            return self._by_storeys(records)[1]
        network, facts = self.with_units(records)
        best: Laws | None = None
        found, before = dict[str, Any](), list[str]()
        sizes = {name: len(CANDIDATES[name].parameters) for name in self.candidates}
        least = 0 if by_storeys else min(sizes.values())  # there is no other way to these laws
        for most in (max(SIZES[0], least), SIZES[1]):
            names = [name for name, size in sizes.items() if size <= most]
            if names == before:
                continue
            if best and (best.leaves_noise or best.error > FAR or leaves_out(names[-1])):
                break
            before = names
            if self.shared:
                laws, own = self.searched(records, names, wider=False, network=network)
            else:
                states = self.with_run_of(network, records)
                with self.reading_states():
                    masses = network.mass().detach()
                    laws, own = self.searched(states, names, wider=False, masses=masses)
            if best is None or laws.improves_on(best):
                best, found = laws, own
            self._take(best)
            network = self
        left_out = best and (best.leaves_noise or leaves_out("laws of each storey by itself"))
        if by_storeys and not left_out:
            laws, own = self._by_storeys(records)
            if best is None or laws.improves_on(best):
                best, found = laws, own
            self._take(best)
        return {**found, **facts}

    def _by_floors_seen(self, records: list[Record]) -> dict[str, Any]:
        """Laws of a chain some of whose floors have no sensor.

        Masses that are unknown count as equal where a base moves, which asks for their ratios only.
        Raises ValueError as `require_motion`, and where the sensors determine no storey.
        """
        self.require_motion(records)
        require_modes(self.floors, self.dofs, self.dt, max(record.samples for record in records))
        masses = torch.ones(self.floors, dtype=torch.float64)
        masses = masses if self.known_masses is None else self.known_masses
        zero = self.B.new_zeros(self.floors)
        self._start(
            LinearStructure(*(u.cpu().numpy() for u in (masses, zero + 1.0, zero))), zero + 1.0
        )
        begin = self._laws_with([], masses, 0.0)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            runs = self._runs_of_all(records, pool.map)
            floors = self.sensors if records[0].quantity == "acceleration" else []
            search = Search(runs, begin, floors, self.seed)
            best, errors = search.choose(self._tiers[:2])  # ensembles of larger ones cost too much
            if self.others:
                runs = runs.weighed(self._kinds, best)
                search = Search(runs, begin, floors, self.seed)
                if not is_out_of_time():
                    announce("all storeys by the noise of the sensors")
                    best = search.refit(best)
            self._take(best)
            left_open = undetermined(self._draw(search, best), runs)
            of_others = self._told_of_others(runs, best, records)
        tried = ", ".join(f"{name} {100.0 * error:.2f}" for name, error in errors.items())
        equal = {"masses": "taken as equal"} if self.known_masses is None else {}
        open_ = {"sensors_do_not_determine": "; ".join(left_open)}
        facts = {**told(best.fits, [{}] * self.floors), **equal, **open_, "error_percent": tried}
        return {**facts, **of_others}

    def searched(
        self,
        records: list[Record],
        names: Sequence[str] | None = None,
        wider: bool = True,
        polished: bool = True,
        masses: Tensor | None = None,
        network: ElementNetwork | None = None,
    ) -> tuple[Laws, dict[str, Any]]:
        """Laws of these names by forces in equilibrium, fitted to the free run if `polished`.

        wider: laws with more parameters and pairs, too, where none suits. masses (n,) [kg]: of the
        forces, in place of those that a chain tells from the top. network: its free run has the
        forces, which equilibrium leaves open.
        """
        facts, of_element, laws = self._begun(records, masses, network)
        rng = np.random.default_rng(self.seed)
        search = partial(self._of_test, names or self.candidates, wider, rng)
        if self.weighs_from_the_top and masses is None:
            heavy, found, of_element = self._from_the_top(records, search)
            laws = replace(laws, masses=heavy)
        else:
            left = range(len(of_element), 0, -1)
            found = [search(motions, k) for motions, k in zip(of_element, left, strict=True)]
        fits, errors = zip(*found, strict=True)
        drag = _mass_damping(fits, of_element)
        laws = replace(laws, fits=fits, mass_damping=max(drag, laws.mass_damping))
        if polished:
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                runs = self._runs_of_all(records, pool.map)
                laws = runs.fitted(laws)
                laws = runs.exchanged(laws, [smaller(fit) for fit in laws.fits])
                laws = replace(laws, leaves_noise=runs.leave_noise(laws))
        self._take(laws)
        return laws, {**facts, **told(laws.fits, errors)}

    def found_laws(self) -> Laws:
        """The laws that were found, or taken."""
        fits, least = [self.named[e] for e in range(len(self.elements))], np.finfo(float).tiny
        return self._laws_with(fits, self.mass(), max(float(self.mass_damping), least))

    def _laws_with(self, fits: Sequence[Fit], masses: Tensor, alpha: float) -> Laws:
        """Laws whose masses (n,) [kg] are as uncertain as `masses_within` says."""
        within = self.masses_within
        if within is None:
            within = UNSURE if self.hidden else 0.0
        free, heavy = within > 0.0, masses.detach().cpu().numpy()
        return Laws(fits, heavy, self.elements, free, alpha, self.foot, within=within)

    def runs_beside(self, batches: Iterable[Record]) -> FreeRuns:
        """Free runs that are compared with records."""
        return FreeRuns(self._shakings(self.admitted(batches)), self._output)

    def _take(self, laws: Laws) -> None:
        for e, fit in enumerate(laws.fits):
            self.named.take(e, fit)
        self.mass_damping.fill_(laws.mass_damping)
        if laws.learned:
            self.mass.start(torch.from_numpy(laws.masses))

    def _draw(self, search: Search, laws: Laws) -> Information:
        """Keep laws that are as likely as these, and the noise; what the motions tell of the laws.

        noise: in the measured ground and at the sensors.
        """
        known = search.information(laws)
        self.noise_of_ground.fill_(search.noise_of_ground(known.left))
        noise = search.noise_of_sensors(known.left) * search.runs.scale
        self.noise_of_sensors.copy_(torch.from_numpy(noise))
        likely, off = search.likely(known, DRAWN), search.directions(known, DRAWN)
        keep(likely, self.drawn, self.drawn_damping, self.drawn_masses)
        keep(off, self.off, self.off_damping, self.off_masses)
        return known

    def likely(self) -> Iterator[Laws]:
        return self._laws_in(self.drawn, self.drawn_damping, self.drawn_masses)

    def about(self) -> tuple[list[Laws], float]:
        """Laws about those found, and the variance of their weights in laws that are as likely.

        A deviation away in each direction; of a model that lacks these, the draws.
        """
        own = list(self._laws_in(self.off, self.off_damping, self.off_masses))
        return (own, 1.0) if own else (list(self.likely()), 1.0 / DRAWN)

    def _laws_in(self, numbers: Tensor, dampings: Tensor, masses: Tensor) -> Iterator[Laws]:
        if not bool(numbers.any()):
            return
        found = self.found_laws()
        rows = zip(numbers.cpu(), dampings.tolist(), masses.cpu().numpy(), strict=True)
        for kept, damping, heavy in rows:
            if not bool(kept.any()):
                return
            fits = [
                replace(fit, units=Units(*own[:4].tolist()), q=own[4 : 4 + fit.q.size])
                for fit, own in zip(found.fits, kept.numpy(), strict=True)
            ]
            heavy = heavy if heavy.any() else found.masses  # an earlier version kept none
            yield replace(found, fits=fits, mass_damping=damping, masses=heavy)

    def with_laws(self, laws: Laws) -> ElementNetworkNamed:
        """The same network with one of the `likely` laws."""
        own = deepcopy(self)
        own._take(laws)
        return own

    def stream(self) -> DriftStream:
        """Drifts of all storeys, sample by sample.

        Raises ValueError where no laws were drawn: all floors are seen, without heights or others.
        """
        return DriftStream(self)

    def _of_test(
        self,
        names: Sequence[str],
        wider: bool,
        rng: np.random.Generator,
        motions: Sequence[ElementTest],
        left: int,
    ) -> tuple[Fit, dict[str, float]]:
        """The law of an element by its forces in equilibrium; errors on motion held back.

        left: elements that wait for one, with this; as much time is kept for all of them together.
        """
        with sharing(left + 1):
            return choose_law(motions, names, int(rng.integers(2**31)), wider)

    def _from_the_top(
        self,
        records: Sequence[Record],
        search: Callable[[Sequence[ElementTest], int], tuple[Fit, dict[str, float]]],
    ) -> tuple[np.ndarray, list[tuple[Fit, dict[str, float]]], list[list[ElementTest]]]:
        """Masses (n,) of a chain, laws and errors of its elements, and their motions.

        What moves above an element tells its force but for the mass at its head, which is found
        with the law: r_e = Σ_{j≥e} (f − m ẍ)_j. What no force acts on above is known but for a
        factor, until one does; without any, the first mass is as heavy as it was. A share of what
        is not known is taken as guessed: a force alone, such as a blow, tells no size of r_e.
        """
        balances = [balance for record in records for balance in self.balances(record)]
        parts = [tuple(part.numpy() for part in balance) for balance in balances]
        begin, n, found = self.mass().detach().cpu().numpy(), self.floors, []
        driven = np.flatnonzero(sum(np.abs(force).sum(axis=0) for _, _, force, *_ in parts))
        masses, highest = np.zeros(n), max(driven.tolist(), default=-1)
        if highest < n - 1:
            masses[-1] = begin[-1]
        for e in reversed(range(n)):
            near = begin if highest >= 0 else masses[min(e + 1, n - 1)]
            guessed = np.where(masses > 0.0, masses, near)
            loose = e == highest < n - 1  # from here on the factor is known
            taken = GUESSED * guessed[e] if masses[e] == 0.0 and e <= highest else masses[e]
            motions = [_above(part, e, masses, guessed, self.dt, taken, loose) for part in parts]
            found.append(search(motions, e + 1))
            best, _ = found[-1]
            factors = best.factors_on(motions)
            if masses[e] == 0.0:
                own = taken + float(factors[0 if loose else -1])
                masses[e] = max(own, GUESSED * guessed[e])
            if loose:
                size = GUESSED + float(factors[-1])
                masses[e + 1 :] *= size
                found[:-1] = [(fit.times(size), errors) for fit, errors in found[:-1]]
        scale = 1.0 if highest >= 0 else float(begin[0]) / masses[0]
        masses *= scale
        fits = [(fit.times(scale), errors) for fit, errors in reversed(found)]
        known = [
            [_above(p, e, masses, masses, self.dt, masses[e]) for p in parts] for e in range(n)
        ]
        return masses, fits, known

    def _by_storeys(self, records: Sequence[Record]) -> tuple[Laws, dict[str, Any]]:
        """Laws of a chain, each by a run of its element alone, coupled to the measured motion."""
        facts, _, laws = self._begun(records)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            runs = FreeRuns(self._shakings(records), self._output, pool.map)
            whole, linear = self._runs_of_all(records, pool.map), runs.beginning(laws)
            tiers = [*self._tiers[:2], *self._pairs, *self._tiers[2:]]
            storeys = Storeys(runs.shakings, whole, linear, tiers, self.seed)
            laws, errors = storeys.choose()
            laws = replace(whole.sided(whole.with_p_delta(laws)), alike=())
            laws = self._with_uncertain_masses(whole, laws)
            laws = replace(laws, leaves_noise=whole.leave_noise(laws))
        if laws.learned and self.known_masses is not None:
            off = 100.0 * (laws.masses / self.known_masses.numpy() - 1.0)
            listed = ", ".join(f"x{i} {share:+.1f}" for i, share in enumerate(off, start=1))
            facts["masses"] = (
                f"the given ones contradict the motion; fitted ones differ by {listed} %"
            )
        self._take(laws)
        return laws, {**facts, **told(laws.fits, errors, "force")}

    def _with_uncertain_masses(self, whole: FreeRuns, laws: Laws) -> Laws:
        """The laws, or a fit of laws and masses that improves on them.

        Without `masses_within`, masses are fitted only where the laws leave more than noise, and
        the fit is taken only if it halves the smooth part of the residual. Where no law suits, it
        does not.
        """
        within = UNSURE if self.masses_within is None else self.masses_within
        exact = within == 0.0 or (self.masses_within is None and whole.leave_noise(laws))
        if exact or leaves_out("masses that are uncertain"):
            return laws
        announce("masses that are uncertain")
        free = replace(laws, learned=True, within=within)
        found = Search(whole, laws, self.sensors, self.seed).refit(free)
        misfits = [smooth_part(whole.left(one).ravel(), self.dofs) for one in (found, laws)]
        mends = self.masses_within is not None or misfits[0] <= HALF**2 * misfits[1]
        return found if mends and found.improves_on(laws) else laws

    @property
    def _tiers(self) -> list[list[str]]:
        """Names of laws by the number of their parameters: others only where the first miss."""
        sizes = {name: len(CANDIDATES[name].parameters) for name in self.candidates}
        some = [
            [name for name, size in sizes.items() if low < size <= high]
            for low, high in pairwise((0, *SIZES, max(sizes.values())))
        ]
        return [names for names in some if names]

    @property
    def _pairs(self) -> list[list[str]]:
        """Names of pairs of laws in parallel, of as many parameters as others that race.

        Those with a damper come before two springs.
        """
        damped, springs = list[str](), list[str]()
        for pair in PAIRS.values():
            known = {half.name for half in pair.halves} <= {*self.candidates}
            if known and len(pair.parameters) <= SIZES[1]:
                has_dashpot = any("coefficient" in half.parameters for half in pair.halves)
                (damped if has_dashpot else springs).append(pair.name)
        return [names for names in (damped, springs) if names]

    def _begun(
        self,
        records: Sequence[Record],
        masses: Tensor | None = None,
        network: ElementNetwork | None = None,
    ) -> tuple[dict[str, Any], list[list[ElementTest]], Laws]:
        """Facts of a linear structure, tests of all elements by equilibrium, and its laws.

        masses (n,) [kg]: in place of the structure's own. network: its runs are the tests.
        """
        facts = ElementNetwork.identify(self, records)
        assert self.linear is not None
        if masses is not None:
            self.mass.start(masses)
        stiffness = self.springs_of_tests()
        if network is None:
            tests = [test for record in records for test in self.element_tests(record, stiffness)]
        else:
            self.mass.start(network.mass().detach())
            tests = [test for record in records for test in network.tests_in_run(record)]
        of_element = [
            [_motion(test, e, self.dt) for test in tests] for e in range(len(self.elements))
        ]
        units = [units_of(motions) for motions in of_element]
        heavy, learned = self.mass().detach().cpu().numpy(), self.known_masses is None
        laws = linear(stiffness.numpy(), heavy, units, self.elements, learned, self.foot)
        return facts, of_element, laws

    def _shakings(self, records: Sequence[Record]) -> list[Shaking]:
        """Every motion of the records, as the laws are fitted to them."""
        inputs, mass = self.composition().inputs.value.detach().cpu(), self.mass().detach().cpu()
        shakings = []
        for record in records:
            targets = record.a.reshape(-1, record.samples, self.dofs).cpu()
            drives = record.excitation.reshape(-1, record.samples, self.inputs).cpu()
            states = self.states_of_elements(record)
            for target, u, (_, v, _, moved) in zip(targets, drives, states, strict=True):
                pull = u @ inputs.T
                force, pull = (0.0 * pull, pull) if self.base else (mass * pull, 0.0 * pull)
                s, s_dot = (part.numpy().copy() for part in u[:, self.forces :].chunk(2, dim=1))
                against = v - moved[:, self.forces + self.supports :][:, :1] if len(s[0]) else v
                parts = (force.numpy(), pull.numpy(), s, s_dot, target.numpy().copy())
                shakings.append(Shaking(self.dt, *parts, against.numpy(), record.warmup))
        return shakings

    def _output(self, motion: Motion) -> np.ndarray:
        """What the sensors have of a simulated motion (T, n)."""
        rows, parts = [number - 1 for number in self.sensors], (motion.x, motion.v, motion.a)
        # picked by NumPy, in a tenth of PyTorch's time: a search does so thousands of times
        x, v, a = (torch.from_numpy(np.ascontiguousarray(u.T[rows])).T for u in parts)
        return measured_of(self.measures, x, v, a).numpy()

    @property
    def _kinds(self) -> list[str]:
        """Of all sensors (S + k,)."""
        return [""] * self.dofs + [signal_of(name) for name in self.others]

    def _others_of(self, records: Sequence[Record]) -> list[np.ndarray]:
        """Displacements and drifts (T, k) of every motion, as they were measured.

        Raises ValueError for records that have others, and for a channel that does not change.
        """
        found = list[np.ndarray]()
        for record in records:
            if self.others and list(record.others) != self.others:
                raise ValueError(
                    f"the records have {', '.join(record.others) or 'no channel'} beside what is "
                    f"estimated; the model was built with others={shown(self.others)}"
                )
            o = record.a[..., :0] if record.o is None or not self.others else record.o
            found += [*o.reshape(record.a.shape[:-2].numel(), *o.shape[-2:]).numpy()]
        for own in found:
            still = np.flatnonzero(np.ptp(own, axis=0) == 0.0)
            if still.size:
                raise ValueError(
                    f"{self.others[still[0]]} does not change in a whole record; check its wiring, "
                    "or leave the channel out"
                )
        return found

    def _told_of_others(
        self, runs: FreeRuns, laws: Laws, records: Sequence[Record]
    ) -> dict[str, str]:
        """Errors of displacements and drifts in words, and their zeros beyond the noise."""
        if not self.others:
            return {}
        rows = np.concatenate([one.target[one.first :] for one in runs.shakings])
        left = np.sqrt(np.mean(runs.left(laws) ** 2, axis=0))
        errors = (100.0 * left / rows.std(axis=0))[self.dofs :]
        noise = (left * runs.scale)[self.dofs :]
        zeros = np.array([
            (o - runs.run(laws, one).x @ self.of_others.T)[one.first :].mean(axis=0)
            for one, o in zip(runs.shakings, self._others_of(records), strict=True)
        ])  # fmt: skip
        told = {"error_of_other_channels_percent": ", ".join(
            f"{name} {error:.2f}" for name, error in zip(self.others, errors, strict=True)
        )}  # fmt: skip
        far = [
            f"{name} {' and '.join(dict.fromkeys(f'{1e3 * z:.3g}' for z in own))} "
            f"{'mm/m' if signal_of(name) == 'strain' else 'mm'}"
            for name, own, small in zip(self.others, zeros.T, noise, strict=True)
            if (np.abs(own) > small).any()
        ]
        return {**told, "zeros_of_sensors": ", ".join(far)}

    def _runs_of_all(
        self, records: Sequence[Record], spread: Spread, laws: Laws | None = None
    ) -> FreeRuns:
        """Free runs, compared with all that was measured, as `FreeRuns.weighed` by laws or without.

        Displacements, drifts and strains count from their first sample.
        """
        shakings, k = self._shakings(records), len(self.others)
        others = self._others_of(records)
        loose = k + (self.dofs if self.hidden and records[0].quantity == "displacement" else 0)
        whole = []
        for one, o in zip(shakings, others, strict=True):
            target = np.hstack([one.target, o])
            target[:, len(target[0]) - loose :] -= target[one.first, len(target[0]) - loose :]
            whole.append(replace(one, target=target, loose=loose))

        def output(motion: Motion) -> np.ndarray:
            return np.hstack([self._output(motion), motion.x @ self.of_others.T])

        runs = FreeRuns(whole, output, spread)
        return runs.weighed(self._kinds, laws) if k else runs

    def structure(self) -> Structure:
        """The structure that was identified, as data/simulation has it."""
        parts = {
            f"r{e + 1}_{i + 1}": element
            for e, pair in enumerate(self.elements)
            for i, element in enumerate(self.named.elements(e, pair))
        }
        return Structure(self.mass().detach().cpu().tolist(), {**parts, **self.mass_dampers()})

    def small_motion(self) -> tuple[Tensor, Tensor, Tensor]:
        """Of all floors, those without a sensor, too."""
        M, C, K = (torch.from_numpy(m) for m in self.structure().linearised())
        return torch.linalg.solve(M, K), torch.linalg.solve(M, C), torch.eye(len(M)).to(M)

    def named_elements(self, e: int) -> Sequence[Element]:
        return self.named.elements(e, self.elements[e])

    def mass_dampers(self) -> dict[str, Element]:
        """Dampers between the masses and the support by names, none for α = 0."""
        return mass_dampers(float(self.mass_damping), self.mass().detach().cpu().numpy(), self.foot)

    def _mass_damping(self) -> Iterable[Parameter]:
        if (alpha := float(self.mass_damping)) > 0.0:
            yield Parameter("mass_damping", alpha, "1/s", "of Rayleigh's")

    def _laws(self, parts: Sequence[tuple[str, str]]) -> Iterable[Parameter]:
        for e, part in enumerate(parts):
            yield from named_law(self.named[e], *part)

    def forward(self, record: Record) -> Tensor:
        return self.run_of(record).a

    def run_of(self, record: Record) -> Response:
        return Estimator.run_of(self, record)

    def free_run(self, drive: Drive) -> Response:
        """The motion from rest; infinite from where it escapes."""
        return self.trace(drive).response

    def trace(self, drive: Drive, *_: Any, **__: Any) -> Trace:
        """The motion from rest, and deformations and forces of the elements."""
        self.require_identified(self.named.numbers)
        return self.trace_of(self.structure(), drive)

    def trace_of(self, structure: Structure, drive: Drive) -> Trace:
        """The same of another structure with the same masses and elements."""
        _require_rest(drive)
        lead = drive.u.shape[:-1]
        named = [name for name in structure.elements if name.startswith("r")]
        of_part = [int(name[1:].partition("_")[0]) - 1 for name in named]
        motions, elements = [], []
        for motion in self.motions_of(structure, drive):
            y, r = motion.y[:, : len(of_part)], motion.r[:, : len(of_part)]  # dampers come last
            parts = [torch.from_numpy(u) for u in (motion.x, motion.v, motion.a)]
            moved = torch.stack([self.seen(u.T).T for u in parts])
            loops = torch.zeros(2, drive.samples, len(self.elements), dtype=torch.float64)
            loops[0, :, of_part] = torch.from_numpy(y)  # of all in parallel the same
            loops[1].index_add_(1, torch.tensor(of_part), torch.from_numpy(r))
            if motion.escape_time is not None:
                moved[:, round(motion.escape_time / drive.dt) :] = torch.inf
                loops[:, round(motion.escape_time / drive.dt) :] = torch.inf
            motions.append(moved)
            elements.append(loops)
        device = drive.u.device
        x, v, a = torch.stack(motions, dim=1).reshape(3, *lead, self.dofs).to(device)
        y, r = torch.stack(elements, dim=1).reshape(2, *lead, len(self.elements)).to(device)
        none = a.new_zeros(*a.shape, 0)
        return Trace(Response(x, v, measured_of(self.measures, x, v, a)), r, y, none, none)

    def motions_of(self, structure: Structure, drive: Drive) -> Iterator[Motion]:
        """The motion of all masses and elements of a structure under every drive of a batch."""
        inputs = self.composition().inputs.value.cpu()
        mass = torch.tensor(structure.masses) if self.base else self.mass().detach().cpu()
        for u in drive.u.cpu().reshape(-1, drive.samples, self.inputs):
            force = (mass * (u @ inputs.T)).numpy()
            s, s_dot = (part.numpy().copy() for part in u[:, self.forces :].chunk(2, dim=1))
            moving = (s, s_dot) if self.supports else (None, None)
            yield simulate(structure, force, drive.dt, *moving)


def _require_rest(drive: Drive, moving: bool = False) -> None:
    """Raise ValueError for a motion that does not begin at rest. moving: it is known that not."""
    if moving or bool(drive.x0.any()) or bool(drive.v0.any()):
        raise ValueError(
            "ElementNetworkNamed simulates from rest, and this record begins in motion; count "
            "its first samples as warm-up (data.initial_state=rest, data.warmup)"
        )


def keep(several: Sequence[Laws], numbers: Tensor, dampings: Tensor, masses: Tensor) -> None:
    """Write laws to the first rows of numbers (·, E, 4 + MOST), dampings (·,) and masses (·, n)."""
    for i, laws in enumerate(several):
        dampings[i], masses[i] = laws.mass_damping, masses.new_tensor(laws.masses)
        for e, fit in enumerate(laws.fits):
            own = [*vars(fit.units).values(), *fit.q.tolist()]
            numbers[i, e, : len(own)] = numbers.new_tensor(own)


def _motion(test: Sequence[Tensor], e: int, dt: float) -> ElementTest:
    y, rate, r, drag = (u[:, e].numpy().copy() for u in test)
    return ElementTest(dt, y, rate, r, drag[:, None])


def _above(
    balance: Sequence[np.ndarray],
    e: int,
    masses: np.ndarray,
    guessed: np.ndarray,
    dt: float,
    taken: float,
    loose: bool = False,
) -> ElementTest:
    """An element of a chain under masses (n,), of which that at its head may be unknown: zero.

    guessed: masses whose dampers α m are in the force. taken [kg]: what of the mass at its head is
    taken as known. loose: those above are known but for a factor, and nothing of the dampers is.
    """
    y, rate, force, absolute, against = balance
    own, above = absolute[:, e], absolute[:, e + 1 :] @ masses[e + 1 :]
    shares = [] if loose else [against[:, e:] @ guessed[e:]]
    shares += [own] if masses[e] == 0.0 else []
    shares += [above] if loose else []
    r = force[:, e:].sum(axis=1) - taken * own - (GUESSED if loose else 1.0) * above
    return ElementTest(dt, y[:, e].copy(), rate[:, e].copy(), r, np.stack(shares, axis=1))


def _mass_damping(fits: Sequence[Fit], of_element: Sequence[Sequence[ElementTest]]) -> float:
    """α [1/s] by the drag in the tests of all elements, weighted by how much there is."""
    weights = [float(np.sum(joined(motions, "shares") ** 2)) for motions in of_element]
    found = [fit.factors_on(test)[0] for fit, test in zip(fits, of_element, strict=True)]
    return float(np.average(found, weights=weights)) if any(weights) else 0.0
