"""The linear equations of motion solved, also with bounds, and what of them the record leaves open.

[inertia | springs | dampers] [m; k; c] = f      columns are scaled to unit length: no unit counts
N equations, P unknowns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

RANK = 1e-7  # of the largest singular value, of scaled columns
TAKES_PART = 0.1  # share of an unknown in a combination that is left open


def least_squares(unknown: Tensor, target: Tensor) -> np.ndarray:
    """The solution (P,) of N equations (N, P), whatever the units of the unknowns."""
    lengths = torch.linalg.vector_norm(unknown, dim=0)
    lengths = torch.where(lengths > 0.0, lengths, 1.0)
    solved = torch.linalg.lstsq(unknown / lengths, target[:, None], driver="gelsd").solution
    return np.asarray((solved[:, 0] / lengths).numpy())


def triangle(unknown: Tensor, target: Tensor) -> np.ndarray:
    """R (P + 1, P + 1) of [unknown, target]: all that least squares has to know of N equations."""
    rows = np.column_stack([unknown.numpy(), target.numpy()])
    factor = np.asarray(np.linalg.qr(rows, mode="r"))
    missing = rows.shape[1] - len(factor)
    return np.vstack([factor, np.zeros((missing, rows.shape[1]))]) if missing > 0 else factor


def not_negative(factor: np.ndarray) -> np.ndarray:
    """The solution (P,) with no unknown below zero."""
    from scipy.optimize import nnls  # slow to import

    lengths = _lengths(factor)
    solution, _ = nnls(factor[:, :-1] / lengths, factor[:, -1], maxiter=100 * len(lengths))
    return np.asarray(solution / lengths)


def left_open(factor: np.ndarray, names: Sequence[str]) -> tuple[int, list[str]]:
    """Number of unknowns that the equations determine, and the names of those that they do not."""
    _, sizes, directions = np.linalg.svd(factor[:, :-1] / _lengths(factor))
    rank = int((sizes > RANK * sizes[0]).sum()) if len(sizes) else 0
    share = (directions[rank:] ** 2).sum(axis=0)
    return rank, [name for name, part in zip(names, share, strict=True) if part > TAKES_PART]


def _lengths(factor: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(factor[:, :-1], axis=0)
    return np.where(lengths > 0.0, lengths, 1.0)
