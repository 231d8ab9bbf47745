"""Peak and residual drifts of elements whose deformation no sensor measured, and how sure they are.

Accelerations hold next to nothing of what stays: noise and an offset, integrated twice, outgrow it
within seconds. So a drift comes from the law, and is as sure as that is.

    Var = g M (S + σ⁴/w²) M gᵀ + mean (Δ²),   M = (JᵀJ + σ²/w²)⁻¹

The first part is what the records leave open of the parameters, g the slope of the drift by θ: θ is
Normal about its start, w wide, S the covariance of the scores under noise with the spectrum of the
residual (laplace.py). How far the fit is from the mode of that counts as a bias. The second part is
of what the model does not explain: e = ẍ − ẍ_run is put back as forces on the masses, block by
block with random weights (wild bootstrap; Liu 1988, Shao 2010), which moves the drift by Δ.
T samples, n DOFs, E elements, P parameters.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from data.parallel import in_threads
from data.record import Drive, Record
from models.composition.coefficients import Part
from models.composition.simulate import DISPLACEMENT
from models.element_network import ElementNetwork
from models.fit.trained_range import names_of
from models.uncertainty.intervals import along, off_centre
from models.uncertainty.laplace import FEWEST_BLOCKS, NORMAL, OPEN, Laplace, stated_widths

LAST = 0.05  # of a motion, at its end, whose mean is called residual
DRAWS = 32  # of the weights: their spread is then known to an eighth of itself


def residual_of(signal: np.ndarray) -> np.ndarray:
    """Mean (…) of the last part of a signal (T, …)."""
    return np.asarray(signal[-max(1, round(LAST * len(signal))) :].mean(axis=0))


@torch.no_grad()
def drifts(
    estimator: ElementNetwork, found: Laplace, record: Record
) -> list[dict[str, float | str]]:
    """Peak and residual of every element in the free run of a record, and their `half` widths [m].

    [] where the record begins in a motion that is not known; without elements whose drift diverges
    in a run that is as likely.
    """
    if record.initial_state == "unknown":
        return []
    drive = record.drive()
    run = estimator.trace(drive)
    y = run.deformations.cpu().numpy()
    own, by_theta = _sizes(run.deformations), _slopes(estimator, drive, y)
    covariance, step = _posterior(estimator, found)
    deviation = np.sqrt(along(by_theta, covariance))
    bias = np.abs(by_theta @ step) + np.abs(by_theta @ found.numerical)
    left_out = (record.a - run.response.a)[record.warmup :]
    moved = [_sizes(y) - own for y in _put_back(estimator, drive, left_out)]
    half = np.hypot(off_centre(deviation, bias), NORMAL * np.sqrt(np.square(moved).mean(axis=0)))
    return _rows(estimator, own, half)


@torch.no_grad()
def drifts_of_likely(estimator: Any, record: Record) -> list[dict[str, float | str]]:
    """Those of an ElementNetworkNamed, by the spread of its laws that are as likely.

    Each runs with another noise in the measured motion of a base, as large as it was in training.
    """
    drive, draw = record.drive(), torch.Generator().manual_seed(0)
    noise = float(estimator.noise_of_ground)

    def noisy(laws: Any) -> tuple[Any, Drive]:
        u = drive.u.clone()
        if noise:
            u[..., 0] += noise * torch.randn(len(u), generator=draw, dtype=u.dtype)
        return laws.structure(), replace(drive, u=u)

    jobs = [noisy(laws) for laws in estimator.likely()]
    traces = in_threads(lambda job: estimator.trace_of(*job), jobs)
    own = _sizes(estimator.trace(drive).deformations)
    moved = np.array([_sizes(trace.deformations) - own for trace in traces])
    return _rows(estimator, own, NORMAL * np.sqrt(np.square(moved).mean(axis=0)))


def _sizes(deformations: Tensor) -> np.ndarray:
    """Peak and residual (2E,) of every element."""
    y = deformations.cpu().numpy()
    return np.concatenate([np.abs(y).max(axis=0), residual_of(y)])


def _rows(estimator: ElementNetwork, own: np.ndarray, half: np.ndarray) -> list[dict[str, Any]]:
    rows = []
    numbers = np.concatenate([own, half]).reshape(4, -1).T.tolist()
    for e, (pair, four) in enumerate(zip(names_of(estimator), numbers, strict=True), start=1):
        keys = ("peak", "residual", "peak_half", "residual_half")
        if np.isfinite(four).all():
            rows.append({"element": f"r{e} {pair}", **dict(zip(keys, four, strict=True))})
    return rows


def _slopes(estimator: ElementNetwork, drive: Drive, y: np.ndarray) -> np.ndarray:
    """∂/∂θ (2E, P) of peaks and residuals of deformations y (T, E), exact: y = D x + supports."""
    of_x = torch.full_like(estimator.measures, DISPLACEMENT)
    seen = replace(estimator.composition(), measures=of_x)
    J = estimator.traced(seen, drive, estimator.substeps, derivatives=True).jacobian.cpu().numpy()
    D, at, every = seen.D.value.cpu().numpy(), np.abs(y).argmax(axis=0), np.arange(y.shape[1])
    peaks = np.sign(y[at, every])[:, None] * np.einsum("en,enp->ep", D, J[at])
    return np.concatenate([peaks, D @ residual_of(J)])


def _posterior(estimator: ElementNetwork, found: Laplace) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (P, P) of θ about its mode, and the step (P,) from the fit to that."""
    width = np.full(len(found.step), OPEN)
    for number, stated in stated_widths(estimator).items():
        width[number] = stated
    squares = sum(float((e**2).sum()) for e in found.residuals)
    variance = squares / max(found.samples - found.determined, 1.0)
    held = variance / width**2
    inverse = np.linalg.inv(variance * found.information + np.diag(held))
    score = sum(
        np.einsum("tn,tnp->p", e, J) for e, J in zip(found.residuals, found.jacobians, strict=True)
    )
    away = estimator.pull(True)[1].detach().cpu().numpy()
    scatter = found.noise.score_covariance(found.jacobians) + np.diag(variance * held)
    return inverse @ scatter @ inverse, inverse @ (score - held * away)


def _put_back(estimator: ElementNetwork, drive: Drive, left_out: Tensor) -> Iterator[Tensor]:
    """Deformations (T, E) of runs in which what the model left out [m/s²] acts on the masses."""
    composed = estimator.composition()
    n, E = left_out.shape[1], composed.supports.shape[1]
    inputs = torch.cat([composed.inputs.value, torch.eye(n, dtype=torch.float64)], dim=1)
    supports = torch.cat([composed.supports, composed.supports.new_zeros(2, E, n)], dim=2)
    more = replace(composed, inputs=Part.fixed(inputs), supports=supports)
    place = torch.arange(len(left_out)) * FEWEST_BLOCKS // len(left_out)
    before = left_out.new_zeros(drive.samples - len(left_out), n)
    draw = torch.Generator().manual_seed(0)
    for _ in range(DRAWS):
        weights = torch.randn(FEWEST_BLOCKS, generator=draw, dtype=torch.float64)[place, None]
        u = torch.cat([drive.u, torch.cat([before, weights * left_out])], dim=1)
        run = estimator.traced(more, replace(drive, u=u), estimator.substeps)
        yield run.deformations
