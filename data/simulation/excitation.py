"""Forces and support motions, drawn from an explicit generator: the same seed gives the same bits.

A waveform gives its values and their rates at T samples for c channels, both (T, c). Random ones
are sums of sinusoids with periods T_record/k, so their rates are exact, and the same seed gives the
same process at any time step.  Brewick & Masri (2016), Sect. 3.2.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data.annotations import NotNegative
from data.checked import checked
from data.record import require_bearable
from data.simulation.structure import Structure

Signal = tuple[np.ndarray, np.ndarray]  # values (T, c) and their rates (T, c)


class Waveform(ABC):
    """Values [N or m] and rates [N/s or m/s] of one record."""

    @abstractmethod
    def draw(
        self, samples: int, dt: float, channels: int, record: int, rng: np.random.Generator
    ) -> Signal:
        """One record: `record` is its number among all, training before testing."""

    def check(self, train_records: int) -> None:  # noqa: B027 - most have nothing to say
        """Raise ValueError where this number of training records would test what was trained on."""

    def check_samples(self, samples: int, dt: float) -> None:  # noqa: B027 - as above
        """Raise ValueError where a record of so many samples cannot be drawn."""


def _harmonics(band: Sequence[float], samples: int, dt: float) -> np.ndarray:
    """Numbers of the harmonics of the record that lie in the band [Hz], below Nyquist's."""
    low, high = band
    duration, nyquist = samples * dt, 0.5 / dt
    if high > nyquist:
        raise ValueError(
            f"band={list(band)} Hz reaches above the Nyquist frequency {nyquist:g} Hz; "
            "lower its upper end or data.dt"
        )
    first, last = max(1, np.ceil(low * duration - 1e-9)), np.floor(high * duration + 1e-9)
    harmonics = np.arange(first, min(last, (samples - 1) // 2) + 1, dtype=int)
    if harmonics.size == 0:
        raise ValueError(
            f"band={list(band)} Hz holds no harmonic of a record of {duration:g} s; "
            "widen it or lengthen data.duration"
        )
    return harmonics


def _sum_of_harmonics(
    harmonics: np.ndarray, cosine: np.ndarray, sine: np.ndarray, samples: int, dt: float
) -> Signal:
    """Σ cosine cos(ωt) + sine sin(ωt), ω = 2π harmonic/(samples dt), and its rate.

    harmonics (L,), amplitudes (L, c) → (T, c) each, by inverse FFT.
    """
    spectrum = np.zeros((samples // 2 + 1, cosine.shape[1]), dtype=complex)
    spectrum[harmonics] = 0.5 * samples * (cosine - 1j * sine)
    omega = 2.0 * np.pi / (samples * dt) * np.arange(len(spectrum))[:, None]
    value, rate = (np.fft.irfft(u, n=samples, axis=0) for u in (spectrum, 1j * omega * spectrum))
    return value, rate


@dataclass(frozen=True)
class _BandLimited(Waveform):
    """A sum of the harmonics of the record that lie in a band."""

    std: float  # root-mean-square value [N or m]
    band: Sequence[float] = (0.0, 3.0)  # [Hz]

    def __post_init__(self) -> None:
        _require_positive("std", self.std)
        _require_band(self.band)

    def check_samples(self, samples: int, dt: float) -> None:
        _harmonics(self.band, samples, dt)

    def draw(
        self, samples: int, dt: float, channels: int, record: int, rng: np.random.Generator
    ) -> Signal:
        harmonics = _harmonics(self.band, samples, dt)
        cosine, sine = self._amplitudes(harmonics.size, channels, rng)
        return _sum_of_harmonics(harmonics, cosine, sine, samples, dt)

    @abstractmethod
    def _amplitudes(self, count: int, channels: int, rng: np.random.Generator) -> Signal:
        """Of cosine and sine (L, c) each."""


@checked
@dataclass(frozen=True)
class BandLimitedGaussian(_BandLimited):
    """Zero-mean stationary Gaussian process, flat in its band, independent between channels."""

    def _amplitudes(self, count: int, channels: int, rng: np.random.Generator) -> Signal:
        cosine, sine = self.std / np.sqrt(count) * rng.standard_normal((2, count, channels))
        return cosine, sine


@checked
@dataclass(frozen=True)
class Multisine(_BandLimited):
    """Harmonics of equal amplitude and random phase: a flat spectrum without chance in its size."""

    def _amplitudes(self, count: int, channels: int, rng: np.random.Generator) -> Signal:
        amplitude = self.std * np.sqrt(2.0 / count)
        phase = rng.uniform(0.0, 2.0 * np.pi, (count, channels))
        return amplitude * np.cos(phase), amplitude * np.sin(phase)


@checked
@dataclass(frozen=True)
class SineSweep(Waveform):
    """A sinusoid whose frequency rises linearly through the band; random phase per channel."""

    amplitude: float  # [N or m]
    band: Sequence[float] = (0.1, 3.0)  # [Hz]

    def __post_init__(self) -> None:
        _require_positive("amplitude", self.amplitude)
        _require_band(self.band)

    def check_samples(self, samples: int, dt: float) -> None:
        _harmonics(self.band, samples, dt)

    def draw(
        self, samples: int, dt: float, channels: int, record: int, rng: np.random.Generator
    ) -> Signal:
        self.check_samples(samples, dt)
        low, high = 2.0 * np.pi * np.asarray(self.band)
        t = dt * np.arange(samples)[:, None]
        pace = (high - low) / (samples * dt)
        phase = low * t + 0.5 * pace * t**2 + rng.uniform(0.0, 2.0 * np.pi, channels)
        rate = self.amplitude * (low + pace * t) * np.cos(phase)
        return self.amplitude * np.sin(phase), rate


@checked
class Given(Waveform):
    """A history given as an array (N, c) or a file of one (.npy, .csv), sampled every `data.dt`.

    Record i takes rows i·T … (i+1)·T − 1, so that testing never repeats training.
    """

    def __init__(
        self,
        values: np.ndarray | Sequence[float] | Sequence[Sequence[float]] | None = None,
        path: str | None = None,
    ) -> None:
        if (values is None) == (path is None):
            raise ValueError("give either values or path, for example excitation.force.path=f.csv")
        if path is not None:
            values = _load_table(Path(path))
        assert values is not None
        try:
            self.values = np.asarray(values, dtype=float)
        except (ValueError, TypeError, OverflowError) as error:  # rows of unequal length, words
            raise ValueError(f"a given history is no table of numbers ({error})") from None
        if self.values.ndim == 1:
            self.values = self.values[:, None]
        if self.values.ndim != 2 or not np.isfinite(self.values).all():
            raise ValueError(
                f"a given history of shape {self.values.shape} is not a finite (samples, channels)"
            )

    def draw(
        self, samples: int, dt: float, channels: int, record: int, rng: np.random.Generator
    ) -> Signal:
        from scipy.interpolate import CubicSpline  # slow to import, seldom needed

        rows, columns = self.values.shape
        if columns != channels or rows < (record + 1) * samples:
            raise ValueError(
                f"the given history has {rows} rows × {columns} columns; record {record + 1} needs "
                f"{(record + 1) * samples} rows × {channels} columns: shorten data.duration, "
                "ask for fewer records or give more rows"
            )
        values = self.values[record * samples : (record + 1) * samples]
        return values, CubicSpline(dt * np.arange(samples), values)(dt * np.arange(samples), 1)


def _load_table(path: Path) -> np.ndarray:
    if not path.is_file():
        raise ValueError(f"no file {path}; expected a .npy or .csv table, one column per channel")
    try:
        if path.suffix == ".npy":  # mapped: a header may claim more than the file holds
            table = np.load(path, mmap_mode="r", allow_pickle=False)
        else:
            table = np.loadtxt(path, delimiter=",", comments="#", ndmin=2)
    except (ValueError, EOFError, OSError) as error:
        words = " ".join(str(error).split())
        raise ValueError(f"{path} cannot be read ({words}); export it again") from None
    if not isinstance(table, np.ndarray) or table.dtype.kind not in "fiu" or table.ndim > 2:
        raise ValueError(f"{path} holds no table of numbers; expected one column per channel")
    return np.array(table, dtype=float)


def _require_positive(name: str, value: float) -> None:
    if not 0.0 < value < np.inf:
        raise ValueError(f"{name}={value} of the excitation must be positive")


def _require_band(band: Sequence[float]) -> None:
    if len(band) != 2 or not 0.0 <= band[0] < band[1]:
        raise ValueError(f"band={list(band)} Hz: expected 0 ≤ lower < upper")


@checked
@dataclass(frozen=True)
class Excitation:
    """What drives a structure: a waveform of forces, one of support displacements, or both.

    `dofs` lists the DOFs that carry a force (1, 2, …), all of them by default; `ramp` [s] lets both
    grow smoothly from zero, so that a support does not jump at the start.
    """

    force: Waveform | None = None
    support: Waveform | None = None
    dofs: Sequence[int] | None = None
    ramp: NotNegative = 0.0

    def check(self, structure: Structure, samples: int, dt: float) -> None:
        """Raise ValueError where this cannot drive a structure for so many samples."""
        if self.force is None and self.support is None:
            raise ValueError("the excitation has neither force nor support; give one of them")
        if self.support is not None and structure.supports == 0:
            raise ValueError(
                "support motion needs a structure with supports s1, s2, …; it has none"
            )
        self.driven(structure)
        for waveform in (self.force, self.support):
            if waveform is not None:
                waveform.check_samples(samples, dt)

    def driven(self, structure: Structure) -> list[int]:
        """Columns of the DOFs that carry a force."""
        if self.force is None:
            return []
        dofs = range(1, structure.dofs + 1) if self.dofs is None else self.dofs
        for dof in dofs:
            if not 1 <= dof <= structure.dofs:
                raise ValueError(f"excitation.dofs holds {dof}; the DOFs are 1 … {structure.dofs}")
        if len(set(dofs)) != len(dofs):
            raise ValueError(f"excitation.dofs={list(dofs)} names a DOF twice")
        return [dof - 1 for dof in dofs]

    def draw(
        self, structure: Structure, samples: int, dt: float, record: int, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Force (T, n) [N], support displacement (T, p) [m] and velocity (T, p) [m/s]."""
        self.check(structure, samples, dt)
        columns = self.driven(structure)
        force = np.zeros((samples, structure.dofs))
        support = velocity = np.zeros((samples, structure.supports))
        grow, growth = self._growth(dt * np.arange(samples)[:, None])
        if self.force is not None:
            force[:, columns] = grow * self.force.draw(samples, dt, len(columns), record, rng)[0]
        if self.support is not None:
            s, s_dot = self.support.draw(samples, dt, structure.supports, record, rng)
            support, velocity = grow * s, grow * s_dot + growth * s
        for name, u in (("force", force), ("support", support), ("velocity", velocity)):
            require_bearable(f"excitation: the {name}", u)
        return force, support, velocity

    def _growth(self, t: np.ndarray) -> Signal:
        """A half cosine from 0 to 1 over the ramp, and its rate."""
        if self.ramp == 0.0:
            return np.ones_like(t), np.zeros_like(t)
        angle = np.pi * np.minimum(t / self.ramp, 1.0)
        return 0.5 - 0.5 * np.cos(angle), 0.5 * np.pi / self.ramp * np.sin(angle)
