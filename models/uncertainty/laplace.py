"""How far the minimum of a fit may lie from the truth, to second order about it (Laplace).

θ̂ − θ = A⁻¹ (Jᵀe − w∘(θ̂ − θ₀)),   A = JᵀJ + diag w

J is the exact Jacobian of the free run over all training records, e the noise, w the prior's
weights. The first term has the covariance A⁻¹ S A⁻¹, S that of the scores Jᵀe: of white noise
(S = σ² JᵀJ), of noise with the spectrum of the residual (noise.py), or, whatever the residual
may be, from its scores over blocks of the records (batch means). The second is what the prior holds
back: parameters that no data move may lie anywhere about their start, `OPEN` units of θ away; those
with a stated prior lie as far from its mean as that says.

What the integrator of the run errs by is no noise: runs in finer steps differ from those of the fit
by d, which moves the minimum by A⁻¹ Jᵀd.

P free parameters, T samples, n channels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data.memory import require_memory
from data.record import Record, singles
from models.composition.composite import Composite
from models.fit.problem import FreeRunProblem
from models.fit.trainable import Trainable
from models.uncertainty.noise import Noise, noise_of

OPEN = 3.0  # standard deviation of a parameter without data, in units of θ
NORMAL = 1.96  # standard deviations, 95 %
CONTRADICTED = 3.0  # standard deviations between records and a stated prior
FEWEST_BLOCKS = 8
FINER = 4  # times as many steps: the error of a method of second order falls to a sixteenth
FLOOR = 1e-12  # of the largest entry of JᵀJ: weight of a prior that is none


@dataclass(frozen=True)
class Laplace:
    """Covariances (P, P) of θ̂, and the step (P,) that the solver left to the minimum.

    numerical (P,): how far the integrator's own error moves the minimum.

    white, coloured: by the noise, with what the prior holds back in both; coloured without stated
    priors that the records contradict. colour (P,): the
    ratio of these variances by noise alone. blocks (m, P): steps
    that each block of the records asks for by itself. weight (n,): by which errors of each channel
    were multiplied. tension (k,): how far data and each stated prior are apart, in standard
    deviations of that; without (k, P): the step that is left where that prior is taken away, or
    that a fit without it went, where that contradicts it.
    determined: parameters that the data determine, in the sense of a trace.
    information (P, P): JᵀJ over σ². inverse (P, P): A⁻¹. held (P,): w. residuals (T, n),
    jacobians (T, n, P): of each record, weighted.
    """

    white: np.ndarray
    coloured: np.ndarray
    blocks: np.ndarray
    step: np.ndarray
    numerical: np.ndarray
    information: np.ndarray
    noise: Noise
    colour: np.ndarray
    determined: float
    weight: np.ndarray
    tension: np.ndarray
    without: np.ndarray
    samples: int
    inverse: np.ndarray
    held: np.ndarray
    residuals: list[np.ndarray]
    jacobians: list[np.ndarray]

    @property
    def log_likelihood(self) -> float:
        """Of the residual in the units of the record, under noise with its spectrum."""
        each = self.samples / len(self.weight)
        return self.noise.log_likelihood + each * float(np.log(self.weight).sum())


@torch.no_grad()
def laplace(
    estimator: Trainable, batches: Iterable[Record], prior: float | None = None
) -> Laplace | None:
    """Laplace's approximation at the present parameters, from the training records.

    prior: the weight that the fit ended with, as in `Trainable.pull`. None where a free run has no
    exact Jacobian, or no parameter. Raises ValueError for a free run that is not finite.
    """
    residuals, jacobians, finer, targets = [], [], [], []
    for record in singles(batches):
        problem = FreeRunProblem(estimator, record, None)
        both = estimator.restarted_jacobian(problem.record, None)
        if both is None or both[1].shape[-1] == 0:
            return None
        run, jacobian = (part[problem.counted].cpu() for part in both)
        targets.append(problem.y.cpu())
        residuals.append((targets[-1] - run).numpy())
        jacobians.append(jacobian.numpy())
        finer.append((finer_run(estimator, problem)[problem.counted].cpu() - run).numpy())
    if not residuals:
        return None
    measured = torch.cat([y.reshape(-1, y.shape[-1]) for y in targets])
    channels = estimator.weights_of_channels()
    each = torch.ones_like(measured[0]) if channels is None else channels.cpu()
    size = measured.numel() ** 0.5 / float(torch.linalg.vector_norm(each * measured))
    weight = (size * each).numpy()
    residuals = [weight * e for e in residuals]
    noise = sum(float((e**2).sum()) for e in residuals) / measured.numel() ** 2
    wide, deviation = estimator.pull(True, prior, noise)
    held = measured.numel() * torch.as_tensor(wide).cpu().expand_as(deviation)
    return about(
        residuals,
        [weight[:, None] * J for J in jacobians],
        held.numpy(),
        deviation.detach().cpu().numpy(),
        weight,
        [weight * d for d in finer],
        stated_widths(estimator),
        estimator.away.cpu().numpy() if isinstance(estimator, Composite) else None,
    )


def stated_widths(estimator: Trainable) -> dict[int, float]:
    """{number of a free parameter: standard deviation of its stated prior, in units of θ}."""
    if not isinstance(estimator, Composite):
        return {}
    numbers = zip(estimator.numbers_of_stated(), estimator.stated, strict=True)
    return {number: one.width for number, one in numbers if number >= 0}


def about(
    residuals: list[np.ndarray],
    jacobians: list[np.ndarray],
    held: np.ndarray,
    deviation: np.ndarray,
    weight: np.ndarray | None = None,
    finer: list[np.ndarray] | None = None,
    stated: Mapping[int, float] | None = None,
    away: np.ndarray | None = None,
) -> Laplace:
    """Of residuals (T, n) = y − run and Jacobians (T, n, P) of every record.

    held, deviation (P,): weights w of a prior, and θ̂ − θ₀. finer (T, n): what runs in finer steps
    differ by. stated: {number: standard deviation} of parameters with a stated prior. away (P,):
    the step to a fit without these, where that contradicts them, else nil.
    """
    P = jacobians[0].shape[-1]
    samples = sum(e.size for e in residuals)
    largest = max(len(e) for e in residuals)
    require_memory(
        40.0 * largest * jacobians[0].shape[1] * P,
        f"intervals of {P} parameters from {largest} samples",
        "take shorter records",
    )
    if not all(np.isfinite(e).all() for e in residuals):
        raise ValueError("the free run of the training motion is not finite: it has no intervals")
    gram = np.zeros((P, P))
    for J in jacobians:
        rows = J.reshape(-1, P)
        gram += rows.T @ rows
    if not np.isfinite(gram).all():
        raise ValueError("the derivatives of the free run are not finite: it has no intervals")
    held = np.maximum(held, FLOOR * gram.diagonal().max())
    size = np.sqrt(gram.diagonal() + held)  # scaled, so that units of θ do not matter
    root = np.linalg.cholesky((gram + np.diag(held)) / np.outer(size, size))
    inverse = np.linalg.inv(root) / size[None, :]  # R⁻¹ of A = R Rᵀ
    A = inverse.T @ inverse
    free = float(((inverse @ gram) * inverse).sum())  # parameters that the data determine
    variance = sum(float((e**2).sum()) for e in residuals) / max(samples - free, 1.0)
    noise = noise_of(residuals, jacobians, inverse.T)
    width = np.full(P, OPEN)
    chosen = np.array(list(stated or {}), dtype=int)
    width[chosen] = list((stated or {}).values())
    back = A * (held * width)  # of what the prior holds back
    unknown = back @ back.T
    white, coloured = variance * A @ gram @ A, A @ noise.score_covariance(jacobians) @ A
    with np.errstate(divide="ignore", invalid="ignore"):
        colour = np.nan_to_num(coloured.diagonal() / white.diagonal(), nan=1.0, posinf=1.0)
    white, coloured = white + unknown, coloured + unknown
    share = (held * A.diagonal())[chosen]  # of what holds each, its prior's
    apart = coloured.diagonal()[chosen] + width[chosen] ** 2 * (1.0 - 2.0 * share)
    tension = deviation[chosen] / np.sqrt(apart.clip(min=np.finfo(float).tiny))
    pull = (held * deviation)[chosen] / (1.0 - share).clip(min=np.finfo(float).eps)
    without = pull[:, None] * A[chosen]
    if away is not None and away.any():
        far = np.abs(away[chosen]) / width[chosen]
        gone = far >= min(CONTRADICTED, far.max())
        tension[gone], without[gone] = np.maximum(far[gone], 1.01 * CONTRADICTED), away
    coloured = _without(coloured, A, held, width, chosen[np.abs(tension) > CONTRADICTED])
    scores = _scores(residuals, jacobians, inverse.T)
    pulled = scores.sum(axis=0) - held * deviation
    moved = _scores(finer, jacobians, inverse.T).sum(axis=0) if finer else np.zeros(P)
    return Laplace(
        white=white,
        coloured=coloured,
        blocks=scores @ A,
        step=A @ pulled,
        numerical=A @ moved,
        information=gram / variance if variance > 0.0 else gram * np.inf,
        noise=noise,
        colour=colour,
        determined=free,
        weight=np.ones(residuals[0].shape[1]) if weight is None else weight,
        tension=tension,
        without=without,
        samples=samples,
        inverse=A,
        held=held,
        residuals=residuals,
        jacobians=jacobians,
    )


def _without(
    coloured: np.ndarray,
    inverse: np.ndarray,
    held: np.ndarray,
    width: np.ndarray,
    which: np.ndarray,
) -> np.ndarray:
    """Covariance (P, P) where some stated priors are taken away; A⁻¹ by Sherman & Morrison."""
    A = inverse
    for j in which:
        u, w = A[:, j], held[j]
        more = np.outer(u, np.eye(len(A))[j]) * w / max(1.0 - w * u[j], np.finfo(float).eps)
        own = w * width[j] * u  # what its spread adds
        M = np.eye(len(A)) + more
        coloured, A = M @ (coloured - np.outer(own, own)) @ M.T, M @ A
    return coloured


def _scores(
    residuals: list[np.ndarray], jacobians: list[np.ndarray], root: np.ndarray
) -> np.ndarray:
    """Jᵀe (m, P) of blocks, each of one record, that tell about as much of the parameters.

    root: R⁻ᵀ (P, P) of JᵀJ = R Rᵀ. Of blocks of equal length the strongest part would decide alone.
    """
    told = [np.square(J @ root).sum(axis=(1, 2)).cumsum() for J in jacobians]
    least = sum(each[-1] for each in told) / FEWEST_BLOCKS
    found = []
    for e, J, own in zip(residuals, jacobians, told, strict=True):
        parts = max(1, math.ceil(own[-1] / least))
        ends = 1 + np.searchsorted(own, own[-1] * np.arange(1, parts) / parts)
        for block in np.split(np.arange(len(e)), ends):
            found.append(np.einsum("tn,tnp->p", e[block], J[block]))
    return np.stack(found)


@torch.no_grad()
def finer_run(estimator: Trainable, problem: FreeRunProblem) -> Tensor:
    """The run of a problem (T, n) in FINER times as many steps, where an estimator has steps.

    It follows the Jacobian of the same problem at once, whose unknown beginning it starts from.
    """
    if isinstance(estimator, Composite):
        return estimator.finer_run(problem.record, FINER)
    return estimator.restarted_run(problem.record, None)
