"""A composed structure in which every part of the equation counts, and its motions."""

from __future__ import annotations

import numpy as np
import torch

from data.record import Drive, Record
from models.composition.coefficients import Coefficients, Numbering, Part
from models.composition.composite import Composite
from models.composition.laws import ElementLaws
from models.composition.simulate import Composition

DT = 0.01


def spread(shape: torch.Size | tuple, low: float, high: float, seed: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return low + (high - low) * torch.rand(shape, generator=generator, dtype=torch.float64)


class Everything(Composite):
    """Two coordinates, three elements, two forces and a moving support; all coefficients learned.

    Not reciprocal, with outputs that mix the coordinates: every part of the equation counts.
    """

    def __init__(self, substeps: int = 2) -> None:
        super().__init__(2, 4, DT, substeps)
        self.core_stiffness = Coefficients(2, positive=True)
        self.core_damping = Coefficients(2, positive=True)
        self.inputs_to = Coefficients(2, 4)
        self.reactions = Coefficients(2, 3)
        self.directions = Coefficients(3, 2)
        self.shapes = Coefficients(2, 2)
        self.laws = ElementLaws(3, 2, 1, 2, True)
        self.identified.fill_(1.0)
        self.core_stiffness.start(torch.tensor([30.0, 60.0]))
        self.core_damping.start(torch.tensor([0.5, 0.8]))
        directions = torch.tensor([[1.0, 0.1], [-1.0, 1.1], [0.2, 0.9]])
        self.directions.start(torch.ones(3, 2), directions)
        self.reactions.start(torch.ones(2, 3), directions.T + 0.1)
        self.inputs_to.start(torch.ones(2, 4), spread((2, 4), -1.0, 1.0, 0))
        self.shapes.start(torch.ones(2, 2), torch.tensor([[1.0, 0.3], [-0.4, 0.9]]))
        each, ones = torch.full((3,), 20.0).double(), torch.ones(3).double()
        self.laws.start(each, 0.02 * each, 0.2 * ones, (0.3, 0.2))
        for seed, part in enumerate(self.laws.children()):
            part.theta.data += spread(part.theta.shape, 0.1, 0.4, 10 + seed)
        self.laws.unit_falling.theta.data -= 0.6

    def composition(self) -> Composition:
        numbering = Numbering(self)
        supports = torch.zeros(2, 3, 4, dtype=torch.float64)
        supports[0, 0, 2] = supports[1, 0, 3] = -1.0
        return Composition(
            core=Part.stack(
                [numbering.part(self.core_stiffness), numbering.part(self.core_damping)], dim=0
            ),
            inputs=numbering.part(self.inputs_to),
            G=numbering.part(self.reactions),
            D=numbering.part(self.directions),
            laws=self.laws.table(numbering),
            outputs=numbering.part(self.shapes),
            supports=supports,
            counts=self.laws.counts,
            parameters=numbering.count,
            measures=self.measures,
        )


def excited(samples: int = 80, seed: int = 0, hold: str = "linear") -> Drive:
    rng = np.random.default_rng(seed)
    f = 0.35 * np.cumsum(rng.standard_normal((samples, 2)), axis=0)
    rate = 0.3 * np.sin(9.0 * DT * np.arange(samples)[:, None] + seed)
    u = torch.from_numpy(np.hstack([f, DT * np.cumsum(rate, axis=0), rate]))
    x0, v0 = torch.tensor([0.02, -0.01]).double(), torch.tensor([0.1, 0.3]).double()
    return Drive(DT, u, x0, v0, hold)


def begun_in_motion(samples: int = 80, seed: int = 0, hold: str = "linear") -> Record:
    """Some motion under a drive: a run from measured states leaves it, as in training."""
    drive = excited(samples, seed, hold)
    model = Everything()
    model.core_stiffness.theta.data += 0.3
    with torch.no_grad():
        motion = model.free_run(drive)
    signals = (drive.u[:, :2], motion.x, motion.v, drive.u[:, 2:3], drive.u[:, 3:])
    return Record(DT, motion.a, *signals, initial_state="given", hold=hold)


def assert_close(one: torch.Tensor, other: torch.Tensor, tolerance: float) -> None:
    assert (one - other).abs().max() <= tolerance * other.abs().max()
