"""Moment frame: floors on columns and beams of steel, whose joints turn; the base is shaken.

M ẍ + α M v + F = M u,   F from members whose ends yield (models/frames/run_compiled.py)

Only floors are measured. Yielding wanders between the joints: no law between two floors follows
it, while columns and beams with joints as hidden unknowns do. Their numbers are identified in
`identify`, by the forces that balance the measured motion; no solver is needed. Choose it for
frames of steel: columns and beams yield at their ends, all joints of a floor turn alike, columns
are clamped at the base, beams carry no load between them.   n floors, T samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from data.record import Drive, Record, Response
from models.estimator import Estimator
from models.frames.fit import Known, Motion, fitted
from models.frames.numbers import members, number_of
from models.frames.run_compiled import free
from models.layers.integrate import between


class MomentFrame(Estimator):
    """Motion (…, T, n) of floors against a shaken base; every estimate is a free run from rest.

    masses: of the floors, from the lowest to the roof [kg]. heights: of the storeys, in any unit;
    None: alike. substeps: of a sample. Records hold displacements and velocities, too; their one
    channel of excitation is the acceleration that it gives all masses, minus that of the base.
    Raises ValueError for other channels, and for a free run that does not begin at rest.
    """

    reads = ("f",)

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
        """Fit all numbers; returns the relative error of the accelerations that balance them."""
        motions = [motion for record in batches for motion in _motions(record.to("cpu"))]
        numbers, error = fitted(self.known, motions)
        self.numbers.data.copy_(torch.from_numpy(numbers))
        return {"balance_error": error}

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
        u = drive.u.cpu().reshape(-1, drive.samples, 1)
        ends = between(u, drive.hold, self.substeps)
        runs = [self._run(*one, drive) for one in zip(u.numpy(), ends.numpy(), strict=True)]
        shape = (3, *drive.u.shape[:-1], self.dofs)
        x, v, a = torch.from_numpy(np.stack(runs, axis=1)).reshape(shape).to(drive.u.device)
        return Response(x, v, a)

    def _run(self, u: np.ndarray, ends: np.ndarray, drive: Drive) -> np.ndarray:
        """x, v, a (3, T, n) under u (T, 1), which ends the steps at `ends` (T − 1, S, 1)."""
        frame = members(self.numbers.cpu().numpy(), self.known.mass, self.known.rho)
        motion = np.zeros((3, len(u), self.dofs))
        free(
            frame.laws, frame.sag, self.known.rho, self.known.mass, frame.alpha, frame.beta,
            u[0, 0], np.ascontiguousarray(ends[..., 0]), drive.dt / self.substeps, *motion,
        )  # fmt: skip
        return motion


def _motions(record: Record) -> list[Motion]:
    """Those of a batch. Raises ValueError where displacements or velocities are missing."""
    if record.x is None or record.v is None:
        raise ValueError(
            "model=moment_frame is fitted to displacements and velocities, too; "
            f"{record.remedy_of_state}"
        )
    x, v, a = (
        s.reshape(-1, record.samples, record.dofs).numpy() for s in (record.x, record.v, record.a)
    )
    u = record.excitation.reshape(-1, record.samples).numpy()
    parts = zip(x, v, a, u, strict=True)
    return [Motion(*(np.ascontiguousarray(s) for s in part), record.dt) for part in parts]
