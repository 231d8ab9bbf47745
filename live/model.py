"""The stream of a live model: of a finished run, or beginning from nothing."""

from __future__ import annotations

from pathlib import Path

from omegaconf import DictConfig

from data.sample import Sensors
from models.layers.features import SigmoidProducts
from models.linear_in_weights import LinearInWeights
from models.online.adaptive import Online, stream_of
from models.online.guard import Guard
from models.online.laws.frozen import Frozen
from models.online.laws.law import Law
from models.online.stream import Stream, started
from models.training.assemble import estimator_from
from models.training.build import build
from runner.folder.run import restore

LAMBDA = 0.05  # λ [1/unit] of a VWNN that no record tells the sizes of its channels


def stream_from_nothing(cfg: DictConfig, sensors: Sensors) -> Stream:
    """A stream of zero weights. Raises ValueError for models that need training first."""
    if cfg.model._target_ != "models.Online":
        raise ValueError(
            f"model={cfg.model.name} cannot begin from nothing; choose model=online_vwnn or "
            "another on-line model, or train it and give --run"
        )
    model = estimator_from(cfg.model, sensors)
    assert isinstance(model, Online)
    activation = getattr(model.estimator, "activation", None)
    if isinstance(activation, SigmoidProducts) and activation.weight.isnan().any():
        activation.weight.fill_(LAMBDA)
    return model.stream(from_nothing=True)


def stream_of_run(cfg: DictConfig, folder: Path, new_law: bool) -> Stream:
    """A finished run's stream; the run's records may be gone.

    new_law: adapt by the law `adaptation=` of the config. Otherwise an on-line run adapts by its
    own law, and a run of batch training keeps its weights. Raises ValueError for a run whose
    weights do not all enter linearly.
    """
    model = restore(cfg, folder)
    if isinstance(model, Online) and not new_law:
        return model.stream()
    inner = model.estimator if isinstance(model, Online) else model
    guard = model.guard if isinstance(model, Online) else Guard()
    if not isinstance(inner, LinearInWeights):
        raise ValueError(
            f"{folder} is a run of {cfg.model.name}, whose weights do not enter linearly; choose "
            "one of a VWNN, an equivalent linear system, a polynomial method or an on-line model"
        )
    law: Law = build(cfg.adaptation, Law) if new_law else Frozen()
    return stream_of(inner, law, started(inner, law), guard)
