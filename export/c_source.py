"""A step as one file of C99 and its header: no allocation, nothing but math.h.

The functions of a step (export/step.py) are translated as they are (export/translate); around
them is a struct, which is the whole state, and four functions that a person calls: step.h.j2,
step.c.j2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from data.record import SAME_STEP
from export.names import GROUND, c_comment, identifier
from export.step import SIGNALS, Step, arrays_of
from export.translate.program import Function, Program, array_of, wrapped
from export.translate.scope import TAKEN
from export.translate.values import DOUBLE, Value, known_value, number, numbers_of, table, tuple_of

OWN = """
begin_motion fail get_value go_on instance jump model set_value start_anew tell_fault values
variables fmi2 fmi3 print read reset time before line comma said rest count parts part start first
last math stdio stdlib string stddef stdarg stdint stdbool printf scanf fprintf getchar stdin stderr
memset memcpy memmove size_t calloc free snprintf strcmp offsetof
"""
RESERVED = TAKEN | set(OWN.split())  # names and files that a program of ours has already
FEW = 4  # numbers that are set one by one


@dataclass(frozen=True)
class Source:
    """The text of NAME.h and NAME.c."""

    name: str
    header: str
    body: str


def source_of(step: Step, name: str, remarks: Sequence[str] = ()) -> Source:
    """A step as C. remarks: of the model, for a comment. Raises ValueError where it cannot."""
    name = identifier(name)
    name = f"{name}_" if name in RESERVED else name
    tuned = {array for array, *_ in step.parameters}
    state, numbers = _arrays(step)
    held = {**state, **{n: v for n, v in numbers.items() if n in tuned}}
    tables = {n: v for n, v in numbers.items() if n not in tuned}
    program = Program()
    made = [_in_c(program, step, function) for function in (step.begin, step.observe, step.advance)]
    used = {n for function, _ in made for n in function.parameters}
    inputs, own_dt = len(step.inputs), f"{name.upper()}_DT"
    channels = ", ".join(f"{n} [{unit}]" if unit else n for n, unit in step.inputs)
    begin, observe, advance = (partial(_call, one) for one in made)
    words = {
        "step": step, "name": name, "big": name.upper(), "dt": repr(step.dt), "ground": GROUND,
        "remarks": c_comment([f"{name}: a model of a structure.", *remarks]),
        "excitation": c_comment([f"excitation: {channels}"]),
        "units": {array: c_comment([f"[{unit}]"]) for array, _, unit in step.outputs},
        "tables": [table(n, v) for n, v in tables.items()
                   if n in used and isinstance(v, np.ndarray)],
        "functions": program.text([function for function, _ in made]),
        "inputs": inputs, "size": max(inputs, 1), "outputs": len(step.outputs[0][1]),
        "state": state, "held": held,
        "tuned": {n: v for n, v in held.items() if n not in state and v.size},
        "filled": [a for a, value in state.items() if np.count_nonzero(value) > FEW],
        "absolute": 0 if step.sensed is None else step.state[step.sensed].size,
        "driven": "f" if step.ground else "u", "begins": "first" in made[2][1],
        "own_dt": own_dt if step.substeps == 1 else f"{own_dt} / {step.substeps}.0",
        "same_step": repr(SAME_STEP), "begin": begin, "observe": observe, "advance": advance,
        "untaken": [s for s in ("x0", "v0") if not any(s in word for word in made[0][1])]
        + ([] if inputs else ["u"]),
    }  # fmt: skip
    header, body = (TEMPLATES.get_template(f"step.{end}.j2").render(words) for end in "hc")
    lines = [part for line in body.split("\n") for part in wrapped(line)]
    return Source(name, header, "\n".join(lines))


def _arrays(step: Step) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Arrays of the state, and all that stays: of a record of the state what has no elements."""
    state, numbers = arrays_of(step.state), arrays_of(step.numbers)
    empty = {n: v for n, v in state.items() if n not in step.state and v.size == 0}
    return {n: v for n, v in state.items() if n not in empty}, {**numbers, **empty}


def _value_of(name: str, own: Any) -> Value:
    """What the translator knows of an argument."""
    if isinstance(own, np.ndarray):
        return array_of(name, own)
    if hasattr(own, "_fields"):
        named = zip(own._fields, own, strict=True)
        return tuple_of([_value_of(f"{name}_{key}", part) for key, part in named], own._fields)
    known = known_value(own)
    if known is None:
        raise ValueError(f"{name} is no array and no number")
    return known


def _in_c(program: Program, step: Step, function: Any) -> tuple[Function, list[str]]:
    """A function of the step in C, and its arguments."""
    arguments: dict[str, Value] = {}
    m, n = len(step.inputs), len(step.outputs[0][1])
    for argument in step.arguments(function):
        if argument == "dt":
            arguments[argument] = Value(DOUBLE)
        elif argument in SIGNALS:
            arguments[argument] = array_of(argument, np.zeros(n if argument in ("x0", "v0") else m))
        else:
            arguments[argument] = _value_of(argument, {**step.numbers, **step.state}[argument])
    found = program.function(function, arguments)
    state, numbers = _arrays(step)
    held = {*state, *(array for array, *_ in step.parameters)}
    words = [
        f"m->{step.member(name)}" if name in held else _word(numbers, name)
        for name in found.parameters
    ]
    return found, words


def _word(numbers: dict[str, Any], name: str) -> str:
    """A number or a table as an argument of a call."""
    own = numbers.get(name)
    return c_number(own) if isinstance(own, float) else name


def _call(made: tuple[Function, list[str]], **signals: str) -> str:
    function, words = made
    return f"{function.name}({', '.join(signals.get(word, word) for word in words)});"


def _places(value: np.ndarray) -> list[tuple[int, str]]:
    """Places of numbers that are not nil, and the numbers."""
    return [(k, c_number(value.flat[k].item())) for k in np.flatnonzero(value).tolist()]


def c_number(value: float) -> str:
    return number(value).code


TEMPLATES = Environment(  # of C, in which nothing is escaped: all text went through export/names.py
    loader=FileSystemLoader(Path(__file__).parent), trim_blocks=True, lstrip_blocks=True,
    keep_trailing_newline=True, undefined=StrictUndefined,
)  # fmt: skip
TEMPLATES.globals |= {
    "kind": lambda value: "int" if value.dtype.kind == "i" else "double",
    "places": _places,
    "numbers": lambda value: "\n".join(numbers_of(value, 8)),
}
