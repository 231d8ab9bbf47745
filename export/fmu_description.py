"""What a functional mock-up unit says of itself: its variables, XML of FMI 2 and 3, and HTML."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from export.names import printable
from export.step import Step, arrays_of

WORDS = {
    "x": "displacement",
    "v": "velocity",
    "a": "acceleration",
    "y": "deformation of an element",
    "deformation": "deformation of an element",
    "r": "force of an element",
}


CAUSES = {  # causality, variability
    "input": {"causality": "input", "variability": "continuous"},
    "output": {"causality": "output", "variability": "continuous"},
    "parameter": {"causality": "parameter", "variability": "fixed"},
    "tunable": {"causality": "parameter", "variability": "tunable"},
}
TOOL = {"generationTool": "structural-model-zoo", "variableNamingConvention": "flat"}
LONGEST = 1000  # characters of a description


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
        value = np.asarray(arrays_of(step.numbers)[array])
        flat = int(np.ravel_multi_index(place, value.shape))
        start = float(value[place])
        found.append(Variable(name, f"own.{array}[{flat}]", "tunable", unit, start, ""))
    return found


def description2(
    step: Step, name: str, variables: list[Variable], token: str, told: Sequence[str]
) -> str:
    said = {"description": printable(" ".join(told))[:LONGEST]}
    named = {"fmiVersion": "2.0", "modelName": name, "guid": token}
    root = Element("fmiModelDescription", {**named, **said, **TOOL})
    able = ("canHandleVariableCommunicationStepSize", "canInterpolateInputs",
            "canGetAndSetFMUstate", "canSerializeFMUstate",
            "canNotUseMemoryManagementFunctions")  # fmt: skip
    unit = SubElement(
        root, "CoSimulation", {"modelIdentifier": name, **dict.fromkeys(able, "true")}
    )
    sources = SubElement(unit, "SourceFiles")
    for file in ("fmi2.c", f"{name}.c"):
        SubElement(sources, "File", name=file)
    _before_variables(root, step, variables, "2")
    listed = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(variables):
        SubElement(SubElement(listed, "ScalarVariable", _variable(variable, reference)), "Real",
                   _real(variable))  # fmt: skip
    structure = SubElement(root, "ModelStructure")
    outputs = [i + 1 for i, v in enumerate(variables) if v.causality == "output"]
    for kind in ("Outputs", "InitialUnknowns"):
        part = SubElement(structure, kind)
        for i in outputs:
            SubElement(part, "Unknown", index=str(i))
    return _text(root)


def description3(
    step: Step, name: str, variables: list[Variable], token: str, told: Sequence[str]
) -> str:
    said = {"description": printable(" ".join(told))[:LONGEST]}
    named = {"fmiVersion": "3.0", "modelName": name, "instantiationToken": token}
    root = Element("fmiModelDescription", {**named, **said, **TOOL})
    able = ("canHandleVariableCommunicationStepSize", "canGetAndSetFMUState",
            "canSerializeFMUState")  # fmt: skip
    SubElement(root, "CoSimulation", {"modelIdentifier": name, **dict.fromkeys(able, "true")})
    _before_variables(root, step, variables, "3")
    listed = SubElement(root, "ModelVariables")
    SubElement(listed, "Float64", name="time", valueReference=str(len(variables)),
               causality="independent", variability="continuous", unit="s")  # fmt: skip
    for reference, variable in enumerate(variables):
        SubElement(listed, "Float64", _variable(variable, reference) | _real(variable))
    structure = SubElement(root, "ModelStructure")
    outputs = [i for i, v in enumerate(variables) if v.causality == "output"]
    for kind in ("Output", "InitialUnknown"):
        for i in outputs:
            SubElement(structure, kind, valueReference=str(i))
    return _text(root)


def _before_variables(root: Element, step: Step, variables: list[Variable], version: str) -> None:
    units = definitions({v.unit for v in variables}, version)
    if units is not None:
        root.append(units)
    SubElement(SubElement(root, "LogCategories"), "Category", name="logStatusError")
    times = {"startTime": "0.0", "stopTime": repr(1000 * step.dt), "stepSize": repr(step.dt)}
    SubElement(root, "DefaultExperiment", times)


def _text(root: Element) -> str:
    indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{tostring(root, "unicode")}\n'


def build_description(name: str) -> str:
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    build = SubElement(root, "BuildConfiguration", modelIdentifier=name)
    files = SubElement(build, "SourceFileSet", language="C99")
    for file in ("fmi3.c", f"{name}.c"):
        SubElement(files, "SourceFile", name=file)
    return _text(root)


def documentation(name: str, variables: list[Variable], told: Sequence[str]) -> str:
    cells = [(v.name, v.causality, v.unit, v.said) for v in variables]
    rows = [f"<tr>{''.join(f'<td>{html(one)}</td>' for one in row)}</tr>" for row in cells]
    lines = [f"<p>{html(line)}</p>" for line in told]
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


def html(text: str) -> str:
    return escape(printable(text), quote=False)


def _variable(variable: Variable, reference: int) -> dict[str, str]:
    said = {"description": variable.said} if variable.said else {}
    named = {"name": variable.name, "valueReference": str(reference)}
    return {**named, **CAUSES[variable.causality], **said}


def _real(variable: Variable) -> dict[str, str]:
    """What FMI 2 and 3 say of the number of a variable."""
    unit = {"unit": variable.unit} if variable.unit else {}
    return unit if variable.start is None else {**unit, "start": repr(variable.start)}


# Units as FMI describes them: powers of kilogram, metre and second.

BASES = {"kg": (1, 0, 0), "m": (0, 1, 0), "s": (0, 0, 1), "N": (1, 1, -2), "J": (1, 2, -2)}
NAMES = ("kg", "m", "s")


def powers_of(unit: str) -> tuple[int, int, int] | None:
    """Powers of kg, m and s of a unit such as N s/m3; None for one that has others."""
    total = [0, 0, 0]
    for part, sign in zip(unit.split("/", 1), (1, -1), strict=False):
        for word in part.split():
            if word == "1":
                continue
            found = re.fullmatch(r"([A-Za-z]+)(\d*)", word)
            if found is None or found[1] not in BASES:
                return None
            power = sign * int(found[2] or 1)
            total = [t + power * b for t, b in zip(total, BASES[found[1]], strict=True)]
    return total[0], total[1], total[2]


def definitions(units: Iterable[str], version: str) -> Element | None:
    """<UnitDefinitions>; None without a unit."""
    found, names = Element("UnitDefinitions"), {u for u in units if u}
    for unit in sorted(names | ({"s"} if version == "3" else set())):
        one, powers = SubElement(found, "Unit", name=unit), powers_of(unit)
        if powers is not None:
            pairs = zip(NAMES, powers, strict=True)
            SubElement(one, "BaseUnit", {name: str(power) for name, power in pairs if power})
    return found if len(found) else None
