"""Damped least squares followed to its end: the one loop of all fits inside `identify`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from torch import nn

from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from models.fit.solvers.solver import Minimised


class WithParameters(Minimised, Protocol):
    """A problem that knows its parameters."""

    @property
    def free(self) -> Sequence[nn.Parameter]:
        """The parameters that are fitted."""
        ...


def minimise(problem: WithParameters, settings: Mapping[str, Any], **changes: Any) -> list[float]:
    """Lower the loss of a problem; its parameters keep the best. The loss of every iteration.

    settings: of `LevenbergMarquardt`; changes: of some of them.
    """
    solver = LevenbergMarquardt(problem.free, **{**settings, **changes})
    losses: list[float] = []
    while not solver.finished:
        losses += solver.solve(problem)
    return losses
