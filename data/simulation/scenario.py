"""What the sensors saw: a scenario turns a simulated record into a measured one.

Brewick & Masri (2016): full state (Sect. 3.2), integrated (Sect. 4.1), noisy (Sect. 4.2). The true
motion stays in `record.truth`, for scoring only.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
import torch

from data.annotations import NotNegative, Positive, Range
from data.checked import checked
from data.record import Record

HIGHEST_ORDER = 20  # of a Butterworth filter that rounding leaves as it should be


class Scenario(ABC):
    """A change of what is measured, with its own generator."""

    @abstractmethod
    def __call__(self, record: Record, rng: np.random.Generator) -> Record: ...


@checked
@dataclass(frozen=True)
class FullState(Scenario):
    """x, v, a and f as they are."""

    def __call__(self, record: Record, rng: np.random.Generator) -> Record:
        return record


@checked
@dataclass(frozen=True)
class Noisy(Scenario):
    """White Gaussian noise; its standard deviation is `level` times that of each channel."""

    level: NotNegative = 0.10
    signals: Sequence[Literal["x", "v", "a", "f"]] = ("x", "v", "a")

    def __call__(self, record: Record, rng: np.random.Generator) -> Record:
        noisy: dict[str, Any] = {}
        for name in self.signals:
            signal = getattr(record, name)
            if signal is None:
                raise ValueError(f"scenario.signals holds {name!r}, which the record lacks")
            noise = torch.from_numpy(rng.standard_normal(signal.shape))
            noisy[name] = signal + self.level * signal.std(dim=-2, keepdim=True) * noise
        if "f" in noisy and record.truth is not None:
            noisy["truth"] = replace(record.truth, f=record.truly_driven().f)
        return replace(record, **noisy)


@checked
@dataclass(frozen=True)
class Integrated(Scenario):
    """v and x by integrating the measured a, high-pass filtered before and after each step.

    Strictly causal by default: v[k] = v[k−1] + dt (3a[k−1] − a[k−2])/2 and x[k] by the trapezoid of
    v, with causal Butterworth filters, so that no value at k depends on a[k], which the estimators
    must not see. `causal=False` integrates a by the trapezoid and filters forward and backward, as
    is usual off line; v[k] and x[k] then depend on a[k] and on what follows.
    """

    cutoff: Positive = 0.02  # of the high-pass filters [Hz]
    order: Annotated[int, Range(1, HIGHEST_ORDER)] = 1
    causal: bool = True

    def __call__(self, record: Record, rng: np.random.Generator) -> Record:
        if record.quantity != "acceleration":
            raise ValueError(
                f"scenario=integrated integrates accelerations; the record holds "
                f"{record.quantity}: choose scenario=full_state"
            )
        a, dt = record.a.numpy(), record.dt
        filtered = self._high_pass(a, dt)
        if self.causal:
            before = np.concatenate([np.zeros_like(a[:2]), filtered])  # a[k−2], a[k−1]
            v = dt * np.cumsum(1.5 * before[1:-1] - 0.5 * before[:-2], axis=0)
        else:
            v = _trapezoid(filtered, dt)
        v = self._high_pass(v, dt)
        x = self._high_pass(_trapezoid(self._high_pass(v, dt), dt), dt)
        return replace(record, x=torch.from_numpy(x), v=torch.from_numpy(v))

    def _high_pass(self, signal: np.ndarray, dt: float) -> np.ndarray:
        from scipy.signal import butter, sosfilt  # slow to import, seldom needed

        nyquist = 0.5 / dt
        if not 0.0 < self.cutoff < nyquist:
            raise ValueError(
                f"scenario.cutoff={self.cutoff} Hz must lie between 0 and the Nyquist frequency "
                f"{nyquist:g} Hz; lower it or data.dt"
            )
        sos = butter(self.order, self.cutoff, "highpass", fs=1.0 / dt, output="sos")
        filtered = sosfilt(sos, signal, axis=0)
        if not self.causal:  # from rest both ways: padded ends would be integrated into a drift
            filtered = sosfilt(sos, filtered[::-1], axis=0)[::-1]
        return np.ascontiguousarray(filtered)


def _trapezoid(rate: np.ndarray, dt: float) -> np.ndarray:
    steps = 0.5 * dt * (rate[1:] + rate[:-1])
    return np.concatenate([np.zeros_like(rate[:1]), np.cumsum(steps, axis=0)])


@checked
class Composed(Scenario):
    """Scenarios one after the other, as `steps` lists them."""

    def __init__(self, steps: Sequence[Scenario]) -> None:
        self.steps = list(steps)

    def __call__(self, record: Record, rng: np.random.Generator) -> Record:
        for step in self.steps:
            record = step(record, rng)
        return record
