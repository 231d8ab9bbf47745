"""What drives the model of a run, in the order of its channels, and a motion as that.

T samples, m channels of excitation, p supports.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from data.measured.units import GRAVITY
from data.sample import Sensors
from data.simulation.accelerograms import SHORTEST, Accelerogram
from data.simulation.earthquake import ground_motion
from export.names import GROUND
from models.estimator import Estimator

Channels = Mapping[str, np.ndarray]
FORCES, SUPPORTS, BASE, IMPOSED = "forces", "supports", "base", "imposed"


@dataclass(frozen=True)
class Interface:
    """Names of the channels that a model reads, and what a ground acceleration is to it.

    kind: forces on DOFs; motions of supports, with forces if there are any; the acceleration of
    a common base; or deformations imposed on elements. others: inputs that no scale factor is for.
    masses (n,) [kg]: with them a ground acceleration is applied as forces −m s̈; None: it cannot be.
    """

    kind: str
    forces: tuple[str, ...] = ()
    supports: int = 0
    others: tuple[str, ...] = ()
    masses: np.ndarray | None = None

    @staticmethod
    def of(estimator: Estimator, sensors: Sensors) -> Interface:
        """That of a model for the sensors that it was identified with."""
        public = "y1" in sensors.channels
        others = () if public else tuple(c for c in sensors.channels if c[0] == "u")
        if sensors.quantity == "force":
            return Interface(IMPOSED, (), sensors.dofs, others)
        if sensors.forced == "base":
            return Interface(BASE, others=others)
        listed = isinstance(sensors.forced, list | tuple)
        numbers: Any = sensors.forced if listed else range(1, min(sensors.dofs, sensors.inputs) + 1)
        forces = tuple(f"{'u' if public else 'f'}{number}" for number in numbers)
        supports = (sensors.inputs - len(forces) - len(others)) // 2
        if supports:
            return Interface(SUPPORTS, forces, supports, others)
        masses = estimator.masses() if sensors.quantity == "acceleration" else None
        if masses is None or len(masses) != len(forces):
            return Interface(FORCES, forces, 0, others)
        return Interface(FORCES, forces, 0, others, masses.cpu().numpy())

    @property
    def motions(self) -> tuple[str, ...]:
        """Names of support motions, or of imposed deformations, and of their rates."""
        numbers = range(1, self.supports + 1)
        return (*(f"s{i}" for i in numbers), *(f"s_dot{i}" for i in numbers))

    @property
    def channels(self) -> tuple[str, ...]:
        """All channels, in the order of the excitation."""
        own = (GROUND,) if self.kind == BASE else (*self.forces, *self.motions)
        return (*own, *self.others)

    @property
    def takes_ground(self) -> bool:
        """Whether the acceleration of the ground alone moves the model."""
        moved = self.kind == SUPPORTS or self.masses is not None
        return self.kind == BASE or (moved and not self.others)

    @property
    def requirement(self) -> str:
        """What a motion has to hold, in words."""
        own = ", ".join(c for c in self.channels if not c.startswith("s_dot"))
        if self.takes_ground and self.kind != BASE:
            return f"{own}, or {GROUND}, the acceleration of the ground"
        return own

    def driving_channels(self, name: str, channels: Channels) -> dict[str, np.ndarray]:
        """Those of some channels that drive the model. Raises ValueError where they lack some."""
        given = {c for c in self.channels if c in channels}
        rates = {f"s_dot{i}" for i in range(1, self.supports + 1) if f"s{i}" in channels}
        if given | rates == set(self.channels):
            return {c: channels[c] for c in self.channels if c in channels}
        if self.takes_ground and GROUND in channels:
            return {GROUND: channels[GROUND]}
        lacking = [c for c in self.channels if c not in given | rates]
        raise ValueError(
            f"{name} has {_listed(channels)} and lacks {_listed(lacking)}: the model is driven by "
            f"{self.requirement}; name them in excitation.channels"
        )

    def excitation(
        self, name: str, dt: float, channels: Channels, scale: float, lag: float
    ) -> Tensor:
        """u (T, m) of the driving channels, all but other inputs times `scale`."""
        if self.kind == BASE:
            columns = [-scale * channels[GROUND]]
        elif GROUND in channels and self.kind == SUPPORTS:
            columns = [*self._supports_of(name, dt, scale * channels[GROUND], lag).T]
        elif GROUND in channels and self.masses is not None:
            columns = [-mass * scale * channels[GROUND] for mass in self.masses]
        else:
            columns = [scale * channels[c] for c in (*self.forces, *self.motions)]
        columns += [channels[c] for c in self.others]
        return torch.from_numpy(np.stack(columns, axis=1).astype(float, copy=False))

    def _supports_of(self, name: str, dt: float, ground: np.ndarray, lag: float) -> np.ndarray:
        """Forces of nil, then displacement and velocity of every support (T, ·)."""
        if len(ground) < SHORTEST:
            raise ValueError(
                f"{name} has {len(ground)} samples; a ground acceleration that is integrated twice "
                f"needs {SHORTEST}: give s1 and s_dot1"
            )
        none = np.zeros((len(ground), len(self.forces)))
        if not ground.any():
            return np.hstack([none, np.zeros((len(ground), 2 * self.supports))])
        recorded = Accelerogram(name, dt, ground / GRAVITY)
        arrivals = lag * np.arange(self.supports)
        return np.hstack([none, *ground_motion(recorded, len(ground), dt, arrivals=arrivals)])


def _listed(names: Iterable[str]) -> str:
    listed = list(names)
    return ", ".join(listed[:8]) + (", …" if len(listed) > 8 else "") if listed else "nothing"
