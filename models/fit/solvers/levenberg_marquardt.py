"""Levenberg–Marquardt, the paper's trainer, with the damping of MATLAB's trainlm.

(JᵀJ + μ I) δ = Jᵀ e,  θ ← θ − δ      Hagan & Menhaj (1994); Brewick & Masri (2016), Sect. 2.3
Choose it for small networks that have to fit closely; an iteration costs N P² operations.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated

import torch
from torch import nn
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from data.annotations import Count, Positive, Range, Share
from data.checked import checked
from data.memory import require_memory
from models.fit.progress import is_out_of_time
from models.fit.solvers.solver import OUT_OF_TIME, Minimised

SMALLEST_SHARE = 1e-9  # of the largest diagonal element, for parameters without any effect


@checked
class LevenbergMarquardt(torch.optim.Optimizer):
    """iterations: at most (trainlm's epochs); damping: μ at the start.

    μ is multiplied by `decrease` after a step that lowered the loss and by `increase` before
    another try. Stops where μ exceeds `largest`, the gradient's norm falls below `gradient`, or
    `patience` iterations lower the loss by less than the fraction `change`.
    scaled: μ multiplies the diagonal of JᵀJ instead of I (Marquardt 1963), for parameters that
    differ in their effect by orders of magnitude; never less than the share `floor` of the mean
    diagonal, so that parameters that the data hardly tell stay where they are.
    longest: a step that changes any parameter by more is shortened as a whole.
    every: JᵀJ is summed over every so-many-th sample; the gradient takes all of them.
    """

    full_batch = True
    kept = ("damping", "recent", "done", "finished", "why")

    def __init__(
        self,
        parameters: Iterable[nn.Parameter],
        iterations: Count = 1000,
        damping: Positive = 1e-3,
        decrease: Annotated[float, Range(0, 1, above=True, below=True)] = 0.1,
        increase: Annotated[float, Range(1, above=True)] = 10.0,
        largest: float = 1e10,
        gradient: float = 1e-7,
        change: float = 0.0,
        patience: Count = 20,
        every: Count = 1,
        scaled: bool = False,
        floor: Share = 0.0,
        longest: float = math.inf,
    ) -> None:
        if not longest > 0.0:  # infinity is one
            raise ValueError(f"solver.longest={longest} must be positive")
        super().__init__(parameters, {})
        count = sum(p.numel() for group in self.param_groups for p in group["params"])
        require_memory(
            24.0 * count**2,
            f"Levenberg–Marquardt's matrix of {count} parameters",
            "choose solver=lbfgs, or fewer parameters",
        )
        self.iterations, self.damping, self.done = iterations, damping, 0
        self.decrease, self.increase, self.largest = decrease, increase, largest
        self.gradient, self.change, self.patience, self.every = gradient, change, patience, every
        self.scaled, self.floor, self.longest = scaled, floor, longest
        self.recent: list[float] = []
        self.finished, self.why = False, ""

    @torch.no_grad()
    def solve(self, problem: Minimised) -> list[float]:
        """One iteration; none where the fit is out of time."""
        if is_out_of_time():
            return self._finish(OUT_OF_TIME)
        free = [p for group in self.param_groups for p in group["params"]] + list(problem.own)
        here, (matrix, vector) = parameters_to_vector(free), problem.normal_equations(self.every)
        loss = float(problem.loss())  # after the normal equations, which may know it
        if not math.isfinite(loss):
            return self._finish("the loss is not finite at the start")
        if not (torch.isfinite(matrix).all() and torch.isfinite(vector).all()):
            return self._finish("the derivatives are not finite")
        if 2.0 * float(torch.linalg.vector_norm(vector)) / problem.y.numel() < self.gradient:
            return self._finish(f"gradient below {self.gradient:g}")
        scale = torch.ones_like(vector)
        if self.scaled:
            diagonal = matrix.diagonal()
            scale = diagonal + SMALLEST_SHARE * diagonal.max()
            scale = scale.clamp_min(self.floor * float(diagonal.mean()))
        while self.damping <= self.largest:
            damped = matrix.clone()
            damped.diagonal().add_(self.damping * scale)
            factor, failed = torch.linalg.cholesky_ex(damped)
            if not failed:
                step = torch.cholesky_solve(vector[:, None], factor)[:, 0]
                step = step / max(1.0, float(step.abs().max()) / self.longest)
                vector_to_parameters(here - step, free)
                tried = float(problem.loss())
                if tried < loss:  # which a loss that is NaN never is
                    self.damping *= self.decrease
                    return self._accept(tried)
            self.damping *= self.increase
        vector_to_parameters(here, free)
        return self._finish(f"damping above {self.largest:g}")

    def _accept(self, loss: float) -> list[float]:
        self.done += 1
        self.recent = [*self.recent[-self.patience :], loss]
        gain = 1.0 - loss / self.recent[0]
        if len(self.recent) > self.patience and gain < self.change:
            self._finish(f"{self.patience} iterations lower the loss by less than {self.change:g}")
        if self.done >= self.iterations:
            self._finish(f"{self.iterations} iterations")
        return [loss]

    def _finish(self, why: str) -> list[float]:
        self.finished, self.why = True, why
        return []
