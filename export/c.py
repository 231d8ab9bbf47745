"""Target c: NAME.c, NAME.h, and NAME_main.c, a program that runs a CSV through them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from export.c_source import TEMPLATES, Source, source_of
from export.names import c_comment, c_string
from export.run import Exported
from export.step import Step
from export.steps import online_step_of, step_of


def write(model: Exported, folder: Path) -> list[Path]:
    """A VWNN has NAME_online.c, too, which reads the measured accelerations.

    Raises ValueError for a model without a step, OSError where the disk does not take it.
    """
    steps = {model.name: step_for(model)}
    if (online := online_step_of(model.estimator)) is not None:
        steps[f"{model.name}_online"] = named(online, model)
    made = []
    for name, step in steps.items():
        source = source_of(step, name, remarks_of(model))
        files = {f"{source.name}.h": source.header, f"{source.name}.c": source.body}
        if name == model.name:
            files[f"{source.name}_main.c"] = program_of(step, source, model.hold)
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
            made.append(folder / file)
    return made


def step_for(model: Exported) -> Step:
    """The step of a run's model, with the names of its channels."""
    return named(step_of(model.estimator, model.passport.facts["quantity"]), model)


def named(step: Step, model: Exported) -> Step:
    """A step with the channels of a run: their names, and what the ground's motion is."""
    own = model.plain_inputs
    step = replace(step, ground=model.ground, absolute=model.absolute)
    if not model.ground and all(name == f"u{i + 1}" for i, (name, _) in enumerate(own)):
        return step  # the run does not know better than the model
    return replace(step, inputs=[*own, *step.inputs[len(own) :]])


def remarks_of(model: Exported) -> list[str]:
    """Lines for a comment."""
    return [*model.lines(), f"excitation between samples in training: {model.hold}"]


def program_of(step: Step, source: Source, hold: str) -> str:
    """A program that reads time and excitation as CSV and writes time and all outputs."""
    name = source.name
    header = ",".join(["time", *(n for _, names, _ in step.outputs for n in names)]) + "\n"
    columns = ", ".join(["time", *(n for n, _ in step.inputs)])
    about = [
        f"Runs a CSV of {columns}, with one line of names, through the model:",
        "",
        f"cc -std=c99 -O2 {name}.c {name}_main.c -lm -o {name}",
        f"./{name} < excitation.csv > motion.csv",
    ]
    return TEMPLATES.get_template("main.c.j2").render(
        step=step,
        name=name,
        big=name.upper(),
        header=c_string(header),
        about=c_comment(about),
        zero_order=hold == "zero_order",
    )
