"""Modes of small motions about rest: frequencies, damping ratios and shapes of identified models.

q̈ = −K q − C q̇,   x = Φ q.        n coordinates, o outputs, N modes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from models.estimator import Estimator

REAL = 1e-9  # imaginary part of a pole, of its size: less is none


@dataclass(frozen=True)
class Modes:
    """Frequencies (N,) [Hz] ascending, damping ratios (N,), shapes (o, N), the largest of each 1.

    A shape is complex where DOFs do not move in phase. unstable: modes that grow.
    """

    frequencies: np.ndarray
    damping: np.ndarray
    shapes: np.ndarray

    @property
    def unstable(self) -> np.ndarray:
        return np.asarray(self.damping < 0.0)


@torch.no_grad()
def modes_of(estimator: Estimator) -> Modes | None:
    """Modes of small motions; None for models without masses and springs or their like.

    A model that only begins with a linear system has none: what it adds acts on small motions, too.
    Poles without an imaginary part, of motions that do not oscillate, are left out.
    """
    matrices = estimator.small_motion()
    if matrices is None:
        return None
    stiffness, damping, outputs = (np.asarray(m.detach().cpu(), dtype=float) for m in matrices)
    n = len(stiffness)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness, -damping]])
    poles, vectors = np.linalg.eig(A)
    upper = poles.imag > REAL * np.abs(poles)
    poles, vectors = poles[upper], vectors[:n, upper]
    order = np.argsort(np.abs(poles))
    poles, shapes = poles[order], outputs @ vectors[:, order]
    largest = np.take_along_axis(shapes, np.abs(shapes).argmax(axis=0)[None], axis=0)
    shapes = shapes / np.where(largest == 0.0, 1.0, largest)
    size = np.abs(poles)
    return Modes(size / (2.0 * np.pi), -poles.real / size, shapes)
