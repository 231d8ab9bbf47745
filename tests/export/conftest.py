"""A finished run, and models whose coefficients are set by hand: no training."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from data.record import Drive
from data.sample import Sensors
from export.passport import Passport
from export.run import Exported
from models import ElementNetwork
from models.estimator import Estimator
from tests.program.test_train import finished_run

DT = 0.01
QUICK = ["data.duration=2", "model=vwnn", "model.order=1", "figures=false"]


@pytest.fixture(scope="session")
def vwnn_run(tmp_path_factory) -> Path:
    """A finished run of the VWNN of first order."""
    return finished_run(tmp_path_factory.mktemp("runs") / "vwnn", *QUICK)


def exported(estimator: Estimator, name: str = "model", hold: str = "linear") -> Exported:
    """A model as `read_exported` returns it, with a passport that says little."""
    facts = {
        "model": name,
        "class": type(estimator).__name__,
        "software": "structural-model-zoo",
        "results": "by hand",
        "config": "by hand",
        "dt_s": estimator.dt,
        "quantity": "acceleration",
        "trained_on": {
            **dict.fromkeys(("records", "duration_s", "benchmark", "hold")),
            **{"system": "nothing", "scenario": "none", "dt_s": DT, "seed": 0, "files": []},
        },
        "error_percent": dict.fromkeys(
            ("free_run_test", "free_run_training", "one_step_test", "one_step_training")
        ),
        "identified": None,
        "trained_range": {},
        "licence": {"code": "MIT", "data": "none"},
    }
    sensors = Sensors(estimator.dt, estimator.dofs, estimator.inputs)
    return Exported(estimator, name, Passport(facts), sensors, {}, hold)


@torch.no_grad()
def network(
    dofs: int, seed: int = 0, terms: tuple[str, ...] = (), **options: object
) -> ElementNetwork:
    """An element network with stiffnesses, dampers and `terms` of its laws drawn by seed."""
    inputs = options.pop("inputs", dofs)
    made = ElementNetwork(dofs, inputs, DT, **options)
    laws, E = made.laws, len(made.elements)
    draw = torch.Generator().manual_seed(seed)

    def around(value: float, *shape: int) -> torch.Tensor:
        return value * (0.7 + 0.6 * torch.rand(*shape, generator=draw, dtype=torch.float64))

    made.mass.start(around(1.5, dofs))
    laws.start(around(60.0, E), around(0.5, E), around(0.06, E), (0.4, 0.6))
    for name in terms:
        coefficients = getattr(laws, name)
        size = 1.0 if name in ("unit_rising", "unit_falling") else 0.3
        sign = torch.where(torch.rand(coefficients.theta.shape, generator=draw) < 0.3, -1.0, 1.0)
        if name in ("cubic", "unit_stiffness"):  # else it may run away
            sign = sign.abs()
        coefficients.theta.copy_(around(size, *coefficients.theta.shape) * sign.double())
    made.identified.fill_(1.0)
    return made.eval()


def drive_of(estimator: Estimator, samples: int = 400, size: float = 5.0) -> Drive:
    """A smooth excitation from rest."""
    draw = torch.Generator().manual_seed(1)
    t = DT * torch.arange(samples, dtype=torch.float64)[:, None]
    rates = 2.0 + 12.0 * torch.rand(3, estimator.inputs, generator=draw, dtype=torch.float64)
    phases = 6.0 * torch.rand(3, estimator.inputs, generator=draw, dtype=torch.float64)
    u = size * sum(torch.sin(w * t + p) for w, p in zip(rates, phases, strict=True)) / 3.0
    rest = torch.zeros(estimator.dofs, dtype=torch.float64)
    return Drive(DT, u, rest, rest)
