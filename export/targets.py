"""The targets by name: who each is for, and the module that writes it.

A target's module has `write(model: Exported, folder: Path) -> list[Path]`, which raises ValueError
in one line for a model that the target cannot take.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Target:
    """Who reads the files of a target."""

    module: str
    reader: str


TARGETS = {
    "c": Target("export.c", "anything that compiles C99: controllers, S-functions of Simulink"),
    "fmu": Target(
        "export.fmu", "Simulink, Dymola, OpenModelica, other co-simulation by FMI 2 or 3"
    ),
    "opensees": Target("export.opensees", "OpenSeesPy, stock materials"),
    "json": Target("export.json", "people, Python, MATLAB: whoever wants the parameters"),
}
