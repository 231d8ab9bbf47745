"""Config → data, estimator, solver and objective of a run."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Any

import torch
from lightning.pytorch import seed_everything
from omegaconf import DictConfig, OmegaConf
from torch import nn
from torch.optim import Optimizer

import models
from data.annotations import shown
from data.datamodule import Data
from data.measured.channels import signal_of
from data.sample import Sensors
from data.simulation.damage import Damage
from data.simulation.datamodule import SimulatedData
from data.simulation.excitation import Excitation
from data.simulation.scenario import Scenario
from data.simulation.structure import Structure
from models.composition.topology import MOST_PAIRED, topology_of
from models.estimator import Estimator
from models.fit.identification import Identification
from models.fit.objective import Objective
from models.fit.solvers.solver import Solver
from models.training.build import arguments_of, build, class_of

USUAL = Sensors(dt=1e-3, dofs=3, inputs=3)  # for which every baseline can be built


def changed(cfg: DictConfig, changes: dict[str, Any]) -> DictConfig:
    """A copy of a config with some values changed."""
    merged = OmegaConf.merge(cfg, changes)
    assert isinstance(merged, DictConfig)
    return merged


def data_from(cfg: DictConfig) -> Data:
    """Training and test records of a run."""
    more: dict[str, Any] = {"scenario": build(cfg.scenario, Scenario), "seed": cfg.seed}
    if cfg.system.structure is not None:  # measured ones come without
        if "_target_" not in (cfg.excitation or {}):
            raise ValueError(
                f"excitation=none is for measured records, and system={cfg.system.name} is "
                "simulated; choose excitation=gaussian"
            )
        more.update(
            structure=build(cfg.system.structure, Structure),
            excitation=build(cfg.excitation, Excitation),
        )
        if cfg.get("damage"):  # runs of older code have none
            more["damage"] = build(cfg.damage, Damage)
    elif cfg.data._target_.endswith(".SimulatedData"):
        raise ValueError(
            f"system={cfg.system.name} has no structure to simulate; choose data=measured and "
            "data.path, or another system"
        )
    elif cfg.get("damage"):
        raise ValueError(
            f"damage is simulated, and system={cfg.system.name} was measured; choose damage=none"
        )
    return build(cfg.data, Data, name=cfg.system.name, **more)


def simulated_from(cfg: DictConfig) -> SimulatedData:
    """Records of a run whose structure is known. Raises ValueError for measured ones."""
    data = data_from(cfg)
    if not isinstance(data, SimulatedData):
        raise ValueError(f"{cfg.system.name} was measured, not simulated: its laws are not known")
    return data


def estimator_from(model: DictConfig, data: Data | Sensors) -> Estimator:
    """An estimator of the size of the data, or of what sensors send, not yet identified."""
    if not isinstance(model, DictConfig):
        raise ValueError(f"{shown(model)!r} is not a model; see --help")
    if (model.get("priors") or model.get("ties")) and not _can_state(model):
        raise ValueError(
            f"model.priors and model.ties are for {_choices_with('priors')}; "
            f"model={model.get('name', '')} has no parameters that they could be of: leave them out"
        )
    more: dict[str, Any] = {}
    sensors = data.sensors if isinstance(data, Data) else data
    others = [] if "y1" in sensors.channels else sensors.channels  # u1 drives a benchmark's y1
    others = [c for c in others if signal_of(c) == "u"]
    chosen: Any = class_of(model)
    if others and not getattr(chosen, "takes_other_inputs", True):
        raise ValueError(
            f"model={model.get('name', '')} has no place for the other inputs {', '.join(others)}; "
            f"take them out of data.channels, or choose {chosen.reading_other_inputs}"
        )
    if "other_inputs" in model and model.other_inputs is None:
        more["other_inputs"] = len(others)
    if "forced" in model and model.forced is None:
        more["forced"] = data.forced
    if "elements" in model and model.elements is None and sensors.topology:
        more["elements"] = sensors.topology
    if "estimator" in model:  # one that wraps another
        more["estimator"] = estimator_from(model.estimator, data)
    return build(model, Estimator, dofs=data.dofs, inputs=data.inputs, dt=data.dt, **more)


def _can_state(model: DictConfig) -> bool:
    return "priors" in arguments_of(class_of(model))


def _choices_with(setting: str) -> str:
    """The elements that have a setting, as a person chooses them."""
    return " or ".join(
        f"model={re.sub('(?<=.)(?=[A-Z])', '_', front).lower()} model.laws={laws}"
        for front, kinds in models.KINDS.items()
        for laws, name in kinds.items()
        if setting in arguments_of(getattr(models, name))
    )


def solver_from(solver: DictConfig) -> Callable[[Iterable[nn.Parameter]], Solver]:
    """A function from free parameters to the chosen solver. Raises ValueError for bad settings."""
    build(
        solver, Optimizer, parameters=[nn.Parameter(torch.zeros(1))]
    )  # a wrong setting is found now
    return lambda parameters: build(solver, Optimizer, parameters=parameters)


def objective_from(objective: DictConfig) -> Objective:
    """The objective that the solver minimises."""
    built: Objective = build(objective, Objective)
    return built


def assembled(
    cfg: DictConfig,
) -> tuple[Data, Identification, dict[str, Estimator | ValueError]]:
    """Everything that a run needs: its data, its model with solver and objective, its baselines.

    A baseline that cannot be built for these data is the reason why. The starting weights are
    drawn from the run's seed. Raises ValueError for settings that do not fit together, before any
    work is done.
    """
    data = data_from(cfg)
    if asks_for_topology(cfg.model, data):
        data.setup()
        data.topology = topology_of(data.records["train"])
    module = identification_from(cfg, data)
    return data, module, {name: _or_why_not(node, data) for name, node in cfg.baselines.items()}


def identification_from(cfg: DictConfig, data: Data) -> Identification:
    """The model of a run with solver and objective, its starting weights drawn from the seed."""
    seed_everything(cfg.seed, verbose=False)
    estimator = estimator_from(cfg.model, data)
    return Identification(
        estimator, solver_from(cfg.solver), cfg.max_fail, objective_from(cfg.objective)
    )


def asks_for_topology(model: DictConfig, data: Data) -> bool:
    """Whether elements between unknown masses are left to the records, and these can tell."""
    unknown = all(model.get(key, "") is None for key in ("elements", "masses"))
    few = 1 < data.dofs <= MOST_PAIRED and data.quantity == "acceleration"
    base = data.measured and data.forced == "base"
    support = data.forced == [] and data.inputs == 2  # its displacement and velocity
    return unknown and few and (base or support)


def _or_why_not(baseline: DictConfig, data: Data) -> Estimator | ValueError:
    """The baseline, or why it is none for these data. Raises ValueError for wrong settings."""
    try:
        return estimator_from(baseline, data)
    except ValueError as error:
        estimator_from(baseline, USUAL)
        return error
