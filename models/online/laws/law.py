"""What an adaptation law is: how weights follow the samples, one after the other.

ŷ = φᵀ W,  e = y − ŷ,  (W, M) ← adapt(W, M, φ, e)
P features φ that all n targets y share; M is what a law keeps of the past, (P, P) or empty.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor, nn

from data.parallel import interruptible
from models.online.laws import laws_compiled as compiled


@dataclass(frozen=True)
class Adapted:
    """The state of a law. A law makes a new one at each step and leaves the old as it was."""

    weights: Tensor  # W (P, n)
    memory: Tensor  # M (P, P), or (0, 0)


class Law(nn.Module):
    """Base of all laws. `number` is that of its step in laws_compiled.py.

    A law has no parameters and holds no state; `Adapted` does.
    """

    number: ClassVar[int]

    def start(self, weights: Tensor) -> Adapted:
        """The state before the first sample, from weights (P, n) that may be zero."""
        return Adapted(weights.detach().clone(), weights.new_zeros(0, 0))

    def adapt(self, state: Adapted, phi: Tensor, error: Tensor) -> Adapted:
        """The state after a sample with features (P,) and error y − φᵀW (n,)."""
        W, memory = (u.detach().cpu().numpy().copy() for u in (state.weights, state.memory))
        seen = (np.ascontiguousarray(u.detach().cpu().numpy()) for u in (phi, error))
        compiled.step(self.number, self.settings(), W, memory, *seen, work_for(W))
        return Adapted(*(torch.from_numpy(u).to(phi.device) for u in (W, memory)))

    def settings(self) -> np.ndarray:
        """The numbers that the compiled step reads."""
        return np.zeros(0)

    def follow(
        self, state: Adapted, phi: Tensor, target: Tensor, first: int = 0
    ) -> tuple[Tensor, Adapted]:
        """Estimates (T, n), each made before its target is used, and the state after the last.

        Features (T, P), targets (T, n); the weights rest until sample `first`. Compiled, on the
        processor.
        """
        W, memory = (u.detach().cpu().numpy().copy() for u in (state.weights, state.memory))
        features, wanted = (np.ascontiguousarray(u.detach().cpu().numpy()) for u in (phi, target))
        estimates = np.empty_like(wanted)
        run = partial(
            compiled.follow,
            *(self.number, self.settings(), features, wanted, first),
            *(W, memory, work_for(W), estimates),
        )
        interruptible(run, len(features) * memory.size)
        estimated, weights, memory_after = (
            torch.from_numpy(u).to(target.device) for u in (estimates, W, memory)
        )
        return estimated, Adapted(weights, memory_after)


def work_for(weights: np.ndarray) -> np.ndarray:
    """Room (3, P) that compiled laws write intermediate results to."""
    return np.zeros((3, weights.shape[0]))
