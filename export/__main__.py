"""A finished run's model as files for other programs.

    python -m export run=FOLDER to=c                          in FOLDER/export
    python -m export run=zoo:element_network/bouc_wen to=c
    python -m export run=FOLDER to=c,fmu,json output=FOLDER

c         C99 without dependencies: controllers, microcontrollers, anything that compiles
fmu       Functional Mock-up Unit, FMI 2 and 3: Simulink, Modelica, co-simulation
opensees  script with stock materials for OpenSeesPy
json      parameters with names and units

All or nothing is written: where one target cannot take the model, the line says which and why.
docs/export.md says which target is for whom.
"""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from data.arguments import key_values, print_any_text, suggestion
from export.targets import TARGETS
from runner.config.command_line import command_errors
from runner.folder.run_folder import (
    FAILED,
    METRICS,
    read_failure,
    require_finished,
    results_folder,
    run_folder,
)
from runner.loading import loading

KEYS = {"run": "FOLDER", "to": "c,fmu,…", "output": "FOLDER"}


@dataclass(frozen=True)
class Words:
    """What the command line asks for."""

    run: Path
    targets: list[str]
    output: Path


def read(words: Sequence[str]) -> Words:
    """The command line. Raises ValueError for words that it does not have."""
    given = key_values(words, KEYS)
    for key in ("run", "to"):
        if key not in given:
            raise ValueError(f"{key} must be given: {key}={KEYS[key]}; see --help")
    run = run_folder(given["run"])
    output = Path(given.get("output", results_folder(run) / "export"))
    return Words(run, targets(given["to"]), output)


def targets(text: str) -> list[str]:
    """The targets that a comma-separated list names, each once."""
    names = [name.strip() for name in text.strip("[]").split(",")]
    for name in names:
        if name not in TARGETS:
            word = rf"\b{re.escape(name.lower())}\b"
            of = [t for t, reader in TARGETS.items() if re.search(word, reader.lower())]
            if name and of:
                raise ValueError(f"to={name}: {name} reads to={' or to='.join(of)}")
            hint = suggestion(name.lower(), TARGETS, cutoff=0.5)
            raise ValueError(f"to={name}: there are {', '.join(TARGETS)}{hint}")
    return list(dict.fromkeys(names))


def require_run(folder: Path) -> None:
    """Raise ValueError for a folder without a finished run, and for a run that failed."""
    if (folder / FAILED).is_file() and not (folder / METRICS).is_file():
        reason = read_failure(folder)["reason"]
        raise ValueError(f"{folder} holds a run that failed: {reason}; repeat the run")
    require_finished(folder)


def main(words: Sequence[str]) -> None:
    """Write what the words ask for, and print a table. Raises ValueError, OSError."""
    asked = read(words)
    require_run(asked.run)
    if asked.output.exists() and not asked.output.is_dir():
        raise ValueError(f"output={asked.output} is a file; give a folder")
    with loading():  # takes seconds: a mistyped word is reported first
        write = importlib.import_module("export.write")
    write.show(write.export(asked.run, asked.targets, asked.output))


def cli() -> None:
    """What the command line runs: bad input ends in one line and exit status 1."""
    if not sys.argv[1:] or {"-h", "--help"} & set(sys.argv[1:]):
        print_any_text()
        print(__doc__)
        return
    with command_errors():
        main(sys.argv[1:])


if __name__ == "__main__":
    cli()
