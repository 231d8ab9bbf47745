"""A model as functional mock-up units: FMI 2 and FMI 3 for co-simulation, around its C.

An FMU is a zip with a description, sources and binaries for Linux (gcc) and, where its cross
compiler is there, Windows. Within a communication step inputs are held, or change with the slopes
that FMI 2 lets a master set.
"""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from export.c import step_for, told_of
from export.c_source import Source, source_of
from export.fmi_units import definitions
from export.run import Exported
from export.step import Step

HERE = Path(__file__).parent / "fmi"
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
PLATFORMS = {  # compiler, suffix, folders in FMI 2 and 3
    "Linux": ("gcc", ".so", "linux64", "x86_64-linux", ("-fPIC", "-fvisibility=hidden")),
    "Windows": ("x86_64-w64-mingw32-gcc", ".dll", "win64", "x86_64-windows", ("-static", "-s")),
}
WAITING = 120.0  # [s] for a compiler
DATE = (2000, 1, 1, 0, 0, 0)  # of all files of the zip: the same model, the same bytes


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


WORDS = {
    "x": "displacement",
    "v": "velocity",
    "a": "acceleration",
    "y": "deformation of an element",
    "deformation": "deformation of an element",
    "r": "force of an element",
}


def write(model: Exported, folder: Path) -> list[Path]:
    """Raises ValueError for a model without a step, and where there is no compiler."""
    return write_fmus(step_for(model), model.name, told_of(model), folder)


def write_fmus(step: Step, name: str, told: Sequence[str], folder: Path) -> list[Path]:
    """NAME-fmi2.fmu and NAME-fmi3.fmu in a folder. Raises ValueError where they cannot be made."""
    source, variables = source_of(step, name, told), variables_of(step)
    if len({v.name for v in variables}) < len(variables):
        raise ValueError("two variables of the FMU have the same name; name the elements apart")
    token = hashlib.sha256((source.header + source.body).encode()).hexdigest()[:32]
    made = []
    for version in (2, 3):
        path = folder / f"{source.name}-fmi{version}.fmu"
        aside = path.with_suffix(".part")
        try:
            _write_one(aside, version, step, source, variables, token, told)
            aside.replace(path)
        finally:
            aside.unlink(missing_ok=True)
        made.append(path)
    return made


def _write_one(
    path: Path,
    version: int,
    step: Step,
    source: Source,
    variables: list[Variable],
    token: str,
    told: Sequence[str],
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
        described = _description2 if version == 2 else _description3
        parts: dict[str, str | bytes] = {
            "modelDescription.xml": described(step, source.name, variables, token, told),
            "documentation/index.html": _documentation(source.name, variables, told),
            **{f"sources/{name}": text for name, text in files.items()},
            **{place: binary.read_bytes() for place, binary in binaries.items()},
        }
        if version == 3:
            parts["sources/buildDescription.xml"] = _build(source.name)
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
        said = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=WAITING)
        if said.returncode:
            raise ValueError(f"{compiler} failed: {said.stderr.strip().splitlines()[0]}")
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
CAUSES = {  # causality, variability
    "input": 'causality="input" variability="continuous"',
    "output": 'causality="output" variability="continuous"',
    "parameter": 'causality="parameter" variability="fixed"',
    "tunable": 'causality="parameter" variability="tunable"',
}


def _said(variable: Variable) -> str:
    return f" description={quoteattr(variable.said)}" if variable.said else ""


def _real(variable: Variable) -> str:
    """What FMI 2 and 3 say of the number of a variable."""
    unit = f" unit={quoteattr(variable.unit)}" if variable.unit else ""
    start = "" if variable.start is None else f' start="{variable.start!r}"'
    return unit + start


def _description2(
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


def _description3(
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


def _build(name: str) -> str:
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<fmiBuildDescription fmiVersion="3.0">\n'
        f'  <BuildConfiguration modelIdentifier="{name}">\n'
        '    <SourceFileSet language="C99">\n'
        f'      <SourceFile name="fmi3.c"/>\n      <SourceFile name="{name}.c"/>\n'
        "    </SourceFileSet>\n  </BuildConfiguration>\n</fmiBuildDescription>\n"
    )


def _documentation(name: str, variables: list[Variable], told: Sequence[str]) -> str:
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
