"""Bands about a free run: where 95 % of what is measured of another motion should lie.

Var = J Σ Jᵀ + σ²: what the parameters leave open, Σ their covariance, and the sensors' noise. J is
the exact Jacobian of the run of that motion. What training never moved may be moved there: the band
widens where it is.   T samples, n channels, P parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data.annotations import MOST
from data.record import Record
from models.composition.composite import Composite
from models.fit.problem import FreeRunProblem
from models.fit.trainable import Trainable
from models.uncertainty.laplace import FINER, NORMAL, Laplace, finer_run
from models.uncertainty.parameters import free_vector, set_free_vector


@torch.no_grad()
def half_widths(estimator: Trainable, found: Laplace, record: Record) -> tuple[Tensor, Tensor]:
    """Half widths (T, n) of the true motion and of the measured one, in the unit of the record.

    The samples are those that are scored. Raises ValueError for an estimator without an exact
    Jacobian.
    """
    problem = FreeRunProblem(estimator, record, None)
    both = estimator.restarted_jacobian(problem.record, None)
    if both is None:
        raise ValueError(f"{type(estimator).__name__} has no exact Jacobian: it has no bands")
    jacobian = both[1][problem.counted].cpu().numpy()
    values, vectors = np.linalg.eigh(found.coloured)
    root = vectors * np.sqrt(values.clip(min=0.0))
    variance = ((jacobian @ root) ** 2).sum(axis=-1)  # (T, n)
    sensors = (found.noise.deviation / found.weight) ** 2
    own = (finer_run(estimator, problem) - both[0])[problem.counted].abs().cpu()  # the integrator's
    narrow, wide = NORMAL * np.sqrt(variance), NORMAL * np.sqrt(variance + sensors)
    return torch.from_numpy(narrow) + own, torch.from_numpy(wide) + own


# Bands about what no sensor measured: displacements, and forces and deformations of elements.
#
# Var = Σ_j (∂s/∂v_j)² λ_j,   Σ = Σ_j λ_j v_j v_jᵀ the covariance of the parameters. Slopes along
# each v_j are central differences of the compiled free run, which has all these signals anyway.
# There is no sensor, and so no noise of one: a band is of the true signal.
# T samples, n DOFs, E elements, P parameters.

STEP = 1e-5  # along a direction of unit length in θ, which is of the order of one
DISPLACEMENT, FORCE, DEFORMATION = "displacement", "force", "deformation"


@dataclass(frozen=True)
class Signal:
    """A signal (T, c) of the free run, the half width (T, c) of its 95 % band, the truth if known.

    Samples that are not scored are NaN in all three.
    """

    run: Tensor
    half: Tensor
    truth: Tensor | None = None

    def coverage(self, truth: Tensor) -> float:
        """Share of the true samples (T, c) within the band, of those that are scored."""
        scored = ~self.half.isnan()
        inside = (truth - self.run).abs() <= self.half
        return float(inside[scored].double().mean())


@torch.no_grad()
def unmeasured(estimator: Composite, found: Laplace, record: Record) -> Mapping[str, Signal]:
    """Displacements [m], forces [N] and deformations [m] of the elements of one record.

    {} where the record begins in a motion that is not known: its beginning, searched for, has an
    error that these bands would not show.
    """
    if record.initial_state == "unknown":
        return {}
    problem = FreeRunProblem(estimator, record, None)
    drive = problem.record.drive()

    def run() -> dict[str, Tensor]:
        trace = estimator.trace(drive)
        signals = {DISPLACEMENT: trace.response.x, FORCE: trace.forces}
        signals |= {DEFORMATION: trace.deformations}
        return {name: signal[-record.samples :].cpu() for name, signal in signals.items()}

    own = run()
    variance = _variance(estimator, found, run)
    substeps = estimator.substeps
    try:
        estimator.substeps = min(FINER * substeps, MOST)
        finer = run()
    finally:
        estimator.substeps = substeps
    bands = {}
    for name, signal in own.items():
        half = NORMAL * variance[name].sqrt() + (finer[name] - signal).abs()
        for each in (signal, half):
            each[: record.warmup] = torch.nan
        bands[name] = Signal(signal, half)
    return bands


def _variance(
    estimator: Composite, found: Laplace, run: Callable[[], dict[str, Tensor]]
) -> dict[str, Tensor]:
    """Σ_j (∂s/∂v_j)² λ_j of each signal. θ is as before when it returns."""
    theta = free_vector(estimator)
    values, vectors = np.linalg.eigh(found.coloured)
    total: dict[str, Tensor] = {}
    try:
        for value, vector in zip(values.clip(min=0.0), vectors.T, strict=True):
            ends = []
            for step in (STEP, -STEP):
                set_free_vector(estimator, theta + step * torch.from_numpy(vector).to(theta))
                ends.append(run())
            for name in ends[0]:
                slope = (ends[0][name] - ends[1][name]) / (2.0 * STEP)
                total[name] = total.get(name, 0.0) + value * slope.square()
    finally:
        set_free_vector(estimator, theta)
    return total
