"""Modes in exact steps: matrix exponentials under a force that is linear, or a parabola.

q̈ = −k q − c q̇ + f;   s = (q, q̇),   s(h) = E s + P₀ f₀ + P₁ f₁ = E s + Q₀ f₀ + Q½ f½ + Q₁ f₁
Van Loan (1978): the integrals are blocks of a larger exponential. Slopes by log k and log c are
those of the exponential at a complex argument (Squire & Trapp 1998), to rounding.   J modes.
"""

from __future__ import annotations

import numpy as np

STEP = 1e-30  # into the complex plane
NUMBERS = 14  # E (4), P₀, P₁, Q₀, Q½, Q₁ (2 each)


def _numbers(k: np.ndarray, c: np.ndarray, h: float) -> np.ndarray:
    """E, P₀, P₁, Q₀, Q½, Q₁ (N, 14) of oscillators k, c (N,) and a step h."""
    from scipy.linalg import expm  # slow to import

    M = np.zeros((len(k), 5, 5), dtype=complex)
    M[:, 0, 1], M[:, 1, 0], M[:, 1, 1] = h, -k * h, -c * h
    M[:, 1, 2] = h  # the force
    M[:, 2, 3] = M[:, 3, 4] = 1.0  # its slope and curvature, in a time that ends at 1
    whole = expm(M)
    held, slope, curve = (whole[:, :2, i] for i in (2, 3, 4))  # of 1, τ, τ²/2
    linear = [held - slope, slope]
    parabola = [held - 3.0 * slope + 4.0 * curve, 4.0 * slope - 8.0 * curve, 4.0 * curve - slope]
    E = whole[:, :2, :2].reshape(len(k), 4)
    return np.concatenate([E, *linear, *parabola], axis=1)


def exact_steps(log_k: np.ndarray, log_c: np.ndarray, h: float) -> np.ndarray:
    """(J, 3, 14): the numbers of a step, and their slopes by log k and by log c."""
    shifts = np.array([[0.0, 0.0], [1j * STEP, 0.0], [0.0, 1j * STEP]])
    k = np.exp(log_k[:, None] + shifts[:, 0]).ravel()
    c = np.exp(log_c[:, None] + shifts[:, 1]).ravel()
    numbers = _numbers(k, c, h).reshape(len(log_k), 3, NUMBERS)
    found: np.ndarray = numbers.imag / STEP
    found[:, 0] = numbers[:, 0].real
    return found
