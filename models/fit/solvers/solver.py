"""The interface of solvers, and of the problems that they minimise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Protocol

from torch import Tensor

HURRY, SOON = 5.0, 3  # times the usual change; iterations without a gain
OUT_OF_TIME = "the budget of time is spent"  # why a solver ended


class Minimised(Protocol):
    """A mean square of N errors, with the normal equations of P parameters."""

    y: Tensor  # what is fitted, N numbers
    steepest: float  # largest gradient that first-order solvers follow; longer ones are clipped
    own: Sequence[Tensor]  # what is fitted along with the parameters, by solvers of all of J

    def loss(self) -> Tensor:
        """Mean square of the errors."""
        ...

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        """JᵀJ (P, P) and Jᵀe (P,), of the parameters and then of `own`."""
        ...


class Solver(Protocol):
    """A torch.optim.Optimizer that is handed a problem, not a closure."""

    full_batch: bool  # needs all windows in one batch
    iterations: int  # at most
    change: float  # of the loss, less than which is no gain
    patience: int  # iterations without one, after which it ends
    done: int
    finished: bool  # converged, or out of iterations
    why: str  # in words, once finished
    kept: ClassVar[tuple[str, ...]]  # attributes that a checkpoint holds beside `state_dict`

    def solve(self, problem: Minimised) -> list[float]:
        """Improve the parameters; the loss after each accepted iteration."""
        ...

    def state_dict(self) -> dict[str, Any]: ...

    def load_state_dict(self, state_dict: dict[str, Any]) -> None: ...


def hurry(solver: Solver) -> None:
    """Let it end sooner, for another goes on from there."""
    solver.change *= HURRY
    solver.patience = min(solver.patience, SOON)
