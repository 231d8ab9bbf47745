"""Names and units of outputs, where only the records say what a model's output is."""

from __future__ import annotations

from dataclasses import replace

from export.step import Step

SPELLED = {  # a quantity's letter and unit, as programs can spell them
    "acceleration": ("a", "m/s2"),
    "velocity": ("v", "m/s"),
    "displacement": ("x", "m"),
    "force": ("r", "N"),
    "output": ("y", ""),
}


def named_by(step: Step, quantity: str, integrates: bool = False) -> Step:
    """The step with the outputs that it has where its model was trained on this quantity.

    integrates: whether its x and v are integrals of a, which mean nothing where a is no
    acceleration.
    """
    letter, unit = SPELLED[quantity]
    arrays = [array for array, *_ in step.outputs]
    if "output" in arrays or (integrates and quantity != "acceleration"):
        array = "output" if "output" in arrays else "a"
        names = [f"{letter}{i + 1}" for i in range(step.state[array].size)]
        return replace(step, outputs=[(array, names, unit)])
    return step
