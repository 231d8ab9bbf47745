"""The zoo: one estimator per file, each a plain nn.Module that knows no Lightning.

Every public class by its name, loaded when it is first used: `from models import VWNN`. The same
names are in configs as `_target_: models.VWNN`. A file of this folder is public without a line
here: its classes are found in its text, and nothing is imported for that.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

ESTIMATORS = {  # class → the module that defines it; parts that are mere layers stay private
    name: f"models.{file.stem}"
    for file in sorted(Path(__file__).parent.glob("*.py"))
    for name in re.findall(r"^class ([A-Z]\w*)\((?!nn\.)", file.read_text("utf-8"), re.MULTILINE)
}
PUBLIC = ESTIMATORS | {
    "Estimator": "models.estimator",  # the interface
    # on line
    "Frozen": "models.online.laws.frozen",
    "Guard": "models.online.guard",
    "NormalisedGradient": "models.online.laws.normalised_gradient",
    "Online": "models.online.adaptive",
    "RandomWalk": "models.online.laws.random_walk",
    "RecursiveLeastSquares": "models.online.laws.recursive_least_squares",
    "Stream": "models.online.stream",
    # change detectors
    "CumulativeSum": "models.detection",
    "HighPass": "models.detection",
    "Monitor": "models.detection",
    "ResidualLevel": "models.detection",
    "WeightDistance": "models.detection",
    "WeightDrift": "models.detection",
    # training
    "Adam": "models.fit.solvers.adam",
    "FreeRun": "models.fit.free_run_objective",
    "Identification": "models.fit.identification",
    "LBFGS": "models.fit.solvers.lbfgs",
    "LevenbergMarquardt": "models.fit.solvers.levenberg_marquardt",
    "OneStep": "models.fit.objective",
    "Trainable": "models.fit.trainable",
}
KINDS = {  # front → its laws → the class that is built
    "ElementNetwork": {
        "units": "ElementNetwork",
        "branch": "ElementNetworkBranch",
        "named": "ElementNetworkNamed",
    },
    "ElementTest": {
        "units": "HystereticElement",
        "branch": "BranchElement",
        "named": "NamedElement",
    },
}
__all__ = list(PUBLIC)


def class_name(name: str, laws: Any = None) -> str:
    """The class that is built where a name and `laws` are given; a list is of named laws.

    Raises ValueError for laws that the class does not have.
    """
    if name not in KINDS:
        return name
    kinds = KINDS[name]
    listed = isinstance(laws, Sequence) and not isinstance(laws, str)
    kind = "named" if listed else laws or "units"
    if not isinstance(kind, str) or kind not in kinds:
        raise ValueError(
            f"model.laws={kind}: expected {', '.join(kinds)}, or a list of laws by their names, "
            "such as [MenegottoPinto, SelfCentering]"
        )
    return kinds[kind]


def __getattr__(name: str) -> Any:
    if name not in PUBLIC:
        raise AttributeError(f"module 'models' has no {name!r}; public are {', '.join(PUBLIC)}")
    return getattr(import_module(PUBLIC[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *PUBLIC]
