"""Training on records that begin in an unknown motion: their first states are fitted along.

The states join the model's parameters in every step of the solver, and are dropped afterwards: they
belong to the records. With the other solvers, which know the model's parameters alone, the run
itself eliminates them (models/composition/beginning.py).
B records, T samples, n outputs, P parameters, S numbers of a first state.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from data.record import Record
from models.fit.problem import FreeRunProblem
from models.fit.trainable import Trainable


def begins_unknown(estimator: Trainable, record: Record) -> bool:
    """Whether the first states of the records are to be estimated, and can be."""
    return record.initial_state == "unknown" and estimator.estimates_beginning


class UnknownBeginningProblem(FreeRunProblem):
    """A free run of whole records from first states of their own, which are in `own`."""

    def __init__(
        self,
        estimator: Trainable,
        record: Record,
        last: bool = True,
        prior: float | None = None,
    ) -> None:
        whole = replace(record, warmup=0)  # no sample is lost to a transient
        super().__init__(estimator, whole, None, 0, last, prior)
        self.own = [estimator.first_states(self.record)]  # (B·S,)

    def errors(self) -> Tensor:
        """e (N,) at the present parameters and first states."""
        if torch.is_grad_enabled():
            return super().errors()
        run, _, _ = self.estimator.run_from(self.record, self.own[0], derivatives=False)
        return self._errors(run)

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        """JᵀJ (P + B·S, P + B·S) and Jᵀe, by the parameters and then by the first states."""
        run, by_theta, by_state = self.estimator.run_from(self.record, self.own[0], True)
        B, P, S = self.own[0].numel() // by_state.shape[-1], by_theta.shape[-1], by_state.shape[-1]
        errors = self._errors(run).reshape(B, -1)
        J = (self.weight[..., None] * by_theta).reshape(B, -1, P)
        J0 = (self.weight[..., None] * by_state).reshape(B, -1, S)
        matrix, vector = J.new_zeros(P + B * S, P + B * S), J.new_zeros(P + B * S)
        prior, deviation = self._pull()
        pull = errors.numel() * prior
        matrix[:P, :P] = torch.einsum("btp,btq->pq", J, J) + torch.eye(P).to(J) * pull
        vector[:P] = torch.einsum("btp,bt->p", J, errors) + pull * deviation
        for b in range(B):
            place = slice(P + b * S, P + (b + 1) * S)
            matrix[place, place] = J0[b].T @ J0[b]
            matrix[:P, place] = J[b].T @ J0[b]
            matrix[place, :P] = matrix[:P, place].T
            vector[place] = J0[b].T @ errors[b]
        return matrix, vector


def run_problem(
    estimator: Trainable,
    record: Record,
    horizon: int | None,
    warmup: int = 0,
    last: bool = True,
    prior: float | None = None,
) -> FreeRunProblem:
    """The error of a free run, with first states of its own where those are not known."""
    if horizon is None and begins_unknown(estimator, record):
        return UnknownBeginningProblem(estimator, record, last, prior)
    return FreeRunProblem(estimator, record, horizon, warmup, last, prior)
