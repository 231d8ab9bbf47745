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
from pathlib import Path

from data.whole_file import whole_file
from export.c import step_for, told_of
from export.c_source import Source, source_of
from export.fmu_description import (
    Variable,
    build_description,
    description2,
    description3,
    documentation,
    variables_of,
)
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
        with whole_file(path) as aside:
            _write_one(aside, version, step, source, variables, token, told)
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
        described = description2 if version == 2 else description3
        parts: dict[str, str | bytes] = {
            "modelDescription.xml": described(step, source.name, variables, token, told),
            "documentation/index.html": documentation(source.name, variables, told),
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
