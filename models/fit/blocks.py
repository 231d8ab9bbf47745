"""Blocks of records that are held back in turn, for models that are linear in their weights.

y = Φ w, the features Φ made from the excitation alone: Gram matrices of blocks add up, and the
error on a block that was left out costs no simulation.
T samples, P features, q outputs, K blocks.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, NamedTuple

import numpy as np
import torch
from torch import Tensor

from data.record import Drive, Record, Response, singles
from models.estimator import Estimator
from models.fit.problem import in_steady_state
from models.layers.integrate import integrated

PATIENCE = 3  # numbers of poles or modes tried in turn without gain, after which no more are tried
BLOCKS = 5  # held back in turn: fewer tell no standard error, more cost a fit each
ROUNDING = 1e-10  # squared relative error that rounding of normal equations leaves
SMALL = 0.005  # misfit over what it is of: where it is less, nothing larger is tried


@dataclass(frozen=True)
class Motion:
    """One record: excitation u (T, m); y (T, q), what was measured, of which `first` counts."""

    u: np.ndarray
    y: np.ndarray
    first: int  # sample

    def size(self, outputs: int) -> Tensor:
        """Squares (1, T) of the first outputs, where they count."""
        squares = np.square(self.y[:, :outputs]).sum(axis=1)
        squares[: self.first] = 0.0
        return torch.from_numpy(squares)[None]


class Piece(NamedTuple):
    motion: int
    start: int
    stop: int


def motions_of(batches: Iterable[Record]) -> list[Motion]:
    """Motions of records and of batches of them; y is [a, x, v], or a where x, v are unknown.

    Raises ValueError where nothing drives them.
    """
    motions = []
    for one in singles(batches):
        record = in_steady_state(one) if one.initial_state == "periodic" else one
        known = record.x is not None and record.v is not None
        outputs = [u for u in (record.a, record.x, record.v) if u is not None]
        y = torch.cat(outputs, dim=-1) if known else record.a
        motions.append(Motion(record.excitation.cpu().numpy(), y.cpu().numpy(), record.warmup))
    if motions[0].u.shape[1] == 0:
        raise ValueError(
            "nothing drives the motion: a model of the excitation alone cannot follow it; give the "
            "record forces or the motion of a support"
        )
    return motions


def blocks_of(motions: Sequence[Motion], dofs: int) -> list[list[Piece]]:
    """All motions, one after the other, cut into BLOCKS of equal power.

    Were each motion a block, a strong one would outweigh the others, and the scatter of the blocks
    would be its own. Raises ValueError for motions too short, or too still, to be cut.
    """
    ends = np.cumsum([len(motion.u) for motion in motions])
    power = np.cumsum(np.concatenate([motion.size(dofs)[0].numpy() for motion in motions]))
    cuts = np.searchsorted(power, power[-1] * np.arange(1, BLOCKS) / BLOCKS)
    blocks = []
    for first, last in pairwise([0, *cuts.tolist(), int(ends[-1])]):
        pieces = [
            Piece(i, max(first - end + len(m.u), m.first), min(last - end, 0) + len(m.u))
            for i, (m, end) in enumerate(zip(motions, ends.tolist(), strict=True))
        ]
        blocks.append([piece for piece in pieces if piece.start < piece.stop])
    if not (power[-1] > 0.0 and all(blocks)):
        raise ValueError("the records are too short, or too still, to hold a part of them back")
    return blocks


def errors_by_block(records: Sequence[Record], estimates: Sequence[Tensor]) -> np.ndarray:
    """Squared errors (K,) of estimates (…, T, n) on blocks; their mean is that of Eq. 21, squared.

    Raises ValueError for records too short, or too still, to be cut.
    """
    return each_by_block(records, [estimates])[0]


def each_by_block(records: Sequence[Record], several: Sequence[Sequence[Tensor]]) -> np.ndarray:
    """`errors_by_block` (E, K) of several estimates of the same records, which are cut once."""
    measured = [r.a.cpu().reshape(r.a.shape[:-2].numel(), *r.a.shape[-2:]) for r in records]
    pairs = zip(measured, records, strict=True)
    motions = [Motion(own, own, r.warmup) for a, r in pairs for own in a.numpy()]
    dofs = motions[0].y.shape[1]
    blocks = blocks_of(motions, dofs)
    sums = []
    for one in several:
        errors = [(e.cpu().view_as(a) - a).numpy() for e, a in zip(one, measured, strict=True)]
        squares = [np.square(own).sum(axis=1) for error in errors for own in error]
        sums.append([sum(squares[p.motion][p.start : p.stop].sum() for p in own) for own in blocks])
    return np.array(sums) / sizes_of(motions, blocks, dofs).mean()


def beyond_chance(one: np.ndarray, other: np.ndarray) -> float:
    """How much larger `other` (K,) is than `one`, in standard errors of the blocks' differences."""
    worse = other - one
    mean, spread = float(worse.mean()), float(worse.std(ddof=1)) / math.sqrt(len(worse))
    return mean / spread if spread > 0.0 else math.copysign(math.inf, mean) if mean else 0.0


def sizes_of(motions: Sequence[Motion], blocks: Sequence[Sequence[Piece]], dofs: int) -> np.ndarray:
    """Squares (K,) of the first `dofs` outputs in each block."""
    squares = [motion.size(dofs)[0] for motion in motions]
    return np.array(
        [sum(float(squares[p.motion][p.start : p.stop].sum()) for p in own) for own in blocks]
    )


@dataclass(frozen=True)
class Grams:
    """ΦᵀΦ (K, P, P) and Φᵀy (K, P, q) of blocks, and the squares (K,) of the first `dofs` y."""

    features: np.ndarray
    targets: np.ndarray
    sizes: np.ndarray
    dofs: int

    def first(self, count: int) -> Grams:
        """With the first features alone."""
        return Grams(
            self.features[:, :count, :count], self.targets[:, :count], self.sizes, self.dofs
        )

    def weights(self, ridge: float, without: int | None = None) -> np.ndarray:
        """Weights (P, q) by all blocks but one. ridge > 0, on columns of unit length."""
        from scipy.linalg import cho_factor, cho_solve  # slow to import

        matrix, right = self.features.sum(axis=0), self.targets.sum(axis=0)
        if without is not None:
            matrix, right = matrix - self.features[without], right - self.targets[without]
        length = np.sqrt(np.maximum(matrix.diagonal(), 0.0))
        length[length == 0.0] = 1.0
        matrix = matrix / length / length[:, None]
        matrix[np.diag_indices_from(matrix)] += ridge
        factor = cho_factor(matrix, overwrite_a=True, check_finite=False)
        return np.asarray(cho_solve(factor, right / length[:, None]) / length[:, None])

    def held_back_error(self, ridge: float, k: int) -> float:
        """Squared relative error on block k, by weights that all others determine."""
        w, c = self.weights(ridge, without=k)[:, : self.dofs], self.targets[k][:, : self.dofs]
        error = float(self.sizes[k] + np.sum(w * (self.features[k] @ w - 2.0 * c)))
        return max(error, 0.0) / self.sizes[k] if math.isfinite(error) else math.inf


def fewest(errors: np.ndarray) -> int:
    """The first of candidates that is as good as the best: within one standard error.

    errors (C, K): of candidates with ever more parameters, on held-back blocks. The standard error
    is that of the blocks' differences. Raises ValueError where no candidate has an error.
    """
    means = errors.mean(axis=1)
    best = int(means.argmin())
    if not np.isfinite(means[best]):
        raise ValueError("no model of the excitation follows the motion; look for outliers in it")
    worse = errors - errors[best]
    with np.errstate(invalid="ignore"):  # an infinite error has no deviation, and is not chosen
        allowed = worse.std(axis=1, ddof=1) / math.sqrt(errors.shape[1]) + ROUNDING
    return int(np.argmax(worse.mean(axis=1) <= allowed))


def scales_of(signals: Sequence[np.ndarray]) -> np.ndarray:
    """RMS of each channel over all (T, c); one of a silent channel."""
    rms = np.sqrt(np.mean(np.square(np.concatenate(signals)), axis=0))
    return np.where(rms > 0.0, rms, 1.0)


class FromExcitation(Estimator):
    """Estimates from the excitation alone: each is a free run, from rest at a record's beginning.

    Displacements and velocities are outputs of their own where they were measured, else integrals
    of the accelerations.
    """

    reads: ClassVar[tuple[str, ...]] = ("f",)
    on_processor: ClassVar[bool] = True
    weights: Tensor  # (features, m, 3n) of [a, x, v], nil for what was not measured

    def outputs(self, u: Tensor) -> Tensor:
        """[a, x, v] (…, T, 3n) under an excitation (…, T, m)."""
        raise NotImplementedError

    def forward(self, record: Record) -> Tensor:
        return self.outputs(record.excitation)[..., : self.dofs]

    def free_run(self, drive: Drive) -> Response:
        a, x, v = self.outputs(drive.u).split(self.dofs, dim=-1)
        known = bool(self.weights[..., self.dofs :].any())
        return Response(x, v, a) if known else integrated(a, drive)


def smooth_part(left: np.ndarray, channels: int = 1) -> float:
    """Squared misfit in an error (T · channels,): its autocovariance at a lag of 1, summed.

    A misfit is smooth; neighbouring samples of white noise have nothing in common.
    """
    return float(left[channels:] @ left[:-channels])


def is_noise(left: np.ndarray, small: float = SMALL, channels: int = 1) -> bool:
    """Whether an error (T · channels,), over the size of what it is of, is white or small."""
    if not np.isfinite(left).all():
        return False
    white = 2.0 / math.sqrt(left.size) * float(left @ left)
    return smooth_part(left, channels) <= max(white, small**2)
