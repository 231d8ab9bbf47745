"""What a structure's sensors are, as far as an estimator must know: how many, and how often."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


class Sized(Protocol):
    """What was built for so many sensors."""

    dt: float  # [s]
    dofs: int
    inputs: int


@dataclass(frozen=True)
class Sensors:
    """Channels of a source of samples. `forced` as in `data.datamodule.Data`."""

    dt: float  # [s]
    dofs: int  # accelerations
    inputs: int  # channels of excitation
    forced: list[int] | str | None = None

    def check(self, estimator: Sized) -> None:
        """Raise ValueError unless an identified estimator can use them."""
        dt, dofs, inputs = estimator.dt, estimator.dofs, estimator.inputs
        if (self.dofs, self.inputs) != (dofs, inputs):
            raise ValueError(
                f"the source has {self.dofs} accelerations and {self.inputs} channels of "
                f"excitation; the run was identified with {dofs} and {inputs}; give it the same "
                "sensors, or begin from nothing (without --run)"
            )
        if abs(self.dt / dt - 1.0) > 1e-6:
            raise ValueError(
                f"the source is sampled every {self.dt:g} s, the run every {dt:g} s; "
                "resample it (data.mend.resample), or begin from nothing (without --run)"
            )
