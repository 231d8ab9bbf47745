"""A model as functional mock-up units: FMI 2 and FMI 3 for co-simulation, around its C.

An FMU is a zip with a description, sources and binaries for Linux (gcc) and, where its cross
compiler is there, Windows. Within a communication step inputs are held, or change with the slopes
that FMI 2 lets a master set.
"""

from __future__ import annotations

import hashlib
import re
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from data.whole_file import whole_file
from export.c import remarks_of, step_for
from export.c_source import Source, source_of
from export.names import printable
from export.run import Exported
from export.step import Step, arrays_of

HERE = Path(__file__).parent / "fmi"
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
PLATFORMS = {  # compiler, suffix, folders in FMI 2 and 3
    "Linux": ("gcc", ".so", "linux64", "x86_64-linux", ("-fPIC", "-fvisibility=hidden")),
    "Windows": ("x86_64-w64-mingw32-gcc", ".dll", "win64", "x86_64-windows", ("-static", "-s")),
}
WAITING = 120.0  # [s] for a compiler
DATE = (2000, 1, 1, 0, 0, 0)  # of all files of the zip: the same model, the same bytes


def write(model: Exported, folder: Path) -> list[Path]:
    """Raises ValueError for a model without a step, and where there is no compiler."""
    return write_fmus(step_for(model), model.name, remarks_of(model), folder)


def write_fmus(step: Step, name: str, remarks: Sequence[str], folder: Path) -> list[Path]:
    """NAME-fmi2.fmu and NAME-fmi3.fmu in a folder. Raises ValueError where they cannot be made."""
    source, variables = source_of(step, name, remarks), variables_of(step)
    if len({v.name for v in variables}) < len(variables):
        raise ValueError("two variables of the FMU have the same name; name the elements apart")
    token = hashlib.sha256((source.header + source.body).encode()).hexdigest()[:32]
    made = []
    for version in (2, 3):
        path = folder / f"{source.name}-fmi{version}.fmu"
        with whole_file(path) as aside:
            _write_one(aside, version, step, source, variables, token, remarks)
        made.append(path)
    return made


def _write_one(
    path: Path,
    version: int,
    step: Step,
    source: Source,
    variables: list[Variable],
    token: str,
    remarks: Sequence[str],
) -> None:
    with tempfile.TemporaryDirectory() as temporary:
        own = Path(temporary)
        files = {
            f"{source.name}.c": source.body,
            f"{source.name}.h": source.header,
            "variables.h": _variables(step, source.name, variables, token),
            "instance.h": (HERE / "instance.h").read_text(),
            f"fmi{version}.c": (HERE / f"fmi{version}.c").read_text(),
        }
        for name, text in files.items():
            (own / name).write_text(text, encoding="utf-8")
        binaries = _compiled(own, source.name, version)
        described = description2 if version == 2 else description3
        parts: dict[str, str | bytes] = {
            "modelDescription.xml": described(step, source.name, variables, token, remarks),
            "documentation/index.html": documentation(source.name, variables, remarks),
            **{f"sources/{name}": text for name, text in files.items()},
            **{place: binary.read_bytes() for place, binary in binaries.items()},
        }
        if version == 3:
            parts["sources/buildDescription.xml"] = build_description(source.name)
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
            for name, text_or_bytes in parts.items():
                entry = zipfile.ZipInfo(name, DATE)
                entry.compress_type = zipfile.ZIP_DEFLATED
                archive.writestr(entry, text_or_bytes)


def _compiled(folder: Path, name: str, version: int) -> dict[str, Path]:
    """Binaries by their places in the zip. Raises ValueError without any compiler."""
    found: dict[str, Path] = {}
    for compiler, suffix, old, new, flags in PLATFORMS.values():
        if shutil.which(compiler) is None:
            continue
        target = folder / f"{name}{suffix}"
        sources = [f"fmi{version}.c", f"{name}.c"]
        words = [compiler, *FLAGS, *flags, "-shared", *sources, "-o", target.name, "-lm"]
        try:
            said = subprocess.run(
                words, cwd=folder, capture_output=True, text=True, timeout=WAITING
            )
        except subprocess.TimeoutExpired:
            raise ValueError(f"{compiler} took over {WAITING:g} s; export to=c instead") from None
        if said.returncode:
            raise ValueError(f"{compiler} failed: {(said.stderr.split(chr(10)) or [''])[0]}")
        found[f"binaries/{old if version == 2 else new}/{target.name}"] = target
    if not found:
        raise ValueError("an FMU needs a compiler: install gcc, or export to=c and build elsewhere")
    return found


def _variables(step: Step, name: str, variables: list[Variable], token: str) -> str:
    """variables.h: names and places of this model for instance.h."""
    n, m = len(step.outputs[0][1]), len(step.inputs)
    kinds = [v.causality for v in variables]
    outputs = kinds.count("output")
    lines = [f'#include "{name}.h"', ""]
    lines += [f"#define {word} {name}_{word.split('_')[1].lower()}" for word in FUNCTIONS]
    lines += [f"#define MODEL_DT {name.upper()}_DT"]
    lines += [f"#define MODEL_DIVERGED {name.upper()}_DIVERGED"]
    lines += [f'#define TOKEN "{token}"', f"#define INPUTS {m}", f"#define VARIABLES {len(kinds)}"]
    lines += [f"#define FIRST_OUTPUT {m}", f"#define FIRST_PARAMETER {m + outputs}"]
    lines += [f"#define TIME {len(kinds)}", "", "typedef struct {", f"    {name} own;"]
    lines += [f"    double input[{max(m, 1)}], slope[{max(m, 1)}], x0[{n}], v0[{n}], time;"]
    lines += ["    int jumps, begun;", "} values;", ""]
    lines += [f"static const size_t PLACES[{len(kinds)}] = {{"]
    lines += [f"    offsetof(values, {v.place})," for v in variables]
    return "\n".join([*lines, "};", ""])


FUNCTIONS = ("MODEL_INIT", "MODEL_BEGIN", "MODEL_EXCITE", "MODEL_STEP")


# What a functional mock-up unit says of itself: its variables, XML of FMI 2 and 3, and HTML.

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
    against = {}
    if step.ground:
        found[0] = replace(found[0], said=f"{WORDS['a']} of the ground, with its sensor's sign")
        against = dict.fromkeys("xva", " relative to the ground")
    for array, names, unit in step.outputs:
        said = WORDS.get(array, "") + against.get(array, "")
        said = f"{WORDS['a']}, absolute, as a sensor gives it" if array == step.sensed else said
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
    step: Step, name: str, variables: list[Variable], token: str, remarks: Sequence[str]
) -> str:
    able = ("canHandleVariableCommunicationStepSize", "canInterpolateInputs",
            "canGetAndSetFMUstate", "canSerializeFMUstate",
            "canNotUseMemoryManagementFunctions")  # fmt: skip
    root, unit, listed = _described("2", step, name, variables, {"guid": token}, remarks, able)
    sources = SubElement(unit, "SourceFiles")
    for file in ("fmi2.c", f"{name}.c"):
        SubElement(sources, "File", name=file)
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
    step: Step, name: str, variables: list[Variable], token: str, remarks: Sequence[str]
) -> str:
    able = ("canHandleVariableCommunicationStepSize", "canGetAndSetFMUState",
            "canSerializeFMUState")  # fmt: skip
    own = {"instantiationToken": token}
    root, _, listed = _described("3", step, name, variables, own, remarks, able)
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


def _described(
    version: str,
    step: Step,
    name: str,
    variables: list[Variable],
    token: dict[str, str],
    remarks: Sequence[str],
    able: Sequence[str],
) -> tuple[Element, Element, Element]:
    """What both versions say before the variables: the root, <CoSimulation>, <ModelVariables>."""
    said = {"description": printable(" ".join(remarks))[:LONGEST]}
    named = {"fmiVersion": f"{version}.0", "modelName": name, **token}
    root = Element("fmiModelDescription", {**named, **said, **TOOL})
    can = {"modelIdentifier": name, **dict.fromkeys(able, "true")}
    unit = SubElement(root, "CoSimulation", can)
    units = definitions({v.unit for v in variables}, version)
    if units is not None:
        root.append(units)
    SubElement(SubElement(root, "LogCategories"), "Category", name="logStatusError")
    times = {"startTime": "0.0", "stopTime": repr(1000 * step.dt), "stepSize": repr(step.dt)}
    SubElement(root, "DefaultExperiment", times)
    return root, unit, SubElement(root, "ModelVariables")


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


def documentation(name: str, variables: list[Variable], remarks: Sequence[str]) -> str:
    cells = [(v.name, v.causality, v.unit, v.said) for v in variables]
    rows = [f"<tr>{''.join(f'<td>{html(one)}</td>' for one in row)}</tr>" for row in cells]
    lines = [f"<p>{html(line)}</p>" for line in remarks]
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
