"""What a functional mock-up unit says of itself: its variables, XML of FMI 2 and 3, and HTML."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from export.fmi_units import definitions
from export.step import Step

WORDS = {
    "x": "displacement",
    "v": "velocity",
    "a": "acceleration",
    "y": "deformation of an element",
    "deformation": "deformation of an element",
    "r": "force of an element",
}


CAUSES = {  # causality, variability
    "input": 'causality="input" variability="continuous"',
    "output": 'causality="output" variability="continuous"',
    "parameter": 'causality="parameter" variability="fixed"',
    "tunable": 'causality="parameter" variability="tunable"',
}


@dataclass(frozen=True)
class Variable:
    """A variable of an FMU; `place` is where it lies in the struct."""

    name: str
    place: str
    causality: str  # input, output, parameter
    unit: str
    start: float | None
    said: str


def variables_of(step: Step) -> list[Variable]:
    """Inputs, outputs, then parameters: the order of their value references."""
    found = [
        Variable(name, f"input[{i}]", "input", unit, 0.0, "excitation")
        for i, (name, unit) in enumerate(step.inputs)
    ]
    for array, names, unit in step.outputs:
        said = WORDS.get(array, "")
        found += [
            Variable(name, f"own.{array}[{i}]", "output", unit, None, said)
            for i, name in enumerate(names)
        ]
    n = len(step.outputs[0][1])
    for array, unit, said in (("x0", "m", "displacement"), ("v0", "m/s", "velocity")):
        found += [
            Variable(f"{array}_{i + 1}", f"{array}[{i}]", "parameter", unit, 0.0, f"first {said}")
            for i in range(n)
        ]
    for array, place, name, unit in step.parameters:
        value = np.asarray(step.numbers[array])
        flat = int(np.ravel_multi_index(place, value.shape))
        start = float(value[place])
        found.append(Variable(name, f"own.{array}[{flat}]", "tunable", unit, start, ""))
    return found


def description2(
    step: Step, name: str, variables: list[Variable], token: str, told: Sequence[str]
) -> str:
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{token}"',
        f"    description={quoteattr(' '.join(told)[:1000])}",
        '    generationTool="structural-model-zoo" variableNamingConvention="flat">',
        f'  <CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"',
        '      canInterpolateInputs="true" canGetAndSetFMUstate="true"',
        '      canSerializeFMUstate="true" canNotUseMemoryManagementFunctions="true">',
        f'    <SourceFiles><File name="fmi2.c"/><File name="{name}.c"/></SourceFiles>',
        "  </CoSimulation>",
        *definitions({v.unit for v in variables}, "2"),
        '  <LogCategories><Category name="logStatusError"/></LogCategories>',
        f'  <DefaultExperiment startTime="0.0" stopTime="{1000 * step.dt!r}" '
        f'stepSize="{step.dt!r}"/>',
        "  <ModelVariables>",
    ]
    for reference, variable in enumerate(variables):
        lines.append(
            f"    <ScalarVariable name={quoteattr(variable.name)} "
            f'valueReference="{reference}" {CAUSES[variable.causality]}{_said(variable)}>'
            f"<Real{_real(variable)}/></ScalarVariable>"
        )
    outputs = [i + 1 for i, v in enumerate(variables) if v.causality == "output"]
    for kind in ("Outputs", "InitialUnknowns"):
        if kind == "Outputs":
            lines += ["  </ModelVariables>", "  <ModelStructure>"]
        lines += [f"    <{kind}>", *(f'      <Unknown index="{i}"/>' for i in outputs)]
        lines += [f"    </{kind}>"]
    return "\n".join([*lines, "  </ModelStructure>", "</fmiModelDescription>", ""])


def description3(
    step: Step, name: str, variables: list[Variable], token: str, told: Sequence[str]
) -> str:
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<fmiModelDescription fmiVersion="3.0" modelName="{name}" instantiationToken="{token}"',
        f"    description={quoteattr(' '.join(told)[:1000])}",
        '    generationTool="structural-model-zoo" variableNamingConvention="flat">',
        f'  <CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"',
        '      canGetAndSetFMUState="true" canSerializeFMUState="true"/>',
        *definitions({v.unit for v in variables}, "3"),
        '  <LogCategories><Category name="logStatusError"/></LogCategories>',
        f'  <DefaultExperiment startTime="0.0" stopTime="{1000 * step.dt!r}" '
        f'stepSize="{step.dt!r}"/>',
        "  <ModelVariables>",
        f'    <Float64 name="time" valueReference="{len(variables)}" causality="independent" '
        'variability="continuous" unit="s"/>',
    ]
    for reference, variable in enumerate(variables):
        lines.append(
            f"    <Float64 name={quoteattr(variable.name)} "
            f'valueReference="{reference}" {CAUSES[variable.causality]}{_said(variable)}'
            f"{_real(variable)}/>"
        )
    outputs = [i for i, v in enumerate(variables) if v.causality == "output"]
    lines += ["  </ModelVariables>", "  <ModelStructure>"]
    for kind in ("Output", "InitialUnknown"):
        lines += [f'    <{kind} valueReference="{i}"/>' for i in outputs]
    return "\n".join([*lines, "  </ModelStructure>", "</fmiModelDescription>", ""])


def build_description(name: str) -> str:
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<fmiBuildDescription fmiVersion="3.0">\n'
        f'  <BuildConfiguration modelIdentifier="{name}">\n'
        '    <SourceFileSet language="C99">\n'
        f'      <SourceFile name="fmi3.c"/>\n      <SourceFile name="{name}.c"/>\n'
        "    </SourceFileSet>\n  </BuildConfiguration>\n</fmiBuildDescription>\n"
    )


def documentation(name: str, variables: list[Variable], told: Sequence[str]) -> str:
    rows = [
        f"<tr><td>{escape(v.name)}</td><td>{v.causality}</td><td>{escape(v.unit)}</td>"
        f"<td>{escape(v.said)}</td></tr>"
        for v in variables
    ]
    lines = [f"<p>{escape(line)}</p>" for line in told]
    return "\n".join(
        [
            "<!DOCTYPE html>",
            f'<html lang="en"><head><meta charset="utf-8"><title>{name}</title></head><body>',
            f"<h1>{name}</h1>",
            *lines,
            "<p>Within a communication step inputs are held; FMI 2 masters may set their slopes. "
            "</p>",
            "<table><tr><th>variable</th><th>kind</th><th>unit</th><th></th></tr>",
            *rows,
            "</table></body></html>",
            "",
        ]
    )


def _said(variable: Variable) -> str:
    return f" description={quoteattr(variable.said)}" if variable.said else ""


def _real(variable: Variable) -> str:
    """What FMI 2 and 3 say of the number of a variable."""
    unit = f" unit={quoteattr(variable.unit)}" if variable.unit else ""
    start = "" if variable.start is None else f' start="{variable.start!r}"'
    return unit + start
