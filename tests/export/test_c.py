"""Exported C does what the compiled free run does, at any size, without a warning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from data.record import Drive, Record
from data.simulation.laws.candidate import Units
from export.c import named, remarks_of, step_for
from export.c_source import source_of
from export.fmu import described, words_of
from export.steps import online, online_step_of, step_of
from models.branch_element import BranchElement
from models.named_element import NamedElement
from models.named_laws.candidates import CANDIDATES
from models.named_laws.fit import Fit
from models.online.adaptive import Online
from models.online.laws.normalised_gradient import NormalisedGradient
from models.online.laws.random_walk import RandomWalk
from models.online.laws.recursive_least_squares import RecursiveLeastSquares
from models.vwnn import VWNN
from tests.export import networks
from tests.export.compiling import needs_gcc, run_in_c
from tests.export.conftest import exported, network
from tests.export.every_model import ELEMENTS, MODELS, chain, differences, drive, imposed, recurrent

pytestmark = needs_gcc
CLOSE = 1e-12  # of the largest of each output
ROUNDED = {"power_series_pairs": 1e-11}  # large powers that cancel each other
SAMPLES = 2000
CHECKED = ("-O0", "-g1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")

NETWORKS = {
    "chain_1": lambda: networks.network(1),
    "all_pairs_3": lambda: networks.network(3, "all"),
    "chain_30": lambda: networks.network(30),
    "support_3": lambda: networks.base_network(3),
    "latent_3": lambda: networks.latent(3),
    "branches_3": lambda: networks.branches(3),
}


def forces(model, samples: int = SAMPLES, hold: str = "linear") -> Drive:
    """White noise from rest, so large that every law leaves its first branch."""
    generator = torch.Generator().manual_seed(model.dofs)
    none = torch.zeros(model.dofs, dtype=torch.float64)
    if getattr(model, "supports", 0):
        return Drive(networks.DT, smooth(samples, 0.03), none, none, hold)
    size = 3e3 / model.dofs if hasattr(model, "mass") else 3.0
    u = size * torch.randn(samples, model.inputs, generator=generator, dtype=torch.float64)
    return Drive(networks.DT, u, none, none, hold)


def smooth(samples: int, size: float) -> torch.Tensor:
    """A motion and its rate (T, 2)."""
    t = networks.DT * torch.arange(samples, dtype=torch.float64)
    fast, slow = 5.0 * t, 0.31 * t
    rate = 5.0 * fast.cos() * slow.sin() + 0.31 * fast.sin() * slow.cos()
    return size * torch.stack([fast.sin() * slow.sin(), rate], dim=1)


def apart(model, given: Drive, folder, flags=("-O2",)) -> dict[str, float]:
    return differences(model, given, run_in_c(step_of(model), given, folder, flags))


HELD = ("all_pairs_3", "support_3", "latent_3", "branches_3")  # one of each kind; one is checked
RUNS = [(name, "linear") for name in NETWORKS] + [(name, "zero_order") for name in HELD]


@pytest.mark.parametrize(("name", "hold"), RUNS)
def test_a_network_runs_in_c_and_is_clean_under_sanitizers(name, hold, tmp_path):
    model = NETWORKS[name]()
    flags = CHECKED if hold == "linear" or name == "all_pairs_3" else ("-O2",)
    found = apart(model, forces(model, hold=hold), tmp_path, flags)
    assert all(error <= CLOSE for error in found.values()), found


def test_branch_laws_whose_sides_differ_run_in_c(tmp_path):
    """For as long as such laws, drawn at random, do not make more of rounding."""
    model = networks.branches(3, sides=True)
    found = apart(model, forces(model, samples=400), tmp_path)
    assert all(error <= CLOSE for error in found.values()), found


OTHERS = (
    *("YieldingStop", "Pinching4", "Bilinear", "LimitedSlip", "TanhDamper", "PowerDamperAndSpring"),
    *("NailedWall", "SofteningPinchingPeakOriented", "BracedDamper", "Concrete", "Chaboche"),
)


def test_named_laws_run_in_c_and_are_clean_under_sanitizers(tmp_path):
    """Storeys of a law each: gcc takes a second for the text of all laws."""
    laws = (*networks.LAWS, *OTHERS)
    model = networks.named(len(laws), *laws)
    rest = torch.zeros(len(laws), dtype=torch.float64)
    given = Drive(networks.DT, smooth(1500, 0.05), rest, rest)
    outputs = run_in_c(step_of(model), given, tmp_path, CHECKED)  # of each part a force
    found = differences(model, given, {name: outputs[name] for name in "xva"})
    # the integrator stops at corners where its own tolerance has found them
    assert all(error <= 1e-9 for error in found.values()), found
    assert found["x"] <= CLOSE


ELSEWHERE = ("linear_base", "gru", "vwnn", "power_series_residual")  # others of their classes here


@pytest.mark.parametrize("name", [name for name in MODELS if name not in ELSEWHERE])
def test_every_estimator_runs_in_c_and_is_clean_under_sanitizers(name, tmp_path):
    """One program shows both."""
    model = MODELS[name](3)
    found = apart(model, drive(model.dofs, model.inputs, 500), tmp_path, CHECKED)
    assert all(error <= ROUNDED.get(name, CLOSE) for error in found.values()), found


@pytest.mark.parametrize("name", ELEMENTS)
def test_every_element_runs_in_c(name, tmp_path):
    found = apart(ELEMENTS[name](), imposed(500), tmp_path)
    assert all(error <= CLOSE for error in found.values()), found


def test_a_motion_begins_where_it_is_said_to(tmp_path):
    model = networks.network(3)
    given = replace(
        forces(model, 500), x0=torch.tensor([0.01, -0.02, 0.03]), v0=torch.tensor([0.1, 0.2, 0.3])
    )
    assert all(error <= CLOSE for error in apart(model, given, tmp_path).values())


@pytest.mark.parametrize("times", [0.5, 7.0])
def test_a_network_takes_any_step(times, tmp_path):
    model = networks.network(3)
    given = replace(forces(model, 500), dt=times * networks.DT)
    assert all(error <= CLOSE for error in apart(model, given, tmp_path).values())


@pytest.mark.parametrize("law", ["UnevenHysteretic", "MaxwellAndSpring"])
def test_a_named_element_runs_in_c(law, tmp_path):
    """Compiled fast: the text of all laws is in it."""
    model = NamedElement(1, 2, networks.DT)
    candidate = CANDIDATES[law]
    fit = Fit(candidate, Units(0.05, 0.2, 2e4, 2e6), np.zeros(len(candidate.parameters)))
    fit.q[0] = -1.0
    model.laws.take(0, fit)
    rest = torch.zeros(1, dtype=torch.float64)
    given = Drive(networks.DT, smooth(1000, 0.05), rest, rest)
    assert apart(model, given, tmp_path, ("-O0",))["r"] <= CLOSE


def test_an_element_under_other_inputs_runs_in_c(tmp_path):
    elements = 2
    model = networks.damper(elements)
    s = smooth(800, 0.1)
    others = torch.rand(800, 2, generator=torch.Generator().manual_seed(0)).double() * 1.4 - 0.2
    u = torch.cat([*([s[:, :1]] * elements), *([s[:, 1:]] * elements), others], dim=1)
    rest = torch.zeros(elements, dtype=torch.float64)
    given = Drive(networks.DT, u, rest, rest)
    with torch.inference_mode():
        right = model.free_run(given).a.numpy()
    found = run_in_c(step_of(model), given, tmp_path)["force"]
    assert np.abs(found - right).max() <= CLOSE * np.abs(right).max()


def test_an_element_test_runs_in_c(tmp_path):
    model = networks.element()
    s = smooth(1000, 0.1)
    u = torch.stack([s[:, 0], 0.7 * s[:, 0], s[:, 1], 0.7 * s[:, 1]], dim=1)
    rest = torch.zeros(2, dtype=torch.float64)
    found = apart(model, Drive(networks.DT, u, rest, rest), tmp_path)
    assert found["r"] <= CLOSE


@pytest.mark.parametrize(
    ("name", "hold"), [("network", "zero_order"), ("linear_base", "linear"), ("gru", "linear")]
)
def test_a_shaken_structure_takes_the_ground_and_gives_what_sensors_gave(name, hold, tmp_path):
    """s_ddot1 with its own sign in, absolute accelerations out; the header says so."""
    base = {"inputs": 1, "forced": "base", "elements": "chain"}
    model = {
        "network": lambda: network(3, 2, ("unit_stiffness",), **base),
        "linear_base": lambda: MODELS["linear_base"](3),
        "gru": lambda: recurrent(3, 1, inputs=1),
    }[name]()
    given = drive(model.dofs, 1, hold=hold)
    given = replace(given, x0=0.0 * given.x0, v0=0.0 * given.v0)
    shaken = exported(model, "shaken", hold)
    shaken = replace(shaken, sensors=replace(shaken.sensors, forced="base"), absolute=True)
    step = step_for(shaken)
    assert [one for one, _ in step.inputs] == ["s_ddot1"]
    ground = replace(given, u=-given.u)
    with torch.inference_mode():
        right = (model.free_run(given).a + ground.u).numpy()
    found = run_in_c(step, ground, tmp_path)[step.sensed]
    assert np.abs(found - right).max() < 1e-11 * np.abs(right).max()
    source = source_of(step, "shaken", remarks_of(shaken))
    assert "acceleration of the ground, with the sign of its sensor" in source.header
    assert "[m/s2], absolute" in source.header
    own = words_of(step, source, remarks_of(shaken))
    for version in (2, 3):
        words = described(version, **own)
        assert 'description="acceleration of the ground, with its sensor\'s sign"' in words
        assert words.count('description="acceleration, absolute, as a sensor gives it"') == 3
        assert "s_ddot1 is the acceleration of the ground" in words.partition("CoSimulation")[0]


def test_a_shaken_vwnn_on_line_reads_absolute_accelerations():
    model = MODELS["vwnn_no_squares"](2)
    shaken = exported(model, "shaken")
    shaken = replace(shaken, sensors=replace(shaken.sensors, forced="base"), absolute=True)
    body = source_of(named(online_step_of(model), shaken), "shaken_online").body
    assert "f[0] = -u[0];" in body
    assert "f[2] = u[2] - u[0];" in body
    assert "m->a[1] = m->a_relative[1] + m->u[0];" in body


def test_a_branch_law_of_an_element_says_why_it_stays_and_what_to_take():
    with pytest.raises(ValueError, match=r"whole imposed motion.*model\.laws=units"):
        step_of(BranchElement(1, 2, networks.DT))


# The on-line step in C: estimates one step ahead, and weights that adapt, as in Python


LAWS = {"rls": RecursiveLeastSquares, "gradient": NormalisedGradient, "walk": RandomWalk}


def told(record: Record) -> Drive:
    """Forces and measured accelerations as they come, held: an estimate cannot read the latter."""
    u = torch.cat([record.excitation, record.a], dim=1)
    rest = torch.zeros(record.dofs, dtype=torch.float64)
    return Drive(record.dt, u, rest, rest, "zero_order")


def assert_alike(found: np.ndarray, right: torch.Tensor, share: float) -> None:
    wanted = right.detach().numpy()
    assert np.abs(found - wanted).max() <= share * np.abs(wanted).max()


def test_a_vwnn_estimates_one_step_ahead(tmp_path):
    record = chain(3)
    model = VWNN(3, 3, record.dt)
    model.identify([record])
    with torch.inference_mode():
        right = model(record)
    found = run_in_c(online.step_of(model), told(record), tmp_path)["a"]
    assert_alike(found, right, 1e-11)


@pytest.mark.parametrize("law", LAWS)
def test_weights_adapt(law, tmp_path):
    record = chain(2)
    model = Online(2, 2, record.dt, VWNN(2, 2, record.dt), LAWS[law]())
    model.identify([record.window(0, 150)])
    later = record.window(150, record.samples)
    with torch.inference_mode():
        right = model(later)
    found = run_in_c(step_of(model), told(later), tmp_path)["a"]
    assert_alike(found, right, 1e-9)


def test_an_estimate_never_reads_the_sample_it_estimates(tmp_path):
    record = chain(2)
    model = VWNN(2, 2, record.dt)
    model.identify([record])
    given = told(record)
    other = Drive(given.dt, given.u.clone(), given.x0, given.v0, given.hold)
    other.u[200:, 2:] += 5.0
    step = online.step_of(model)
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    one, two = (
        run_in_c(step, drive, tmp_path / name)["a"]
        for drive, name in ((given, "one"), (other, "two"))
    )
    np.testing.assert_array_equal(one[:201], two[:201])
    assert not np.array_equal(one[201], two[201])
