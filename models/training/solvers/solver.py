"""What every solver has."""

from __future__ import annotations

from typing import Protocol

from models.training.problem import Problem


class Solver(Protocol):
    """A torch.optim.Optimizer that is handed a problem, not a closure."""

    full_batch: bool  # needs all windows in one batch
    finished: bool  # converged, or out of iterations
    why: str  # in words, once finished

    def solve(self, problem: Problem) -> list[float]:
        """Improve the parameters; the loss after each accepted iteration."""
        ...
