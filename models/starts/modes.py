"""Modes from the spectra of a motion, where least squares gives none; of no topology.

A = Σ (iω)² Φ_r Γ_r U / (ω_r² − ω² + 2 i ζ_r ω_r ω)    Φ_r Γ_r by least squares, ω_r, ζ_r sought
F frequencies, n DOFs and modes, m channels of excitation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.starts.spectra import Layout, Spectra, typical

PLACES, POLISHED, EVALUATIONS = 40, 3, 40
MOST_ROWS = 600  # frequencies, so that a search stays quick
RATIO, LEAST, MOST = 0.05, 1e-3, 1.0  # of critical damping: to begin with, and its bounds
ALIKE = 1e-6  # singular values of the shapes, of the largest, below which modes are the same


class NoModesError(ValueError):
    """Raised where least squares gives no modes; the message says what it gives."""


@dataclass(frozen=True)
class Modes:
    """ω² (n,) [1/s²], 2ζω (n,) [1/s], shapes (n, n) in columns of unit length, Γ (n, m)."""

    squares: np.ndarray
    damping: np.ndarray
    shapes: np.ndarray
    inputs: np.ndarray
    error: float  # of the response, relative


def modes_of(spectra: Spectra) -> Modes:
    """The modes, as many as there are outputs, whose response is nearest to a motion."""
    some = slice(None, None, max(1, len(spectra.omega) // MOST_ROWS))
    spectra = Spectra(
        spectra.omega[some], spectra.outputs[some], spectra.inputs[some], spectra.measured
    )
    n = spectra.outputs.shape[1]
    low, high = 0.5 * spectra.omega.min(), 2.0 * spectra.omega.max()
    begins = [_chain(n, spectra, w) for w in [*np.geomspace(low, high, PLACES), spectra.dominant]]
    begins.sort(key=lambda theta: float(np.linalg.norm(_missing(theta, spectra))))
    ends = [_polished(theta, spectra, low, high) for theta in begins[:POLISHED]]
    best = min(ends, key=lambda theta: float(np.linalg.norm(_missing(theta, spectra))))
    return _modes(best, spectra)


def _chain(n: int, spectra: Spectra, first: float) -> np.ndarray:
    """Logarithms of frequencies and ratios (2n,) of a uniform chain with this first frequency."""
    layout = Layout(np.eye(n) - np.eye(n, k=-1), np.zeros((n, 0)), [], True)
    squares = typical(spectra, layout, first**2, np.ones(n)).frequencies(layout.B)
    return np.log(np.concatenate([np.sqrt(squares), np.full(n, RATIO)]))


def _columns(theta: np.ndarray, spectra: Spectra) -> np.ndarray:
    """(F, n m): the response of each mode to each channel."""
    omega, ratio = np.split(np.exp(theta), 2)
    w = spectra.omega[:, None]
    response = (1j * w) ** spectra.measured / (omega**2 - w**2 + 2j * ratio * omega * w)
    each = response[:, :, None] * spectra.inputs[:, None, :]
    return np.asarray(each.reshape(len(w), -1))


def _residues(theta: np.ndarray, spectra: Spectra) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Φ_r Γ_r (n m, n) of all modes, and columns and outputs as real numbers."""
    columns = _columns(theta, spectra)
    phi = np.concatenate([columns.real, columns.imag])
    target = np.concatenate([spectra.outputs.real, spectra.outputs.imag])
    length = np.linalg.norm(phi, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    return np.linalg.lstsq(phi / length, target, rcond=1e-8)[0] / length[:, None], phi, target


def _missing(theta: np.ndarray, spectra: Spectra) -> np.ndarray:
    residues, phi, target = _residues(theta, spectra)
    return np.asarray((phi @ residues - target).ravel() / np.linalg.norm(target))


def _polished(theta: np.ndarray, spectra: Spectra, low: float, high: float) -> np.ndarray:
    from scipy.optimize import least_squares  # slow to import

    n = len(theta) // 2
    lowest = np.log(np.concatenate([np.full(n, low), np.full(n, LEAST)]))
    highest = np.log(np.concatenate([np.full(n, 2.0 * high), np.full(n, MOST)]))
    begin = np.clip(theta, lowest + 1e-6, highest - 1e-6)
    found = least_squares(
        _missing, begin, bounds=(lowest, highest), max_nfev=EVALUATIONS, args=(spectra,)
    )
    return np.asarray(found.x)


def _modes(theta: np.ndarray, spectra: Spectra) -> Modes:
    omega, ratio = np.split(np.exp(theta), 2)
    n, m = len(omega), spectra.inputs.shape[1]
    residues = _residues(theta, spectra)[0].reshape(n, m, n)
    shapes, inputs = np.empty((n, n)), np.empty((n, m))
    for r, residue in enumerate(residues):  # of rank one where modes lie apart
        U, size, V = np.linalg.svd(residue.T, full_matrices=False)
        shapes[:, r], inputs[r] = U[:, 0], size[0] * V[0]
    U, size, V = np.linalg.svd(shapes)
    shapes = U @ np.diag(np.maximum(size, ALIKE * size[0])) @ V
    error = float(np.linalg.norm(_missing(theta, spectra)))
    return Modes(omega**2, 2.0 * ratio * omega, shapes, inputs, error)
