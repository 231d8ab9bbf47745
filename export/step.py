"""An identified model as a state, numbers and three functions over them: what becomes C.

The functions are plain loops over arrays of fixed shape, in the part of Python that
export/translate turns into C99: what an export does is what they do, and tests hold them to the
model's own free run. They take arrays, and records of arrays (named tuples), by the names of their
arguments.
m excitations, n DOFs, E elements.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from data.record import Drive
from export.names import unit_of
from models.layers.integrate import between

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_.]*")  # e1.stiffness
SIGNALS = ("u", "x0", "v0", "first", "last", "dt")  # given with each call, not held


@dataclass(frozen=True)
class Step:
    """One sample of a model, and the next.

    begin(x0, v0, …): sets the state at the first instant. x0, v0 (n,).
    advance(first, last, dt, …): moves the state on by dt, `dt / substeps` of the step's, to just
    before the excitation there jumps. first, last (m,): the excitation at the start and the end,
    linear in between.
    observe(last, u, …): fills the outputs where the excitation jumps from `last` to `u`; called
    again with another u, it makes good what it did. After `begin`, `last` is u.

    state: arrays (float64 or int64) that change, by name, with their first values, and records of
    them; `outputs` are among them. numbers: arrays that stay, by name, and whole numbers and tuples
    of them, which are folded into the program. An array of a record is known as RECORD_FIELD.
    parameters: those of the numbers that a user may tune, with a name and a unit for each entry:
    (array, place, name, unit).
    outputs: (array of the state, name of each entry, unit of each entry).
    """

    begin: Callable[..., None]
    observe: Callable[..., None]
    advance: Callable[..., None]
    dt: float  # [s]
    state: Mapping[str, Any]
    numbers: Mapping[str, Any]
    inputs: list[tuple[str, str]]  # name and unit of each excitation
    outputs: list[tuple[str, list[str], str]]
    substeps: int = 1  # calls of `advance` in a step of `dt`
    any_step: bool = False  # whether `advance` takes any dt; others take their own alone
    holds: tuple[str, ...] = ("linear", "zero_order")  # that it knows
    parameters: list[tuple[str, tuple[int, ...], str, str]] = field(default_factory=list)
    ground: bool = False  # the first excitation is −s̈, of which callers give s̈ [m/s²]
    absolute: bool = False  # and of accelerations those against the ground plus s̈

    def __post_init__(self) -> None:
        """Raise ValueError for names that are none, units and numbers: they become code."""
        tuned = [(name, unit) for _, _, name, unit in self.parameters]
        given = [(n, unit) for _, names, unit in self.outputs for n in names]
        for name, unit in (*self.inputs, *given, *tuned):
            if not NAME.fullmatch(name) or unit_of(unit) != unit:
                raise ValueError(f"{name!r} [{unit!r}] is no name and unit of a signal")
        if type(self.substeps) is not int or not isinstance(self.dt, float | int):
            raise ValueError(f"dt={self.dt!r}, substeps={self.substeps!r}: expected numbers")

    @property
    def sensed(self) -> str | None:
        """The array whose outputs are accelerations against the ground, given as absolute ones."""
        found = [array for array, names, _ in self.outputs if names[:1] == ["a1"]]
        return found[0] if self.absolute and found else None

    def member(self, array: str) -> str:
        """What the struct calls an array of the state; by its own name go absolute ones."""
        return f"{array}_relative" if array == self.sensed else array

    def arguments(self, function: Callable[..., None]) -> list[str]:
        """Names of what a function takes. Raises ValueError for one that nobody holds."""
        names = list(inspect.signature(getattr(function, "py_func", function)).parameters)
        unknown = [n for n in names if n not in (*SIGNALS, *self.state, *self.numbers)]
        if unknown:
            raise ValueError(f"{', '.join(unknown)}: neither state nor numbers of the step")
        return names


def fields_of(name: str, value: Any) -> dict[str, Any]:
    """The arrays and numbers of a record by their own names; of any other value itself."""
    if value is None:
        return {}
    if not hasattr(value, "_fields"):
        return {name: value}
    parts = [fields_of(f"{name}_{key}", part) for key, part in value._asdict().items()]
    return {own: part for found in parts for own, part in found.items()}


def arrays_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """All arrays and numbers by their own names."""
    return {own: v for name, value in values.items() for own, v in fields_of(name, value).items()}


def copy_of(value: Any) -> Any:
    """An array, or a record of arrays, that may be written to."""
    if value is None:
        return None
    if hasattr(value, "_fields"):
        return type(value)(*map(copy_of, value))
    return np.array(value)


def run(step: Step, drive: Drive) -> dict[str, np.ndarray]:
    """The outputs (T, ·) of a drive, by the functions in Python: the reference."""
    held = {name: copy_of(value) for name, value in step.state.items()}
    known: dict[str, Any] = {**held, **step.numbers}
    u = drive.u.detach().numpy()
    ends = between(drive.u, drive.hold, 1)[:, 0].detach().numpy()
    given = {"x0": drive.x0.numpy(), "v0": drive.v0.numpy(), "dt": drive.dt / step.substeps}

    def call(function: Callable[..., None], **signals: np.ndarray) -> None:
        known.update(given, **signals)
        function(*(known[name] for name in step.arguments(function)))

    names = [name for name, *_ in step.outputs]
    history: dict[str, list[np.ndarray]] = {name: [] for name in names}
    call(step.begin, u=u[0])
    call(step.observe, last=u[0], u=u[0])
    for k in range(len(u)):
        if k > 0:
            at = u[k - 1]
            for part in range(1, step.substeps + 1):
                before, share = at, part / step.substeps
                at = u[k - 1] + share * (ends[k - 1] - u[k - 1])
                call(step.advance, first=before, last=at)
            call(step.observe, last=at, u=u[k])
        for name in names:
            history[name].append(held[name].copy())
    return {name: np.stack(values) for name, values in history.items()}
