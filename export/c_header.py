"""The header of a step in C: the struct that is its whole state, and what a person calls."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from export.names import c_comment
from export.step import Step


def header_of(step: Step, name: str, held: dict[str, np.ndarray], told: Sequence[str]) -> str:
    big = name.upper()
    lines = [c_comment([f"{name}: a model of a structure.", *told]), ""]
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
        lines += [f"    {kind} {array}[{max(value.size, 1)}];{words}"]
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
