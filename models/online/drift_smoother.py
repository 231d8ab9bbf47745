"""Drifts of all storeys by all samples of a record: the filter forwards, its adjoint backwards.

    ŝ = s − C λ,   Ĉ = C − C Λ C

λ, Λ gather what later samples say (modified Bryson–Frazier smoother; Bierman 1973). No covariance
is inverted, many of which are singular: at rest, of memories, of zeros.   D numbers in s, E storeys
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from models.online.drift_filter import DriftFilter
from models.uncertainty.laplace import NORMAL

Adjoint = tuple[np.ndarray, np.ndarray]  # λ (D,) and Λ (D, D)


class DriftSmoother(DriftFilter):
    """A filter that remembers its steps, so that the drifts of a whole record can be smoothed."""

    keeps = True

    def __init__(self, *settings: Any) -> None:
        super().__init__(*settings)
        self.back: list[Callable[[np.ndarray, np.ndarray], Adjoint]] = []
        self.missed = self.freedom = 0.0
        self.rows: list[np.ndarray] = []  # drifts and variances, the last sample first

    def predict(self, *drive: Any) -> np.ndarray:
        self.moved = np.eye(len(self.s))
        predicted = super().predict(*drive)
        self._go_on(self.moved)
        return predicted

    def _go_on(self, F: np.ndarray) -> None:
        """Remember a step to F s (D, D), most of whose rows are those of the unit matrix."""
        rows = np.flatnonzero((np.eye(len(F)) != F).any(axis=1))
        own = F[rows]

        def before(u: np.ndarray, U: np.ndarray) -> Adjoint:
            kept, half = np.where(np.isin(np.arange(len(u)), rows), 0.0, u), U.copy()
            half[rows] = 0.0
            half += own.T @ U[rows]
            whole = half.copy()
            whole[:, rows] = 0.0
            return kept + own.T @ u[rows], whole + half[:, rows] @ own

        self.back.append(before)

    def _remember(self, new: np.ndarray) -> None:
        before = len(self.s)
        super()._remember(new)
        if len(self.s) > before:
            end = len(self.A) + 1 + self.B.shape[1]
            kept = np.delete(np.arange(len(self.s)), slice(end - len(self.s) + before, end))
            self.back.append(lambda u, U: (u[kept], U[np.ix_(kept, kept)]))

    def _update(self, H: np.ndarray, variances: np.ndarray, left: np.ndarray) -> float:
        CH, innovation = self.C @ H.T, left - H @ self.s
        V = np.linalg.pinv(H @ CH + np.diag(variances))
        K = CH @ V

        def before(u: np.ndarray, U: np.ndarray) -> Adjoint:
            A = np.eye(len(u)) - K @ H
            return A.T @ u - H.T @ V @ innovation, A.T @ U @ A + H.T @ V @ H

        self.back.append(before)
        missed = super()._update(H, variances, left)
        self.missed, self.freedom = self.missed + missed, self.freedom + len(left)
        return missed

    def _find_zero(self, j: int, left: float, variance: float) -> None:
        super()._find_zero(j, left, variance)
        at, T = len(self.A) + 1 + j, np.eye(len(self.s))
        T[at] = -self.H[len(self.sensors) + j]
        T[at, at] = 0.0
        self._go_on(T)

    def correct(self, a: np.ndarray | None, others: np.ndarray | None = None) -> None:
        super().correct(a, others)
        PC = self.of_drifts @ self.C
        drifts, variance = self.own + self.of_drifts @ self.s, (PC * self.of_drifts).sum(axis=1)

        def read(u: np.ndarray, U: np.ndarray) -> Adjoint:
            self.rows.append(np.stack([drifts - PC @ u, variance - ((PC @ U) * PC).sum(axis=1)]))
            return u, U

        self.back.append(read)

    def smoothed(self) -> np.ndarray:
        """Drifts and halves of their 95 % intervals (2, T, E) [m]."""
        self.rows, D = [], len(self.s)
        state = np.zeros(D), np.zeros((D, D))
        for step in reversed(self.back):
            state = step(*state)
        drifts, variances = np.array(self.rows[::-1]).transpose(1, 0, 2)
        wide = max(1.0, self.missed / max(self.freedom, 1.0))
        return np.stack([drifts, NORMAL * np.sqrt(wide * variances.clip(0.0))])
