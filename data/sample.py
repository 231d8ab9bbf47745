"""Samples of a record one by one, as the sensors deliver them while the structure moves.

n DOFs, m force channels, p supports.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import torch
from torch import Tensor

from data.checked import checked
from data.measured.channels import beside, numbered
from data.record import Record, dof_numbers, same_step

OUTPUTS = {"acceleration": "a", "velocity": "v", "displacement": "x", "force": "r"}
INPUTS = ("f", "x", "v", "s", "s_dot", "e")  # what an estimate at k may see of sample k


@dataclass(frozen=True)
class Sample:
    """Signals as in `Record`, float64, at one instant; a missing signal is None.

    `a` arrives after the estimate of it. `time` [s] is that of the sensors' clock, where there is
    one: dropped and repeated samples show in it.
    """

    f: Tensor  # force (m,) [N]
    a: Tensor | None = None  # acceleration (n,) [m/s²]
    x: Tensor | None = None  # displacement (n,) [m]
    v: Tensor | None = None  # velocity (n,) [m/s]
    s: Tensor | None = None  # support displacement (p,) [m]
    s_dot: Tensor | None = None  # support velocity (p,) [m/s]
    time: float | None = None
    e: Tensor | None = None  # other inputs (k,)
    o: Tensor | None = None  # other outputs (k,) [m], which arrive with `a`

    @property
    def excitation(self) -> Tensor:
        """Forces, then support motions and other inputs, as in `Record.excitation`."""
        if self.s is None and self.s_dot is None and self.e is None:
            return self.f
        return torch.cat([u for u in (self.f, self.s, self.s_dot, self.e) if u is not None])


def samples_of(record: Record) -> Iterator[Sample]:
    """Samples of one record (T, ·) with their times. Raises ValueError for a batch of records."""
    if record.a.ndim != 2:
        raise ValueError(
            f"the record holds a batch {tuple(record.a.shape)}; give its records one by one"
        )
    signals = {name: u.unbind(dim=0) for name, u in record.signals().items()}
    for k in range(record.samples):
        at_k = {name: u[k] for name, u in signals.items()}
        yield Sample(**at_k, time=k * record.dt)


class Sized(Protocol):
    """An estimator, as far as its sensors are concerned."""

    dt: float  # [s]
    dofs: int
    inputs: int


@checked
@dataclass(frozen=True)
class Sensors:
    """All that must be known of records, or of a stream, to build a model for their channels.

    Plain values: `Sensors(**json.loads(json.dumps(asdict(sensors))))` equals `sensors`.
    `forced` as in `data.datamodule.Data`, `quantity` as in `data.record.Record`.
    """

    dt: float  # [s]
    dofs: int  # channels that are estimated
    inputs: int  # channels of excitation
    forced: list[int] | str | None = None
    quantity: str = "acceleration"
    channels: Sequence[str] = ()  # names, such as f1 and a1, where files have them
    units: Mapping[str, str] = field(default_factory=dict)  # of a record's values, by channel
    topology: str | None = None  # of the elements, "chain" or "all" pairs, where the records told

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", tuple(self.channels))  # JSON makes a list of it

    @property
    def numbers(self) -> list[int]:
        """Numbers of the DOFs that are estimated, by the names of the channels."""
        signal = OUTPUTS.get(self.quantity, "y")
        own = [c.removeprefix(signal) for c in self.channels if c.startswith(signal)]
        return dof_numbers(sorted(int(i) for i in own if i.isdecimal()), self.dofs)

    def unit_of(self, channel: str) -> str:
        """Unit of a channel of a record; "" where it is not known."""
        known = {"f": "m/s²" if self.forced == "base" else "N", "s": "m", "s_dot": "m/s"}
        return self.units.get(channel) or known.get(channel.rstrip("0123456789"), "")

    @property
    def others(self) -> list[str]:
        """Displacements, drifts and strains that are measured beside what is estimated."""
        return beside(self.channels, self.quantity)

    @property
    def highest(self) -> int:
        """The highest number of a DOF that anything is measured of."""
        others = numbered(self.others, "x") + numbered(self.others, "drift")
        return max([*self.numbers, *others], default=0)

    def unread(self, estimator: object) -> dict[str, list[str]]:
        """What is said of channels that an estimator does not read; {} where it reads all."""
        rates = numbered(self.channels, "v")
        left = [f"v{i}" for i in rates if rates != self.numbers]
        left += [c for c in self.others if c not in getattr(estimator, "others", [])]
        why = "drifts, strains and displacements of other DOFs are read by model=element_network "
        why += "model.laws=named, velocities where each acceleration has one"
        return {f"not read: {', '.join(left)}": [why]} if left else {}

    def require_dofs_of(self, run: Sensors) -> None:
        """Raise ValueError where as many channels are of other DOFs than those of a run.

        And where a base or other DOFs are driven; older runs may not say which.
        """
        if run.dofs == self.dofs and run.numbers != self.numbers:
            raise ValueError(
                f"the run was identified on the DOFs {run.numbers}, the records are of "
                f"{self.numbers}; name their channels (data.channels)"
            )
        both = (run.forced, self.forced)
        known = "base" in both or None not in both
        if known and run.forced != self.forced and run.quantity != "output":
            own, theirs = map(_driven_by, both)
            raise ValueError(
                f"the run was driven by {own}, the records by {theirs}; name the channels "
                "(data.channels)"
            )

    def check(self, estimator: Sized) -> None:
        """Raise ValueError unless an identified estimator can use these channels."""
        wanted = getattr(estimator, "others", [])
        if wanted and self.others != wanted:
            raise ValueError(
                f"the run was identified with {', '.join(wanted)} beside accelerations, the source "
                f"has {', '.join(self.others) or 'none of them'}; give it the same sensors"
            )
        dt, dofs, inputs = estimator.dt, estimator.dofs, estimator.inputs
        if (self.dofs, self.inputs) != (dofs, inputs):
            raise ValueError(
                f"the source has {self.dofs} accelerations and {self.inputs} channels of "
                f"excitation; the run was identified with {dofs} and {inputs}; give it the same "
                "sensors, or begin from nothing (without --run)"
            )
        if not same_step(self.dt, dt):
            raise ValueError(
                f"the source is sampled every {self.dt:g} s, the run every {dt:g} s; "
                "resample it (data.mend.resample), or begin from nothing (without --run)"
            )


def _driven_by(forced: list[int] | str | None) -> str:
    if forced == "base":
        return "the acceleration of its base (s_ddot1)"
    if forced is None:
        return "forces or support motions"
    return ", ".join(f"f{i}" for i in forced) or "no force"
