"""Config and stream of a live model: of a finished run, or beginning from nothing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from data.sample import Sensors
from models.linear_in_weights import LinearInWeights
from models.online.adaptive import Online, stream_of
from models.online.guard import Guard
from models.online.laws.frozen import Frozen
from models.online.laws.law import Law
from models.online.stream import Stream, started
from models.training.assemble import build, estimator_from
from runner.compose import composed
from runner.run_folder import read_run, restore

GROUPS = ("adaptation", "damage")  # choices that may differ from a finished run's,
KEYS = ("data", "seed")  # and settings


def fresh_config(words: Sequence[str], replayed: bool) -> DictConfig:
    """The config of a model that begins from nothing, as train.py would compose it."""
    named = {word.partition("=")[0] for word in words}
    first = [] if "model" in named else ["model=online_vwnn"]
    if replayed and not named & {"data", "experiment"}:
        first.append("data=measured")
    return composed(*first, *words)


def run_config(folder: Path, words: Sequence[str]) -> DictConfig:
    """A finished run's config, with the law, damage, data or seed that the words name.

    Raises ValueError for other words: a run brings its model along.
    """
    cfg, _ = read_run(folder)
    chosen = {word.partition("=")[0] for word in words} & set(GROUPS)
    for group in chosen:
        cfg[group] = composed(*(w for w in words if _head(w) == group))[group]
    keys = [word for word in words if _head(word) in {*KEYS, *GROUPS} - chosen]
    other = [word for word in words if _head(word) not in (*GROUPS, *KEYS)]
    if other:
        raise ValueError(
            f"{other[0]}: a run brings its model along; beside --run there may stand "
            f"{', '.join(f'{name}=' for name in GROUPS)} seed= and data.…="
        )
    merged = OmegaConf.merge(cfg, OmegaConf.from_dotlist(keys))
    assert isinstance(merged, DictConfig)
    return merged


def _head(word: str) -> str:
    return word.partition("=")[0].partition(".")[0]


def stream_from_nothing(cfg: DictConfig, sensors: Sensors) -> Stream:
    """A stream of zero weights. Raises ValueError for models that need training first."""
    if cfg.model._target_ != "models.Online":
        raise ValueError(
            f"model={cfg.model.name} cannot begin from nothing; choose model=online_vwnn or "
            "another on-line model, or train it and give --run"
        )
    model = estimator_from(cfg.model, sensors)
    assert isinstance(model, Online)
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
    law: Law = build(cfg.adaptation) if new_law else Frozen()
    return stream_of(inner, law, started(inner, law), guard)
