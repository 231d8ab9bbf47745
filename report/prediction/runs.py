"""Free runs of a model under many motions and scale factors, on all cores.

T samples, n outputs, E elements.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import islice, product
from typing import Any

import numpy as np
import torch
from torch import Tensor

from data.record import QUANTITIES, Drive, dof_numbers
from data.sample import OUTPUTS
from models.composition.many_runs import TOGETHER
from models.estimator import Estimator
from models.fit.metrics import LEFT
from models.fit.trained_range import names_of, outside, shares_of, spectrum_of
from models.stored.schema import SPECTRUM
from models.uncertainty.conformal import Band
from models.uncertainty.drifts import storeys_of
from report.prediction.interface import FORCES, GROUND, IMPOSED, SUPPORTS, Interface
from report.prediction.motions import Motion


@dataclass(frozen=True)
class Signal:
    """Columns (T, c) of one quantity. kind: as in the trained range; symbol: of column names.

    half: half widths (T, c) of the 95 % band, where there is one.
    """

    kind: str
    symbol: str
    unit: str
    names: Sequence[str]
    values: np.ndarray
    half: np.ndarray | None = None


@dataclass(frozen=True)
class Prediction:
    """The free run of a motion at a scale; `left` [s]: when it diverged."""

    name: str
    scale: float
    dt: float
    hold: str
    signals: Sequence[Signal]
    outside: Sequence[Mapping[str, Any]]  # where it leaves the trained range
    left: float | None
    judged: bool = True  # the trained range is known
    storeys: Sequence[Mapping[str, Any]] = ()  # rows of `storeys_of`
    row: Mapping[str, Any] | None = None  # of the table of many runs, whose histories are gone
    integrated: bool = False  # positions and velocities are integrals of the accelerations

    def slim(self) -> Prediction:
        """The same with the largest sizes in place of histories: rows (1, c)."""
        signals = [
            replace(s, values=np.abs(s.values).max(axis=0)[None], half=None) for s in self.signals
        ]
        return replace(self, signals=signals)

    def signal(self, kind: str) -> Signal | None:
        return next((signal for signal in self.signals if signal.kind == kind), None)


@dataclass(frozen=True)
class Runner:
    """A model, what drives it, and the range that it was trained in."""

    estimator: Estimator
    interface: Interface
    quantity: str
    trained: Mapping[str, Any]
    hold: str = "linear"
    lag: float = 0.0
    band: Band | None = None  # of the free run
    numbers: Sequence[int] = ()  # of the DOFs that the outputs are of; (): 1 … n
    storeys: bool = False  # their responses, which takes as many runs as laws are likely
    # of the excitation of each motion at scale 1, by its id
    spectra: dict[int, tuple[Motion, dict[str, Any]]] = field(default_factory=dict)

    def many(
        self,
        motions: Sequence[Motion],
        scales: Sequence[float],
        cores: int,
        models: Iterable[Estimator] = (),
    ) -> Iterator[Prediction]:
        """The run of every motion at every scale, in this order, each as soon as it is there.

        models: one after the other, in place of the runner's own.
        """
        runners = [replace(self, estimator=model, storeys=False) for model in models] or [self]
        jobs = product(runners, motions, scales)

        def run(job: tuple[Runner, Motion, float]) -> Prediction:
            return job[0](*job[1:])

        yield run(next(jobs))  # what is compiled, is compiled once
        if cores == 1:
            yield from map(run, jobs)
            return
        with ThreadPoolExecutor(cores) as pool:  # some at a time: histories are large
            while some := list(islice(jobs, TOGETHER * cores)):
                yield from pool.map(run, some)

    @torch.no_grad()
    def __call__(self, motion: Motion, scale: float) -> Prediction:
        u = self.interface.excitation(motion.name, motion.dt, motion.channels, scale, self.lag)
        rest = torch.zeros(self.estimator.dofs, dtype=torch.float64)
        drive = Drive(motion.dt, u, rest, rest, self.hold)
        response, loops = self.estimator.run_with_loops(drive)
        x, v, a = (s.numpy() for s in (response.x, response.v, response.a))
        signals = [*self._driving(motion, scale), *self._motion(x, v, a, motion, scale)]
        if loops is not None:
            signals += self._loops(*(s.numpy() for s in loops))
        left = self._divergence_time(a, u, motion.dt)
        found = []
        if left is None:
            ranged = self._range(u, a, signals, motion.dt) | self._spectrum(motion, scale, a)
            found = outside(self.trained, ranged)
        storeys = self._storeys(motion, scale, drive) if left is None and self.storeys else []
        return Prediction(
            motion.name, scale, motion.dt, self.hold, signals, found, left, bool(self.trained),
            storeys, integrated=response.integrated,
        )  # fmt: skip

    def _storeys(self, motion: Motion, scale: float, drive: Drive) -> list[dict[str, Any]]:
        moving = GROUND in motion.channels and self.interface.kind == FORCES
        carried = scale * motion.channels[GROUND] if moving else 0.0
        name = motion.name if scale == 1.0 else f"{motion.name} × {scale:g}"
        return [{"record": name, **row} for row in storeys_of(self.estimator, drive, carried)]

    def _driving(self, motion: Motion, scale: float) -> list[Signal]:
        """What drives the model, as it was given."""
        signals = []
        for name, u in motion.channels.items():
            symbol = name.rstrip("0123456789")
            unit = {"f": "N", "s": "m", "s_dot": "m/s", "s_ddot": "m/s^2"}.get(symbol, "")
            size = 1.0 if name in self.interface.others else scale
            number = [name.removeprefix(symbol)]
            signals.append(Signal("input", symbol, unit, number, size * u[:, None]))
        return signals

    def _motion(
        self, x: np.ndarray, v: np.ndarray, a: np.ndarray, motion: Motion, scale: float
    ) -> list[Signal]:
        """Outputs; where the ground moves, accelerations are absolute, as sensors have them."""
        numbers = [str(i) for i in dof_numbers(self.numbers, self.estimator.dofs)]
        unit = QUANTITIES[self.quantity][1].replace("m/s²", "m/s^2").replace("–", "")
        relative = GROUND in motion.channels and self.interface.kind != SUPPORTS
        half = None
        if self.band is not None and np.isfinite(a).all():
            half = self.band.half_widths(torch.from_numpy(a), motion.dt).numpy()
        if self.quantity == "acceleration" and relative:
            a = a + scale * motion.channels[GROUND][:, None]
        found = [Signal(self.quantity, OUTPUTS.get(self.quantity, "y"), unit, numbers, a, half)]
        if self.interface.kind == IMPOSED:
            return found
        states = [("velocity", "v", "m/s", v), ("displacement", "x", "m", x)]
        for kind, symbol, unit, values in states:
            if kind != self.quantity and values.any():  # nil throughout: the model has none
                found.insert(0, Signal(kind, symbol, unit, numbers, values))
        return found

    def _loops(self, y: np.ndarray, r: np.ndarray) -> list[Signal]:
        numbers = [str(e + 1) for e in range(y.shape[1])]
        return [Signal("deformation", "y", "m", numbers, y), Signal("loop", "r", "N", numbers, r)]

    def _range(
        self, u: Tensor, a: np.ndarray, signals: Sequence[Signal], dt: float
    ) -> dict[str, Any]:
        """The largest of all that is compared with training, as `trained_range` has it."""
        others = len(self.interface.others)
        found = {self.quantity: a}
        loops = any(s.kind == "deformation" for s in signals)
        if not (loops and self.interface.kind == SUPPORTS):  # elements know no motion in common
            found["excitation"] = u.numpy()[:, : u.shape[1] - others]
            found |= {s.kind: s.values for s in signals if s.kind in ("displacement", "velocity")}
        for signal in (s for s in signals if s.kind == "deformation"):
            found |= {"deformation": signal.values}
            found["rate"] = np.gradient(signal.values, dt, axis=0)
        ranged = {
            kind: {**self.trained[kind], "largest": np.abs(values).max(axis=0).tolist()}
            for kind, values in found.items()
            if kind in self.trained and values.shape[1] == len(self.trained[kind]["largest"])
        }
        if others and "other input" in self.trained:
            values = u.numpy()[:, u.shape[1] - others :]
            ends = {"lowest": values.min(axis=0).tolist(), "largest": values.max(axis=0).tolist()}
            ranged["other input"] = {**self.trained["other input"], **ends}
        return ranged

    def _spectrum(self, motion: Motion, scale: float, a: np.ndarray) -> dict[str, Any]:
        """That of the excitation is proportional to the scale: it is calculated once a motion."""
        if SPECTRUM not in self.trained:
            return {}
        if id(motion) not in self.spectra:
            u = self.interface.excitation(motion.name, motion.dt, motion.channels, 1.0, self.lag)
            driving = u.numpy()[:, : u.shape[1] - len(self.interface.others)]
            self.spectra[id(motion)] = motion, spectrum_of([(driving, a)], motion.dt)
        one = self.spectra[id(motion)][1]
        largest = abs(scale) * np.array(one["largest"])
        if largest.shape[-1] != len(self.trained[SPECTRUM]["names"]):
            return {}
        power = shares_of([a], motion.dt, np.array(one["periods"]))
        return {SPECTRUM: {**one, "largest": largest, "power": power}}

    def _divergence_time(self, a: np.ndarray, u: Tensor, dt: float) -> float | None:
        """When the outputs were no numbers, or went far beyond what training and drive explain."""
        known = self.trained.get(self.quantity, {}).get("largest")
        gone = ~np.isfinite(a)
        if known:
            before = self.trained.get("excitation", {}).get("largest") or [0.0]
            more = float(u.abs().max()) / max(max(before), 1e-300)
            gone |= np.abs(a) > LEFT * max(known) * max(1.0, more if math.isfinite(more) else 1.0)
        first = np.flatnonzero(gone.any(axis=1))
        return dt * int(first[0]) if len(first) else None


def parts_of(signal: Signal, estimator: Estimator) -> list[str]:
    """What each column of a signal is of: x1, a DOF; r2 x1–x2, an element; s1, an input."""
    if signal.kind == "input":
        return [f"{signal.symbol}{number}" for number in signal.names]
    if signal.kind not in ("deformation", "loop", "force"):
        return [f"x{number}" for number in signal.names]
    pairs = names_of(estimator) if signal.kind != "force" else []
    labels = [f"r{number}" for number in signal.names]
    return [f"{n} {p}" for n, p in zip(labels, pairs, strict=True)] if pairs else labels
