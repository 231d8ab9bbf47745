"""Modes of small motions about rest: frequencies, damping ratios and shapes of identified models.

q̈ = −K q − C q̇,   x = Φ q.        n coordinates, o outputs, N modes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from models.composition.composite import Composite
from models.element_network import ElementNetwork
from models.element_network_named import ElementNetworkNamed
from models.estimator import Estimator
from models.hysteretic_element import HystereticElement
from models.linear import EquivalentLinear
from models.linear_motion import LinearMotion

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
    matrices = _matrices(estimator)
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


def _matrices(estimator: Estimator) -> tuple[Tensor, Tensor, Tensor] | None:
    """K (n, n) [1/s²], C (n, n) [1/s] by unit mass, and Φ (o, n)."""
    if isinstance(estimator, ElementNetworkNamed):
        M, C, K = (torch.from_numpy(m) for m in estimator.structure().linearised())
        return torch.linalg.solve(M, K), torch.linalg.solve(M, C), torch.eye(len(M)).to(M)
    if isinstance(estimator, Composite) and not isinstance(estimator, HystereticElement):
        return _of_composite(estimator)
    if isinstance(estimator, LinearMotion):
        estimator = estimator.system
    if type(estimator) is EquivalentLinear and estimator.weights.ndim == 2:
        estimator.require_identified(estimator.weights)
        damping, stiffness, _ = estimator.matrices()
        return stiffness, damping, torch.eye(estimator.dofs).to(stiffness)
    return None


def _of_composite(model: Composite) -> tuple[Tensor, Tensor, Tensor]:
    """The core, and the springs and dampers of the elements for small motions."""
    model.require_identified(model.identified)
    composed = model.composition()
    springs, dampers = composed.laws.value[:, 0], composed.laws.value[:, 1]
    if isinstance(model, ElementNetwork):  # whose laws may be others than those of the table
        values = {p.name: p.value for p in model.physical_parameters()}
        numbers = range(1, len(model.elements) + 1)
        springs = torch.tensor([values[f"r{e}.stiffness"] for e in numbers]).to(springs)
        dampers = torch.tensor([values.get(f"r{e}.damping", 0.0) for e in numbers]).to(springs)
    G, D = composed.G.value, composed.D.value
    core_k, core_c = (torch.diag(part) for part in composed.core.value)
    return core_k + (G * springs) @ D, core_c + (G * dampers) @ D, composed.outputs.value
