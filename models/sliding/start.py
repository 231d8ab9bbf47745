"""The start of a sliding mass: positions differentiated, the equation of motion by least squares.

Both sides of v̇ = β u − o − sgn(v) (j + G(|v|)) are smoothed alike, by parabolas over some samples;
what is linear in the parameters is solved for where the mass slides.   T samples, K knots.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.sliding.problem import Motion, bends
from models.sliding.run_compiled import SHARED

DEGREE = 3  # of the polynomials
RIDGE, STRAIGHT = 1e-9, 1e-3  # weights of θ² and of bends, beside the mean squared acceleration
LEAST_JUMP = 1e-4  # of the input's effect


@dataclass(frozen=True)
class Smoothed:
    """Position, velocity, acceleration and input (T,) of a motion, smoothed alike."""

    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    u: np.ndarray

    @staticmethod
    def of(motion: Motion, samples: int) -> Smoothed:
        """By cubic parabolas over so many samples, an odd number."""
        from scipy.signal import savgol_filter  # slow to import

        dt = motion.h * motion.u.shape[1]
        u = motion.u.mean(axis=1)
        # what acts about a sample is the mean of the inputs before it and after it
        u = 0.5 * (np.r_[u[:1], u] + np.r_[u, u[-1:]])
        x, v, a = (savgol_filter(motion.y, samples, DEGREE, deriv=d, delta=dt) for d in range(3))
        return Smoothed(x, v, a, savgol_filter(u, samples, DEGREE, deriv=0))


def hats(w: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """G(w) by its weights at the knots (T, K), straight beyond the last."""
    K, places = len(knots), np.r_[0.0, knots]
    piece = np.clip(np.searchsorted(places, w, side="right") - 1, 0, K - 1)
    part = (w - places[piece]) / (places[piece + 1] - places[piece])
    columns = np.zeros((len(w), K + 1))
    columns[np.arange(len(w)), piece] = 1.0 - part
    columns[np.arange(len(w)), piece + 1] = part
    return columns[:, 1:]


def solved(smoothed: Sequence[Smoothed], knots: np.ndarray, least: float) -> np.ndarray:
    """Parameters (P,) by least squares over all samples at which |v| is above `least`."""
    rows, sides = [], []
    for one in smoothed:
        slides = np.abs(one.v) > least
        v, a, u = one.v[slides], one.a[slides], one.u[slides]
        G = hats(np.abs(v), knots)
        forward = (v > 0.0)[:, None]
        columns = [u, -np.ones_like(v), -np.sign(v)]
        rows.append(np.column_stack([*columns, -G * forward, G * ~forward]))
        sides.append(a)
    A, b = np.concatenate(rows), np.concatenate(sides)
    size = np.sqrt((A**2).mean(axis=0)).clip(1e-9)
    pulls = np.sqrt(STRAIGHT * len(b) * max(float(np.mean(b * b)), 1e-12)) * bends(knots)
    ridge = np.sqrt(RIDGE * len(b)) * np.diag(size)
    theta = np.linalg.lstsq(
        np.concatenate([A, pulls, ridge]),
        np.concatenate([b, np.zeros(len(pulls) + len(ridge))]),
        rcond=None,
    )[0]
    effect = abs(theta[0]) * max(float(np.sqrt(np.mean(A[:, 0] ** 2))), 1e-9)
    theta[2] = np.log(max(theta[2], LEAST_JUMP * effect, 1e-12))
    found: np.ndarray = theta
    assert len(found) == SHARED + 2 * len(knots)
    return found


def pieces(
    motions: Sequence[Motion], smoothed: Sequence[Smoothed], samples: int
) -> tuple[list[Motion], np.ndarray]:
    """Motions cut into parts of so many samples or more, and their smoothed beginnings (…, 2)."""
    parts, begins = [], []
    for motion, one in zip(motions, smoothed, strict=True):
        T = len(motion.y)
        cuts = np.linspace(0, T - 1, max(1, (T - 1) // samples) + 1).astype(int)
        for start, stop in itertools.pairwise(cuts):
            parts.append(motion.part(start, stop + 1))
            begins.append([one.x[start], one.v[start]])
    return parts, np.array(begins)
