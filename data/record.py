"""One time history: what was measured, and what only a simulation knows.

Signals are float64 tensors (…, T, channels): one record (T, c) or a batch of them (B, T, c).
n DOFs, m force channels, p supports, E elements; T samples, `dt` seconds apart.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from operator import itemgetter
from typing import Any

import torch
from torch import Tensor

from data.annotations import shown
from data.arguments import Shown, count_of

LARGEST_SIGNAL = 1e100  # in any unit: squares of larger ones, and of what they cause, overflow
SHORTEST = 20  # samples of a part of a record, by which anything is judged
SAME_STEP = 1e-3  # relative: steps and clocks of two files or crystals that agree to this are one


def all_finite(u: Tensor) -> bool:
    """Whether no value is NaN or infinite: a finite sum has neither, and takes a fifth as long."""
    return bool(torch.isfinite(u.sum())) or bool(torch.isfinite(u).all())


def is_ordinary(u: Tensor) -> bool:
    """Whether all values are finite and bearable, by one pass: most signals are."""
    if not u.numel():
        return True
    low, high = torch.aminmax(u)
    return bool(low >= -LARGEST_SIGNAL) and bool(high <= LARGEST_SIGNAL)  # NaN is neither


def require_bearable(name: str, u: Any) -> None:
    """Raise ValueError for an array or a tensor with finite values beyond `LARGEST_SIGNAL`."""
    size = abs(u)
    if ((size > LARGEST_SIGNAL) & (size < float("inf"))).any():
        raise ValueError(
            f"{name} has values beyond {LARGEST_SIGNAL:g}, whose squares no computer holds; look "
            "at its unit and its scale"
        )


def dof_numbers(numbers: Sequence[int], count: int) -> list[int]:
    """Numbers of the DOFs that so many channels are of: 1 … count, where as many are not given."""
    return list(numbers) if len(numbers) == count else list(range(1, count + 1))


def about_samples(samples: int, dt: float | None, channels: Mapping[str, Sequence[str]]) -> str:
    """What a record holds, in a line. channels: names by unit."""
    length = "without a clock" if dt is None else f"{samples * dt:.4g} s at {1.0 / dt:.5g} Hz"
    named = (
        f"{', '.join(names[:9])}{', …' if names[9:] else ''}{f' [{unit}]' if unit else ''}"
        for unit, names in channels.items()
    )
    return f"{count_of(samples, 'sample')}, {length}: {'; '.join(named)}"


def same_step(dt: float, other: float) -> bool:
    """Whether two time steps [s] are one, up to rounding and the drift of clocks."""
    return abs(dt - other) <= SAME_STEP * abs(other)


@dataclass(frozen=True)
class Truth:
    """What no sensor sees: the motion without noise, deformations and forces of the elements."""

    x: Tensor  # displacement (…, T, n) [m]
    v: Tensor  # velocity (…, T, n) [m/s]
    a: Tensor  # acceleration (…, T, n) [m/s²]
    y: Tensor  # element deformation (…, T, E) [m]
    r: Tensor  # element restoring force (…, T, E) [N]
    f: Tensor | None = None  # force (…, T, m) [N], where its sensor errs
    kept: Tensor | None = None  # share of its stiffness an element still has (…, T, E), if damaged


@dataclass(frozen=True)
class Drive:
    """All that a free run is given: the excitation and the state at its first sample."""

    dt: float  # time step [s]
    u: Tensor  # excitation (…, T, m): forces [N], then support motions [m], [m/s]
    x0: Tensor  # displacement (…, n) [m]
    v0: Tensor  # velocity (…, n) [m/s]
    hold: str = "linear"  # of u between samples, see HOLDS

    def __post_init__(self) -> None:
        _require_step(self.dt)
        _require_choice("hold", self.hold, HOLDS)
        _take_signals(self, {"u": self.u, "x0": self.x0, "v0": self.v0})
        if self.u.ndim < 2 or 0 in self.u.shape[:-1]:
            raise ValueError(
                f"u has shape {tuple(self.u.shape)}; expected (samples, channels), or runs of them"
            )
        if self.x0.shape != self.v0.shape or self.x0.shape[:-1] not in (self.u.shape[:-2], ()):
            raise ValueError(
                f"x0 has shape {tuple(self.x0.shape)} and v0 {tuple(self.v0.shape)}, which do not "
                f"fit u with shape {tuple(self.u.shape)}; expected (DOFs,) for each run"
            )

    @property
    def samples(self) -> int:
        return self.u.shape[-2]


@dataclass(frozen=True)
class Response:
    """What a free run returns: the motion that a model says the excitation causes."""

    x: Tensor  # displacement (…, T, n) [m]
    v: Tensor  # velocity (…, T, n) [m/s]
    a: Tensor  # acceleration (…, T, n) [m/s²]
    integrated: bool = field(default=False, kw_only=True)  # x and v from a, adding up its errors


def _require_step(dt: object) -> None:
    if not isinstance(dt, int | float) or not 0.0 < dt < float("inf"):
        raise ValueError(f"dt={shown(dt)} s must be positive")


def _require_choice(name: str, value: object, choices: Sequence[str]) -> None:
    if value not in choices:
        raise ValueError(f"{name}={shown(value)}: choose {', '.join(choices)}")


def _take_signals(holder: Any, signals: Mapping[str, Tensor]) -> None:
    """Let `holder` have its signals in double precision.

    Raises ValueError unless all are tensors of real numbers on one device.
    """
    for name, u in signals.items():
        known = isinstance(u, Tensor) and u.layout == torch.strided and u.device.type != "meta"
        if not known or u.is_complex() or u.dtype == torch.bool:
            described = isinstance(u, Tensor)
            kind = f"{u.dtype}, {u.layout}, on {u.device}" if described else type(u).__name__
            raise ValueError(
                f"{name} is {kind}; signals are tensors of real numbers: "
                "torch.as_tensor(values, dtype=torch.float64)"
            )
        if u.dtype != torch.float64:
            object.__setattr__(holder, name, u.to(torch.float64))
    devices = {u.device for u in signals.values()}
    if len(devices) > 1:
        named = " and ".join(sorted(map(str, devices)))
        raise ValueError(f"the signals lie on {named}; move them to one")


QUANTITIES = {  # that `a` may be, with symbol and unit
    "acceleration": ("ẍ", "m/s²"),
    "velocity": ("ẋ", "m/s"),
    "displacement": ("x", "m"),
    "force": ("r", "N"),
    "output": ("y", "–"),
}
HOLDS = ("linear", "zero_order", "band_limited")
INITIAL_STATES = ("rest", "given", "periodic", "unknown")


@dataclass(frozen=True, repr=False)
class Record(Shown):
    """A record, or a batch of records of equal length. Raises ValueError for unequal shapes.

    Signals of single precision and of whole numbers are taken to double precision.

    `a` is what is estimated and scored: accelerations, unless `quantity` names what else the
    sensors measured: a displacement, say, the force of an element under an imposed motion s and
    s_dot, or an output of whatever unit.

    `initial_state` says how the motion begins: at rest, with the first x and v as given, in the
    periodic steady state of an excitation that repeats itself, or in a motion that is unknown: then
    the first `warmup` samples tell of it to models that can estimate a state, and for all others it
    is at rest. `hold` says what the excitation does
    between samples: "linear" and "zero_order" as digital-to-analogue converters do, or
    "band_limited", which looks ahead and so is not causal.
    """

    dt: float  # time step [s]
    a: Tensor  # acceleration (…, T, n) [m/s²], or `quantity`
    f: Tensor  # force (…, T, m) [N]
    x: Tensor | None = None  # displacement (…, T, n) [m]
    v: Tensor | None = None  # velocity (…, T, n) [m/s]
    s: Tensor | None = None  # support displacement (…, T, p) [m]
    s_dot: Tensor | None = None  # support velocity (…, T, p) [m/s]
    truth: Truth | None = None
    warmup: int = 0  # first samples: filters may use them, metrics do not count them
    initial_state: str = "rest"
    hold: str = "linear"
    quantity: str = "acceleration"
    e: Tensor | None = None  # other inputs (…, T, k), such as a voltage or a temperature
    numbers: tuple[int, ...] = ()  # of the DOFs that the channels of a are of; (): 1 … n
    o: Tensor | None = None  # other outputs (…, T, k) [m]: displacements of floors, drifts
    others: tuple[str, ...] = ()  # their channels, such as x5 and drift2

    def __post_init__(self) -> None:
        _require_step(self.dt)
        _require_choice("initial_state", self.initial_state, INITIAL_STATES)
        _require_choice("hold", self.hold, HOLDS)
        _require_choice("quantity", self.quantity, tuple(QUANTITIES))
        _take_signals(self, {"a": self.a, "f": self.f, **self.signals()})
        if not isinstance(self.warmup, int):
            raise ValueError(f"warmup={self.warmup!r} must be a whole number of samples")
        if self.a.ndim >= 2 and 0 in (*self.a.shape[:-2], self.a.shape[-1]):
            raise ValueError(
                f"a has shape {tuple(self.a.shape)}, which holds no numbers; expected records of "
                "at least one channel"
            )
        if self.a.ndim < 2 or self.a.shape[-2] < 2:
            raise ValueError(
                f"a record of shape {tuple(self.a.shape)} has too few samples; expected "
                "(samples, DOFs) with at least 2 samples"
            )
        for name, signal in self.signals().items():
            if signal.shape[:-1] != self.a.shape[:-1] or (
                name in "xv" and signal.shape != self.a.shape
            ):
                raise ValueError(
                    f"{name} has shape {tuple(signal.shape)}, which does not fit "
                    f"a with shape {tuple(self.a.shape)}; all signals share their samples"
                )
        self._take_numbers()
        if not 0 <= self.warmup < self.samples:
            raise ValueError(
                f"warmup={self.warmup} samples must be shorter than the record "
                f"of {self.samples} samples"
            )

    def _take_numbers(self) -> None:
        object.__setattr__(self, "others", tuple(self.others))
        if len(self.others) != (0 if self.o is None else self.o.shape[-1]):
            raise ValueError(
                f"others={shown(self.others)} name the channels of o; expected one name for each"
            )
        numbers = tuple(self.numbers)
        if numbers and not (
            len(numbers) == self.dofs
            and all(isinstance(i, int) and not isinstance(i, bool) for i in numbers)
            and all(i < j for i, j in zip((0, *numbers), numbers, strict=False))
        ):
            raise ValueError(
                f"numbers={shown(self.numbers)} of the DOFs do not fit a with shape "
                f"{tuple(self.a.shape)}; expected one for each channel, positive and ascending"
            )
        object.__setattr__(self, "numbers", () if numbers[-1:] == (self.dofs,) else numbers)

    def __repr__(self) -> str:
        units = {"a": QUANTITIES[self.quantity][1], "f": "N", "v": "m/s", "s_dot": "m/s", "e": ""}
        found: dict[str, list[str]] = {}
        for name, signal in self.signals().items():
            numbers = self.dof_numbers if name in "axv" else range(1, signal.shape[-1] + 1)
            named = self.others if name == "o" else [f"{name}{i}" for i in numbers]
            found.setdefault(units.get(name, "m"), []).extend(named)
        many = f"{self.a[..., 0, 0].numel()} × " if self.a.ndim > 2 else ""
        return f"<Record of {many}{about_samples(self.samples, self.dt, found)}>"

    @property
    def samples(self) -> int:
        return self.a.shape[-2]

    @property
    def dofs(self) -> int:
        return self.a.shape[-1]

    @property
    def dof_numbers(self) -> list[int]:
        """Numbers of the DOFs that the channels of a, and of x and v, are of."""
        return dof_numbers(self.numbers, self.dofs)

    @property
    def excitation(self) -> Tensor:
        """All that drives the structure: forces, then support motions and other inputs, if any."""
        parts = [u for u in (self.f, self.s, self.s_dot, self.e) if u is not None]
        return parts[0] if len(parts) == 1 else torch.cat(parts, dim=-1)

    def drive(self) -> Drive:
        """What a free run of this record may see. Raises ValueError where a state is missing."""
        if self.initial_state != "given":
            rest = torch.zeros_like(self.a[..., 0, :])
            return Drive(self.dt, self.excitation, rest, rest, self.hold)
        if self.x is None or self.v is None:
            raise ValueError(
                f"the record begins in motion but has no x and v; {self.remedy_of_state}, or start "
                "at rest and count the first samples as warm-up (data.initial_state=rest, "
                "data.warmup)"
            )
        return Drive(self.dt, self.excitation, self.x[..., 0, :], self.v[..., 0, :], self.hold)

    @property
    def remedy_of_state(self) -> str:
        """What to do where x and v are missing: only accelerations can be integrated."""
        if self.quantity == "acceleration":
            return (
                "measure them, integrate (scenario=integrated), or take a model that reads none: "
                "model=element_network model/reads=accelerations, model=linear_modes, model=vwnn"
            )
        own = "element_test" if self.quantity == "force" else "element_network"
        return (
            f"take a model that a {self.quantity} alone can train: model={own}, "
            "model=linear_modes, model=vwnn"
        )

    def signals(self) -> dict[str, Tensor]:
        """The measured signals that this record has, by name."""
        named = {name: getattr(self, name) for name in ("a", "f", "x", "v", "s", "s_dot", "e", "o")}
        return {name: signal for name, signal in named.items() if signal is not None}

    def require_finite(self) -> None:
        """Raise ValueError naming the first sample that is NaN or infinite, and too large ones."""
        for name, signal in self.signals().items():
            if is_ordinary(signal):
                continue
            require_bearable(name, signal)
            if not all_finite(signal):
                bad = torch.nonzero(~torch.isfinite(signal))[0]
                at = int(bad[-1])
                channel = (
                    self.others[at] if name == "o"
                    else self.dof_numbers[at] if name in "axv" else at + 1
                )  # fmt: skip
                raise ValueError(
                    f"{name} is not finite at sample {int(bad[-2])} "
                    f"(t = {float(bad[-2]) * self.dt:g} s, channel {channel}); "
                    "mend or cut the record"
                )

    def truly_driven(self) -> Record:
        """This record with the force that acted, where its sensor erred."""
        if self.truth is None or self.truth.f is None:
            return self
        return replace(self, f=self.truth.f)

    def measured(self) -> Record:
        """This record without what only a simulation knows."""
        return self if self.truth is None else replace(self, truth=None)

    def map(self, change: Callable[[Tensor], Tensor]) -> Record:
        """This record with `change` applied to every signal, measured and true."""
        changed: dict[str, Any] = {name: change(signal) for name, signal in self.signals().items()}
        if self.truth is not None:
            named = {one.name: getattr(self.truth, one.name) for one in fields(Truth)}
            true = {name: change(u) for name, u in named.items() if u is not None}
            return replace(self, **changed, truth=Truth(**true))
        return replace(self, **changed)

    def counted(self, signal: Tensor) -> Tensor:
        """The samples (…, t, c) of a signal (…, T, c) after the warm-up, which alone are scored."""
        return signal[..., self.warmup :, :]

    def window(self, start: int, length: int, warmup: int = 0) -> Record:
        """Samples `start` … `start + length − 1`, the first `warmup` of them for warming up."""
        unknown = self.initial_state == "unknown" and (self.x is None or self.v is None)
        begins = self.initial_state if start == 0 or unknown else "given"
        if begins == "periodic" and length < self.samples:  # a part of a period is none
            begins = "given"
        cut = replace(self, warmup=0).map(lambda u: u[..., start : start + length, :])
        return replace(cut, warmup=warmup, initial_state=begins)

    def behind(self, before: Record) -> Record:
        """This record as the end of one that begins with `before`, whose samples are its warm-up.

        Both have the same signals.
        """
        own = iter(_tensors(self))
        whole = replace(before, warmup=0).map(lambda u: torch.cat([u, next(own)], dim=-2))
        return replace(whole, warmup=before.samples)

    def to(self, device: torch.device | str) -> Record:
        return self.map(lambda u: u.to(device))


def singles(batches: Iterable[Record]) -> Iterator[Record]:
    """The records of all batches, one by one."""
    for batch in batches:
        if batch.a.ndim < 3:
            yield batch
        else:
            yield from (batch.map(itemgetter(i)) for i in range(len(batch.a)))


def stack(records: Sequence[Record]) -> Record:
    """Records of equal length and warm-up as one batch, signals (B, T, c).

    Where some begin in motion and others do not, all begin as measured.
    """
    kinds = {
        (
            *(r.dt, r.warmup, r.hold, r.quantity, r.truth is None, r.numbers, r.others),
            *((name, tuple(u.shape)) for name, u in r.signals().items()),
        )
        for r in records
    }
    if len(kinds) != 1:
        raise ValueError(
            "records differ in (dt, warm-up, hold, quantity, truth missing, numbers, others, "
            "signals): "
            f"{' and '.join(map(str, sorted(kinds, key=str)[:2]))}; "
            "give all the same signals and cut them into windows of equal length"
        )
    begins = {r.initial_state for r in records}
    if len(records) == 1:  # nothing is copied
        batch = records[0].map(lambda signal: signal.unsqueeze(0))
    else:
        rest = iter(zip(*(_tensors(r) for r in records), strict=True))
        batch = records[0].map(lambda _: torch.stack(next(rest)))
    return replace(batch, initial_state=begins.pop() if len(begins) == 1 else "given")


def _tensors(record: Record) -> list[Tensor]:
    seen: list[Tensor] = []

    def note(u: Tensor) -> Tensor:
        seen.append(u)
        return u

    record.map(note)
    return seen


@dataclass(frozen=True)
class Escape:
    """A motion that escaped: split, record and time [s].

    redrawn: motions that were drawn instead until one stayed; 0: the record was left out.
    """

    split: str
    record: int
    time: float
    redrawn: int = 0
