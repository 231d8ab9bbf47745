"""Estimators as steps (export/step.py), a file for each kind."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING

from data.record import QUANTITIES
from data.sample import OUTPUTS
from export.names import plain_unit
from export.step import Step
from models import PUBLIC

if TYPE_CHECKING:
    from models.estimator import Estimator


KINDS = {  # file of this folder → the estimators whose steps it has
    "composite": (
        *("ElementNetwork", "ElementNetworkBranch"),
        *("HystereticElement", "LatentHysteresisNetwork"),
    ),
    "named": ("ElementNetworkNamed", "NamedElement"),
    "linear": ("EquivalentLinear", "LinearMotion"),
    "static": ("RestoringForceSurface", "Rigid", "Zero"),
    "runge_kutta": ("GlobalMLP", "ModalPolynomial", "ResidualMLP"),
    "modal": ("ModalNetwork",),
    "neural_state_space": ("NeuralStateSpace",),
    "recurrent": ("Recurrent",),
    "sliders": ("PrandtlIshlinskii",),
    "vwnn": ("VWNN",),
    "online": ("Online",),
    "vwnn_forward": ("ForwardVWNN",),
}
FILES = {name: file for file, names in KINDS.items() for name in names}
NO_STEP = {  # why, and what to take
    "BranchElement": "looks for turning points in the whole imposed motion, which a step has not "
    "seen; take model=element_test model.laws=units or model.laws=named, or to=json for its curves"
}
WITH_ONLINE_STEP = ("VWNN",)  # beside their free run
INTEGRATE = ("recurrent", "vwnn", "vwnn_forward")  # what they estimate, whatever that is


def online_step_of(model: Estimator) -> Step | None:
    """The step of a model that is told measured accelerations; None of most models."""
    if type(model).__name__ not in WITH_ONLINE_STEP:
        return None
    return import_module("export.steps.online").step_of(model)


def step_of(model: Estimator, quantity: str | None = None) -> Step:
    """The step of an identified model.

    quantity: of the records that it was trained on (data.record.QUANTITIES), which names the
    outputs of models that do not know; None: they are y, of unknown unit.

    Raises ValueError for one that is not identified, and for a class that has none: one without a
    free run, or one that is not of this zoo, even where it derives from one that is.
    """
    kind = type(model)
    if why := NO_STEP.get(kind.__name__):
        raise ValueError(f"{kind.__name__} has no step to export: it {why}")
    if kind.__name__ not in FILES or PUBLIC.get(kind.__name__) != kind.__module__:
        raise ValueError(
            f"{kind.__name__} has no step to export: it has no free run, or nobody wrote it; "
            f"export one of {', '.join(sorted(FILES))}"
        )
    file = FILES[kind.__name__]
    step: Step = import_module(f"export.steps.{file}").step_of(model)
    return step if quantity is None else named_by(step, quantity, file in INTEGRATE)


# Names and units of outputs, where only the records say what a model's output is.


def named_by(step: Step, quantity: str, integrates: bool) -> Step:
    """The step with the outputs that it has where its model was trained on this quantity.

    integrates: whether its x and v are integrals of a, which mean nothing where a is no
    acceleration.
    """
    letter = OUTPUTS.get(quantity, "y")
    unit = plain_unit(QUANTITIES[quantity][1]).replace("–", "")
    arrays = [array for array, *_ in step.outputs]
    if "output" in arrays or (integrates and quantity != "acceleration"):
        array = "output" if "output" in arrays else "a"
        names = [f"{letter}{i + 1}" for i in range(step.state[array].size)]
        return replace(step, outputs=[(array, names, unit)])
    return step
