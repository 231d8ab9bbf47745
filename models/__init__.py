"""The zoo: one estimator per file, each a plain nn.Module that knows no Lightning.

Every public class by its name, loaded when it is first used: `from models import VWNN`. The same
names stand in configs as `_target_: models.VWNN`.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

PUBLIC = {  # class → the module that defines it
    # estimators
    "ElementNetwork": "models.element_network",
    "EquivalentLinear": "models.linear",
    "Estimator": "models.estimator",
    "FilteredExtrapolation": "models.baselines",
    "ForwardVWNN": "models.vwnn_forward",
    "GlobalMLP": "models.mlp",
    "HystereticElement": "models.hysteretic_element",
    "LastValue": "models.baselines",
    "LatentHysteresisNetwork": "models.latent_hysteresis_network",
    "ModalPolynomial": "models.polynomial",
    "NeuralStateSpace": "models.neural_state_space",
    "NoFreeRunError": "models.estimator",
    "Recurrent": "models.recurrent",
    "ResidualMLP": "models.mlp",
    "RestoringForceSurface": "models.restoring_force_surface",
    "TwoPoint": "models.baselines",
    "VWNN": "models.vwnn",
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
    "FreeRun": "models.training.objective",
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
