"""A static curve of smooth ramps, straight beyond the outermost, through zero.

f(x) = β x + Σₖ wₖ (ρ(x; κₖ, sₖ) − ρ(0; κₖ, sₖ)),   ρ = s ln(1 + e^((x − κ)/s))
T samples, K ramps.
"""

from __future__ import annotations

import numpy as np
from scipy.special import expit

NARROWEST = 0.5  # of the distance of two ramps, as they begin


def ramp(x: np.ndarray, kappa: float, s: float) -> np.ndarray:
    value: np.ndarray = s * np.logaddexp(0.0, (x - kappa) / s)
    return value


def value(x: np.ndarray, beta: float, laws: np.ndarray) -> np.ndarray:
    """f(x) (T,); laws (K, 3): w, κ and ln s of each ramp."""
    f, nothing = beta * x, np.zeros(1)
    for w, kappa, log_s in laws:
        f = f + w * (ramp(x, kappa, np.exp(log_s)) - ramp(nothing, kappa, np.exp(log_s)))
    return f


def slope(x: np.ndarray, beta: float, laws: np.ndarray) -> np.ndarray:
    """f′(x) (T,)."""
    f = np.full_like(x, beta)
    for w, kappa, log_s in laws:
        f += w * expit((x - kappa) / np.exp(log_s))
    return f


def by_coefficients(x: np.ndarray, laws: np.ndarray) -> np.ndarray:
    """∂f (1 + 3K, T) by β, then by w, κ and ln s of each ramp."""
    rows, nothing = [x], np.zeros(1)
    for w, kappa, log_s in laws:
        s = np.exp(log_s)
        here, there = expit((x - kappa) / s), expit((nothing - kappa) / s)
        rise, rest = ramp(x, kappa, s), ramp(nothing, kappa, s)
        widened = (rise - (x - kappa) * here) - (rest - (nothing - kappa) * there)
        rows += [rise - rest, -w * (here - there), w * widened]
    return np.stack(rows)


def begun(x: np.ndarray, ramps: int) -> np.ndarray:
    """Laws (K, 3) without effect, ramps where x (T,) goes: by its range and by its visits."""
    share = (np.arange(ramps) + 0.5) / max(ramps, 1)
    low, high = np.quantile(x, [0.001, 0.999])
    kappa = 0.5 * (np.quantile(x, share) + low + (high - low) * share)
    apart = np.gradient(kappa) if ramps > 1 else np.full(ramps, high - low)
    laws = np.zeros((ramps, 3))
    laws[:, 1], laws[:, 2] = kappa, np.log(NARROWEST * np.maximum(apart, 1e-9))
    return laws
