"""What Levenberg–Marquardt minimises of a modal network: the error of its free runs.

mean((w (o − y))²) + prior Σ θ²; the first states of motions that begin unknown are fitted along.
T samples, o outputs, P learned parameters, S numbers of a first state.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from data.parallel import in_threads
from models.modal.excitation import Excited
from models.modal.layout import Layout
from models.modal.run import BLOCK, blocks


@dataclass(frozen=True)
class Motion:
    """A record in units of the model: what drives it, its outputs (T, o) and their weights (o,)."""

    excited: Excited
    y: np.ndarray
    weight: np.ndarray
    unknown: bool  # how it begins; else at rest
    stop: int  # samples before this one are fitted, those from there on are held back
    first: int = 0  # sample of the excitation at which y begins: after a period that settles

    def of(self, out: np.ndarray) -> np.ndarray:
        """What stands beside y of a run (·, o) of the whole excitation."""
        return out[self.first : self.first + len(self.y)]

    @property
    def periodic(self) -> bool:
        """One period of a steady state; the excitation has it twice."""
        return self.first > 0


@dataclass
class State:
    """All numbers of a model in training: parameters (size,), first states (motions, S)."""

    values: np.ndarray
    begins: np.ndarray

    def copy(self) -> State:
        return State(self.values.copy(), self.begins.copy())


class ModalProblem:
    """Loss and normal equations by the `learned` parameters and the first states."""

    steepest = float("inf")

    def __init__(
        self,
        layout: Layout,
        motions: Sequence[Motion],
        state: State,
        learned: np.ndarray,
        prior: float = 0.0,
    ) -> None:
        self.layout, self.motions, self.learned, self.prior = layout, motions, learned, prior
        self.state = state.copy()
        self.theta = nn.Parameter(torch.from_numpy(state.values[learned].copy()))
        self.free = [self.theta]
        self.unknown = [i for i, motion in enumerate(motions) if motion.unknown]
        self.own: Sequence[Tensor] = [torch.from_numpy(state.begins[self.unknown].ravel().copy())]
        count = sum(motion.stop * motion.y.shape[1] for motion in motions)
        self.y = torch.zeros(1, dtype=torch.float64).expand(count)

    def now(self) -> State:
        """The state at the present parameters."""
        state = self.state.copy()
        state.values[self.learned] = self.theta.detach().numpy()
        state.begins[self.unknown] = self.own[0].numpy().reshape(-1, self.layout.states)
        return state

    def errors(
        self, state: State, number: int, derived: bool
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """w (o − y) (t·o,) and its derivatives (t·o, P + S), block by block of a motion."""
        motion = self.motions[number]
        last = motion.first + motion.stop
        with np.errstate(all="ignore"):
            runs = blocks(
                self.layout, state.values, motion.excited, state.begins[number],
                self.learned if derived else None, derived and motion.unknown, last,
            )  # fmt: skip
            for k, (out, _, jacobian) in enumerate(runs):
                counted = slice(min(max(0, motion.first - k * BLOCK), len(out)), None)
                at = k * BLOCK - motion.first + counted.start
                y = motion.y[at : at + len(out) - counted.start]
                rows = motion.weight[:, None] * jacobian[counted]
                rows = rows.reshape(len(rows) * out.shape[1], rows.shape[2])
                lost = 0.0 if np.isfinite(out[-1]).all() else np.nan
                yield (motion.weight * (out[counted] - y)).ravel() + lost, rows

    def loss(self) -> Tensor:
        """Mean square error, and the prior; NaN where a run diverged."""
        state = self.now()

        def squares(number: int) -> float:
            return sum(float(e @ e) for e, _ in self.errors(state, number, False))

        theta = state.values[self.learned]
        total = sum(in_threads(squares, range(len(self.motions))))
        return torch.tensor(total / len(self.y) + self.prior * float(theta @ theta))

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        """JᵀJ and Jᵀe by the parameters, then by the first states of one motion after the other."""
        state, P, S = self.now(), int(self.learned.sum()), self.layout.states

        def sums(number: int) -> tuple[np.ndarray, np.ndarray]:
            width = P + (S if self.motions[number].unknown else 0)
            matrix, vector = np.zeros((width, width)), np.zeros(width)
            for e, rows in self.errors(state, number, True):
                matrix += rows.T @ rows
                vector += rows.T @ e
            return matrix, vector

        whole = P + len(self.unknown) * S
        matrix, vector = np.zeros((whole, whole)), np.zeros(whole)
        for number, (part, side) in enumerate(in_threads(sums, range(len(self.motions)))):
            place = np.arange(P)
            if self.motions[number].unknown:
                start = P + self.unknown.index(number) * S
                place = np.r_[place, start : start + S]
            matrix[np.ix_(place, place)] += part
            vector[place] += side
        pull = len(self.y) * self.prior
        matrix[np.arange(P), np.arange(P)] += pull
        vector[:P] += pull * state.values[self.learned]
        return torch.from_numpy(matrix), torch.from_numpy(vector)
