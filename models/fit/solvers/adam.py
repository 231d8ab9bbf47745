"""Adam on mini-batches of windows, its step length falling to zero along half a cosine.

Kingma & Ba (2015); Loshchilov & Hutter (2017) for the cosine. Choose it for data that do not fit
in one batch; on full batches the second-order solvers come closer, sooner.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import torch
from torch import nn

from data.annotations import Count, Positive
from data.checked import checked
from models.fit.progress import is_out_of_time
from models.fit.solvers.solver import OUT_OF_TIME, Minimised


@checked
class Adam(torch.optim.Adam):
    """iterations: steps in all, one for every mini-batch; rate: the first step length."""

    full_batch, change, patience = False, 0.0, 0
    kept = ("done", "finished", "why")

    def __init__(
        self, parameters: Iterable[nn.Parameter], iterations: Count = 5000, rate: Positive = 0.01
    ) -> None:
        super().__init__(parameters, lr=rate)
        self.iterations, self.rate, self.done = iterations, rate, 0
        self.finished, self.why = False, ""

    def solve(self, problem: Minimised) -> list[float]:
        """One step. The loss is that of the mini-batch before the step.

        A mini-batch whose loss or gradient is not finite is left out; a gradient longer than the
        problem's `steepest` is shortened. None is taken where the fit is out of time.
        """
        if is_out_of_time():
            self.finished, self.why = True, OUT_OF_TIME
            return []
        for group in self.param_groups:
            group["lr"] = 0.5 * self.rate * (1.0 + math.cos(math.pi * self.done / self.iterations))
        self.zero_grad()
        with torch.enable_grad():
            loss = problem.loss()
            loss.backward()
        free = [p for group in self.param_groups for p in group["params"]]
        slope = torch.nn.utils.clip_grad_norm_(free, problem.steepest)
        usable = bool(torch.isfinite(loss) and torch.isfinite(slope))
        if usable:
            self.step()
        self.done += 1
        if self.done >= self.iterations:
            self.finished, self.why = True, f"{self.iterations} iterations"
        return [float(loss.detach())] if usable else []
