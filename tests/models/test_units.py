"""No unit counts: with other units of length, force and time every model fits as well as before.

Units change by powers of two near 1e6, so that not even rounding differs: whatever has a constant
with a unit inside, such as a floor, a ridge or a limit, is caught, however long its solver takes.
Units on both sides of a record's own are compared with each other: a floor is reached on one side.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
import torch
from lightning.pytorch import seed_everything
from omegaconf import DictConfig

from data.datamodule import Data
from data.record import Record
from models.estimator import simulate
from models.fit.identification import Identification
from models.starts import branch_laws
from runner.config.compose import CONF, EARLIER, composed
from tests.experiments import changed, estimator_from, objective_from, solver_from
from tests.models.training import fit
from tests.models.zoo import NO_STRUCTURE, SMALL_BRANCH, SMALLER, class_name

MORE = 2.0**20  # 1.05e6
OWN = (1.0, 1.0, 1.0)  # units of length, force and time
SIDES = ((MORE, 1.0 / MORE, MORE), (1.0 / MORE, MORE, 1.0 / MORE))
SEARCHED = 1e-3  # named laws follow the integrator, whose first step has a floor in metres
ROUNDING = 1e-7  # the named laws' search (SciPy's) sums in an order that depends on memory
RATES = (  # whose filters are stated in rad/s or s, for all records
    "filtered_extrapolation",
    "neural_state_space",
    "online_vwnn",
    "vwnn",
    "vwnn_forward",
)
STATED = (
    "online_linear",  # its features have units, and so has adaptation.variance
)
SAME = ("hysteretic_element", "vwnn_first_order", "vwnn_third_order")  # as others here
SHORTER = {
    **SMALLER,
    "models.VWNN": {"stages": 1},
    "models.ElementNetworkBranch": {"elements": "chain", **SMALL_BRANCH},
    "models.ElementNetworkNamed": {"elements": "chain", "laws": ["Linear"]},
}
NAMES = {path.stem for folder in (CONF, EARLIER) for path in (folder / "model").glob("*.yaml")}
MODELS = sorted(NAMES.difference(STATED, SAME))
SLOW = ("element_network_branch", "element_network_named")  # from the record's own to one side


class Held(Data):
    """Records of a person's own, all to train on."""

    name, measured = "held", True

    def __init__(self, record: Record) -> None:
        super().__init__()
        self.record, self.dt, self.quantity = record, record.dt, record.quantity
        self.dofs, self.inputs = record.dofs, record.excitation.shape[-1]
        self.forced = list(range(1, self.inputs + 1))
        self.setup()

    def make_records(self) -> dict[str, list[Record]]:
        return {"train": [self.record], "test": [self.record]}


def in_units(record: Record, length: float, force: float, time: float) -> Record:
    rate = length / time
    size = {"acceleration": rate / time, "displacement": length, "force": force}[record.quantity]
    sizes = {"x": length, "v": rate, "s": length, "s_dot": rate, "f": force, "a": size}
    signals = {k: sizes[k] * u for k, u in record.signals().items()}
    return replace(record, dt=time * record.dt, **signals)


@pytest.fixture(scope="module")
def records(bilinear_record) -> dict[str, Record]:
    """A motion, and an element's force under it."""
    whole = replace(bilinear_record, truth=None).window(0, 160)
    y, r = bilinear_record.truth.y[:160, :1], bilinear_record.truth.r[:160, :1]
    rate = torch.gradient(y, spacing=whole.dt, dim=0)[0]
    element = Record(
        whole.dt, r.clone(), r.new_zeros(160, 0), s=y.clone(), s_dot=rate, quantity="force"
    )
    return {"structure": whole, "element": element}


@cache
def config(name: str) -> DictConfig:
    return composed(f"model={name}", "system.sigmoid_weight=null")


def errors(name: str, record: Record, folder) -> dict[str, float]:
    """Relative errors of a model after a few iterations, one step ahead and in free run."""
    cfg = config(name)
    short = {k: v for k, v in SHORTER.get(class_name(cfg.model), {}).items() if k in cfg.model}
    seed_everything(0, verbose=False)
    data = Held(record)
    few = {"starts": 2, "start_iterations": 1, "finalists": 1} if "starts" in cfg.objective else {}
    module = Identification(
        estimator_from(changed(cfg.model, short), data),
        solver_from(changed(cfg.solver, {"iterations": 2})),
        objective=objective_from(changed(cfg.objective, few)),
    )
    fit(module, data, folder)
    with torch.no_grad():
        ways = {"one step": module.estimator(record)}
        if "f" in module.estimator.reads:
            ways["free run"] = simulate(module.estimator, record).a
    return {way: float((u - record.a).norm() / record.a.norm()) for way, u in ways.items()}


def record_for(name: str, records: dict[str, Record]) -> Record:
    return records["element" if class_name(config(name).model) in NO_STRUCTURE else "structure"]


@pytest.mark.parametrize("name", MODELS)
def test_other_units_change_no_error(name, records, tmp_path, monkeypatch):
    monkeypatch.setitem(branch_laws.SETTINGS, "iterations", 5)
    monkeypatch.setattr(branch_laws, "FIRST", 3)
    record, found = record_for(name, records), []
    for length, force, time in (OWN, SIDES[0]) if name in SLOW else SIDES:
        other = in_units(record, length, force, 1.0 if name in RATES else time)
        found.append(errors(name, other, tmp_path))
    most = SEARCHED if name == "element_network_named" else ROUNDING
    assert found[1] == pytest.approx(found[0], rel=most, nan_ok=True)
