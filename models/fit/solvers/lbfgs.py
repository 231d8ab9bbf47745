"""Limited-memory BFGS with a strong-Wolfe line search, full batch.

Nocedal & Wright, Numerical Optimization (2006), Algorithms 7.5 and 3.5; the recursion is PyTorch's.
Choose it by default: cheap iterations, memory for a few gradients.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Annotated, NamedTuple

import torch
from torch import Tensor, nn

from data.annotations import MOST, Count, Range
from data.checked import checked
from data.record import all_finite
from models.fit.progress import is_out_of_time
from models.fit.solvers.solver import OUT_OF_TIME, Minimised

WALL = 1e6  # of the largest loss that is remembered


@checked
class LBFGS(torch.optim.LBFGS):
    """iterations: at most; history: pairs of steps and gradients that make the inverse Hessian.

    Stops when the norm of the loss's gradient falls below `gradient`, or when `patience`
    iterations lower the loss by less than the fraction `change`.
    """

    full_batch = True
    kept = ("done", "finished", "why")

    def __init__(
        self,
        parameters: Iterable[nn.Parameter],
        iterations: Count = 1000,
        history: Annotated[int, Range(1, MOST)] = 50,
        gradient: float = 1e-12,
        change: float = 1e-6,
        patience: Count = 20,
    ) -> None:
        super().__init__(
            parameters,
            max_iter=1,
            max_eval=26,  # 25 of them in the line search
            history_size=history,
            line_search_fn="strong_wolfe",
            tolerance_grad=0.0,
            tolerance_change=0.0,
        )
        self.iterations, self.gradient, self.change = iterations, gradient, change
        self.patience, self.done = patience, 0
        self.finished, self.why = False, ""
        self.recall: _Recall | None = None

    def solve(self, problem: Minimised) -> list[float]:
        """Up to `patience` iterations; none where the fit is out of time."""
        if is_out_of_time():
            self._finish(OUT_OF_TIME)
            return []
        if self.recall is None or self.recall.problem is not problem:
            self.recall = _Recall(self, problem)
        recall = self.recall
        accepted = [recall()]
        if not recall.points:
            self._finish("the loss is not finite at the start")
            return []
        for _ in range(min(self.patience, self.iterations - self.done)):
            self.step(recall)
            accepted.append(recall())
            self.done += 1
            slope = float(torch.linalg.vector_norm(recall.points[0].gradient))
            if slope <= self.gradient * recall.scale:
                self._finish(f"gradient below {self.gradient:g}")
                break
        if accepted[0] - accepted[-1] <= self.change * accepted[0]:
            self._finish(f"loss falls by less than {self.change:g}")
        if self.done >= self.iterations:
            self._finish(f"{self.iterations} iterations")
        return [a / recall.scale for a in accepted[1:]]

    def _finish(self, why: str) -> None:
        self.finished, self.why = True, self.why or why


class _Point(NamedTuple):
    """Loss and its gradient, at the parameters in one vector, and by parameter."""

    parameters: Tensor
    loss: float
    gradient: Tensor
    slopes: Sequence[Tensor]


class _Recall:
    """Loss and gradients at the present parameters, remembered for the last points.

    PyTorch's step begins by evaluating the point that the step before it ended with: remembered,
    one iteration at a time costs no more than many at once.
    """

    def __init__(self, solver: LBFGS, problem: Minimised) -> None:
        self.problem = problem
        self.parameters = [p for group in solver.param_groups for p in group["params"]]
        self.scale = problem.y.numel()
        self.points: list[_Point] = []  # finite ones, the newest or the one last asked for at first

    def __call__(self) -> float:
        here = torch.cat([p.detach().reshape(-1) for p in self.parameters])
        known = (i for i, one in enumerate(self.points) if torch.equal(one.parameters, here))
        place = next(known, None)
        found = self._evaluated(here) if place is None else self.points.pop(place)
        if found is None:
            return self._wall()
        self.points = [found, *self.points[:7]]
        for p, slope in zip(self.parameters, found.slopes, strict=True):
            p.grad = slope
        return found.loss

    def _evaluated(self, here: Tensor) -> _Point | None:
        """The present point; None where it is not finite."""
        if getattr(self.problem, "closed", None) is not None:
            value, gradient = self.problem.slopes()  # type: ignore[attr-defined]
            gradient = self.scale * gradient
            parts = gradient.split([p.numel() for p in self.parameters])
            slopes = tuple(g.view_as(p) for g, p in zip(parts, self.parameters, strict=True))
        else:
            with torch.enable_grad():
                value = self.problem.loss()
                slopes = torch.autograd.grad(self.scale * value, self.parameters)
            gradient = torch.cat([slope.reshape(-1) for slope in slopes])
        loss = self.scale * float(value.detach())
        finite = math.isfinite(loss) and all_finite(gradient)
        return _Point(here, loss, gradient, slopes) if finite else None

    def _wall(self) -> float:
        """For the line search, a point without finite loss is high and flat: it turns back there.

        Its interpolation would make NaN of NaN.
        """
        for p in self.parameters:
            p.grad = torch.zeros_like(p)
        return WALL * max((one.loss for one in self.points), default=1.0)
