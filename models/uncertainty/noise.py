"""The noise of a record, estimated from the residual of a fit: a spectrum, constant in bands.

The residual of a simulation is seldom white: sensors drift, excitations have noise of their own,
which the structure filters. A free run depends on nothing that was measured but its drive, so the
scores of a fit, Jᵀe, have the covariance Σ_ω Jᴴ(ω) S(ω) J(ω), S the spectral density of e: no more
of the noise is needed than S.   Hannan (1973), The asymptotic theory of linear time-series models

n channels, K bands, P parameters, T samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

PER_BAND = 100  # real numbers of a channel that a band holds at least
MOST_BANDS = 64
LEAST_LEFT = 0.1  # share of a band's residual that a fit leaves at least: no more is made up for


@dataclass(frozen=True)
class Noise:
    """Spectral densities (K, n, n) of the residual in bands of equal width up to Nyquist.

    log_likelihood: of the residual as it is, under noise with its spectrum (Whittle 1953), but for
    a constant of the records.
    """

    spectrum: np.ndarray
    log_likelihood: float

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviations (n,) of the channels."""
        return np.sqrt(np.einsum("kii->i", self.spectrum).real / len(self.spectrum))

    def score_covariance(self, jacobians: Sequence[np.ndarray]) -> np.ndarray:
        """Covariance (P, P) of Jᵀe, for Jacobians (T, n, P) of independent records."""
        size = jacobians[0].shape[-1]
        total = np.zeros((size, size))
        for jacobian in jacobians:
            columns, counts, place = transformed(jacobian, len(self.spectrum))
            for k in range(len(self.spectrum)):
                inside = place == k
                own = root_of(self.spectrum[k]).conj().T @ columns[inside]  # (bins, n, P)
                own *= np.sqrt(counts[inside])[:, None, None]
                rows = own.reshape(-1, size)
                total += rows.real.T @ rows.real + rows.imag.T @ rows.imag
        return total


def transformed(signal: np.ndarray, bands: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The half spectrum (F, …) of a signal (T, …), how often each counts (F,), its band (F,).

    Unitary: the sum of squares of a signal is that of its spectrum, counted so often.
    """
    samples = len(signal)
    half = np.fft.rfft(signal, axis=0, norm="ortho")
    counts = np.full(len(half), 2.0)
    counts[0] = 1.0
    if samples % 2 == 0:
        counts[-1] = 1.0
    frequency = np.arange(len(half)) / samples
    place = np.minimum((2.0 * bands * frequency).astype(int), bands - 1)
    return half, counts, place


def root_of(spectrum: np.ndarray) -> np.ndarray:
    """R (n, n) with R Rᴴ = S."""
    values, vectors = np.linalg.eigh(spectrum)
    return np.asarray(vectors * np.sqrt(values.clip(min=0.0)))


def noise_of(
    residuals: Sequence[np.ndarray], jacobians: Sequence[np.ndarray], root: np.ndarray
) -> Noise:
    """The noise of independent records, from residuals (T, n) of a fit and its Jacobians (T, n, P).

    root: R⁻ᵀ (P, P) of JᵀJ = R Rᵀ. What the parameters took of the noise, most of it where the
    structure resonates, is made up for band by band.
    """
    n = residuals[0].shape[1]
    numbers = sum(len(e) for e in residuals)
    longest = max(len(e) for e in residuals)  # two lines of it in each band: none stays empty
    bands = int(np.clip(min(numbers // PER_BAND, longest // 4), 1, MOST_BANDS))
    powers, taken, sizes = np.zeros((bands, n, n), complex), np.zeros((bands, n)), np.zeros(bands)
    for residual, jacobian in zip(residuals, jacobians, strict=True):
        e, counts, place = transformed(residual, bands)
        columns = transformed(jacobian, bands)[0] @ root
        leverage = counts[:, None] * (np.abs(columns) ** 2).sum(axis=2)  # (F, n)
        crossed = counts[:, None, None] * e[:, :, None] * e[:, None, :].conj()
        np.add.at(powers, place, crossed)
        np.add.at(taken, place, leverage)
        np.add.at(sizes, place, counts)
    left = (1.0 - taken / sizes[:, None]).clip(min=LEAST_LEFT)
    scale = 1.0 / np.sqrt(left)
    raw = powers / sizes[:, None, None]
    likely = -0.5 * float((sizes * np.linalg.slogdet(raw)[1]).sum())
    return Noise(raw * scale[:, :, None] * scale[:, None, :], likely)
