"""Finished runs whose models were planted, not trained: exact, and made in no time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from data.record import Record
from data.sample import Sensors
from models import ElementNetwork, Estimator
from models.fit.trained_range import range_of
from runner.config.choices import plain
from runner.config.compose import composed
from runner.folder.run import Run

DT = 0.01
K, C, Y, AFTER = 400.0, 1.5, 0.01, 0.2  # N/m, N s/m, m, share of the stiffness after yielding


def chain(dofs: int, inputs: int, cubic: float = 0.0, **more: Any) -> ElementNetwork:
    """Masses of 1 kg above each other, on bilinear elements (cubic [N/m³])."""
    model = ElementNetwork(dofs, inputs, DT, hinges=0, units=1, **more)
    E = len(model.elements)
    one = torch.ones(E, dtype=torch.float64)
    model.laws.start(K * one, C * one, 0.05 * one, (0.5, 0.5))
    model.mass.start(torch.ones(dofs, dtype=torch.float64))
    model.laws.unit_stiffness.start((1.0 - AFTER) * K * one[:, None], 1.0)
    model.laws.unit_limit.start(Y * one[:, None])
    model.laws.cubic.start(one, cubic)
    model.identified.fill_(1.0)
    return model


def forced(dofs: int, **more: Any) -> tuple[ElementNetwork, Sensors]:
    loaded = list(range(1, dofs + 1))
    model = chain(dofs, dofs, elements="chain", forced=loaded, **more)
    return model, Sensors(DT, dofs, dofs, loaded)


def shaken(dofs: int) -> tuple[ElementNetwork, Sensors]:
    """On a base whose acceleration is measured."""
    model = chain(dofs, 1, elements="chain", masses=[1.0] * dofs, forced="base")
    return model, Sensors(DT, dofs, 1, "base")


def carried(dofs: int) -> tuple[ElementNetwork, Sensors]:
    """On a support whose displacement and velocity are known."""
    model = chain(dofs, 2, elements="chain", masses=[1.0] * dofs, forced=[])
    return model, Sensors(DT, dofs, 2, [])


def plant(folder: Path, model: Estimator, sensors: Sensors, *words: str, **metrics: Any) -> Path:
    """A finished run of a model, whose trained range is that of a motion of some centimetres."""
    settings = [f"model.{key}={value}" for key, value in _settings(model).items()]
    cfg = composed(*settings, *(words or ("model=element_network", "system=bilinear")))
    run = Run.begin(folder, plain(cfg), sensors)
    run.save(model)
    run.finish(
        {
            "model": cfg.model.name,
            "system": cfg.system.name,
            "scenario": "full_state",
            "verdict": {"identified": True, "reason": ""},
            "trained_range": range_of(model, [training(model, sensors)]),
            **metrics,
        }
    )
    return folder


def _settings(model: Estimator) -> dict[str, Any]:
    """What the config has to say of a planted chain."""
    if not isinstance(model, ElementNetwork):
        return {}
    masses = None if model.known_masses is None else model.known_masses.tolist()
    return {
        "elements": "chain", "hinges": 0, "units": 1, "masses": str(masses).replace("None", "null"),
        "forced": "base" if model.base else str([i + 1 for i in model.forced]).replace(" ", ""),
        "mass_damping": "false",
    }  # fmt: skip


def training(model: Estimator, sensors: Sensors) -> Record:
    """A record of a second of growing sines."""
    t = DT * torch.arange(100, dtype=torch.float64)[:, None]
    u = 2.0 * t * torch.sin(12.0 * t * torch.ones(1, sensors.inputs))
    supports = sensors.forced == [] and sensors.inputs == 2
    still = torch.zeros(100, sensors.dofs, dtype=torch.float64)
    if supports or sensors.quantity == "force":
        s, s_dot = (0.02 * u).chunk(2, dim=1)
        record = Record(DT, still, u[:, :0], s=s, s_dot=s_dot, quantity=sensors.quantity)
    else:
        record = Record(DT, still, u)
    with torch.no_grad():
        run = model.free_run(record.drive())
    return Record(
        DT, run.a, record.f, None, None, record.s, record.s_dot, quantity=sensors.quantity
    )
