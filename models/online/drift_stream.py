"""Drifts of all storeys of a structure some of whose floors have a sensor, as a stream.

    stream = model.stream()
    for sample in samples:
        stream.step(sample)
        now, half, largest, its_half = stream.drifts

Bad samples are mended, held and named as in any `Stream` (models/online/guard.py).
"""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
import torch
from torch import Tensor

from data.memory import require_memory
from data.record import Record
from data.sample import Sample, samples_of
from data.simulation.laws.element import MEMORY
from models.composition.coefficients import ACCELERATION
from models.online.drift_filter import DriftFilter, DriftSmoother
from models.online.guard import Guard
from models.online.laws.frozen import Frozen
from models.online.stream import Stream
from models.uncertainty.laplace import NORMAL


class DriftStream(Stream):
    """A `DriftFilter` that begins at the posterior of an identified ElementNetworkNamed.

    about: coefficients of the likely laws, as for `filter_of`. Raises ValueError where no laws were
    drawn that are as likely, and for a fit to displacements.
    """

    def __init__(
        self,
        estimator: Any,
        guard: Guard | None = None,
        kind: type[DriftFilter] = DriftFilter,
        about: np.ndarray | None = None,
    ) -> None:
        self._begin(estimator, Frozen(), [], guard)
        self.kind, self.about = kind, about
        self._restart.due = math.inf  # it falls back to the fit instead
        inputs = estimator.composition().inputs.value.detach().cpu()
        mass = estimator.mass().detach().cpu()[:, None]
        self._by_inputs = inputs if estimator.base else mass * inputs  # (n, ·)
        nothing = Sample(f=torch.zeros(estimator.inputs, dtype=torch.float64))
        self._rest()
        for _ in range(2):  # compiles
            self._learn(nothing, self._estimate(nothing), sound=True)
        self._rest()

    def _rest(self) -> None:
        """Restart the filter at rest; the largest drifts so far remain."""
        before = getattr(self, "filter", None)
        self.filter = filter_of(self.estimator, self.watch.guard, self.kind, self.about)
        if before is not None:
            self.filter.peaks = before.peaks

    def _estimate(self, sample: Sample) -> Tensor:
        """Excitation that did not come, or came wrong, is held: it is guessed."""
        u, bad = sample.excitation, {channel[0] for _, channel in self.watch.bad}
        guessed = sample is self.previous or bool(bad & {"f", "s"})
        force = (self._by_inputs @ u).numpy()
        if self.estimator.base:  # which pulls at the masses of the laws that the filter is about
            force = force * self.filter.fit.masses
        s, s_dot = u[self.estimator.forces :].numpy().reshape(2, -1)
        return torch.from_numpy(self.filter.predict(force, s, s_dot, guessed))

    def _learn(self, sample: Sample, a: Tensor, sound: bool) -> None:
        before = self.filter.diverged
        others = None if sample.o is None or not len(self.filter.others) else sample.o.numpy()
        self.filter.correct(a.numpy() if sound else None, others)
        if self.filter.diverged and not before:
            self.watch.diverge()

    def snapshot(self) -> dict[str, Any]:
        return super().snapshot() | {"filter": copy.deepcopy(self.filter)}

    def restore(self, snapshot: dict[str, Any]) -> None:
        super().restore(snapshot)
        self.filter = snapshot["filter"]

    @property
    def weights(self) -> list[Tensor]:
        """c (N,) of the likely laws."""
        return [torch.from_numpy(self.filter.c.copy())]

    @property
    def numbers(self) -> dict[str, float]:
        rows = zip(("drift", "half"), self.filter.drifts.tolist(), strict=True)
        named = {f"{name}{e}": u for name, row in rows for e, u in enumerate(row, start=1)}
        own = self.filter
        watch = 2.0 if own.diverged else float(own.is_rare)  # of the fit alone; unlikely; as usual
        return {**named, "innovations": math.sqrt(own.ratio), "watch": watch}

    @property
    def noise(self) -> np.ndarray:
        return np.asarray(self.estimator.noise_of_sensors, dtype=float)

    @property
    def drifts(self) -> np.ndarray:
        return np.concatenate([self.filter.drifts, self.filter.peaks[:2]])


def smoothed(estimator: Any, record: Record) -> np.ndarray | None:
    """Drifts of storeys and halves of their intervals (2, T, E) [m], by all samples of a record.

    Twice: the second time about the laws that the first found, where runs are less far from
    linear. How far they still are widens the intervals (`nonlinearity`). None where the sensors
    contradict the model. Raises ValueError as `DriftStream`, and for a record that is too long to
    be remembered.
    """
    from models.named_laws.free_run import blend  # slow to import

    fit, (others, _) = estimator.found_laws(), estimator.about()
    found, about = None, np.zeros(len(others))
    for _ in range(2):
        stream = DriftStream(estimator, kind=DriftSmoother, about=about)
        own, storeys = stream.filter, len(estimator.elements)
        assert isinstance(own, DriftSmoother)
        rows = len(own.A) + 2 * storeys
        need = 8.0 * record.samples * rows * (len(own.s) + MEMORY * storeys)
        require_memory(need, f"smoothed drifts of {record.samples:,} samples", "cut it (data.stop)")
        for sample in samples_of(record):
            stream.step(sample)
        if own.diverged:
            return found
        about = about + own.c
        drifts, half = own.smoothed()
        nonlinearity = own.nonlinearity(blend(fit, others, about).structure())
        found = np.stack([drifts, np.hypot(half, NORMAL * np.sqrt(own.wide * nonlinearity))])
    return found


def filter_of(
    estimator: Any,
    guard: Guard,
    kind: type[DriftFilter] = DriftFilter,
    about: np.ndarray | None = None,
) -> DriftFilter:
    """The filter of an identified ElementNetworkNamed before its first sample.

    about (N,): weights of the laws about the fit; it begins at their sum in place of the fit, with
    the same uncertainty.
    """
    fit, (others, variance) = estimator.found_laws(), estimator.about()
    if not others or not bool(estimator.noise_of_sensors.any()):
        lacking = "the noise of its sensors" if others else "laws that are as likely as its own"
        raise ValueError(
            f"the model lacks {lacking}, from which a filter of drifts begins: identify it again, "
            "as a chain some of whose floors have no sensor, or with model.heights"
        )
    if bool((estimator.measures != ACCELERATION).any()):
        raise ValueError(
            "the model was identified by displacements, and drifts are followed by accelerations: "
            "give it accelerometers (a1, …), with displacements beside them"
        )
    laws = [fit, *others]
    if about is not None:
        from models.named_laws.free_run import blend  # slow to import

        laws = [blend(fit, others, about + row) for row in np.eye(len(about) + 1, len(about), -1)]
    structures = [one.structure() for one in laws]
    parts = [name.partition("_")[0] for name in structures[0].elements]
    found = kind(
        structures,
        [parts.index(f"r{e + 1}") for e in range(len(estimator.elements))],
        [number - 1 for number in estimator.sensors],
        estimator.noise_of_sensors.cpu().numpy(),
        float(estimator.noise_of_ground),
        estimator.dt,
        math.inf if guard.outlier is None else guard.outlier,
        estimator.of_others,
        variance,
    )
    if about is not None:
        found.s[len(found.s) - len(about) :] = -about
    return found
