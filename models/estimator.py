"""The interface of the zoo: records in, accelerations out, at every time step.

An estimator has a closed-form part, solved by `identify`. One with parameters that still require a
gradient afterwards is a `Trainable` (models/fit/trainable.py). The estimate at t_k never uses
the acceleration at t_k.   B records, T samples, n DOFs, m channels of excitation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import wraps
from importlib import import_module
from itertools import chain
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import torch
from torch import Tensor, nn

from data.annotations import MOST, Positive, Range
from data.arguments import as_html
from data.checked import checked, constructor_of
from data.record import (
    Drive,
    Record,
    Response,
    all_finite,
    is_ordinary,
    require_bearable,
    same_step,
)

if TYPE_CHECKING:
    from data.datamodule import Data


class NoFreeRunError(ValueError):
    """Raised by estimators that cannot simulate; the message says why."""


@dataclass(frozen=True)
class Parameter:
    """A physical parameter of an identified model.

    about: what its part is, such as the nodes that an element joins. derived: it follows from
    others of the list, as a yield force from stiffness and yield displacement.
    """

    name: str
    value: float
    unit: str  # SI; "" where it has none
    about: str = ""
    derived: bool = False


PERIODS = (2, 5)  # how often a periodic excitation is repeated, and again where that was too short
SETTLED = 1e-6  # largest change of the motion between two periods, relative


@checked
class Estimator(nn.Module):
    """Base of all estimators. `reads` names the signals of a record that `forward` may read.

    What a class defines of `identify`, `forward` and `free_run` is handed signals that `check`
    passed, and finite ones unless the class is one that `mends` them; its constructor is handed
    arguments of the types that it names.
    """

    reads: ClassVar[tuple[str, ...]] = ("a", "f")
    mends: ClassVar[bool] = False  # copes with NaN
    later: ClassVar[tuple[str, ...]] = ()  # buffers that older files of weights lack
    takes_other_inputs: ClassVar[bool] = True  # such as a voltage, beside forces and motions
    reading_other_inputs: ClassVar[str] = "gru or neural_state_space"  # instead of this one
    laws_are_curves: ClassVar[bool] = False  # which no parameter states
    elements: list[list[str]] | None = None  # the nodes that each element joins
    supports: int = 0  # that move
    on_processor: ClassVar[bool] = False  # compiled code does its work, which a GPU cannot run

    def __init_subclass__(cls, **more: Any) -> None:
        super().__init_subclass__(**more)
        own = vars(cls)
        if "__init__" in own:
            checked(cls, finite=False)  # their own words do: what is built need not be ours
            # else inspect would take that of `__new__` for it, which `ByLaws` has
            cls.__signature__ = constructor_of(cls)  # type: ignore[attr-defined, arg-type]
        for name, admit in (("identify", _Admitted), ("forward", _record), ("free_run", _drive)):
            if name in own:
                setattr(cls, name, _checking(own[name], admit))

    def __init__(
        self,
        dofs: Annotated[int, Range(1, MOST)],
        inputs: Annotated[int, Range(0, MOST)],
        dt: Positive,
    ) -> None:
        super().__init__()
        self.dofs, self.inputs, self.dt = dofs, inputs, dt

    def extra_repr(self) -> str:
        return f"dofs={self.dofs}, inputs={self.inputs}, dt={self.dt:g}"

    def _repr_html_(self) -> str:
        """What it is and its parameters, for a notebook."""
        description = import_module("report.describe.description")  # a room above this one
        return as_html(description.text_of(self))

    def identify(self, batches: Iterable[Record]) -> dict[str, Any]:
        """Solve whatever has a closed form; returns facts about the solution, such as its rank.

        `batches` may be iterated more than once and need not fit in memory together.
        """
        return {}

    def todays_weights(self, stored: dict[str, Tensor]) -> dict[str, Tensor]:
        """Weights of an earlier version as this one has them.

        Raises ValueError where that changes the model.
        """
        return stored

    @classmethod
    def topology_from(cls, settings: Mapping[str, Any], data: Data) -> str | None:
        """The topology of elements that the training records show; None where it is not open.

        settings: of the model's config. It becomes `Sensors.topology`.
        """
        return None

    @classmethod
    def rival_topology(cls, topology: str, error: float | None) -> str | None:
        """Another topology that is worth a fit as well; None for none.

        error: relative, of the fitted model on held-back motion, where there is some.
        """
        return None

    def forward(self, record: Record) -> Tensor:
        """Estimated acceleration (…, T, n) [m/s²] of a record or a batch of records."""
        raise NotImplementedError

    def estimates(self, record: Record) -> dict[str, Tensor]:
        """All estimates (…, T, n) that are scored: "" is `forward`, others have a name."""
        return {"": self(record)}

    def free_run(self, drive: Drive) -> Response:
        """The motion from the excitation and the initial state alone, on the model's own estimates.

        Differentiable in the parameters, where there are any. A run that diverges is returned as it
        is, with huge or non-finite values. Raises NoFreeRunError where the model cannot simulate.
        """
        raise NoFreeRunError(f"{type(self).__name__} has no free run")

    def run_of(self, record: Record) -> Response:
        """The free run of a record; one that begins in an unknown motion is begun at rest."""
        return self.free_run(record.drive())

    @torch.no_grad()
    def physical_parameters(self) -> list[Parameter]:
        """Masses, springs, dampers, yield points, modes in SI units; none of a black box.

        Where `scale_is_open`, masses and forces are known up to a factor that all of them share.
        Raises ValueError for an estimator that is not identified.
        """
        return list(self._physical_parameters())

    def _physical_parameters(self) -> Iterable[Parameter]:
        return ()

    @property
    def scale_is_open(self) -> bool:
        """Whether masses and forces share an unknown factor: no force, mass or prior was given."""
        return False

    def small_motion(self) -> tuple[Tensor, Tensor, Tensor] | None:
        """K (n, n) [1/s²] and C (n, n) [1/s] per unit mass for small motions, Φ (o, n) of outputs.

        None of a model that holds no linear structure.
        """
        return None

    def masses(self) -> Tensor | None:
        """Masses (n,) [kg], where the model knows them."""
        return None

    def likely(self) -> Iterator[Any]:
        """Laws that records leave as likely as the identified ones; none where none were drawn."""
        return iter(())

    def run_with_loops(self, drive: Drive) -> tuple[Response, tuple[Tensor, Tensor] | None]:
        """The free run; deformations [m] and forces [N] (…, T, E) of elements, where it has any."""
        return self.free_run(drive), None

    def check(self, signals: Record | Drive) -> None:
        """Raise ValueError where a record, or the excitation of a free run, does not fit."""
        own = next(chain(self.parameters(), self.buffers()), None)
        device = (signals.u if isinstance(signals, Drive) else signals.a).device
        if own is not None and own.device != device:
            raise ValueError(
                f"the signals lie on {device}, {type(self).__name__} on {own.device}; move either: "
                f"record.to({str(own.device)!r})"
            )
        if isinstance(signals, Drive):
            self._check_drive(signals)
        else:
            self._check_record(signals)

    def _check_record(self, record: Record) -> None:
        if not same_step(record.dt, self.dt):
            raise ValueError(
                f"the record has dt={record.dt} s, the estimator was built for dt={self.dt} s; "
                "resample the record or identify a new model"
            )
        missing = [name for name in self.reads if getattr(record, name) is None]
        if missing:
            raise ValueError(
                f"{type(self).__name__} reads {', '.join(missing)}, which the record lacks; "
                f"{record.remedy_of_state}"
            )
        if record.dofs != self.dofs or record.excitation.shape[-1] != self.inputs:
            raise ValueError(
                f"the record has {record.dofs} DOFs and {record.excitation.shape[-1]} channels of "
                f"excitation; {type(self).__name__} was built for {self.dofs} and {self.inputs}"
            )

    def _check_drive(self, drive: Drive) -> None:
        if not same_step(drive.dt, self.dt):
            raise ValueError(
                f"the excitation has dt={drive.dt} s, the estimator was built for dt={self.dt} s; "
                "resample it or identify a new model"
            )
        if drive.u.shape[-1] != self.inputs or drive.x0.shape[-1] != self.dofs:
            raise ValueError(
                f"there are {drive.u.shape[-1]} channels of excitation and {drive.x0.shape[-1]} "
                f"DOFs; {type(self).__name__} was built for {self.inputs} and {self.dofs}"
            )

    def require_identified(self, weights: Tensor) -> None:
        """Raise ValueError where `weights` are not finite."""
        if not torch.isfinite(weights).all():
            raise ValueError(
                f"{type(self).__name__} is not identified yet; call identify(records) or load a "
                "finished run"
            )

    @property
    def identified_parameters(self) -> int:
        """Number of parameters that the data determine."""
        return sum(p.numel() for p in self.parameters())


def _checking(method: Callable[..., Any], admit: Callable[[Estimator, Any], Any]) -> Any:
    """A method of an estimator that is handed what `admit` returns in place of its argument."""

    @wraps(method)
    def checking(self: Estimator, signals: Any) -> Any:
        return method(self, admit(self, signals))

    return checking


def _record(estimator: Estimator, record: Any) -> Record:
    """The record. Raises ValueError where the estimator cannot use it."""
    if not isinstance(record, Record):
        raise ValueError(f"{type(record).__name__} is no Record; Record(dt, a, f) makes one")
    estimator.check(record)
    if not estimator.mends:
        read = record if "a" in estimator.reads else replace(record, a=torch.zeros_like(record.a))
        read.require_finite()
    return record


def _drive(estimator: Estimator, drive: Any) -> Drive:
    """The excitation. Raises ValueError where the estimator cannot use it."""
    if not isinstance(drive, Drive):
        raise ValueError(f"{type(drive).__name__} is no Drive; record.drive() makes one")
    estimator.check(drive)
    for name, u in (("u", drive.u), ("x0", drive.x0), ("v0", drive.v0)):
        if is_ordinary(u):
            continue
        if not all_finite(u):
            raise ValueError(f"{name} of the free run is not finite; mend or cut the record")
        require_bearable(f"{name} of the free run", u)
    return drive


class ByLaws:
    """A front of several estimators: `laws` says which of them is built, see models.KINDS."""

    def __new__(cls, *args: Any, laws: Any = None, **more: Any) -> Any:
        """An object of the kind, whose constructor is called next: it is a subclass.

        Raises ValueError for laws that there are not.
        """
        front = import_module("models")  # which loads no estimator by itself
        name = front.class_name(cls.__name__, laws)
        return super().__new__(cls if name == cls.__name__ else getattr(front, name))


class _Admitted(Iterable[Record]):
    """Batches to identify from, each looked at as often as they are iterated.

    Without derivatives: what is solved in closed form has none. Raises ValueError where there are
    none, or where they do not fit.
    """

    def __init__(self, estimator: Estimator, batches: Any) -> None:
        if isinstance(batches, Record) or not isinstance(batches, Iterable):
            raise ValueError("identify takes records in a list, such as identify([record])")
        self.estimator, self.batches = estimator, batches

    def __iter__(self) -> Iterator[Record]:
        none = True
        for record in self.batches:
            _record(self.estimator, record)
            if not self.estimator.mends:
                record.require_finite()
            none = False
            asked = any(u.requires_grad for u in record.signals().values())
            yield record.map(torch.detach) if asked else record
        if none:
            raise ValueError(
                "there are no records to identify from; give them in a list (an iterator is empty "
                "after its first pass)"
            )


def weight_matrix(rows: int, columns: int) -> nn.Parameter:
    """Weights (rows, columns) of a closed-form head; NaN until identified."""
    empty = torch.full((rows, columns), torch.nan, dtype=torch.float64)
    return nn.Parameter(empty, requires_grad=False)


def simulate(estimator: Estimator, record: Record) -> Response:
    """Motion (…, T, n) under the record's excitation; no measured sample but the first is seen.

    Raises NoFreeRunError for an estimator that has none, and for a record that begins in motion
    without its state.
    """
    try:
        drive = record.drive()
    except ValueError as reason:
        raise NoFreeRunError(str(reason)) from None
    periodic = record.initial_state == "periodic"
    return periodic_run(estimator, drive) if periodic else estimator.run_of(record)


def periodic_run(estimator: Estimator, drive: Drive) -> Response:
    """The last period of an excitation that repeats itself: the steady state, where it is reached.

    `drive` is one period; runs begin at rest and always from the start, for estimators remember
    more than the state. Times of the response count from the start of its period.
    """
    T = drive.samples
    for periods in PERIODS:
        whole = estimator.free_run(replace(drive, u=torch.cat([drive.u] * periods, dim=-2)))
        if _settled(whole.a, T):
            break
    return Response(*(s[..., -T:, :] for s in (whole.x, whole.v, whole.a)))


def _settled(a: Tensor, T: int) -> bool:
    """The accelerations in the last quarter of the last two periods agree.

    Not the states: some estimators get theirs by integration, which drifts.
    """
    tail = -(-T // 4)
    before, last = a[..., -T - tail : -T, :], a[..., -tail:, :]
    change = torch.linalg.vector_norm(last - before)
    return bool(change <= SETTLED * torch.linalg.vector_norm(last))
