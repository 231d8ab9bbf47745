"""The zoo: one estimator per file, each a plain nn.Module that knows no Lightning.

Every public class by its name, loaded when it is first used: `from models import VWNN`. The same
names stand in configs as `_target_: models.VWNN`. A file of this folder is public without a line
here: its classes are found in its text, and nothing is imported for that.
"""

from __future__ import annotations

import re
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
    "CumulativeSum": "models.detection.cumulative_sum",
    "HighPass": "models.detection.high_pass",
    "Monitor": "models.detection.monitor",
    "ResidualLevel": "models.detection.residual_level",
    "WeightDistance": "models.detection.weight_distance",
    "WeightDrift": "models.detection.weight_drift",
    # training
    "Adam": "models.training.solvers.adam",
    "FreeRun": "models.training.free_run_objective",
    "Identification": "models.training.identification",
    "LBFGS": "models.training.solvers.lbfgs",
    "LevenbergMarquardt": "models.training.solvers.levenberg_marquardt",
    "OneStep": "models.training.objective",
    "Trainable": "models.training.trainable",
}
__all__ = list(PUBLIC)


def __getattr__(name: str) -> Any:
    if name not in PUBLIC:
        raise AttributeError(f"module 'models' has no {name!r}; public are {', '.join(PUBLIC)}")
    return getattr(import_module(PUBLIC[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *PUBLIC]
