"""Limited-memory BFGS with a strong-Wolfe line search, full batch.

Nocedal & Wright, Numerical Optimization (2006), Algorithms 7.5 and 3.5; the recursion is PyTorch's.
Choose it by default: cheap iterations, memory for a few gradients.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated

import torch
from torch import Tensor, nn

from data.annotations import MOST, Count, Range
from data.checked import checked
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

    def solve(self, problem: Minimised) -> list[float]:
        """Up to `patience` iterations; none where the fit is out of time."""
        if is_out_of_time():
            self._finish(OUT_OF_TIME)
            return []
        recall = _Recall(self, problem)
        accepted = [recall()]
        if not recall.points:
            self._finish("the loss is not finite at the start")
            return []
        for _ in range(min(self.patience, self.iterations - self.done)):
            self.step(recall)
            accepted.append(recall())
            self.done += 1
            if self._slope() <= self.gradient * recall.scale:
                self._finish(f"gradient below {self.gradient:g}")
                break
        if accepted[0] - accepted[-1] <= self.change * accepted[0]:
            self._finish(f"loss falls by less than {self.change:g}")
        if self.done >= self.iterations:
            self._finish(f"{self.iterations} iterations")
        return [a / recall.scale for a in accepted[1:]]

    def _slope(self) -> float:
        slopes = [p.grad.reshape(-1) for group in self.param_groups for p in group["params"]]
        return float(torch.linalg.vector_norm(torch.cat(slopes)))

    def _finish(self, why: str) -> None:
        self.finished, self.why = True, self.why or why


class _Recall:
    """Loss and gradients at the present parameters, remembered for the last points.

    PyTorch's step begins by evaluating the point that the step before it ended with: remembered,
    one iteration at a time costs no more than many at once.
    """

    def __init__(self, solver: LBFGS, problem: Minimised) -> None:
        self.problem = problem
        self.parameters = [p for group in solver.param_groups for p in group["params"]]
        self.scale = problem.y.numel()
        self.points: list[tuple[Tensor, float, list[Tensor]]] = []  # finite ones

    def __call__(self) -> float:
        here = torch.cat([p.detach().reshape(-1) for p in self.parameters])
        for point, loss, slopes in self.points:
            if torch.equal(point, here):
                for p, slope in zip(self.parameters, slopes, strict=True):
                    p.grad = slope.clone()
                return loss
        if getattr(self.problem, "closed", None) is not None:
            value, slopes = self.problem.slopes()  # type: ignore[attr-defined]
            parts = (self.scale * slopes).split([p.numel() for p in self.parameters])
            gradients = [g.view_as(p) for g, p in zip(parts, self.parameters, strict=True)]
        else:
            with torch.enable_grad():
                value = self.problem.loss()
                gradients = list(torch.autograd.grad(self.scale * value, self.parameters))
        loss = self.scale * float(value.detach())
        if not (math.isfinite(loss) and all(torch.isfinite(g).all() for g in gradients)):
            return self._wall()
        for p, slope in zip(self.parameters, gradients, strict=True):
            p.grad = slope
        self.points = [*self.points[-7:], (here, loss, [g.clone() for g in gradients])]
        return loss

    def _wall(self) -> float:
        """For the line search, a point without finite loss is high and flat: it turns back there.

        Its interpolation would make NaN of NaN.
        """
        for p in self.parameters:
            p.grad = torch.zeros_like(p)
        return WALL * max((loss for _, loss, _ in self.points), default=1.0)
