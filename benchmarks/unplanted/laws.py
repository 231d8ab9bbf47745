"""Laws of elements that no model of the zoo contains, simulated under an imposed motion.

Each is a few lines of the literature in units of its own, followed at a motion's fine steps. Their
parameters were chosen before any model was fitted to them.   y [m], r [kN], t [s]
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

Law = Callable[[np.ndarray, np.ndarray], np.ndarray]  # y, ẏ (N,) in fine steps to r (N,)


def steel(y: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Menegotto & Pinto (1973) with the hardening of Filippou et al. (1983): both grow."""
    k, limit, b, sharp, a1, a2, a3, a4 = 2.0e4, 200.0, 0.03, 18.0, 0.925, 0.15, 0.04, 1.0
    first = limit / k
    largest, smallest = first, -first
    side, y_r, r_r, y_0, r_0, plastic = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    r = np.zeros_like(y)
    for n in range(1, len(y)):
        step = y[n] - y[n - 1]
        new = int(np.sign(step)) or side
        if new != side and new != 0:
            y_r, r_r = (y[n - 1], r[n - 1]) if side else (0.0, 0.0)
            largest, smallest = max(largest, y_r), min(smallest, y_r)
            grown = 1.0 + a3 * ((largest - smallest) / (2.0 * a4 * first)) ** 0.8
            at = limit * grown * new
            y_0 = (at - b * k * (at / k) - r_r + k * y_r) / (k * (1.0 - b))
            r_0 = at + b * k * (y_0 - at / k)
            plastic = abs((smallest if new > 0 else largest) - y_0) / first if side else 0.0
            side = new
        if side:
            bend = sharp * (1.0 - a1 * plastic / (a2 + plastic))
            ratio = (y[n] - y_r) / (y_0 - y_r)
            curve = b * ratio + (1.0 - b) * ratio / (1.0 + abs(ratio) ** bend) ** (1.0 / bend)
            r[n] = r_r + curve * (r_0 - r_r)
    return r


def flag(y: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Self-centring: a flag between a loading line and one lower by a part of the activation."""
    k, hardening, at, lower = 1.5e4, 0.08, 0.012, 0.65
    r = np.zeros_like(y)
    for n in range(1, len(y)):
        size, up = abs(y[n]), math.copysign(1.0, y[n])
        beyond = hardening * k * (size - at)
        above = min(k * size, k * at + beyond)
        below = min(k * size, (1.0 - lower) * k * at + beyond * (size > 0.0))
        trial = up * (r[n - 1] + k * (y[n] - y[n - 1]))
        r[n] = up * min(max(trial, min(below, above)), above)
    return r


def slack(y: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Two braces in tension alone whose yielding lengthens them: a gap that grows."""
    k, limit, hardening, gap = 1.2e4, 160.0, 0.02, 0.002
    gaps, r = [gap, gap], np.zeros_like(y)
    for n in range(len(y)):
        for i, side in enumerate((1.0, -1.0)):
            at = side * y[n]
            strength = limit + hardening * k * (gaps[i] - gap)
            if k * (at - gaps[i]) > strength:
                gaps[i] = (k * at - limit + hardening * k * gap) / (k * (1.0 + hardening))
            r[n] += side * max(k * (at - gaps[i]), 0.0)
    return r


def pendulum(y: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Friction pendulum: W y/R + μ(v) W z with μ of Constantinou et al. (1990)."""
    weight, radius, slow, fast, speed, yielding = 1000.0, 1.2, 0.04, 0.11, 0.05, 0.0006
    z, r = 0.0, np.zeros_like(y)
    for n in range(1, len(y)):
        z = min(max(z + (y[n] - y[n - 1]) / yielding, -1.0), 1.0)
        friction = fast - (fast - slow) * math.exp(-abs(rate[n]) / speed)
        r[n] = weight * (y[n] / radius + friction * z)
    return r


def pinching(y: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Bouc–Wen losing strength and stiffness (Baber & Wen 1981), pinching (Foliente 1995)."""
    k, post, size = 1.5e4, 0.06, 0.010
    gamma, beta, n_exp = 0.5, 0.5, 1.3
    z, energy, r = 0.0, 0.0, np.zeros_like(y)
    for n in range(1, len(y)):
        step = (y[n] - y[n - 1]) / size
        parts = max(1, int(abs(step) / 0.02) + 1)
        for _ in range(parts):
            d = step / parts
            stiff, strong = 1.0 + 0.02 * energy, 1.0 + 0.008 * energy
            top = (1.0 / (strong * (gamma + beta))) ** (1.0 / n_exp)
            deep = 0.75 * (1.0 - math.exp(-0.25 * energy))
            wide = (0.15 + 0.004 * energy) * 1.2
            side = math.copysign(1.0, d)
            pinch = 1.0 - deep * math.exp(-(((z * side - 0.15 * top) / wide) ** 2))
            power = abs(z) ** n_exp * strong
            dz = pinch * (1.0 - power * (gamma + beta * math.copysign(1.0, d * z))) / stiff * d
            energy += (z + 0.5 * dz) * d * (1.0 - post)
            z += dz
        r[n] = k * size * (post * y[n] / size + (1.0 - post) * z)
    return r


def takeda(y: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Clough & Johnston (1966): reloading aims at the largest deformation of its side."""
    k, post, yielding, softer = 1.8e4, 0.05, 0.008, 0.3
    peaks = [yielding, yielding]
    r, mode = np.zeros_like(y), 0

    def skeleton(size: float) -> float:
        return k * min(size, yielding) + post * k * max(size - yielding, 0.0)

    for n in range(1, len(y)):
        step = y[n] - y[n - 1]
        side = 1.0 if step >= 0.0 else -1.0
        i = 0 if side > 0.0 else 1
        opposite = peaks[1 - i]
        if side * r[n - 1] < 0.0:  # unloading, towards zero force
            slope = k * (yielding / opposite) ** softer
            trial = r[n - 1] + slope * step
            if side * trial <= 0.0:
                r[n] = trial
                continue
            start_y, start_r = y[n - 1] - r[n - 1] / slope, 0.0
        else:
            start_y, start_r = y[n - 1], r[n - 1]
        aim_y, aim_r = side * peaks[i], side * skeleton(peaks[i])
        if side * y[n] >= peaks[i]:
            r[n] = side * skeleton(side * y[n])
        else:
            slope = min((aim_r - start_r) / (aim_y - start_y), k)
            if mode != side and side * start_r > 0.0:
                slope = min(max(slope, k * (yielding / peaks[i]) ** softer), k)
            r[n] = start_r + slope * (y[n] - start_y)
            r[n] = side * min(side * r[n], skeleton(peaks[i]))
        peaks[i] = max(peaks[i], side * y[n])
        mode = int(side)
    return r


def iwan(y: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Iwan (1967): elastoplastic units in parallel, loops within loops by Masing's rule."""
    k, units = 2.0e4, 12
    limits = 0.0015 * 1.4 ** np.arange(units)
    shares = 1.0 / limits**0.7
    shares /= shares.sum()
    z, r = np.zeros(units), np.zeros_like(y)
    for n in range(1, len(y)):
        z = np.clip(z + (y[n] - y[n - 1]), -limits, limits)
        r[n] = k * (0.02 * y[n] + 0.98 * shares @ z)
    return r


LAWS: dict[str, Law] = {
    "steel": steel,
    "flag": flag,
    "slack": slack,
    "pendulum": pendulum,
    "pinching": pinching,
}
HELD_BACK: dict[str, Law] = {"takeda": takeda, "iwan": iwan}  # not looked at before the end
SIZES = {  # largest deformations of the training motions [m]
    "steel": 0.06,
    "flag": 0.06,
    "slack": 0.05,
    "pendulum": 0.12,
    "pinching": 0.06,
    "takeda": 0.05,
    "iwan": 0.05,
}
