"""A published model, ready to run: `load_pretrained("element_network/bouc_wen")`."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from data.measured.units import GRAVITY
from data.plain_data import read_text
from data.record import Drive
from data.sample import Sensors
from data.simulation.accelerograms import Accelerogram
from models.estimator import Estimator, NoFreeRunError
from models.fit.trained_range import outside, range_of_drive, warnings_of
from models.stored.run import read_run
from models.zoo.index import ROOT, entry_of


class OutsideEnvelopeWarning(UserWarning):
    """A motion leaves what the weights were trained on; nobody measured what they do there."""


@dataclass(frozen=True)
class Pretrained:
    """Weights with what is known of them.

    name: MODEL/SYSTEM.vN. model: its parameters ask for no gradient. config, metrics: of the run
    that made it. sensors: time step, channels and units that it was built for.
    """

    name: str
    model: Estimator
    config: dict[str, Any]
    metrics: dict[str, Any]
    sensors: Sensors
    card: str

    def shaken(self, ground: Accelerogram, scale: float = 1.0) -> Drive:
        """The excitation that a ground acceleration is to the model, at rest before it.

        Of a shaken base −s̈, of forces on masses that the model knows −m s̈, the motion being that
        relative to the ground. Linear between the samples of the record. Raises ValueError for a
        model that is driven otherwise.
        """
        model, forced = self.model, self.sensors.forced
        base, masses = forced == "base", self.model.masses()
        forced = forced if isinstance(forced, list) else [*range(1, model.inputs + 1)]
        known = masses is not None and len(forced) == model.inputs == model.dofs
        if not (base or known):
            raise ValueError(f"zoo:{self.name} is driven by neither a shaken base nor known masses")
        recorded = ground.dt * np.arange(len(ground.a))
        times = model.dt * np.arange(int(recorded[-1] / model.dt + 1e-9) + 1)
        s_ddot = scale * GRAVITY * np.interp(times, recorded, ground.a)
        u = -torch.from_numpy(s_ddot)[:, None].expand(-1, model.inputs).clone()
        if not base:
            assert masses is not None
            u *= masses[[number - 1 for number in forced]]
        rest = torch.zeros(model.dofs, dtype=torch.float64)
        return Drive(model.dt, u, rest, rest)

    def inside(self, drive: Drive) -> bool:
        """Whether the model stays in its training envelope under an excitation; warns where not.

        Compared are the excitation and its spectrum, the model's own motion, and the deformation
        and rate of each element, to 5 % (models/fit/trained_range.py). A model without a free run
        is judged by the largest excitation alone. Raises ValueError for an excitation that does
        not fit the model.
        """
        trained = self.metrics.get("trained_range", {})
        try:
            new = range_of_drive(self.model, drive, trained)
        except NoFreeRunError:
            self.model.check(drive)
            trained = {kind: one for kind, one in trained.items() if kind == "excitation"}
            largest = drive.u.abs().flatten(0, -2).amax(dim=0).tolist()
            new = {kind: {**one, "largest": largest} for kind, one in trained.items()}
        left = outside(trained, new)
        if left:
            words = "; ".join(warnings_of(left))
            warnings.warn(f"zoo:{self.name}: {words}", OutsideEnvelopeWarning, stacklevel=2)
        return not left


def load_pretrained(name: str, root: Path = ROOT) -> Pretrained:
    """The newest version of MODEL/SYSTEM, or MODEL/SYSTEM.vN.

        pretrained = load_pretrained("element_network/bouc_wen")
        rest = torch.zeros(3)
        motion = pretrained.model.free_run(Drive(0.01, force, rest, rest))   # force (T, 3) [N]
        motion.x, motion.v, motion.a                                          # (T, 3)

    Read from this clone, without network; every file is held against its published SHA-256, and
    nothing of them is executed. Raises ValueError for a name that is not published, with what
    comes near, and for a file that was changed.
    """
    entry = entry_of(name, root)
    entry.require_untouched()
    run = read_run(entry.folder)
    with torch.random.fork_rng(devices=[]):  # starting weights, which are overwritten
        estimator = run.restore()
    return Pretrained(
        name=entry.name,
        model=estimator.requires_grad_(False),
        config=dict(run.values),
        metrics=run.metrics,
        sensors=run.sensors,
        card=read_text(entry.folder / "card.md"),
    )
