"""Config → data and estimators. A `_target_` names a class that a front lists, nothing else.

A run's config may come from somebody else; building from it must not run code of their choice.
"""

from __future__ import annotations

import difflib
import inspect
import re
from collections.abc import Callable, Iterable
from typing import Any

import torch
from hydra.errors import InstantiationException
from hydra.utils import instantiate
from lightning.pytorch import seed_everything
from omegaconf import DictConfig, ListConfig, OmegaConf
from torch import nn

import data
import models
from data.datamodule import Data
from data.sample import Sensors
from models.estimator import Estimator
from models.training.identification import Identification
from models.training.objective import Objective
from models.training.solvers.solver import Solver

FRONTS = {"data": data, "models": models}
LABELS = ("name", "about")  # of a choice: what tables call it, and what they say of it


def _class_of(target: Any) -> type:
    """The class that a `_target_` names. Raises ValueError unless a front lists it."""
    room, _, name = target.partition(".") if isinstance(target, str) else ("", "", "")
    if room in FRONTS and name in FRONTS[room].PUBLIC:
        public: type = getattr(FRONTS[room], name)
        return public
    raise ValueError(f"_target_={target!r} is not a public class of this project's data or models")


def _check(node: Any) -> None:
    """Check every `_target_` and the arguments beside it, before anything is built."""
    if isinstance(node, list):
        for value in node:
            _check(value)
    if isinstance(node, dict):
        for value in node.values():
            _check(value)
        if "_target_" in node:
            known = inspect.signature(_class_of(node["_target_"])).parameters
            for key in node:
                if key.startswith("_") and key != "_target_":
                    raise ValueError(f"{node['_target_']}: the key {key!r} is not allowed")
                if key not in known and key not in ("_target_", *LABELS):
                    near = difflib.get_close_matches(key, known, n=1)
                    hint = f"; did you mean {near[0]!r}?" if near else ""
                    raise ValueError(f"{node['_target_']} has no argument {key!r}{hint}")


def build(node: DictConfig | ListConfig, **more: Any) -> Any:
    """The object that a config node describes; its LABELS are no arguments."""
    plain: Any = OmegaConf.to_container(node, resolve=True, throw_on_missing=True)
    _check(plain)
    for key in (*LABELS, *more):  # what is given comes before what the config says
        plain.pop(key, None)
    try:
        # called here, not by Hydra, which would turn dataclasses among `more` into dicts
        return instantiate(plain, _convert_="all", _partial_=True)(**more)
    except InstantiationException as error:
        if isinstance(error.__cause__, ValueError):
            where = re.search(r"full_key: (\S+)", str(error))
            raise ValueError(f"{where[1] + ': ' if where else ''}{error.__cause__}") from None
        raise
    except TypeError as error:  # a number for a list, a word for a number
        raise ValueError(f"{plain['_target_']}: {error}; see its comments in conf/") from None


def changed(cfg: DictConfig, changes: dict[str, Any]) -> DictConfig:
    """A copy of a config with some values changed."""
    merged = OmegaConf.merge(cfg, changes)
    assert isinstance(merged, DictConfig)
    return merged


def data_from(cfg: DictConfig) -> Data:
    """Training and test records of a run."""
    more: dict[str, Any] = {"scenario": build(cfg.scenario), "seed": cfg.seed}
    if cfg.system.structure is not None:  # measured ones come without
        more.update(structure=build(cfg.system.structure), excitation=build(cfg.excitation))
        if cfg.get("damage"):  # runs of older code have none
            more["damage"] = build(cfg.damage)
    elif cfg.data._target_.endswith(".SimulatedData"):
        raise ValueError(
            f"system={cfg.system.name} has no structure to simulate; choose data=measured and "
            "data.path, or another system"
        )
    elif cfg.get("damage"):
        raise ValueError(
            f"damage is simulated, and system={cfg.system.name} was measured; choose damage=none"
        )
    return build(cfg.data, name=cfg.system.name, **more)


def estimator_from(model: DictConfig, data: Data | Sensors) -> Estimator:
    """An estimator of the size of the data, or of what sensors send, not yet identified."""
    more: dict[str, Any] = {}
    if "forced" in model and model.forced is None:
        more["forced"] = data.forced
    if "estimator" in model:  # one that wraps another
        more["estimator"] = estimator_from(model.estimator, data)
    return build(model, dofs=data.dofs, inputs=data.inputs, dt=data.dt, **more)


def solver_from(solver: DictConfig) -> Callable[[Iterable[nn.Parameter]], Solver]:
    """A function from free parameters to the chosen solver. Raises ValueError for bad settings."""
    build(solver, parameters=[nn.Parameter(torch.zeros(1))])  # a wrong setting is found now
    return lambda parameters: build(solver, parameters=parameters)


def objective_from(objective: DictConfig) -> Objective:
    """The objective that the solver minimises."""
    return build(objective)


def assembled(cfg: DictConfig) -> tuple[Data, Identification, dict[str, Estimator]]:
    """Everything that a run needs: its data, its model with solver and objective, its baselines.

    The starting weights are drawn from the run's seed. Raises ValueError for settings that do not
    fit together, before any work is done.
    """
    if cfg.threads < 1:
        raise ValueError(f"threads={cfg.threads} must be at least 1")
    if not isinstance(cfg.seed, int) or cfg.seed < 0:
        raise ValueError(f"seed={cfg.seed} must be a whole number, not negative")
    data = data_from(cfg)
    seed_everything(cfg.seed, verbose=False)
    estimator = estimator_from(cfg.model, data)
    module = Identification(
        estimator, solver_from(cfg.solver), cfg.max_fail, objective_from(cfg.objective)
    )
    return data, module, {name: estimator_from(node, data) for name, node in cfg.baselines.items()}
