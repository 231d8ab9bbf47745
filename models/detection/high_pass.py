"""The same high-pass filter on all signals, so that slow drifts do not count as changes.

A linear structure obeys the same equation of motion in signals that are all filtered alike:
F(M ẍ + C ẋ + K x) = F f (Young 1981). Without the slow part, where hysteretic elements creep, the
weights of an equivalent linear system are far steadier. Causal: nothing is known of the future.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

import numpy as np
import torch
from torch import Tensor

from data.annotations import Positive, Range
from data.checked import checked
from data.record import Record
from data.sample import INPUTS, Sample
from data.simulation.scenario import HIGHEST_ORDER


@checked
class HighPass:
    """Butterworth filter of `order`, cutoff [Hz], for signals sampled every `dt` [s].

    Raises ValueError for a cutoff that is not between 0 and the Nyquist frequency.
    """

    def __init__(
        self, cutoff: float, dt: Positive, order: Annotated[int, Range(1, HIGHEST_ORDER)] = 2
    ) -> None:
        from scipy.signal import butter  # slow to import

        if not 0.0 < cutoff < 0.5 / dt:
            raise ValueError(
                f"cutoff={cutoff} Hz must lie between 0 and the Nyquist frequency {0.5 / dt:g} Hz; "
                "lower it or data.dt"
            )
        self.sos = butter(order, cutoff, "highpass", fs=1.0 / dt, output="sos")
        self.states: dict[str, np.ndarray] = {}

    def record(self, record: Record) -> Record:
        """A record, from rest, filtered as it was measured: what is true is left out."""
        return record.measured().map(self._from_rest)

    def sample(self, sample: Sample) -> Sample:
        """The next sample, going on from those before. Missing signals stay missing."""
        named = {name: getattr(sample, name) for name in ("a", *INPUTS)}
        signals = {name: u for name, u in named.items() if u is not None}
        filtered: dict[str, Any] = {name: self._next(name, u) for name, u in signals.items()}
        return replace(sample, **filtered)

    def _from_rest(self, signal: Tensor) -> Tensor:
        from scipy.signal import sosfilt  # slow to import

        filtered = sosfilt(self.sos, signal.numpy(), axis=-2)
        return torch.from_numpy(np.ascontiguousarray(filtered))

    def _next(self, name: str, signal: Tensor) -> Tensor:
        from scipy.signal import sosfilt  # slow to import

        if name not in self.states:
            self.states[name] = np.zeros((len(self.sos), 2, signal.numel()))
        filtered, self.states[name] = sosfilt(
            self.sos, signal.numpy()[None, :], axis=0, zi=self.states[name]
        )
        return torch.from_numpy(filtered[0])
