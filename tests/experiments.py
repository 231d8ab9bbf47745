"""The objects that configs and their nodes describe, as a run makes them of its choices."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

from omegaconf import DictConfig, OmegaConf

from data.datamodule import Data
from data.measured.datamodule import MeasuredData
from data.measured.mend import Mending
from data.sample import Sensors
from data.simulation.scenario import FullState
from models import choice
from models.choice import Choice
from models.estimator import Estimator
from models.experiment import Experiment, Model
from models.fit.objective import Objective
from runner.config.choices import plain
from runner.config.compose import composed


def experiment_of(cfg: DictConfig) -> Experiment:
    return Experiment.of(plain(cfg))


def data_from(cfg: DictConfig) -> Data:
    return experiment_of(cfg).make_data()


def estimator_from(node: Any, data: Data | Sensors) -> Estimator:
    return Model(*_placed(node)).estimator(data)


def solver_from(node: Any) -> Callable[..., Any]:
    return replace(_usual(), solver=Choice(*_placed(node))).make_solver()


def objective_from(node: Any) -> Objective:
    return replace(_usual(), objective=Choice(*_placed(node))).make_objective()


def build(node: Any, kind: type, **more: Any) -> Any:
    return Choice(*_placed(node)).build(kind, **more)


def class_of(node: Any) -> type:
    return choice.class_of(_placed(node)[1])


def changed(cfg: DictConfig, changes: Mapping[str, Any]) -> DictConfig:
    """A copy of a config with some values changed."""
    merged = OmegaConf.merge(cfg, changes)
    assert isinstance(merged, DictConfig)
    return merged


def said_by(main: Callable[..., object], words: Sequence[str], capsys: Any) -> tuple[int, str, str]:
    """Exit status, output and errors of a program's main function."""
    status = 0
    try:
        main(words)
    except SystemExit as end:
        status = int(end.code or 0)
    said = capsys.readouterr()
    return status, said.out, said.err


def measured(path: Any, **choices: Any) -> MeasuredData:
    """Records of files with all channels seen, and nothing mended unless it is chosen."""
    usual = {"path": str(path), "scenario": FullState(), "mend": Mending()}
    return MeasuredData(**{**usual, **choices})


@cache
def _usual() -> Experiment:
    return experiment_of(composed())


def _placed(node: Any) -> tuple[str, Any]:
    """The key and the resolved values of a node; "" for a whole config."""
    if not isinstance(node, DictConfig):
        return "", node
    return str(node._get_full_key(None) or ""), OmegaConf.to_container(node, resolve=True)
