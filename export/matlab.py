"""A composite network as a function of one step and a function that runs a CSV, for MATLAB, Octave.

The equation is that of models/composition/simulate.py, substep by substep, in vectors over the
elements; the text stands in matlab_step.m.txt, the numbers are put into it.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from string import Template

import torch
from torch import Tensor

from export.composite import plain_composite
from export.names import line_comment, matlab_string
from export.run import Exported
from models.composition.laws_compiled import LARGEST, SMALL, TERMS, TERMS_OF_LOGARITHM

FOLDER = Path(__file__).parent
STEP, RUN = ((FOLDER / f"matlab_{name}.m.txt").read_text("utf-8") for name in ("step", "run"))
WORDS = set(re.findall(r"\w+", STEP + RUN))  # that the functions use


def write(model: Exported, folder: Path) -> list[Path]:
    """NAME.m and NAME_run.m. Raises ValueError for a model that is no composite network."""
    model = replace(model, name=f"{model.name}_") if model.name in WORDS else model
    texts = {model.name: step_of(model), f"{model.name}_run": run_of(model)}
    paths = [folder / f"{name}.m" for name in texts]
    for path, text in zip(paths, texts.values(), strict=True):
        path.write_text(text, encoding="utf-8")
    return paths


def step_of(model: Exported) -> str:
    """The function of one step."""
    network = plain_composite(model.estimator)
    c = network.composition()
    n, E = c.D.value.shape[1], c.D.value.shape[0]
    pairs = getattr(network, "elements", None) or [[f"e{e + 1}"] for e in range(E)]
    numbers = {
        "core": c.core.value.T,
        "inputs": c.inputs.value,
        "G": c.G.value,
        "D": c.D.value,
        "supports0": c.supports[0],
        "supports1": c.supports[1],
        "outputs": c.outputs.value,
        "back": torch.linalg.pinv(c.outputs.value),
        "laws": c.laws.value,
        "measures": 1 + c.measures[:, None],
        "bound": network.bound[:, None],
        "counts": torch.tensor(c.counts)[None],
    }
    assert n == len(c.core.value[0])
    return Template(STEP).substitute(
        {name: matrix(value) for name, value in numbers.items()},
        name=model.name,
        units=", ".join(f"{name} [{unit}]" for name, unit in model.plain_inputs),
        elements=", ".join("-".join(pair) for pair in pairs),
        about=line_comment(model.lines(), "%"),
        dt=repr(network.dt),
        substeps=network.substeps,
        small=SMALL,
        largest=LARGEST,
        terms=TERMS,
        terms_of_logarithm=TERMS_OF_LOGARITHM,
    )


def run_of(model: Exported) -> str:
    """The function that runs a CSV: an excitation that was not held is linear between samples."""
    held = model.hold == "zero_order"
    columns = model.plain_inputs
    return Template(RUN).substitute(
        name=model.name,
        units=", ".join(f"{name} [{unit}]" for name, unit in columns),
        columns=", ".join(matlab_string(name) for name in ("time", *(name for name, _ in columns))),
        hold="held" if held else "linear",
        held=int(held),
    )


def matrix(values: Tensor) -> str:
    """A matrix as MATLAB reads it, to the last digit; a row to a line."""
    rows, columns = values.shape
    if 0 in values.shape:
        return f"zeros({rows}, {columns})"
    lines = [" ".join(repr(one) for one in row) for row in values.detach().tolist()]
    return "[" + "; ...\n  ".join(lines) + "]"
