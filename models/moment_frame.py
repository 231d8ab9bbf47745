"""Moment frame: floors on columns and beams of steel, whose joints turn; the base is shaken.

M ẍ + α M v + F = M u,   F from members whose ends yield (models/frames/run_compiled.py)

Only floors are measured. Yielding wanders between the joints: no law between two floors follows
it, while columns and beams with joints as hidden unknowns do. Their numbers are fitted to forces
that balance the measured motion, then to its free run (models/frames/fit.py); no solver is needed.
Choose it for frames of steel: columns and beams yield at their ends, all joints of a floor turn
alike, columns are clamped at the base, beams carry no load between them. From accelerations alone
a fit may end away from the frame: `free_run_error` says so.   n floors, T samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from data.record import Drive, Record, Response
from models.estimator import Estimator
from models.frames.fit import Known, Motion, fitted, simulated
from models.frames.numbers import members, number_of
from models.layers.integrate import between
from models.starts.equilibrium import integrated_states


class MomentFrame(Estimator):
    """Motion (…, T, n) of floors against a shaken base; every estimate is a free run from rest.

    masses: of the floors, from the lowest to the roof [kg]. heights: of the storeys, in any unit;
    None: alike. substeps: of a sample. The records' one channel of excitation is the acceleration
    that it gives all masses, minus that of the base; displacements and velocities that they lack
    are integrated.
    Raises ValueError for other channels, and for a free run that does not begin at rest.
    """

    reads = ("f",)
    on_processor = True

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        masses: Sequence[float] | None = None,
        heights: Sequence[float] | None = None,
        substeps: int = 2,
    ) -> None:
        super().__init__(dofs, inputs, dt)
        if inputs != 1:
            raise ValueError(
                f"inputs={inputs}: a moment frame is shaken at its base, by one channel; choose "
                "model=element_network for forces on its floors"
            )
        heights = [1.0] * dofs if heights is None else heights
        for name, values in (("masses", masses), ("heights", heights)):
            if values is None or len(values) != dofs or not all(value > 0.0 for value in values):
                raise ValueError(
                    f"model.{name}={values}: expected {dofs} positive numbers, from the lowest "
                    "floor to the roof"
                )
        if substeps < 1:
            raise ValueError(f"model.substeps={substeps}: expected at least 1")
        assert masses is not None
        self.known = Known(np.array(masses, float), np.array(heights, float) / heights[0])
        self.substeps = substeps
        empty = torch.full((number_of(dofs),), torch.nan, dtype=torch.float64)
        self.numbers = nn.Parameter(empty, requires_grad=False)  # see models/frames/numbers.py

    def identify(self, batches: Iterable[Record]) -> dict[str, Any]:
        """Fit all numbers; returns relative errors of the accelerations.

        balance_error: of those that the frame's forces give under the measured motion;
        free_run_error: of the free run.
        """
        motions = [motion for record in batches for motion in self._motions(record.to("cpu"))]
        numbers, balance, free_run = fitted(self.known, motions)
        self.numbers.data.copy_(torch.from_numpy(numbers))
        return {"balance_error": balance, "free_run_error": free_run}

    def forward(self, record: Record) -> Tensor:
        """Accelerations (…, T, n) of the free run of a record or a batch."""
        return self.run_of(record).a

    def free_run(self, drive: Drive) -> Response:
        """The motion from rest; infinite from where it is lost."""
        self.require_identified(self.numbers)
        if bool(drive.x0.any()) or bool(drive.v0.any()):
            raise ValueError(
                "MomentFrame simulates from rest, and this record begins in motion; count its "
                "first samples as warm-up (data.initial_state=rest, data.warmup)"
            )
        frame = members(self.numbers.cpu().numpy(), self.known.mass, self.known.rho)
        none = torch.zeros(*drive.u.shape[:-1], self.dofs, dtype=torch.float64)
        motions = self._of(none, none, none, drive.u.cpu(), drive.hold, drive.dt)
        runs = np.stack([simulated(frame, self.known, motion) for motion in motions], axis=1)
        x, v, a = torch.from_numpy(runs).reshape(3, *none.shape).to(drive.u.device)
        return Response(x, v, a)

    def _motions(self, record: Record) -> list[Motion]:
        """Those of a batch; displacements and velocities that it lacks are integrated."""
        x, v = record.x, record.v
        if x is None or v is None:
            states = [(x, v) for x, v, _, _ in integrated_states(record, 1)]
            x, v = (torch.stack(s).reshape(record.a.shape) for s in zip(*states, strict=True))
        return self._of(x, v, record.a, record.excitation, record.hold, record.dt)

    def _of(self, x: Tensor, v: Tensor, a: Tensor, u: Tensor, hold: str, dt: float) -> list[Motion]:
        """Motions of x, v, a (…, T, n) under the excitation u (…, T, 1)."""
        T = u.shape[-2]
        ends = between(u.reshape(-1, T, 1), hold, self.substeps)[..., 0].contiguous()
        signals = [s.reshape(-1, T, self.dofs).contiguous() for s in (x, v, a)]
        signals += [u.reshape(-1, T).contiguous(), ends]
        parts = zip(*(s.numpy() for s in signals), strict=True)
        return [Motion(x, v, a, u, ends, dt) for x, v, a, u, ends in parts]
