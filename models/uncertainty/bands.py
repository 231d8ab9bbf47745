"""Bands about a free run: where 95 % of what is measured of another motion should lie.

Var = J Σ Jᵀ + σ²: what the parameters leave open, Σ their covariance, and the sensors' noise. J is
the exact Jacobian of the run of that motion. What training never moved may be moved there: the band
widens where it is.   T samples, n channels, P parameters.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from data.record import Record
from models.fit.problem import FreeRunProblem
from models.fit.trainable import Trainable
from models.uncertainty.laplace import NORMAL, Laplace, finer_run


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
