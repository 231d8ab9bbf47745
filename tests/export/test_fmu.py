"""FMUs that a program of others validates and simulates: fmpy."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from data.record import Drive
from export.fmu import write_fmus
from export.steps import step_of
from tests.export import networks

fmpy = pytest.importorskip("fmpy", reason="fmpy is not installed: pip install -e '.[export]'")
pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
validation = pytest.importorskip("fmpy.validation")
CLOSE = 1e-12
LARGEST = 100_000  # bytes of an FMU


@dataclass
class Unit:
    """An FMU that is open: value references by name, and what differs between FMI 2 and 3."""

    path: Path
    description: Any
    folder: str

    def instance(self) -> Any:
        made = fmpy.instantiate_fmu(self.folder, self.description, fmi_type="CoSimulation")
        if self.old:
            made.setupExperiment(startTime=0.0)
        made.enterInitializationMode()
        return made

    @property
    def old(self) -> bool:
        return str(self.description.fmiVersion) == "2.0"

    def references(self, names: list[str]) -> list[int]:
        known = {v.name: v.valueReference for v in self.description.modelVariables}
        return [known[name] for name in names]

    def set(self, instance: Any, names: list[str], values: Any) -> None:
        setter = instance.setReal if self.old else instance.setFloat64
        setter(self.references(names), [float(v) for v in values])

    def saved(self, instance: Any) -> bytes:
        if self.old:
            return instance.serializeFMUstate(instance.getFMUstate())
        return instance.serializeFMUState(instance.getFMUState())

    def restore(self, instance: Any, saved: bytes) -> None:
        if self.old:
            instance.setFMUstate(instance.deSerializeFMUstate(saved))
        else:
            instance.setFMUState(instance.deserializeFMUState(saved))

    def get(self, instance: Any, names: list[str]) -> np.ndarray:
        getter = instance.getReal if self.old else instance.getFloat64
        return np.array(getter(self.references(names)))


@pytest.fixture(scope="module")
def model():
    return networks.network(3)


@pytest.fixture(scope="module", params=[2, 3], ids=["fmi2", "fmi3"])
def unit(request, model, tmp_path_factory) -> Iterator[Unit]:
    folder = tmp_path_factory.mktemp("fmu")
    told = ["trained on: nothing <at all>", 'error: "none"']
    path = write_fmus(step_of(model), "frame", told, folder)[request.param - 2]
    extracted = fmpy.extract(str(path))
    yield Unit(path, fmpy.read_model_description(str(path)), extracted)
    shutil.rmtree(extracted, ignore_errors=True)


FORCES = ["f1", "f2", "f3"]
MOTION = [f"{signal}{i}" for signal in "xva" for i in (1, 2, 3)]


def drive(samples: int, hold: str = "zero_order") -> Drive:
    generator = torch.Generator().manual_seed(5)
    u = 2e3 * torch.randn(samples, 3, generator=generator, dtype=torch.float64)
    rest = torch.zeros(3, dtype=torch.float64)
    return Drive(networks.DT, u, rest, rest, hold)


def expected(model, given: Drive) -> np.ndarray:
    """x, v, a (T, 9)."""
    with torch.inference_mode():
        run = model.free_run(given)
    return torch.cat([run.x, run.v, run.a], dim=1).numpy()


def assert_close(found: np.ndarray, right: np.ndarray) -> None:
    assert np.abs(found - right).max() <= CLOSE * np.abs(right).max()


def test_it_is_valid_and_small(unit):
    assert validation.validate_fmu(str(unit.path)) == []
    assert unit.path.stat().st_size <= LARGEST
    with zipfile.ZipFile(unit.path) as archive:
        page = archive.read("documentation/index.html").decode()
    assert "nothing &lt;at all&gt;" in page


@pytest.mark.parametrize("times", [1, 7])
def test_held_inputs_give_the_zero_order_run(unit, model, times):
    """At communication steps of 1 and 7 samples, inputs are held over all of them."""
    given = drive(5000 if times == 1 else 701)
    u = given.u[::times]
    held = replace(given, u=u.repeat_interleave(times, dim=0)[: given.samples])
    right = expected(model, held)[::times]
    instance = unit.instance()
    unit.set(instance, FORCES, u[0])
    instance.exitInitializationMode()
    found = [unit.get(instance, MOTION)]
    for k in range(1, len(right)):
        instance.doStep((k - 1) * times * networks.DT, times * networks.DT)
        unit.set(instance, FORCES, u[k])
        found.append(unit.get(instance, MOTION))
    assert_close(np.array(found), right)


def test_slopes_of_inputs_give_the_linear_run(unit, model):
    if not unit.old:
        pytest.skip("FMI 3 has no derivatives of inputs")
    given = drive(1000, "linear")
    right, u = expected(model, given), given.u.numpy()
    instance = unit.instance()
    unit.set(instance, FORCES, u[0])
    instance.exitInitializationMode()
    found = [unit.get(instance, MOTION)]
    for k in range(1, len(u)):
        slopes = [float(s) for s in (u[k] - u[k - 1]) / networks.DT]
        unit.set(instance, FORCES, u[k - 1])
        instance.setRealInputDerivatives(unit.references(FORCES), [1, 1, 1], slopes)
        instance.doStep((k - 1) * networks.DT, networks.DT)
        found.append(unit.get(instance, MOTION))
    assert_close(np.array(found), right)


def test_two_instances_and_a_saved_state(unit, model):
    given = drive(300)
    right, u = expected(model, given), given.u.numpy()
    one, other = unit.instance(), unit.instance()
    unit.set(one, FORCES, u[0])
    for instance in (one, other):
        instance.exitInitializationMode()
    saved = b""
    for k in range(1, len(u)):
        one.doStep((k - 1) * networks.DT, networks.DT)
        unit.set(one, FORCES, u[k])
        if k == 150:
            saved = unit.saved(one)
    assert_close(unit.get(one, MOTION), right[-1])
    unit.restore(other, saved)
    for k in range(151, len(u)):
        other.doStep((k - 1) * networks.DT, networks.DT)
        unit.set(other, FORCES, u[k])
    np.testing.assert_array_equal(unit.get(other, MOTION), unit.get(one, MOTION))


def test_parameters_are_tuned(unit):
    """Twice the stiffness of all elements, half the displacement under small forces at rest."""
    stiff = [v.name for v in unit.description.modelVariables if v.name.endswith(".stiffness")]
    hooked = [v.name for v in unit.description.modelVariables if v.name.endswith("_stiffness")]
    reached = []
    for times in (1.0, 2.0):
        instance = unit.instance()
        values = unit.get(instance, stiff)
        unit.set(instance, hooked, np.zeros(len(hooked)))
        unit.set(instance, stiff, times * values)
        unit.set(instance, FORCES, [1.0, 1.0, 1.0])
        instance.exitInitializationMode()
        for k in range(20_000):
            instance.doStep(k * networks.DT, networks.DT)
        reached.append(unit.get(instance, ["x3"])[0])
    assert reached[1] == pytest.approx(0.5 * reached[0], rel=1e-4)


def test_wrong_values_are_refused(unit):
    instance = unit.instance()
    with pytest.raises(Exception, match="fmi"):
        unit.set(instance, ["f1"], [float("nan")])
    with pytest.raises(Exception, match="fmi"):
        unit.set(instance, ["x1"], [1.0])
