"""A rational filter as a sum of sections: its states, poles, zeros, response.

x[t] = d u[t] + Σᵢ c₀ᵢ sᵢ[t] + c₁ᵢ sᵢ[t−1],   sᵢ[t] = u[t] − a₁ᵢ sᵢ[t−1] − a₂ᵢ sᵢ[t−2]

Sections have a pair of poles each, complex or real; one with a₂ = c₁ = 0 has a single pole. The
sum is well conditioned where a polynomial of high order is not.   T samples, p sections.
"""

from __future__ import annotations

import numpy as np


def _section(a: np.ndarray, u: np.ndarray, before: np.ndarray | None = None) -> np.ndarray:
    """s (…, T) of one section under u (…, T), from before (2,) = s[−1], s[−2]."""
    from scipy.signal import lfilter  # slow to import

    polynomial = np.r_[1.0, a]
    if before is None:
        s: np.ndarray = lfilter([1.0], polynomial, u, axis=-1)
        return s
    state = np.array([-a[0] * before[0] - a[1] * before[1], -a[1] * before[0]])
    return np.asarray(lfilter([1.0], polynomial, u, zi=state)[0])


def states(a: np.ndarray, u: np.ndarray, begin: np.ndarray) -> np.ndarray:
    """s (p, T) of all sections with a (p, 2), from begin (p, 2)."""
    if not len(a):
        return np.empty((0, len(u)))
    return np.stack([_section(one, u, first) for one, first in zip(a, begin, strict=True)])


def driven(d: float, a: np.ndarray, c: np.ndarray, u: np.ndarray) -> np.ndarray:
    """x (…, T) of the filter under u (…, T), from rest."""
    from scipy.signal import lfilter  # slow to import

    x = d * u
    for poles, weights in zip(a, c, strict=True):
        x += lfilter(weights, np.r_[1.0, poles], u, axis=-1)
    return x


def sections_of(poles: np.ndarray) -> np.ndarray:
    """a (p, 2) of sections with these poles: complex ones in pairs, real ones two and two."""
    real = np.sort(poles[np.abs(poles.imag) < 1e-9].real)
    pairs = [[-2.0 * p.real, abs(p) ** 2] for p in poles if p.imag >= 1e-9]
    for k in range(0, len(real) - 1, 2):
        pairs.append([-(real[k] + real[k + 1]), real[k] * real[k + 1]])
    if len(real) % 2:
        pairs.append([-real[-1], 0.0])
    return np.array(pairs).reshape(-1, 2)


def poles_of(a: np.ndarray) -> np.ndarray:
    """The poles of sections a (p, 2), those at zero left out."""
    poles = np.concatenate([np.empty(0), *(np.roots(np.r_[1.0, one]) for one in a)])
    return poles[np.abs(poles) > 1e-9].astype(complex)


def response(d: float, a: np.ndarray, c: np.ndarray, z: np.ndarray) -> np.ndarray:
    """The frequency response (F,) at points z (F,) of the unit circle."""
    H = np.full(len(z), complex(d))
    for poles, weights in zip(a, c, strict=True):
        H += (weights[0] + weights[1] / z) / (1.0 + poles[0] / z + poles[1] / z**2)
    return H


def fitted_to(
    H: np.ndarray, a: np.ndarray, z: np.ndarray, weight: np.ndarray
) -> tuple[float, np.ndarray]:
    """d and c (p, 2) of the filter with sections a whose response is nearest H (F,)."""
    columns, single = [np.ones(len(z), dtype=complex)], [False]
    for poles in a:
        below = 1.0 + poles[0] / z + poles[1] / z**2
        columns += [1.0 / below, 1.0 / (z * below)]
        single += [False, poles[1] == 0.0]
    A = np.stack(columns, axis=1) * weight[:, None]
    A[:, single] = 0.0
    b = H * weight
    A, b = np.concatenate([A.real, A.imag]), np.concatenate([b.real, b.imag])
    size = np.linalg.norm(A, axis=0)
    size[size == 0.0] = 1.0
    x = np.linalg.lstsq(A / size, b, rcond=1e-12)[0] / size
    return float(x[0]), x[1:].reshape(-1, 2)


def zeros_of(d: float, a: np.ndarray, c: np.ndarray) -> np.ndarray:
    """The zeros of the filter in the z plane, those at zero and near infinity left out."""
    below = [np.r_[1.0, one] for one in a]
    whole = np.array([1.0])
    for one in below:
        whole = np.convolve(whole, one)
    above = d * whole
    for i, weights in enumerate(c):
        others = np.array([1.0])
        for j, one in enumerate(below):
            others = np.convolve(others, one) if j != i else others
        part = np.convolve(others, weights)
        above[: len(part)] += part
    above = np.where(np.abs(above) > 1e-9 * np.abs(above).max(), above, 0.0)
    zeros = np.roots(np.trim_zeros(above))
    return zeros[(np.abs(zeros) > 1e-6) & (np.abs(zeros) < 1e3)].astype(complex)
