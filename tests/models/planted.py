"""Element networks of known springs that nothing was fitted to, and their motion under forces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from scipy.signal import lfilter

from data.record import Drive, Record
from models.element_network import ElementNetwork

DT = 0.01


def planted(
    mass: Sequence[float],
    stiffness: Sequence[float],
    elements: Sequence[Sequence[str]] | str | None = None,
    inputs: int | None = None,
    yielding: float | None = None,
    damper: float = 0.01,
    **settings: Any,
) -> ElementNetwork:
    """Masses [kg] and springs [N/m], of which a unit takes a share θ where it yields.

    elements: a chain's, unless said; inputs: a force on each mass. damper: of each element [s],
    over its stiffness.
    """
    n = len(mass)
    chain = [["ground", "x1"], *([f"x{i}", f"x{i + 1}"] for i in range(1, n))]
    settings = {"hinges": 0, "units": int(yielding is not None), **settings}
    model = ElementNetwork(n, n if inputs is None else inputs, DT, elements or chain, **settings)
    k = torch.tensor(stiffness).double()
    model.mass.start(torch.tensor(mass).double())
    model.laws.start(k, damper * k.abs(), torch.full_like(k, 0.1), (0.5, 0.5))
    if yielding is not None:
        model.laws.unit_stiffness.theta.data.fill_(yielding)
    model.identified.fill_(1.0)
    return model


@torch.no_grad()
def under_forces(
    model: ElementNetwork, rng: np.random.Generator, samples: int, size: float = 5.0
) -> Record:
    """The motion from rest under slow random forces of a standard deviation [N] on all masses."""
    f = lfilter([1.0], [1.0, -1.8, 0.85], rng.standard_normal((samples, model.dofs)), axis=0)
    rest = torch.zeros(model.dofs, dtype=torch.float64)
    drive = Drive(DT, torch.from_numpy(size * f / f.std()), rest, rest)
    run = model.free_run(drive)
    return Record(DT, run.a, drive.u, run.x, run.v)
