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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from data.whole_file import whole_file
from export.c import remarks_of, step_for
from export.c_source import Source, source_of
from export.names import printable, short
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
    source = source_of(step, name, remarks)
    words, made = words_of(step, source, remarks), []
    for version in (2, 3):
        path = folder / f"{source.name}-fmi{version}.fmu"
        with whole_file(path) as aside:
            _write_one(aside, version, source, words)
        made.append(path)
    return made


def _write_one(path: Path, version: int, source: Source, words: Mapping[str, Any]) -> None:
    with tempfile.TemporaryDirectory() as temporary:
        own = Path(temporary)
        files = {
            f"{source.name}.c": source.body,
            f"{source.name}.h": source.header,
            "variables.h": filled("variables.h.j2", **words),
            "instance.h": (HERE / "instance.h").read_text(),
            f"fmi{version}.c": (HERE / f"fmi{version}.c").read_text(),
        }
        for name, text in files.items():
            (own / name).write_text(text, encoding="utf-8")
        binaries = _compiled(own, source.name, version)
        parts: dict[str, str | bytes] = {
            "modelDescription.xml": described(version, **words),
            "documentation/index.html": filled("index.html.j2", **words),
            **{f"sources/{name}": text for name, text in files.items()},
            **{place: binary.read_bytes() for place, binary in binaries.items()},
        }
        if version == 3:
            parts["sources/buildDescription.xml"] = filled("build.xml.j2", name=source.name)
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
    "input": ("input", "continuous"),
    "output": ("output", "continuous"),
    "parameter": ("parameter", "fixed"),
    "tunable": ("parameter", "tunable"),
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


def filled(template: str, **words: Any) -> str:
    """A text of the unit. Words go through `q`, which escapes what XML reads as its own."""
    return TEMPLATES.get_template(template).render(words)


def words_of(step: Step, source: Source, remarks: Sequence[str]) -> dict[str, Any]:
    """What the texts of a unit say of a model. Raises ValueError for two variables of one name."""
    variables = variables_of(step)
    if len({v.name for v in variables}) < len(variables):
        raise ValueError("two variables of the FMU have the same name; name the elements apart")
    return {
        "step": step, "name": source.name, "variables": variables, "remarks": remarks,
        "token": hashlib.sha256((source.header + source.body).encode()).hexdigest()[:32],
        "said": short(" ".join(remarks)),
        "inputs": len(step.inputs), "dofs": len(step.outputs[0][1]),
        "outputs": [i for i, v in enumerate(variables) if v.causality == "output"],
    }  # fmt: skip


def described(version: int, variables: list[Variable], **words: Any) -> str:
    """modelDescription.xml."""
    names = {v.unit for v in variables if v.unit} | ({"s"} if version == 3 else set())
    units = [(unit, powers_of(unit)) for unit in sorted(names)]
    more = {"version": version, "variables": variables, "units": units}
    return filled("description.xml.j2", **words, **more)


# Units as FMI describes them: powers of kilogram, metre and second.

BASES = {"kg": (1, 0, 0), "m": (0, 1, 0), "s": (0, 0, 1), "N": (1, 1, -2), "J": (1, 2, -2)}
NAMES = ("kg", "m", "s")


def powers_of(unit: str) -> list[tuple[str, int]] | None:
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
    return list(zip(NAMES, total, strict=True))


TEMPLATES = Environment(
    loader=FileSystemLoader(HERE), trim_blocks=True, lstrip_blocks=True,
    keep_trailing_newline=True, undefined=StrictUndefined,
)  # fmt: skip
TEMPLATES.globals |= {"q": lambda text: escape(printable(text), {'"': "&quot;"}), "causes": CAUSES}
