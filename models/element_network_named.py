"""Element network whose elements follow laws of a name: steel, flags, pendulums, concrete.

M ẍ + Bᵀ r = f,   y = B x + B_s s,   r_e = law_e(y_e, ẏ_e; q_e)          (models/named_laws)

Forces by equilibrium (models/starts/equilibrium.py) make a test of every element; each gets the law
that suits it on a motion held back. The structure of these laws is then simulated from rest by the
integrator of data/simulation, which finds the instants of yielding. No solver is needed.
B records, T samples, n DOFs, E elements, m excitations.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from data.record import Drive, Record, Response
from data.simulation.motion import simulate
from data.simulation.structure import Structure
from models.composition.stated import typed
from models.composition.trace import Trace
from models.element_network import ElementNetwork
from models.estimator import Estimator
from models.named_laws.fit import Motion, chosen
from models.named_laws.learned import LearnedLaws, require_laws, told


class ElementNetworkNamed(ElementNetwork):
    """Masses and named laws from the motion, or from accelerations and forces alone.

    elements, masses, forced, from_accelerations: as for `ElementNetwork`. laws, seed: as for
    `NamedElement`. Forces by equilibrium are those of the elements where there are no more of them
    than DOFs, as in a chain. Raises ValueError for channels, masses, nodes or laws that do not fit,
    and for a free run that does not begin at rest.
    """

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        elements: Sequence[Sequence[str]] | Literal["chain", "all"] | None = None,
        masses: Sequence[float | None] | None = None,
        forced: Sequence[int] | str | None = None,
        laws: Sequence[str] | None = None,
        seed: int = 0,
        from_accelerations: bool = False,
    ) -> None:
        if masses is not None and None in masses:
            raise ValueError(
                f"model.masses={typed(masses)}: named laws need all masses or none; give "
                "numbers, or choose element_network"
            )
        super().__init__(
            dofs, inputs, dt, elements, masses, forced, 0, 0, 0, False,
            from_accelerations=from_accelerations,
        )  # fmt: skip
        self.candidates, self.seed = require_laws(laws), seed
        self.named = LearnedLaws(len(self.elements))
        self.requires_grad_(False)

    estimates_beginning = False

    @property
    def identified_parameters(self) -> int:
        return self.named.count + (self.dofs if self.known_masses is None else 0)

    @torch.no_grad()
    def identify(self, batches: Iterable[Record]) -> dict[str, Any]:
        """Start at a linear structure, then give every element the law of its forces."""
        records = self.admitted(batches)
        facts = super().identify(records)
        assert self.linear is not None
        stiffness = self.linear[0].clamp_min(1e-3 * self.linear[0].max())
        tests = [test for record in records for test in self.element_tests(record, stiffness)]
        rng = np.random.default_rng(self.seed)
        fits, errors = [], []
        for e in range(len(self.elements)):
            motions = [_motion(test, e, self.dt) for test in tests]
            fit, held_back = chosen(motions, self.candidates, int(rng.integers(2**31)))
            self.named.take(e, fit)
            fits.append(fit)
            errors.append(held_back)
        return {**facts, **told(fits, errors)}

    def structure(self) -> Structure:
        """The structure that was identified, as data/simulation has it."""
        parts = {
            f"r{e + 1}_{i + 1}": element
            for e, pair in enumerate(self.elements)
            for i, element in enumerate(self.named.elements(e, pair))
        }
        return Structure(self.mass().detach().cpu().tolist(), parts)

    def forward(self, record: Record) -> Tensor:
        return self.run_of(record).a

    def run_of(self, record: Record) -> Response:
        return Estimator.run_of(self, record)

    def free_run(self, drive: Drive) -> Response:
        """The motion from rest; infinite from where it escapes."""
        return self.trace(drive).response

    def trace(self, drive: Drive, *_: Any, **__: Any) -> Trace:
        """The motion from rest, and deformations and forces of the elements."""
        self.require_identified(self.named.numbers)
        if bool(drive.x0.any()) or bool(drive.v0.any()):
            raise ValueError(
                "ElementNetworkNamed simulates from rest, and this record begins in motion; count "
                "its first samples as warm-up (data.initial_state=rest, data.warmup)"
            )
        structure, inputs = self.structure(), self.composition().inputs.value.cpu()
        mass, lead = self.mass().detach().cpu(), drive.u.shape[:-1]
        of_part = [int(name[1:].partition("_")[0]) - 1 for name in structure.elements]
        motions, elements = [], []
        for u in drive.u.cpu().reshape(-1, drive.samples, self.inputs):
            force = (mass * (u @ inputs.T)).numpy()
            s, s_dot = (part.numpy().copy() for part in u[:, self.forces :].chunk(2, dim=1))
            moving = (s, s_dot) if self.supports else (None, None)
            motion = simulate(structure, force, drive.dt, *moving)
            parts = torch.stack([torch.from_numpy(v) for v in (motion.x, motion.v, motion.a)])
            loops = torch.zeros(2, drive.samples, len(self.elements), dtype=torch.float64)
            loops[0, :, of_part] = torch.from_numpy(motion.y)  # of all in parallel the same
            loops[1].index_add_(1, torch.tensor(of_part), torch.from_numpy(motion.r))
            if motion.escape_time is not None:
                parts[:, round(motion.escape_time / drive.dt) :] = torch.inf
                loops[:, round(motion.escape_time / drive.dt) :] = torch.inf
            motions.append(parts)
            elements.append(loops)
        device = drive.u.device
        x, v, a = torch.stack(motions, dim=1).reshape(3, *lead, self.dofs).to(device)
        y, r = torch.stack(elements, dim=1).reshape(2, *lead, len(self.elements)).to(device)
        none = a.new_zeros(*a.shape, 0)
        return Trace(Response(x, v, self.composition().output(x, v, a)), r, y, none, none)


def _motion(test: tuple[Tensor, Tensor, Tensor], e: int, dt: float) -> Motion:
    y, rate, r = (u[:, e].numpy().copy() for u in test)
    return Motion(dt, y, rate, r)
