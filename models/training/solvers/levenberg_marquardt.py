"""Levenberg–Marquardt, the paper's trainer, with the damping of MATLAB's trainlm.

(JᵀJ + μ I) δ = Jᵀ e,  θ ← θ − δ      Hagan & Menhaj (1994); Brewick & Masri (2016), Sect. 2.3
Choose it for small networks that have to fit closely; an iteration costs N P² operations.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import nn
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from models.training.problem import Problem


class LevenbergMarquardt(torch.optim.Optimizer):
    """iterations: at most (trainlm's epochs); damping: μ at the start.

    μ is multiplied by `decrease` after a step that lowered the loss and by `increase` before
    another try. Stops where μ exceeds `largest` or the gradient's norm falls below `gradient`.
    """

    full_batch = True

    def __init__(
        self,
        parameters: Iterable[nn.Parameter],
        iterations: int = 1000,
        damping: float = 1e-3,
        decrease: float = 0.1,
        increase: float = 10.0,
        largest: float = 1e10,
        gradient: float = 1e-7,
    ) -> None:
        super().__init__(parameters, {})
        self.iterations, self.damping, self.done = iterations, damping, 0
        self.decrease, self.increase, self.largest = decrease, increase, largest
        self.gradient = gradient
        self.finished, self.why = False, ""

    @torch.no_grad()
    def solve(self, problem: Problem) -> list[float]:
        """One iteration."""
        free = [p for group in self.param_groups for p in group["params"]]
        here, loss = parameters_to_vector(free), float(problem.loss())
        matrix, vector = problem.normal_equations()
        if 2.0 * float(torch.linalg.vector_norm(vector)) / problem.y.numel() < self.gradient:
            return self._finish(f"gradient below {self.gradient:g}")
        while self.damping <= self.largest:
            damped = matrix.clone()
            damped.diagonal().add_(self.damping)
            factor, failed = torch.linalg.cholesky_ex(damped)
            if not failed:
                step = torch.cholesky_solve(vector[:, None], factor)[:, 0]
                vector_to_parameters(here - step, free)
                tried = float(problem.loss())
                if tried < loss:
                    self.damping *= self.decrease
                    self.done += 1
                    if self.done >= self.iterations:
                        self._finish(f"{self.iterations} iterations")
                    return [tried]
            self.damping *= self.increase
        vector_to_parameters(here, free)
        return self._finish(f"damping above {self.largest:g}")

    def _finish(self, why: str) -> list[float]:
        self.finished, self.why = True, why
        return []
