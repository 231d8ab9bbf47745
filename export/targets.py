"""The targets by name, and who each is for; the module of its name writes its files.

It has `write(model: Exported, folder: Path) -> list[Path]`, which raises ValueError in one line for
a model that the target cannot take.
"""

TARGETS = {
    "c": "anything that compiles C99: controllers, S-functions of Simulink",
    "fmu": "Simulink, Dymola, OpenModelica, other co-simulation by FMI 2 or 3",
    "opensees": "OpenSeesPy, stock materials",
    "json": "people, Python, MATLAB: whoever wants the parameters",
}
