"""Estimators that are a composition of a linear core and elements, simulated as a whole.

The free run is compiled, with its derivatives (trace.py). It holds at any time step.
B records, T samples, n DOFs, E elements, P free parameters.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from typing import Annotated, Any, ClassVar

import torch
from torch import Tensor, nn

from data.annotations import MOST, Range
from data.record import SHORTEST, Drive, Record, Response
from models.composition.coefficients import ACCELERATION, DISPLACEMENT, VELOCITY, Composition
from models.composition.first_state import first_state, projected, units_of
from models.composition.laws import ElementLaws
from models.composition.priors import Held
from models.composition.states import MEASURES, reconstructed_of, states_of
from models.composition.trace import DifferentiatedRun, Trace, traced
from models.estimator import simulate as simulate_record
from models.fit.problem import begins_unknown

SHARES = (0.0, 0.5, -0.5)  # of its limit: a unit's memory, where a search for it starts
LOST = 1e6  # times the largest measured motion: a run that goes so far has diverged


def digest(*signals: Tensor | None) -> int:
    """A number that tells other values apart."""
    return hash(b"".join(s.detach().cpu().numpy().tobytes() for s in signals if s is not None))


GONE = (  # of weights until 0.12
    *("laws.quadratic", "laws.absolute_damping", "laws.square_damping"),
    *("laws.tanh_stiffness", "laws.tanh_slope", "laws.tanh_place"),
)


class Composite(Held):
    """Base of the networks of elements. `substeps` divide a sample interval of `dt`.

    from_accelerations: measured x and v are not used. prior: of Held.
    """

    reads = ("f",)
    on_processor = True
    estimates_beginning = True
    later: ClassVar[tuple[str, ...]] = ("bound", "channels", *Held.later)
    traced = staticmethod(traced)  # how a composition is run
    differentiated: ClassVar[dict[str, int | None]] = {"x": DISPLACEMENT, "v": VELOCITY, "a": None}
    measures: Tensor  # (n,): of the sensors, displacement 0, velocity 1, acceleration 2
    bound: Tensor  # (n,): of what sensors measure; a run beyond has diverged
    channels: Tensor  # (n,): what the errors of each count by
    identified: Tensor  # 1 once the parameters have their units, until then NaN

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        substeps: Annotated[int, Range(1, MOST)] = 2,
        prior: float = 1e-10,
        from_accelerations: bool = False,
    ) -> None:
        super().__init__(dofs, inputs, dt, prior)
        self.from_accelerations = from_accelerations
        self.register_buffer("identified", torch.tensor(torch.nan, dtype=torch.float64))
        self.register_buffer("measures", torch.full((dofs,), ACCELERATION))
        self.register_buffer("bound", torch.full((dofs,), torch.inf, dtype=torch.float64))
        self.register_buffer("channels", torch.ones(dofs, dtype=torch.float64))
        self.substeps = substeps
        self.first: dict[int, tuple[Tensor, Tensor, Tensor]] = {}  # states of records in training
        self.first_found: dict[int, Any] = {}  # by record: what for, and its first state
        self.motions: dict[int, tuple[Tensor, Tensor]] = {}  # x and v of such records
        self.last_beginning: Tensor | None = None  # unknown, of the last training run

    def weights_of_channels(self) -> Tensor | None:
        return self.channels

    def todays_weights(self, stored: dict[str, Tensor]) -> dict[str, Tensor]:
        """Without the terms of laws until 0.12 that no config learned, whose θ are zero.

        Raises ValueError where they are not.
        """
        kept = {name: t for name, t in stored.items() if name.rpartition(".")[0] not in GONE}
        used = [name for name in stored if name not in kept and name.endswith("theta")]
        if any(bool(stored[name].any()) for name in used):
            raise ValueError(f"{', '.join(used)}: laws have no such terms any more; repeat the run")
        return kept

    def composition(self) -> Composition:
        """The equation of motion with coefficients at the present parameters."""
        raise NotImplementedError

    def compiled_branches(self) -> Any:
        """Branch laws of the elements, as compiled runs take them; () where these have units."""
        return ()

    def forward(self, record: Record) -> Tensor:
        """Acceleration (…, T, n) one step ahead of measured x and v; without these, a free run.

        The memory of hysteretic units follows the increments of the steps.
        """
        if not self.has_states(record) and record.initial_state in ("periodic", "unknown"):
            return simulate_record(self, record).a
        return self.restarted_run(record, 1 if self.has_states(record) else None)

    def has_states(self, record: Record) -> bool:
        return not self.from_accelerations and super().has_states(record)

    def begins_anew(self, record: Record) -> bool:
        """Training takes x and v from the whole motion where they are not measured."""
        return self.has_states(record) or record.quantity in MEASURES

    def regression(self, record: Record) -> tuple[nn.Module, Any, Tensor]:
        raise ValueError(
            f"{type(self).__name__} is trained on its free run; set objective=free_run"
        )

    @property
    def identified_parameters(self) -> int:
        return sum(p.numel() for p in self.parameters() if p.requires_grad)

    def free_run(self, drive: Drive) -> Response:
        """The motion, whose signals `differentiated` follow the free parameters in autograd."""
        motion, free = self.trace(drive).response, self._parameters_asked_for()
        runs = self.differentiated if free else {}
        found = {
            name: DifferentiatedRun.apply(partial(self._seen_as, kind, drive), *free)
            for name, kind in runs.items()
        }
        return replace(motion, **found)

    def _parameters_asked_for(self) -> list[nn.Parameter]:
        """Parameters that autograd asks for."""
        return [p for p in self.parameters() if p.requires_grad] if torch.is_grad_enabled() else []

    def _seen_as(self, kind: int | None, drive: Drive) -> tuple[Tensor, Tensor]:
        """The compiled run with derivatives, as sensors of one kind see it; None: its own."""
        if kind is None:
            trace = self.trace(drive, derivatives=True)
        else:
            composed = self.composition()
            seen = replace(composed, measures=torch.full_like(composed.measures, kind))
            trace = self.traced(seen, drive, self._substeps(drive.dt), derivatives=True)
        return trace.response.a, trace.jacobian

    def run_of(self, record: Record) -> Response:
        """The free run of a record; the warm-up samples tell an unknown first state."""
        if not begins_unknown(self, record) or not record.warmup:
            return self.free_run(record.drive())
        return self._trace_of(record).response

    def _trace_of(self, record: Record) -> Trace:
        """The compiled run of a record, with its elements."""
        if not begins_unknown(self, record) or not record.warmup:
            return self.trace(record.drive())
        seen = record.window(0, record.warmup)
        return self.trace(record.drive(), begin=self.first_state(seen))

    @torch.no_grad()
    def first_state(self, record: Record, near: Tensor | None = None) -> Tensor:
        """q, q̇ and the units' memory (…, 2n + E·units) at the first sample of a record.

        All its samples are simulated as well as can be; it begins where x and v are measured.
        near: where the search begins instead, of the first state in coarser steps, say.
        The same record and parameters are searched once.
        """
        key = digest(record.a, record.excitation, record.x, record.v)
        state = self.substeps, digest(near, *self.parameters(), *self.buffers())
        if self.first_found.get(key, (None,))[0] != state:
            self.first_found[key] = state, self._search(record, near)
        return self.first_found[key][1].clone()

    def _search(self, record: Record, near: Tensor | None) -> Tensor:
        """`first_state` by simulation."""
        self.require_identified(self.identified)
        drive, composition = record.drive(), self.composition()
        n, lead = composition.core.value.shape[1], record.a.shape[:-2]
        memory = composition.laws.value.shape[0] * composition.counts[1]
        start = record.a.new_zeros(lead.numel(), 2 * n + memory)
        found = self._first_motion(record)
        if found is not None:
            back = torch.linalg.pinv(composition.outputs.value)
            first = [u[..., 0, :].reshape(len(start), -1) @ back.T for u in found]
            start[:, : 2 * n] = torch.cat(first, dim=1)
        measured = record.a.reshape(len(start), *record.a.shape[-2:])
        u = drive.u.reshape(len(start), *drive.u.shape[-2:])
        rest, substeps = drive.x0.new_zeros(self.dofs), self._substeps(drive.dt)

        def run(begin: Tensor, samples: int) -> Trace:
            part = Drive(drive.dt, u[:, :samples], rest, rest, drive.hold)
            return self.traced(composition, part, substeps, begin=begin, by_begin=True)

        limit, most = composition.limits().flatten(), start.new_full((2 * n + memory,), torch.inf)
        most[2 * n :] = limit
        if near is not None:
            found_near = first_state(run, measured, [near.reshape(len(start), -1)], most, n, (1,))
            return found_near.reshape(*lead, -1)
        starts = [start.clone() for _ in SHARES]
        for state, share in zip(starts, SHARES, strict=True):
            state[:, 2 * n :] = share * limit
        if found is not None and not self.has_states(record):
            starts.append(torch.zeros_like(start))  # reconstructed motions err at their ends
        return first_state(run, measured, starts, most, n).reshape(*lead, -1)

    def _first_motion(self, record: Record) -> tuple[Tensor, Tensor] | None:
        """x and v (…, T, n) of samples that tell how a record begins; None of other quantities."""
        if self.has_states(record):
            assert record.x is not None
            assert record.v is not None
            return record.x, record.v
        long = record.quantity in MEASURES and record.samples >= SHORTEST
        return reconstructed_of(record) if long else None

    @torch.no_grad()
    def first_states(self, record: Record) -> Tensor:
        key = digest(record.a)
        if key not in self.first:
            begin = self.first_state(record)
            by_begin = self.trace(record.drive(), None, 0, True, begin).by_begin
            unit = units_of(by_begin, record.a, self.composition().core.value.shape[1])
            self.first[key] = (begin, unit, begin.new_zeros(begin.numel()))
        return self.first[key][2]

    def run_from(
        self, record: Record, own: Tensor, derivatives: bool
    ) -> tuple[Tensor, Tensor, Tensor]:
        begin, unit, _ = self.first[digest(record.a)]
        begin = begin + unit * own.reshape(begin.shape)
        trace = self.trace(record.drive(), None, 0, derivatives, begin)
        by_state = trace.by_begin * unit[..., None, None, :] if derivatives else trace.by_begin
        return trace.response.a, trace.jacobian, by_state

    def forget(self) -> None:
        self.first.clear()

    def restarted_run(self, record: Record, horizon: int | None) -> Tensor:
        """Acceleration (…, T, n) of runs that begin again at measured x and v.

        The memory of hysteretic units goes on where a run begins again, so runs need no warm-up.
        """
        if free := self._parameters_asked_for():
            return DifferentiatedRun.apply(partial(self.restarted_jacobian, record, horizon), *free)
        return self._restarted(record, horizon, False).response.a

    def restarted_jacobian(self, record: Record, horizon: int | None) -> tuple[Tensor, Tensor]:
        trace = self._restarted(record, horizon, True)
        return trace.response.a, trace.jacobian

    @torch.no_grad()
    def finer_run(self, record: Record, times: int) -> Tensor:
        """The run (…, T, n) in so many times as many steps, right after that in the usual ones.

        An unknown first state is searched for about that of the run before, of this record.
        """
        substeps = self.substeps
        try:
            self.substeps = min(times * substeps, MOST)
            return self._restarted(record, None, False, self.last_beginning).response.a
        finally:
            self.substeps = substeps

    def _restarted(
        self, record: Record, horizon: int | None, derivatives: bool, near: Tensor | None = None
    ) -> Trace:
        """A run of a record in training, all of whose samples tell how it begins."""
        anchors = self._anchors(record, horizon)
        if anchors is not None or not begins_unknown(self, record):
            return self.trace(record.drive(), anchors, horizon or 0, derivatives)
        begin = self.first_state(record, near)
        self.last_beginning = begin
        trace = self.trace(record.drive(), None, 0, derivatives, begin)
        if not derivatives:
            return trace
        flat = record.a.shape[:-2].numel()
        n = self.composition().core.value.shape[1]
        J, J0 = (u.reshape(flat, *u.shape[-3:]) for u in (trace.jacobian, trace.by_begin))
        return replace(trace, jacobian=projected(J, J0, n).reshape(trace.jacobian.shape))

    def small_motion(self) -> tuple[Tensor, Tensor, Tensor] | None:
        """The core, with the springs and dampers of the elements for small motions."""
        self.require_identified(self.identified)
        composed = self.composition()
        springs, dampers = self._springs_and_dampers()
        G, D = composed.G.value, composed.D.value
        core_k, core_c = (torch.diag(part) for part in composed.core.value)
        return core_k + (G * springs) @ D, core_c + (G * dampers) @ D, composed.outputs.value

    def _springs_and_dampers(self) -> tuple[Tensor, Tensor]:
        """Stiffness [N/m] and damping [N s/m] (E,) of small motions."""
        laws = self.composition().laws.value
        return laws[:, 0], laws[:, 1]

    def run_with_loops(self, drive: Drive) -> tuple[Response, tuple[Tensor, Tensor] | None]:
        self.check(drive)
        trace = self.trace(drive)
        return trace.response, (trace.deformations, trace.forces)

    def element_loops(self, signals: Record | Drive) -> tuple[Tensor, Tensor]:
        """Deformations [m], restoring forces [N] (…, T, E) of the elements in a free run.

        Raises ValueError for a record that begins in motion without its state.
        """
        trace = self._trace_of(signals) if isinstance(signals, Record) else self.trace(signals)
        return trace.deformations, trace.forces

    def trace(
        self,
        drive: Drive,
        anchors: Tensor | None = None,
        every: int = 0,
        derivatives: bool = False,
        begin: Tensor | None = None,
    ) -> Trace:
        """A compiled run, restarted from `anchors` (…, 2, T, n) every so many samples.

        begin: q, q̇ and the units' memory (…, S) at the first sample, in place of the drive's.
        """
        self.require_identified(self.identified)
        substeps, by_begin = self._substeps(drive.dt), derivatives and begin is not None
        composed = self.composition()
        return self.traced(
            composed, drive, substeps, anchors, every, derivatives, self.bound, begin, by_begin
        )

    def admitted(self, batches: Iterable[Record]) -> list[Record]:
        """The records on the processor; sets what their sensors measure, and how much at most.

        Raises ValueError for records that hold no motion.
        """
        records = [record.to("cpu") for record in batches]
        for record in records:
            if record.quantity not in MEASURES:
                raise ValueError(
                    f"{type(self).__name__} describes motions; the record holds "
                    f"{record.quantity}: take model=element_test for the force of an element, "
                    "model=gru for other outputs"
                )
            if record.quantity != records[0].quantity:
                raise ValueError(
                    f"some records hold {records[0].quantity}, others {record.quantity}: identify "
                    "from those of one quantity"
                )
            self.measures.fill_(MEASURES[record.quantity])
        self.bind(records)
        return records

    def bind(self, records: Iterable[Record]) -> None:
        """Set what a run must not exceed, by the motion of some records."""
        largest = [r.a.abs().reshape(-1, self.dofs).amax(dim=0) for r in records]
        size = torch.stack(largest).amax(dim=0)
        self.bound.copy_(LOST * torch.where(size > 0.0, size, size.max()))

    def states(self, record: Record) -> Iterable[tuple[Tensor, Tensor, Tensor, Tensor]]:
        """x, v, a, u (T, ·) of each record as measured; filtered alike where x or v is missing."""
        return states_of(record, self.from_accelerations)

    def _anchors(self, record: Record, horizon: int | None) -> Tensor | None:
        """x and v (…, 2, T, n), measured or reconstructed; first the record's initial state."""
        if horizon is None:
            return None
        if not self.begins_anew(record):
            raise ValueError(
                "runs restart from measured x and v, which this record or model lacks; set "
                f"objective.restart=false, or {record.remedy_of_state}"
            )
        x, v = (record.x, record.v) if self.has_states(record) else self._motion(record)
        assert x is not None
        assert v is not None
        anchors = torch.stack([x, v], dim=-3).clone()
        if record.initial_state != "unknown":
            drive = record.drive()
            anchors[..., 0, 0, :], anchors[..., 1, 0, :] = drive.x0, drive.v0
        return anchors

    def _motion(self, record: Record) -> tuple[Tensor, Tensor]:
        """x and v (…, T, n) of a record in training, from what was measured of its motion."""
        key = digest(record.a)
        if key not in self.motions:
            self.motions[key] = reconstructed_of(record)
        return self.motions[key]

    def check(self, signals: Record | Drive) -> None:
        super().check(replace(signals, dt=self.dt))  # any time step will do

    def _substeps(self, dt: float) -> int:
        """Number of substeps in a sample interval of `dt`: substeps keep their length."""
        substeps = max(1, round(self.substeps * dt / self.dt))
        if substeps > MOST:
            raise ValueError(
                f"the signals have dt={dt:g} s, of which {type(self).__name__}, built for dt="
                f"{self.dt:g} s, makes {substeps} substeps; {MOST} are possible: resample"
            )
        return substeps


class FromSprings(Composite):
    """Base of composites whose laws start at linear springs and dampers, without memory.

    `identify` sets `linear`: their stiffness [N/m] and damping [N s/m], and the largest
    deformations [m], all (E,).
    """

    laws: ElementLaws
    linear: tuple[Tensor, Tensor, Tensor] | None = None

    @torch.no_grad()
    def settle(self) -> None:
        """Start the laws again at the present springs and dampers, which set the units of θ."""
        assert self.linear is not None
        self.linear = self.laws.stiffness().cpu(), self.laws.damping().cpu(), self.linear[2]
        self.laws.start(*self.linear)

    def restart(self, generator: torch.Generator) -> None:
        """Go back to the identified springs and dampers; spread hinges and limits again."""
        if self.linear is None:
            name = type(self).__name__
            raise ValueError(f"{name} restarts from its identification; identify it first")
        places = torch.rand(2, generator=generator, dtype=torch.float64).tolist()
        self.laws.start(*self.linear, places)
        self.start_as_stated()
