"""Estimators as steps (export/step.py), a file for each kind."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from models import ESTIMATORS

if TYPE_CHECKING:
    from export.step import Step
    from models.estimator import Estimator

KINDS = {  # file of this folder → the estimators whose steps it has
    "composite": ("ElementNetwork", "HystereticElement", "LatentHysteresisNetwork"),
    "branches": ("ElementNetworkBranch",),
    "named": ("ElementNetworkNamed", "NamedElement"),
    "linear": ("EquivalentLinear", "LinearMotion"),
    "static": ("RestoringForceSurface", "Rigid", "Zero"),
    "mlp": ("GlobalMLP", "ResidualMLP"),
    "polynomial": ("ModalPolynomial",),
    "modal": ("ModalNetwork",),
    "neural_state_space": ("NeuralStateSpace",),
    "recurrent": ("Recurrent",),
    "sliders": ("PrandtlIshlinskii",),
    "sliding_mass": ("SlidingMass",),
    "tanks": ("TankCascade",),
    "vwnn": ("VWNN",),
    "vwnn_forward": ("ForwardVWNN",),
    "wiener_hammerstein": ("WienerHammerstein",),
}
FILES = {name: file for file, names in KINDS.items() for name in names}


def step_of(model: Estimator) -> Step:
    """The step of an identified model.

    Raises ValueError for one that is not identified, and for a class that has none: one without a
    free run, or one that is not of this zoo, even where it derives from one that is.
    """
    kind = type(model)
    if kind.__name__ not in FILES or ESTIMATORS.get(kind.__name__) != kind.__module__:
        raise ValueError(
            f"{kind.__name__} has no step to export: it has no free run, or nobody wrote it; "
            f"export one of {', '.join(sorted(FILES))}"
        )
    step: Step = import_module(f"export.steps.{FILES[kind.__name__]}").step_of(model)
    return step
