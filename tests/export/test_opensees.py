"""OpenSeesPy scripts run by OpenSees against the model's own free run."""

from __future__ import annotations

import ast
import csv
import json
import os
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import torch

from data import FrictionPendulum, Polynomial
from data.record import Drive
from data.simulation.element_test import force
from data.simulation.laws.candidate import Units
from export.opensees import material_of, named_materials, script_of, write
from models import ElementNetwork, ElementNetworkNamed
from models.named_laws.candidates import CANDIDATES
from models.named_laws.fit import Fit
from tests.export.conftest import DT, drive_of, exported, network
from tests.reference_networks import law as law_of
from tests.reference_networks import units

FOUND = find_spec("openseespy") is not None
needs_opensees = pytest.mark.skipif(
    not FOUND, reason="needs openseespy: pip install -c constraints.txt -e '.[opensees]'"
)
LIBRARIES = "openseespylinux"  # its wheel needs its own BLAS loaded first


def opensees_environment() -> dict[str, str]:
    found, env = find_spec(LIBRARIES), dict(os.environ)
    if found is not None and found.origin is not None:
        env["LD_LIBRARY_PATH"] = str(Path(found.origin).parent / "lib")
    env["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
    return env


def python(script: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(script), *words]
    return subprocess.run(
        command, env=opensees_environment(), capture_output=True, text=True, errors="replace"
    )


def run(model, drive: Drive, folder: Path, steps: int) -> np.ndarray:
    """x, v, a (3, T, n) by the script."""
    script = write(model, folder)[0]
    columns = script.read_text("utf-8").split("COLUMNS = ")[1].splitlines()[0]
    with open(folder / "in.csv", "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["time", *ast.literal_eval(columns)])
        table.writerows([k * drive.dt, *row] for k, row in enumerate(drive.u.tolist()))
    done = python(script, str(folder / "in.csv"), str(folder / "out.csv"), str(steps))
    assert done.returncode == 0, done.stderr
    table = np.loadtxt(folder / "out.csv", delimiter=",", skiprows=1)
    return np.stack(np.split(table[:, 1:], 3, axis=1))


@torch.no_grad()
def own(estimator: ElementNetwork, drive: Drive, substeps: int) -> np.ndarray:
    """x, v, a (3, T, n) of the compiled run in finer steps."""
    found = estimator.traced(estimator.composition(), drive, substeps, bound=estimator.bound)
    return torch.stack([found.response.x, found.response.v, found.response.a]).numpy()


def difference(theirs: np.ndarray, ours: np.ndarray) -> float:
    return float(np.linalg.norm(theirs[2] - ours[2]) / np.linalg.norm(ours[2]))


EXACT = ("cubic", "hinge_stiffness", "unit_stiffness")
SMOOTH = (*EXACT, "unit_rising", "unit_falling")


@needs_opensees
@pytest.mark.parametrize(("dofs", "terms"), [(1, ()), (3, SMOOTH), (10, EXACT)])
def test_the_script_tends_to_the_compiled_run(dofs, terms, tmp_path):
    chain = "chain" if dofs > 3 else None
    model = exported(network(dofs, 1, terms, elements=chain))
    drive = drive_of(model.estimator, 300, 2.0 if dofs < 10 else 0.5)
    fine = own(model.estimator, drive, 160)
    errors = [difference(run(model, drive, tmp_path, steps), fine) for steps in (10, 40)]
    assert errors[1] < (1e-3 if terms == SMOOTH else 1e-5)
    if terms != SMOOTH:
        assert errors[1] < 0.1 * errors[0]  # second order
    coarse = own(model.estimator, drive, model.estimator.substeps)
    assert difference(run(model, drive, tmp_path, 10), coarse) < 5e-3


@needs_opensees
def test_a_moving_base_and_moving_supports_drive_the_script(tmp_path):
    base = exported(network(3, 2, EXACT, inputs=1, forced="base", elements="chain"))
    drive = drive_of(base.estimator, 300, 2.0)
    theirs = run(base, drive, tmp_path, 40)
    assert difference(theirs, own(base.estimator, drive, 160)) < 1e-5
    text = (tmp_path / "in.csv").read_text().replace("f1", "s_ddot1")
    (tmp_path / "in.csv").write_text(text)  # f1 = −s̈
    script = tmp_path / "model_opensees.py"
    assert python(script, str(tmp_path / "in.csv"), str(tmp_path / "out.csv"), "40").returncode == 0
    table = np.loadtxt(tmp_path / "out.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(np.split(table[:, 1:], 3, axis=1), -theirs, atol=1e-9)

    moving = exported(network(2, 2, EXACT, inputs=4, forced=[1, 2]))
    drive = drive_of(moving.estimator, 300, 2.0)
    t = DT * torch.arange(300, dtype=torch.float64)
    u = drive.u.clone()
    u[:, 2], u[:, 3] = 0.05 * (1.0 - torch.cos(5.0 * t)), 0.25 * torch.sin(5.0 * t)
    drive = replace(drive, u=u)
    assert difference(run(moving, drive, tmp_path, 40), own(moving.estimator, drive, 160)) < 1e-5


def stress(materials, y: np.ndarray, tmp_path: Path) -> np.ndarray:
    """Forces of materials in parallel, without dampers, under imposed deformations."""
    script = tmp_path / "stress.py"
    script.write_text(
        "import sys, json\nimport openseespy.opensees as ops\n"
        "materials, y = json.load(open(sys.argv[1]))\ntag, joined = 0, []\n"
        "for _, parts in materials:\n"
        "    for kind, *words in parts:\n"
        "        tag += 1\n"
        "        words = [tag + int(w[1:]) if str(w).startswith('@') else w for w in words]\n"
        "        ops.uniaxialMaterial(kind, tag, *words)\n"
        "    joined.append(tag)\n"
        "factors = [factor for factor, _ in materials]\n"
        "ops.uniaxialMaterial('Parallel', tag + 1, *joined, '-factors', *factors)\n"
        "ops.testUniaxialMaterial(tag + 1)\nout = []\n"
        "for one in y:\n    ops.setStrain(one)\n    out.append(ops.getStress())\n"
        "json.dump(out, open(sys.argv[2], 'w'))\n"
    )
    told = [[m.factor, [list(part) for part in m.parts]] for m in materials]
    (tmp_path / "in.json").write_text(json.dumps([told, y.tolist()]))
    done = python(script, str(tmp_path / "in.json"), str(tmp_path / "out.json"))
    assert done.returncode == 0, done.stderr
    return np.array(json.loads((tmp_path / "out.json").read_text()))


def imposed(samples: int = 4000) -> np.ndarray:
    t = np.linspace(0.0, 10.0, samples)
    return 0.05 * np.sin(3.0 * t) * np.sin(0.5 * t + 0.2) + 0.02 * np.sin(11.0 * t)


UNITS = (  # and how near the forces are
    ([20.0, 0.02, 0.0, 0.0], 1e-8),
    ([-20.0, 0.02, 0.0, 0.0], 1e-8),
    ([20.0, 1e3, -10.0, 4.0], 4e-3),  # OpenSees integrates Bouc–Wen to first order
    ([20.0, 0.02, -10.0, 4.0], 4e-3),
    ([-10.0, 0.03, 7.0, 8.0], 4e-3),
)


@pytest.fixture(scope="module")
def laws_and_forces() -> tuple[torch.Tensor, np.ndarray]:
    """Laws with each of the units, one step after another for all, and their forces (T, ·)."""
    rest = torch.tensor([60.0, 0.0, -50.0, 8.0, 0.03, 5.0, 0.0], dtype=torch.float64)
    laws = torch.stack([torch.cat([rest, rest.new_tensor(unit)]) for unit, _ in UNITS])
    y, z = (
        torch.from_numpy(imposed())[:, None].expand(-1, len(laws)),
        [torch.zeros_like(laws[:, :1])],
    )
    for step in torch.diff(y, dim=0):
        z.append(units(laws, (2, 1), z[-1], step))
    return laws, law_of(laws, (2, 1), y, 0.0 * y, torch.stack(z)).numpy()


@needs_opensees
@pytest.mark.parametrize("k", range(len(UNITS)))
def test_the_materials_have_the_forces_of_the_law(k, laws_and_forces, tmp_path):
    laws, forces = laws_and_forces
    theirs = stress(material_of(laws[k], (2, 1), 0.07), imposed(), tmp_path)
    assert np.abs(theirs - forces[:, k]).max() < UNITS[k][1] * np.abs(forces[:, k]).max()


def test_an_element_that_bends_is_refused():
    with pytest.raises(ValueError, match="joins three nodes"):
        script_of(exported(network(2, 1, (), elements="frame")))


# --- named laws

BETWEEN = ("ground", "x1")
MIDDLE = Units(length=0.05, rate=0.3, force=3.0, slope=100.0)


def candidate(name: str) -> list:
    """The elements of a law, its numbers in the middle of where a search begins."""
    law = CANDIDATES[name]
    q = [0.5 * (p.at(np.random.default_rng(0).random()) + p.at(np.random.default_rng(9).random()))
         for p in law.parameters.values()]  # fmt: skip
    return law.elements(np.array(q), MIDDLE, BETWEEN)


@needs_opensees
@pytest.mark.parametrize(
    "name",
    [
        "SelfCentering",
        "SlackBrace",
        "YieldingStop",
        "MenegottoPinto",
        "BoucWen",
        "Pinching4",
        "UnevenPinching4",
        "Hysteretic",
        "UnevenHysteretic",
        "Bilinear",
        "LimitedSlip",
        "NailedWall",
        "PeakOriented",
        "PinchingPeakOriented",
        "Concrete",
        "Chaboche",
    ],
)
def test_named_laws_have_their_stock_materials(name, tmp_path):
    nil = {"damping": 0.0, "post_yield_damping": 0.0, "slip_damping": 0.0, "forward": False}
    elements, y = [replace(e, **{n: nil[n] for n in nil.keys() & vars(e).keys()})
                   for e in candidate(name)], imposed(20000)  # fmt: skip
    theirs = stress([m for e in elements for m in named_materials(e, "one")], y, tmp_path)
    ours = sum(force(e, y, 10.0 / 20000) for e in elements)
    assert np.linalg.norm(theirs - ours) < 2e-3 * np.linalg.norm(ours)


def test_dashpots_are_viscous_materials_beside_a_power_spring():
    """Their forces need rates, which a test of one material in OpenSees does not take."""
    found = {"PowerDamperAndSpring": "Viscous", "MaxwellAndSpring": "ViscousDamper"}
    for name, kind in (found | {"BracedDamper": "ViscousDamper"}).items():
        commands = [m.parts[0] for e in candidate(name) for m in named_materials(e, "one")]
        assert commands[0][0] == kind
        assert commands[-1][0] == "ElasticPowerFunc"


@needs_opensees
def test_a_weight_aloft_is_a_spring_that_pushes_over(tmp_path):
    steel = replace(candidate("MenegottoPinto")[0], damping=0.0)
    over = Polynomial(between=steel.between, stiffness=-0.1 * steel.stiffness)
    y = imposed(20000)
    theirs = stress([m for e in (steel, over) for m in named_materials(e, "one")], y, tmp_path)
    ours = force(steel, y, 10.0 / 20000) + over.stiffness * y
    assert np.linalg.norm(theirs - ours) < 2e-3 * np.linalg.norm(ours)


@pytest.mark.parametrize(
    "name",
    [
        *("Takeda", "FrictionPendulum", "BaberNoori", "TanhDamper", "SofteningNailedWall"),
        "SofteningPeakOriented",
    ],
)
def test_named_laws_that_no_stock_material_is_are_refused(name):
    with pytest.raises(ValueError, match=r"ground–x1.*choose to=c or to=fmu"):
        [named_materials(e, "ground–x1") for e in candidate(name)]


def test_concrete_that_crushes_forward_is_refused():
    with pytest.raises(ValueError, match=r"crushes forward.*choose to=c or to=fmu"):
        named_materials(candidate("Concrete")[0], "one")


def test_a_bearing_of_constant_friction_is_exported_where_its_surface_is_not_curved():
    flat = FrictionPendulum(
        between=("ground", "x1"), weight=1e6, radius=2.0, friction_fast=0.06, friction_slow=0.06,
        rate=0.0, yield_displacement=1e-3, spring_share=1.0,
    )  # fmt: skip
    assert [m.parts[-1][0] for m in named_materials(flat, "ground–x1")] == ["Elastic", "ElasticPP"]
    with pytest.raises(ValueError, match=r"a curved surface \(curvature\) has no stock material"):
        named_materials(replace(flat, curvature=0.5), "ground–x1")


@needs_opensees
def test_a_network_of_named_laws_runs(tmp_path):
    named = ElementNetworkNamed(3, 3, DT, elements="chain")
    named.mass.start(torch.tensor([1.5, 1.2, 1.0], dtype=torch.float64))
    named.mass_damping.fill_(0.5)
    for e, name in enumerate(("SelfCentering", "MenegottoPinto", "SlackBrace")):
        law = CANDIDATES[name]
        rng = np.random.default_rng(e)
        q = law.drawn(rng)
        named.named.take(e, Fit(law, MIDDLE, q))
    model, drive = exported(named), drive_of(named, 300, 2.0)
    response = named.free_run(drive)
    ours = torch.stack([response.x, response.v, response.a]).numpy()
    coarse, fine = (difference(run(model, drive, tmp_path, s), ours) for s in (10, 200))
    assert fine < 5e-3
    assert fine < 0.5 * coarse
