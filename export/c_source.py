"""A step as one file of C99 and its header: no allocation, nothing but math.h.

The functions of a step (export/step.py) are translated as they are (export/translate); around
them is a struct, which is the whole state, and four functions that a person calls.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

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
    text = program.text([function for function, _ in made])
    used = {n for function, _ in made for n in function.parameters}
    constants = [table(n, v) for n, v in tables.items() if n in used and isinstance(v, np.ndarray)]
    parts = [
        c_comment([f"{name}: a model of a structure.", *remarks]),
        f'#include "{name}.h"\n\n#include <math.h>\n#include <string.h>',
        *constants,
        text,
        *_public(step, name, held, made),
    ]
    lines = [part for line in "\n\n".join(parts).split("\n") for part in wrapped(line)]
    return Source(name, header_of(step, name, held, remarks), "\n".join(lines) + "\n")


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


def _public(
    step: Step, name: str, held: dict[str, np.ndarray], made: list[tuple[Function, list[str]]]
) -> Iterable[str]:
    begin, observe, advance = made
    given = "f" if step.ground else "u"
    kept = {"last": "m->last", "u": "m->last"}
    inputs, n = len(step.inputs), len(step.outputs[0][1])
    yield "\n".join(_reset(step, name))
    if step.ground:
        yield "\n".join(_driving(step, name))
    state, _ = _arrays(step)
    tuned = [a for a in held if a not in state and held[a].size]
    yield "\n".join(
        [
            f"void {name}_init({name} *m)",
            "{",
            f"    static const double rest[{max(n, inputs, 1)}] = {{0.0}};",
            *(line for array in tuned for line in _first_values(array, held[array])),
            "",
            "    memset(m, 0, sizeof *m);",
            *(f"    memcpy(m->{a}, first_{a}, sizeof first_{a});" for a in tuned),
            f"    {name}_begin(m, rest, rest, rest);",
            "}",
        ]
    )
    yield "\n".join(
        [
            f"void {name}_begin({name} *m, const double *x0, const double *v0, const double *u)",
            "{",
            *_given(step, inputs),
            "    reset(m);",
            *_copied("m->u", "u", inputs),
            *_copied("m->last", given, inputs),
            *([] if any("x0" in w for w in begin[1]) else ["    (void)x0;"]),
            *([] if any("v0" in w for w in begin[1]) else ["    (void)v0;"]),
            *([] if inputs else ["    (void)u;"]),
            f"    {_call(begin, **kept)}",
            f"    {_call(observe, **kept)}",
            *_absolute(step),
            "}",
        ]
    )
    yield "\n".join(
        [
            f"void {name}_excite({name} *m, const double *u)",
            "{",
            *_given(step, inputs),
            f"    {_call(observe, last='m->last', u=given)}",
            *_copied("m->u", "u", inputs),
            *_absolute(step),
            "}",
        ]
    )
    yield "\n".join(_stepping(step, name, inputs, observe, advance))


def _reset(step: Step, name: str) -> Iterable[str]:
    """The state as it is before a motion."""
    yield f"static void reset({name} *m)"
    yield "{"
    state, _ = _arrays(step)
    filled = [a for a, value in state.items() if np.count_nonzero(value) > FEW]
    for array in filled:
        yield from _first_values(array, state[array])
    for array, value in state.items():
        own = f"m->{step.member(array)}"
        if array in filled:
            yield f"    memcpy({own}, first_{array}, sizeof first_{array});"
            continue
        yield f"    memset({own}, 0, sizeof {own});"
        for place in np.flatnonzero(value):
            yield f"    {own}[{place}] = {c_number(value.flat[place].item())};"
    yield "}"


def _driving(step: Step, name: str) -> Iterable[str]:
    """What a caller gives as the model reads it: −s̈, and accelerations against the ground."""
    yield f"static void driving(double *f, const double *u) /* f1 of {name} is -{GROUND} */"
    yield "{"
    yield "    f[0] = -u[0];"
    for i, (channel, _) in enumerate(step.inputs[1:], start=1):
        measured = step.absolute and channel.endswith("_measured")
        yield f"    f[{i}] = u[{i}]{' - u[0]' if measured else ''};"
    yield "}"


def _given(step: Step, inputs: int) -> list[str]:
    return [f"    double f[{inputs}];", "", "    driving(f, u);"] if step.ground else []


def _absolute(step: Step) -> list[str]:
    """The accelerations that sensors give, from those against the ground."""
    own = step.sensed
    count = 0 if own is None else step.state[own].size
    return [f"    m->{own}[{i}] = m->{own}_relative[{i}] + m->u[0];" for i in range(count)]


def _first_values(array: str, value: np.ndarray) -> Iterable[str]:
    kind = "int" if value.dtype.kind == "i" else "double"
    yield f"    static const {kind} first_{array}[{value.size}] = {{"
    yield from numbers_of(value, 8)
    yield "    };"


def _copied(to: str, source: str, count: int) -> list[str]:
    return [f"    memmove({to}, {source}, {count} * sizeof(double));"] if count else []


def _stepping(
    step: Step,
    name: str,
    inputs: int,
    observe: tuple[Function, list[str]],
    advance: tuple[Function, list[str]],
) -> Iterable[str]:
    big = f"{name.upper()}"
    size = max(inputs, 1)
    yield f"int {name}_step({name} *m, const double *u, double dt)"
    yield "{"
    yield f"    const double parts = floor({step.substeps}.0 * dt / {big}_DT + 0.5);"
    yield "    const int count = parts < 1.0 ? 1 : (int)parts;"
    begins, given = "first" in advance[1], "f" if step.ground else "u"
    own = f"{big}_DT" if step.substeps == 1 else f"{big}_DT / {step.substeps}.0"
    more = f"f[{size}], " if step.ground else ""
    yield f"    double {more}start[{size}], {f'first[{size}], ' if begins else ''}last[{size}];"
    yield "    int part, i;"
    yield ""
    if step.ground:
        yield "    driving(f, u);"
        yield "    driving(start, m->u);"
    if step.any_step:
        yield "    if (!(dt > 0.0) || parts > 1e9) {"
    else:
        yield f"    if (!(fabs(dt - count * {own}) <= {SAME_STEP!r} * {big}_DT)) {{"
    yield f"        return {big}_BAD_STEP;"
    yield "    }"
    yield f"    for (i = 0; i < {inputs}; ++i) {{" if inputs else "    i = 0;"
    if inputs:
        yield f"        {'last[i] = start[i]' if step.ground else 'start[i] = last[i] = m->u[i]'};"
        yield "    }"
    else:
        yield "    start[i] = last[i] = 0.0;"
    yield "    for (part = 1; part <= count; ++part) {"
    yield f"        for (i = 0; i < {size}; ++i) {{"
    if begins:
        yield "            first[i] = last[i];"
    if inputs:
        goes = f"(double)part / count * ({given}[i] - start[i])"
        yield f"            last[i] = start[i] + {goes};"
    yield "        }"
    step_of_dt = "dt / count" if step.any_step else own
    yield f"        {_call(advance, first='first', last='last', dt=step_of_dt)}"
    if not step.any_step:
        yield f"        {_call(observe, last='last', u=f'part < count ? last : {given}')}"
    yield "    }"
    if step.any_step:
        yield f"    {_call(observe, last='last', u=given)}"
    yield from _copied("m->last", "last", inputs)
    yield from _copied("m->u", "u", inputs)
    yield from _absolute(step)
    if not inputs:
        yield "    (void)u;"
    last = [f"m->{array}" for array, *_ in step.outputs]
    yield f"    for (i = 0; i < {len(step.outputs[-1][1])}; ++i) {{"
    yield f"        if (!isfinite({last[-1]}[i])) {{"
    yield f"            return {big}_DIVERGED;"
    yield "        }"
    yield "    }"
    yield "    return 0;"
    yield "}"


def c_number(value: float) -> str:
    return number(value).code


# The header of a step in C: the struct that is its whole state, and what a person calls.


def header_of(step: Step, name: str, held: dict[str, np.ndarray], remarks: Sequence[str]) -> str:
    big = name.upper()
    lines = [c_comment([f"{name}: a model of a structure.", *remarks]), ""]
    lines += [f"#ifndef {big}_H", f"#define {big}_H", ""]
    lines += [f"#define {big}_INPUTS {len(step.inputs)}"]
    lines += [f"#define {big}_{array.upper()} {len(names)}" for array, names, _ in step.outputs]
    lines += [f"#define {big}_X0 {len(step.outputs[0][1])}"]
    lines += [f"#define {big}_DT {step.dt!r} /* [s] */"]
    lines += [f"#define {big}_BAD_STEP 1", f"#define {big}_DIVERGED 2", ""]
    lines += ["#ifdef __cplusplus", 'extern "C" {', "#endif", ""]
    lines += ["/* The whole state: copy it to save it. */", "typedef struct {"]
    channels = ", ".join(f"{n} [{unit}]" if unit else n for n, unit in step.inputs)
    excitation = c_comment([f"excitation: {channels}"])
    lines += [f"    double u[{max(len(step.inputs), 1)}]; {excitation}"]
    lines += [f"    double last[{max(len(step.inputs), 1)}]; /* before it jumped */"]
    units = {array: unit for array, _, unit in step.outputs}
    for array, value in held.items():
        kind = "int" if value.dtype.kind == "i" else "double"
        words = f" {c_comment([f'[{units[array]}]'])}" if array in units else ""
        lines += [f"    {kind} {step.member(array)}[{max(value.size, 1)}];{words}"]
    if step.sensed is not None:
        lines += [f"    double {step.sensed}[{big}_{step.sensed.upper()}]; /* [m/s2], absolute */"]
    lines += [f"}} {name};", ""]
    lines += ["/* The numbers that were identified, at rest. */", f"void {name}_init({name} *m);"]
    lines += ["/* A motion that begins with x0, v0 and the excitation u. */"]
    lines += [f"void {name}_begin({name} *m, const double *x0, const double *v0, const double *u);"]
    lines += [
        "/* The excitation jumps to u. */",
        f"void {name}_excite({name} *m, const double *u);",
    ]
    lines += [
        "/* To the next instant, dt [s] later, while the excitation goes to u on a straight line.",
        f"   0, or {big}_BAD_STEP, or {big}_DIVERGED. */",
        f"int {name}_step({name} *m, const double *u, double dt);",
    ]
    return "\n".join([*lines, "", "#ifdef __cplusplus", "}", "#endif", "", "#endif", ""])
