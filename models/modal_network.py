"""Modal network: hidden modes and nonlinear elements behind any outputs, from any inputs.

q̈ + c q̇ + k q = Γ (u + u₀) − G r(D q, D q̇, z),   o = C_q q + C_v q̇ + D_u u + D_r r + o₀

J modes, as many as the records tell, E elements along learned directions. Outputs may be volts or
accelerations, and fewer than the modes. Each estimate is a free run: compiled, modes by their exact
exponentials (models/modal/run_compiled.py). All is identified in `identify`, by spectra, least
squares and Levenberg–Marquardt on exact derivatives (models/modal/fit.py); no solver is needed.
T samples, m inputs, n outputs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import torch
from torch import Tensor, nn

from data.annotations import MOST, Count, Range
from data.record import Drive, Record, Response, singles
from models.estimator import Estimator, Parameter, simulate
from models.fit.held_back import HELD_BACK, end_of_share
from models.modal.excitation import Excited, interpolated, period_of, steady_mean
from models.modal.fit import ORDERS, Plan, fit_modal, learned
from models.modal.layout import FAMILIES, Layout
from models.modal.linear_start import first_state
from models.modal.problem import Motion
from models.modal.run import outputs, steady_state
from models.physical.parameters import modal

LIKELY = 5.0  # mean square of the errors of warm-up samples, in units of those in training
LAWS = ("cubic", "smooth", "hysteretic", "all")
THROUGH = ("acceleration", "force", "output")  # quantities that may jump with a force


class ModalNetwork(Estimator):
    """Outputs (…, T, n) of hidden modes with nonlinear elements; every estimate is a free run.

    modes: their number, up to 40, whose poles are found in seconds; None: as many as lower the
    error on held-back motion. elements: at most.
    laws: of which those that lower it are taken (models/modal/layout.py has them by name).
    substeps: of a sample interval; None: by the fastest mode. iterations: of the last fit.
    directions, draws: that are tried for an element. Modes and laws are chosen on the last part of
    each record's motion, by power.

    A record of unknown beginning tells its first state by its warm-up samples; of those that are
    trained on, all samples tell.
    """

    reads = ("f",)
    on_processor = True

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        modes: Annotated[int, Range(1, 40)] | None = None,
        elements: Annotated[int, Range(0, MOST)] = 2,
        laws: Sequence[str] = LAWS,
        substeps: Annotated[int, Range(1, 100)] | None = None,
        iterations: Count = 60,
        directions: Count = 30,
        draws: Count = 3,
        seed: int = 0,
    ) -> None:
        super().__init__(dofs, inputs, dt)
        if not laws or not set(laws) <= set(FAMILIES):
            raise ValueError(f"model.laws={list(laws)}: choose some of {', '.join(FAMILIES)}")
        self.substeps = substeps
        self.plan = Plan(
            orders=ORDERS if modes is None else [modes], elements=elements, families=tuple(laws),
            directions=directions, draws=draws, iterations=iterations, seed=seed,
        )  # fmt: skip
        most = Layout(modes or max(ORDERS), elements, inputs, dofs)
        empty = torch.full((most.size,), torch.nan, dtype=torch.float64)
        self.theta = nn.Parameter(empty, requires_grad=False)  # the first of them are used
        self.register_buffer("counts", torch.zeros(4, dtype=torch.int64))
        self.register_buffer("scales", torch.ones(inputs + 2 * dofs + 1, dtype=torch.float64))
        self.register_buffer("deviation", torch.zeros(most.states, dtype=torch.float64))
        self.register_buffer("missed", torch.ones(dofs, dtype=torch.float64))

    counts: Tensor  # modes, elements, substeps, learned parameters
    scales: Tensor  # of inputs (m,), outputs (n,), means of outputs (n,), time
    deviation: Tensor  # RMS of the states, in units of the model
    missed: Tensor  # RMS error (n,) of the training motion, in units of the outputs

    @property
    def layout(self) -> Layout:
        J, E, _, _ = self.counts.tolist()
        return Layout(J, E, self.inputs, self.dofs)

    @property
    def scale(self) -> Scale:
        places = np.cumsum([self.inputs, self.dofs, self.dofs])
        u, y, mean, time = np.split(self.scales.cpu().numpy(), places)
        return Scale(u, y, mean, float(time[0]))

    @property
    def identified_parameters(self) -> int:
        return int(self.counts[3])

    @property
    def values(self) -> np.ndarray:
        """All parameters (size,), in units of the model."""
        self.require_identified(self.theta[:1])
        return self.theta[: self.layout.size].detach().cpu().numpy()

    def identify(self, batches: Iterable[Record]) -> dict[str, Any]:
        """Identify all parameters; what was chosen, and its errors on held-back motion."""
        records = list(batches)
        if self.inputs == 0:
            raise ValueError(
                "nothing drives the records, and a modal network is identified from "
                "excitation; give a force or a motion of the base, or choose another model"
            )
        signals = [Signals.of(one.to("cpu")) for one in singles(records)]
        scale = Scale.of(signals)
        substeps = self.substeps or self._substeps(scale)
        motions = [scale.motion(one, substeps, HELD_BACK) for one in signals]
        plan = replace(self.plan, through=records[0].quantity in THROUGH)
        fit, facts = fit_modal(motions, plan)
        layout = fit.layout
        count = int(learned(fit, plan).sum())
        self.counts.copy_(torch.tensor([layout.modes, layout.elements, substeps, count]))
        self.theta.data.fill_(0.0)
        self.theta.data[: layout.size] = torch.from_numpy(fit.state.values)
        self.scales.copy_(torch.from_numpy(np.r_[scale.u, scale.y, scale.mean, scale.time]))
        self._note_deviations(fit.layout, fit.state.values, fit.state.begins, motions)
        return {**facts, "substeps": substeps, "between_samples": records[0].hold}

    def _substeps(self, scale: Scale) -> int:
        """So many that typical motion is followed closely within a sample interval."""
        return int(np.clip(np.ceil(self.dt / scale.time / FINEST), 1, MOST_SUBSTEPS))

    def _note_deviations(
        self, layout: Layout, values: np.ndarray, begins: np.ndarray, motions: Sequence[Motion]
    ) -> None:
        squares, errors, samples = np.zeros(layout.states), np.zeros(self.dofs), 0
        for motion, begin in zip(motions, begins, strict=True):
            out, states = outputs(layout, values, motion.excited, begin)
            out, states = motion.of(out), motion.of(states)
            squares[: 2 * layout.modes] += (states[:, : 2 * layout.modes] ** 2).sum(axis=0)
            squares[2 * layout.modes :] += np.repeat(
                (states[:, 2 * layout.modes : 2 * layout.modes + layout.elements] ** 2).sum(axis=0),
                layout.units,
            )
            errors, samples = errors + ((out - motion.y) ** 2).sum(axis=0), samples + len(out)
        self.deviation.zero_()
        self.deviation[: layout.states] = torch.from_numpy(np.sqrt(squares / samples))
        self.missed.copy_(torch.from_numpy(np.sqrt(errors / samples).clip(1e-9)))

    def _physical_parameters(self) -> Iterable[Parameter]:
        parts, time = self.layout.split(self.values), self.scale.time
        for i, (k, c) in enumerate(zip(parts["log_k"], parts["log_c"], strict=True), start=1):
            square, rate = float(torch.tensor(k).exp()), float(torch.tensor(c).exp())
            yield from modal(f"mode_{i}", square / time**2, rate / time, "without the elements")

    def forward(self, record: Record) -> Tensor:
        """Outputs (…, T, n) of the free run of a record or a batch."""
        return simulate(self, record).a

    def free_run(self, drive: Drive) -> Response:
        """Outputs as `a` of the response; x and v are unknown of hidden modes, and nil."""
        return self._response(drive, None)

    def run_of(self, record: Record) -> Response:
        """The free run of a record. An unknown beginning is estimated from the warm-up samples."""
        known = record.initial_state in ("rest", "periodic") or not record.warmup
        if known:
            return self._response(record.drive(), None)
        return self._response(replace(record, initial_state="rest").drive(), record)

    def _response(self, drive: Drive, record: Record | None) -> Response:
        values, layout, scale = self.values, self.layout, self.scale
        lead, T = drive.u.shape[:-2], drive.u.shape[-2]
        runs = []
        inputs = drive.u.reshape(-1, T, self.inputs).cpu().numpy()
        seen = None if record is None else record.a.reshape(-1, T, self.dofs).cpu().numpy()
        for i, u in enumerate(inputs):
            y = np.zeros((T, self.dofs)) if seen is None else seen[i]
            one = Signals(u, y, drive.dt, drive.hold, seen is not None)
            begin = np.zeros(layout.states)
            if seen is None or record is None:
                excited = scale.excited(one, int(self.counts[2]))
            else:
                motion = scale.motion(one, int(self.counts[2]))
                excited, begin = motion.excited, self._first_state(motion, record.warmup)
            with np.errstate(all="ignore"):
                out, _ = outputs(layout, values, excited, begin)
            runs.append(scale.mean + scale.y * out)
        a = torch.from_numpy(np.stack(runs)).to(drive.u.device).reshape(*lead, T, self.dofs)
        return Response(torch.zeros_like(a), torch.zeros_like(a), a)

    def _first_state(self, motion: Motion, warmup: int) -> np.ndarray:
        """From the first `warmup` samples alone, the excitation, and what training has seen.

        At rest, or in the steady state of an excitation that repeats itself, where those samples
        do not contradict it; else what suits them, and the size that states had in training.
        """
        layout, values = self.layout, self.values
        seen = replace(motion, stop=warmup, weight=1.0 / self.missed.cpu().numpy())
        usual: list[tuple[float, np.ndarray]] = []
        for begin in self._usual_beginnings(motion.excited):
            out, _ = outputs(layout, values, motion.excited.first(warmup), begin)
            usual.append((float(((seen.weight * (out - motion.y[:warmup])) ** 2).mean()), begin))
        error, begin = min(usual, key=lambda one: one[0])
        if error < LIKELY:
            return begin
        return first_state(layout, values, seen, self.deviation[: layout.states].cpu().numpy())

    def _usual_beginnings(self, excited: Excited) -> Iterator[np.ndarray]:
        """At rest; in the steady state, where the excitation repeats itself."""
        layout = self.layout
        yield np.zeros(layout.states)
        period = period_of(excited.u)
        if period is not None:
            yield steady_state(layout, self.values, excited, period)


# Records in units of a modal network: RMS of inputs and outputs, time by a typical frequency.
#
# A change of the records' units therefore changes nothing.   T samples, m inputs, o outputs.

FAINT = 0.1  # of the outputs' RMS: a record with less weighs no more for it
STOPS = (0.5, 0.95)  # of a record: what is held back begins between these
FINEST = 0.25  # of a radian of the fastest mode, in a substep
MOST_SUBSTEPS = 8


@dataclass(frozen=True)
class Signals:
    """One time history: u (T, m), y (T, o), how it begins, whether it is one period."""

    u: np.ndarray
    y: np.ndarray
    dt: float
    hold: str
    unknown: bool
    periodic: bool = False

    @staticmethod
    def of(record: Record) -> Signals:
        """Those of a record; of one that repeats itself, the mean of its periods."""
        u, y, begins = record.excitation.numpy(), record.a.numpy(), record.initial_state
        one = Signals(u, y, record.dt, record.hold, begins != "rest", begins == "periodic")
        return one.averaged()

    def averaged(self) -> Signals:
        """The mean of the periods after the first, where there are some."""
        period = None if self.periodic else period_of(self.u)
        if period is None or len(self.u) // period < 2:
            return self
        mean = steady_mean(self.u, self.y, period)
        if mean is None:
            return self
        return replace(self, u=mean[0], y=mean[1], unknown=True, periodic=True)


@dataclass(frozen=True)
class Scale:
    """Units of a model: of inputs (m,), of outputs (o,) and their means, of time [s]."""

    u: np.ndarray
    y: np.ndarray
    mean: np.ndarray
    time: float

    @staticmethod
    def of(signals: Sequence[Signals]) -> Scale:
        """RMS of the inputs, and of the outputs about their means; frequencies by power."""
        u = np.concatenate([one.u for one in signals])
        y = np.concatenate([one.y for one in signals])
        mean = y.mean(axis=0)
        size = [np.sqrt((s * s).mean(axis=0)) for s in (u, y - mean)]
        size = [np.where(s > 0.0, s, 1.0) for s in size]
        squares, power = 0.0, 0.0
        for one in signals:
            omega = 2.0 * np.pi * np.fft.rfftfreq(len(one.y), one.dt)
            lines = (np.abs(np.fft.rfft((one.y - mean) / size[1], axis=0)) ** 2).sum(axis=1)[1:]
            squares, power = squares + float(omega[1:] ** 2 @ lines), power + float(lines.sum())
        typical = np.sqrt(squares / power) if squares > 0.0 else 1.0 / signals[0].dt
        return Scale(size[0], size[1], mean, 1.0 / float(typical))

    def excited(self, one: Signals, substeps: int) -> Excited:
        u = one.u / self.u
        if one.periodic:
            u = np.concatenate([u] * 2)
        fine = interpolated(u, one.hold, substeps, one.periodic)
        return Excited(np.ascontiguousarray(u), fine, one.dt / self.time)

    def motion(self, one: Signals, substeps: int, held_back: float = 0.0) -> Motion:
        y = (one.y - self.mean) / self.y
        rms = np.sqrt((y * y).mean(axis=0))
        stop = len(y)
        if held_back:  # by power: a quiet tail shows but one mode
            place = end_of_share(torch.from_numpy(y * y).sum(dim=1)[None], 1.0 - held_back)
            first, last = (int(share * len(y)) for share in STOPS)
            stop = max(2, min(max(place, first), last))
        weight = 1.0 / np.sqrt(rms**2 + FAINT**2)
        excited, first = self.excited(one, substeps), len(y) if one.periodic else 0
        return Motion(excited, y, weight, one.unknown and not one.periodic, stop, first)
