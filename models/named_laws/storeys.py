"""Laws of all storeys of a chain together, and the damping of its masses.

Every law is in a run of its own, which is held near what was measured, but less than in the search
(storey.py): so the numbers of laws that are nearly right show better. α is fitted with them: where
the beginning is not linear, it tells α badly, and forces by equilibrium are wrong by that.
E elements.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from models.named_laws.differences import Spread, descended
from models.named_laws.free_run import Laws, Shaking
from models.named_laws.storey import Storey, residuals
from models.training.doing import doing

HELD = 0.4  # h
ITERATIONS, PULL = 12, 1e-6  # pull of the numbers towards their start
KNOWN = 64  # residuals of storeys that are kept


def together(
    laws: Laws, motions: Sequence[Shaking], stiffness: Sequence[float], spread: Spread = map
) -> Laws:
    """Laws and α that suit the motions; masses are as they were. stiffness (E,): see `Storey`."""
    doing("laws of all storeys together")
    begin = replace(laws, learned=False)

    @lru_cache(KNOWN)  # a number of one law changes the run of no other
    def of_storey(e: int, q: tuple[float, ...], alpha: float) -> np.ndarray:
        trial = replace(begin, mass_damping=alpha)
        storeys = [Storey.of(motion, trial, e, stiffness[e], HELD) for motion in motions]
        return residuals(replace(begin.fits[e], q=np.array(q)), storeys, 1.0)

    def of(numbers: np.ndarray) -> np.ndarray:
        trial = begin.at(numbers)
        parts = [
            of_storey(e, tuple(fit.q.tolist()), trial.mass_damping)
            for e, fit in enumerate(trial.fits)
        ]
        return np.concatenate(parts) / math.sqrt(len(parts))

    numbers, error = descended(of, begin.numbers, ITERATIONS, PULL, spread=spread)
    return replace(begin.at(numbers), learned=laws.learned, error=error)
