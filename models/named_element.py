"""One element by the law of a name: steel, flag, slack brace, pendulum, Bouc–Wen, concrete.

r = law(s, ṡ; q)                        (models/named_laws, simulated by data/simulation/laws)

Every law that may be is fitted to the motions; which of them it is shows on the largest motion,
which is held back. All happens in `identify`; no solver is needed.   T samples, one element.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from data.record import Drive, Record, Response
from models.element_test import ElementTest
from models.estimator import Parameter
from models.named_laws.candidates import CANDIDATES
from models.named_laws.choice import choose_law
from models.named_laws.fit import Motion
from models.named_laws.learned import LearnedLaws, named_law, require_laws, told

NO_DAMPING = 1e-9  # times its unit: as little as there may be


class NamedElement(ElementTest):
    """Force (…, T, 1) from the imposed deformation s and rate ṡ of an element test.

    laws: names to choose from (models/named_laws/candidates.py), "named" or None: all. seed: of the
    starts. Without rates, of a test without a clock, laws that depend on them are no choice, and no
    damper is found. Every estimate is a free run from rest. Raises ValueError for other channels.
    """

    reads = ("f",)
    on_processor = True

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        laws: Literal["named"] | Sequence[str] | None = "named",
        seed: int = 0,
    ) -> None:
        super().__init__(dofs, inputs, dt)
        self.require_one_element()
        self.candidates, self.seed = require_laws(laws), seed
        self.laws = LearnedLaws(1)

    @property
    def identified_parameters(self) -> int:
        return self.laws.count

    def identify(self, batches: Iterable[Record]) -> dict[str, Any]:
        """Fit and choose the law; returns it, its parameters in SI units, errors held back."""
        motions = []
        for record in batches:
            self.require_force(record)
            motions += _motions(record.excitation, record.a, record.dt, record.warmup)
        still = not any(motion.rate.any() for motion in motions)
        names = [n for n in self.candidates if not (still and CANDIDATES[n].needs_rates)]
        if not names:
            raise ValueError(
                f"model.laws={list(self.candidates)}: these depend on rates, of which a test "
                "without a clock tells nothing; say data.dt, or choose other laws"
            )
        fit, errors = choose_law(motions, names, self.seed)
        if still and "damping" in fit.candidate.parameters:
            none = {"damping": NO_DAMPING * fit.units.damping}
            fit = replace(fit, q=fit.candidate.with_values(fit.q, none, fit.units))
        self.laws.take(0, fit)
        return told([fit], [errors])

    def _physical_parameters(self) -> Iterable[Parameter]:
        self.require_identified(self.laws.numbers)
        return named_law(self.laws[0], "r1", "under s and its rate")

    def forward(self, record: Record) -> Tensor:
        """Forces (…, T, 1) of the free run of a record or a batch."""
        return self._forces(record.excitation, record.dt)

    def free_run(self, drive: Drive) -> Response:
        """Forces as `a` of the response, from rest; x and v are the imposed motion."""
        s, rate = drive.u.split(1, dim=-1)
        return Response(s, rate, self._forces(drive.u, drive.dt))

    def _forces(self, u: Tensor, dt: float) -> Tensor:
        self.require_identified(self.laws.numbers)
        fit, lead = self.laws[0], u.shape[:-1]
        forces = fit.forces(_motions(u, u[..., :1], dt, 0))
        r = torch.stack([torch.from_numpy(force) for force in forces])
        return r.reshape(*lead, 1).to(u.device)


def _motions(u: Tensor, r: Tensor, dt: float, first: int) -> list[Motion]:
    """Every motion of a batch; `first`: sample from which on it counts."""
    T = u.shape[-2]
    rows, forces = u.reshape(-1, T, 2).cpu().numpy(), r.reshape(-1, T).cpu().numpy()
    counts, none = np.arange(T) >= first, np.zeros((T, 0))
    return [
        Motion(dt, row[:, 0].copy(), row[:, 1].copy(), force.copy(), none, counts)
        for row, force in zip(rows, forces, strict=True)
    ]
