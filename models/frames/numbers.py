"""The numbers of a moment frame: what is fitted, and the members that follow from it.

θ holds logarithms, and logits of shares, beside those of the start, so that it is 0 there:
    α, β, γ;   of all columns, then of all beams: k_hinge/k, b, R₀, c₁;
    of every floor: k of its columns, their yield moment, k of its beams, their yield moment
Weight takes g_i = γ Σ m / ρ_i of the stiffness of a storey, γ = 9.81 m/s² over a storey's height.
n floors, P = 11 + 4 n.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SHARED = 11
SHARES = (4, 6, 8, 10)  # b and c₁, between 0 and 1
KIND = (12.0, 0.03, 6.0, 0.8)  # of a member at the start: k_hinge/k, b, R₀, c₁
DAMPERS = (0.02, 0.01, 0.02)  # α/ω, β ω and γ/ω² at the start, ω of the first mode
TURNING = 2.5  # times the stiffness that columns between joints that do not turn would need
YIELDS = 0.4  # of the largest shear of a storey, per member


@dataclass(frozen=True)
class Members:
    """All that a run is given: see run_compiled.py."""

    laws: np.ndarray  # (n, 2, 6)
    sag: np.ndarray  # g (n,)
    alpha: float
    beta: float


def number_of(floors: int) -> int:
    return SHARED + 4 * floors


def start(mass: np.ndarray, drift: np.ndarray, shear: np.ndarray) -> np.ndarray:
    """Numbers (P,) for the drifts and shears (N, n) of storeys.

    Raises ValueError for a storey that never drifts, or that pushes the way it goes.
    """
    square = (drift**2).sum(axis=0)
    if not (square > 0.0).all() or not ((shear * drift).sum(axis=0) > 0.0).all():
        raise ValueError(
            "a storey does not drift, or not against its shear; give displacements, velocities and "
            "accelerations against the base, from the lowest floor to the roof"
        )
    secant, largest = (shear * drift).sum(axis=0) / square, np.abs(shear).max(axis=0)
    B = np.eye(len(mass)) - np.eye(len(mass), k=-1)
    rate = np.sqrt(np.linalg.eigvals(B.T * secant @ B / mass[:, None]).real.min())
    dampers = (DAMPERS[0] * rate, DAMPERS[1] / rate, DAMPERS[2] * rate**2)
    member = (TURNING / 6.0 * secant, YIELDS * largest)
    return np.concatenate([dampers, KIND, KIND, *member, *member])


def moved(start: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Numbers (P,) at θ."""
    found: np.ndarray = start * np.exp(theta)
    for i in SHARES:
        odds = start[i] / (1.0 - start[i]) * np.exp(theta[i])
        found[i] = odds / (1.0 + odds)
    return found


def scaled(start: np.ndarray, stiffer: float, stronger: float) -> np.ndarray:
    """θ (P,) of a frame whose members are all so much stiffer and stronger, in logarithms."""
    theta = np.zeros_like(start)
    theta[SHARED:].reshape(2, 2, -1)[:] = np.array([stiffer, stronger])[:, None]
    return theta


def members(numbers: np.ndarray, mass: np.ndarray, rho: np.ndarray) -> Members:
    alpha, beta, gamma = numbers[:3]
    kinds, (k_column, m_column, k_beam, m_beam) = (
        numbers[3:SHARED].reshape(2, 4),
        numbers[SHARED:].reshape(4, -1),
    )
    laws = np.empty((len(mass), 2, 6))
    for j, (k, moment) in enumerate(((k_column, m_column), (k_beam, m_beam))):
        stiff, *shape = kinds[j]
        laws[:, j, 0], laws[:, j, 1], laws[:, j, 2] = k, moment / (stiff * k), stiff * k
        laws[:, j, 3:] = shape
    above = np.cumsum(mass[::-1])[::-1]
    return Members(laws, gamma * above / rho, float(alpha), float(beta))
