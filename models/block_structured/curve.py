"""A static curve of smooth ramps, straight beyond the outermost, through zero.

f(x) = β x + Σₖ wₖ (ρ(x; κₖ, sₖ) − ρ(0; κₖ, sₖ)),   ρ = s ln(1 + e^((x − κ)/s))
T samples, K ramps.
"""

from __future__ import annotations

import numpy as np

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


def columns(x: np.ndarray, laws: np.ndarray) -> np.ndarray:
    """∂f (1 + K, T) by β and by the weight w of each ramp."""
    nothing = np.zeros(1)
    ramps = [ramp(x, k, np.exp(s)) - ramp(nothing, k, np.exp(s)) for _, k, s in laws]
    return np.stack([x, *ramps])


def begun(x: np.ndarray, ramps: int) -> np.ndarray:
    """Laws (K, 3) without effect, ramps where x (T,) goes: by its range and by its visits."""
    share = (np.arange(ramps) + 0.5) / max(ramps, 1)
    low, high = np.quantile(x, [0.001, 0.999])
    kappa = 0.5 * (np.quantile(x, share) + low + (high - low) * share)
    apart = np.gradient(kappa) if ramps > 1 else np.full(ramps, high - low)
    laws = np.zeros((ramps, 3))
    laws[:, 1], laws[:, 2] = kappa, np.log(NARROWEST * np.maximum(apart, 1e-9))
    return laws
