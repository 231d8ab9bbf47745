"""Measured records: from files to Records, split without leakage, fitted as what they are."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch

from data import Polynomial, SlackBrace
from data.inspect.proposal import proposal
from data.measured.mend import Mending
from data.record import Record
from data.sample import Sensors
from data.simulation.element_test import force, growing_cycles, write
from data.simulation.laws.element import Element
from data.simulation.motion import simulate
from data.simulation.scenario import FullState, Integrated
from data.simulation.structure import Structure
from models.element_network import ElementNetwork
from models.fit.problem import FreeRunProblem
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from models.hysteretic_element import HystereticElement
from models.restoring_force_surface import RestoringForceSurface
from tests.data.odd_files import table
from tests.experiments import measured

DT = 0.01
TEN_LINES = """time,f1,a1
0.00,0.0,0.0
0.01,0.5,0.4
0.02,0.9,0.7
0.03,1.0,0.6
0.04,0.8,0.3
0.05,0.4,-0.1
0.06,-0.1,-0.5
0.07,-0.5,-0.8
0.08,-0.8,-0.9
"""


def oscillator(element: Element, force=None, support=None, support_rate=None, mass: float = 2.0):
    """Motion of one mass, sampled every DT."""
    samples = len(force if force is not None else support)
    force = np.zeros((samples, 1)) if force is None else force
    return simulate(Structure([mass], {"r": element}), force, DT, support, support_rate)


def write_csv(path, **columns) -> None:
    table(path, columns, "%.17g")


@pytest.fixture
def ten_lines(tmp_path):
    path = tmp_path / "hand.csv"
    path.write_text(TEN_LINES)
    return path


# From files to records


def test_a_file_with_our_names_needs_no_more(ten_lines):
    data = measured(ten_lines)
    (train,), (test,) = data.records["train"], data.records["test"]
    assert (data.dofs, data.inputs, data.forced) == (1, 1, [1])
    assert data.dt == pytest.approx(DT, rel=1e-12)
    assert torch.cat([train.a, test.a])[:, 0].tolist() == pytest.approx(
        [0.0, 0.4, 0.7, 0.6, 0.3, -0.1, -0.5, -0.8, -0.9]
    )
    assert (train.initial_state, test.initial_state) == ("rest", "unknown")


def test_channels_and_units_are_named(tmp_path):
    write_csv(tmp_path / "r.csv", t=10.0 * np.arange(8), P=np.arange(8.0), acc=np.ones(8) / 8)
    data = measured(
        tmp_path / "r.csv", channels={"time": "t", "f2": "P", "a1": "acc"},
        units={"time": "ms", "f": "kN", "a1": "g"},
    )  # fmt: skip
    record = data.records["train"][0]
    assert record.dt == pytest.approx(0.01)
    assert record.f[:, 0].tolist() == [0.0, 1000.0, 2000.0, 3000.0]
    assert record.a[0, 0] == pytest.approx(9.80665 / 8)
    assert data.forced == [2]
    sensors = Sensors(0.01, 1, 1, [2], "acceleration", ("f2", "a1"), {"f2": "N", "a1": "m/s^2"})
    assert replace(data.sensors, dt=0.01) == sensors
    assert Sensors(**json.loads(json.dumps(asdict(data.sensors)))) == data.sensors


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"channels": {"a1": "Acc"}}, "no column 'Acc'"),
        ({"channels": {"q1": "a1"}}, "no such channel"),
        ({"channels": {"time": "time", "a1": "a1"}}, "nothing that drives"),
        ({"channels": {"time": "time", "f1": "f1"}}, "nothing to estimate"),
        ({"channels": {"time": "time", "s_ddot2": "f1", "a1": "a1"}}, "without a gap"),
        ({"channels": {"f1": "f1", "a1": "a1"}}, r"data\.dt"),
        ({"units": {"a9": "g"}}, "fits no signal"),
        ({"units": {"a": "kN"}}, "kN"),
        ({"quantity": "weight"}, "choose acceleration"),
        ({"quantity": "displacement"}, "nothing to estimate"),
        ({"split": 1.0}, "between 0 and 1"),
        ({"start": 5.0}, "samples"),
        ({"test": "other"}, "no record is called other"),
        ({"train": "hand", "test": "hand"}, "both"),
        ({"test": "hand"}, "one of them"),
    ],
)
def test_what_cannot_be_is_named(ten_lines, choices, message):
    with pytest.raises(ValueError, match=message):
        measured(ten_lines, **choices)


def test_channels_of_some_floors_keep_their_numbers(tmp_path):
    """x and v beside accelerations are read where they are of the same floors."""
    u = np.random.default_rng(0).standard_normal((8, 9))
    names = ("f5", "a2", "a5", "x2", "x5", "v2", "v5")
    write_csv(tmp_path / "r.csv", time=DT * np.arange(9), **dict(zip(names, u, strict=False)))
    data = measured(tmp_path / "r.csv")
    record = data.records["train"][0]
    assert (data.numbers, data.forced, record.numbers) == ([2, 5], [5], (2, 5))
    assert np.array_equal(record.a.numpy(), u[1:3, :4].T)
    assert np.array_equal(record.x.numpy(), u[3:5, :4].T)
    read = {c: c for c in ("time", "f5", "a2", "a5")}
    assert measured(tmp_path / "r.csv", channels=read).numbers == [2, 5]
    other = measured(tmp_path / "r.csv", channels=read | {"x1": "x2", "x2": "x5"})
    assert other.records["train"][0].x is None
    displaced = {"time": "time", "f5": "f5", "x2": "x2", "x5": "x5"}
    assert measured(tmp_path / "r.csv", channels=displaced).sensors.numbers == [2, 5]
    header, rows = (tmp_path / "r.csv").read_text().split("\n", 1)
    (tmp_path / "s.csv").write_text(header.replace("a5", "a6") + "\n" + rows)
    with pytest.raises(ValueError, match="differ in their channels"):
        measured(tmp_path)


def test_a_test_record_of_another_quantity_is_refused(tmp_path):
    """A model of accelerations would be scored against displacements."""
    (tmp_path / "one.csv").write_text(TEN_LINES)
    (tmp_path / "two.csv").write_text(TEN_LINES.replace("a1", "x1").replace("0.5", "0.6"))
    with pytest.raises(ValueError, match="the test records of measured differ in their channels"):
        measured(tmp_path, train="one", test="two")


def test_of_several_records_the_last_is_tested_on_unless_others_are_named(tmp_path):
    for number, name in enumerate(("one", "two", "three"), start=1):
        (tmp_path / f"{name}.csv").write_text(TEN_LINES.replace("0.5", f"0.{number}"))
    data = measured(tmp_path / "*.csv")
    assert [data.names[s] for s in ("train", "test")] == [["one", "three"], ["two"]]
    assert "tested on two of 3 records" in data.notes
    data = measured(tmp_path, test=["t*"])
    assert [len(data.records[s]) for s in ("train", "test")] == [1, 2]
    assert data.records["train"][0].samples == 9


# No leakage


@pytest.mark.parametrize("mend", [Mending(), Mending(detrend="linear", low_pass=20.0)])
@pytest.mark.parametrize("scenario", [FullState(), Integrated(causal=False)])
def test_training_motions_never_see_the_rest_of_their_record(tmp_path, mend, scenario):
    rng = np.random.default_rng(0)
    t, f, a = DT * np.arange(200), rng.standard_normal(200), rng.standard_normal(200)
    write_csv(tmp_path / "one.csv", time=t, f1=f, a1=a)
    a[100:] += 50.0
    write_csv(tmp_path / "other.csv", time=t, f1=f, a1=a)
    one, other = (
        measured(tmp_path / name, mend=mend, scenario=scenario).records
        for name in ("one.csv", "other.csv")
    )
    for name, signal in one["train"][0].signals().items():
        assert torch.equal(signal, getattr(other["train"][0], name))
    assert not torch.equal(one["test"][0].a, other["test"][0].a)


def test_an_estimated_displacement_is_not_among_what_models_read(tmp_path):
    t = DT * np.arange(40)
    write_csv(tmp_path / "r.csv", time=t, f1=np.sin(t), x1=np.cos(t), v1=-np.sin(t))
    record = measured(tmp_path / "r.csv").records["train"][0]
    assert record.quantity == "displacement"
    assert record.x is None
    assert record.v is None
    with pytest.raises(ValueError, match="integrates accelerations"):
        measured(tmp_path / "r.csv", scenario=Integrated())


# Physics


def trained(model, records, iterations: int = 60):
    """Whole-record free runs by Levenberg–Marquardt, as the objective does."""
    model.identify(records)
    solver = LevenbergMarquardt(
        [p for p in model.parameters() if p.requires_grad], iterations, scaled=True, damping=1e-4
    )
    while not solver.finished:
        solver.solve(FreeRunProblem(model, records[0], None))
    return model


def test_a_base_excited_frame_is_found_from_accelerations_alone(tmp_path):
    """Absolute accelerations and that of the ground: ω² = k/m and c/m, the mass being unknown."""
    t = DT * np.arange(3000)
    rate = 0.02 * (np.sin(7.0 * t) + np.sin(15.0 * t) + np.sin(29.0 * t) * np.sin(0.3 * t))
    support = DT * np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))])
    element = Polynomial(between=("s1", "x1"), stiffness=400.0, damping=1.2, cubic_stiffness=0.0)
    motion = oscillator(element, None, support[:, None], rate[:, None])
    ground = np.gradient(rate, DT)
    write_csv(tmp_path / "r.csv", time=t, s_ddot1=ground, a1=motion.a[:, 0])
    data = measured(tmp_path / "r.csv")
    (record,) = data.records["train"]
    model = ElementNetwork(
        1, 1, DT, forced=data.forced, hinges=0, units=0, cubic=False, from_accelerations=True
    )
    trained(model, [record])
    of_mass = (model.laws.stiffness, model.laws.damping)
    stiffness, damping = (float((c()[0] / model.mass()[0]).detach()) for c in of_mass)
    assert stiffness == pytest.approx(200.0, rel=0.01)
    assert damping == pytest.approx(0.6, rel=0.05)


def test_a_periodic_record_is_trained_on_in_its_steady_state():
    """Begun at rest, an oscillator misses its own steady state; a period later it does not."""
    samples = 400
    f = torch.sin(2.0 * torch.pi * 5.0 * torch.arange(samples).double() / samples)[:, None]
    planted = ElementNetwork(1, 1, DT, hinges=0, units=0, cubic=False)
    planted.mass.start(torch.tensor([2.0]))
    planted.laws.start(torch.tensor([900.0]), torch.tensor([9.0]), torch.tensor([0.01]), (0.5, 0.5))
    planted.identified.fill_(1.0)
    with torch.no_grad():
        twice = Record(DT, torch.zeros(3 * samples, 1), torch.cat([f, f, f]).double()).drive()
        steady = planted.free_run(twice).x[-samples:]
    record = Record(DT, steady, f, initial_state="periodic", quantity="displacement")
    planted.measures.fill_(0)
    with torch.no_grad():
        settled = float(FreeRunProblem(planted, record, None).loss())
        at_rest = float(FreeRunProblem(planted, replace(record, initial_state="rest"), None).loss())
    assert settled < 1e-4 * at_rest


@pytest.fixture
def loop(tmp_path):
    """An element test on a bilinear damper: slow sines of growing amplitude."""
    t = DT * np.arange(1200)
    s = (0.01 + 0.003 * t) * np.sin(2.0 * np.pi * 0.4 * t)
    rate = np.gradient(s, DT)
    k1, k2, yielding, z, r = 9000.0, 2500.0, 0.012, 0.0, []
    for before, now in zip(np.concatenate([[0.0], s[:-1]]), s, strict=True):
        z = float(np.clip(z + now - before, -yielding, yielding))
        r.append(k2 * now + (k1 - k2) * z)
    write_csv(tmp_path / "loop.csv", time=t, s1=s, s_dot1=rate, r1=np.array(r))
    return tmp_path / "loop.csv"


def test_an_element_test_is_identified_and_a_surface_without_memory_is_not(loop):
    data = measured(loop)
    train = data.records["test"][0].window(0, 600, warmup=60)  # the test is the whole file
    assert (train.quantity, data.inputs, data.dofs, data.forced) == ("force", 2, 1, [])
    surface = RestoringForceSurface(1, 2, data.dt, order=3)
    surface.identify([train])
    element = trained(HystereticElement(1, 2, data.dt, hinges=0, units=1, cubic=False), [train], 15)
    with torch.no_grad():
        errors = [(m.free_run(train.drive()).a - train.a).norm() / train.a.norm()
                  for m in (element, surface)]  # fmt: skip
    assert errors[0] < 0.01
    assert errors[1] > 0.05
    assert float(element.laws.unit_limit()[0, 0].detach()) == pytest.approx(0.012, rel=0.02)


def test_the_rest_of_an_element_test_remembers_its_first_part(tmp_path):
    """Slack that grew before the cut: a run from the cut alone knows nothing of it."""
    law = SlackBrace(
        between=("ground", "x1"), stiffness=1e6, yield_displacement=0.01, hardening_ratio=0.02,
        gap=0.001,
    )  # fmt: skip
    y = growing_cycles(0.08, 12, 0.01, 0.5)
    y = np.concatenate([y, y[::-1]])
    write(tmp_path / "brace.csv", law, y, 0.01)
    data = measured(tmp_path / "brace.csv")
    (train,), (test,) = data.records["train"], data.records["test"]
    assert test.samples == len(y)
    assert test.warmup == train.samples == pytest.approx(len(y) // 2, abs=51)  # of a cycle
    assert torch.equal(test.a[: train.samples], train.a)
    assert any("from the start of its file" in str(said) for said in data.notes.values())
    r = torch.from_numpy(force(law, test.s[:, 0].numpy(), 0.01, test.s_dot[:, 0].numpy()))
    late = slice(test.warmup, None)
    assert (r[late] - test.a[late, 0]).norm() < 1e-3 * test.a[late].norm()
    rested = measured(tmp_path / "brace.csv", initial_state="rest").records["test"][0]
    assert rested.samples == len(y)  # at rest it begins, and never in mid-loop


def test_a_model_of_motions_refuses_an_element_test(loop):
    data = measured(loop)
    with pytest.raises(ValueError, match="force"):
        ElementNetwork(1, 2, data.dt, forced=[]).identify(data.records["train"])


def test_a_surface_recovers_its_own_coefficients(loop):
    data = measured(loop)
    (record,) = data.records["train"]
    planted = 3.0 * record.s**3 - 2.0 * record.s_dot + 0.5
    model = RestoringForceSurface(1, 2, data.dt, order=3)
    model.identify([replace(record, a=planted)])
    assert torch.allclose(model(record), planted, rtol=0.0, atol=1e-9)


# The command


@pytest.mark.parametrize(
    ("settings", "warmup"),
    [({"run_in": True}, True), ({"initial_state": "rest"}, True), ({}, False),
     ({"initial_state": "rest", "run_in": False}, False)],
)  # fmt: skip
def test_what_yielded_before_the_cut_is_no_part_of_measured_states(tmp_path, settings, warmup):
    path, t = tmp_path / "states.csv", 0.01 * np.arange(60)
    signals = {name: np.sin((3.0 + i) * t) for i, name in enumerate(("f1", "a1", "x1", "v1"))}
    write_csv(path, time=t, **signals)
    (train,), (test,) = (measured(path, **settings).records[s] for s in ("train", "test"))
    assert test.warmup == (train.samples if warmup else 0)
    assert test.samples == (60 if warmup else 60 - train.samples)


@pytest.mark.parametrize(
    ("name", "told"),
    [("same", True), ("in_kN_and_g", True), ("shorter", True), ("other_units", True),
     ("late", True), ("padded", True), ("half", False), ("larger", False)],
)  # fmt: skip
def test_a_copy_of_a_training_record_is_told_and_left_out_where_nobody_chose(tmp_path, name, told):
    t = 0.01 * np.arange(200)
    u = np.sin(9 * t) * t * (2.0 - t)
    whole = {"time": t, "f1": u, "a1": 0.5 * u}
    table(tmp_path / "an.csv", {"time": t, "f1": u**3, "a1": u**2})
    table(tmp_path / "first.csv", whole)
    of_name = {
        "same": whole,
        "in_kN_and_g": {"time": t, "f1 [kN]": 1e-3 * u, "a1 [g]": 0.5 * u / 9.80665},
        "shorter": {c: x[:150] for c, x in whole.items()},
        "other_units": {"time": t, "f1": 1e3 * u, "a1": 0.5 * u / 9.80665 + 0.01},
        "late": {"time": t[:170], "f1": u[30:], "a1": 0.5 * u[30:]},
        "padded": {"time": t, **{c: np.append(np.zeros(30), whole[c][:170]) for c in ("f1", "a1")}},
        "half": {"time": t[:90], "f1": u[:90], "a1": 0.5 * u[60:150]},
        "larger": {"time": t, "f1": 2.0 * u, "a1": u},
    }
    table(tmp_path / f"{name}.csv", of_name[name])
    data = measured(tmp_path, test=name)
    assert (f"doubtful: {name} has the samples of first" in data.notes) == told
    data = measured(tmp_path)
    assert data.notes.get(f"left out {name}") == (["it has the samples of first"] if told else None)
    assert name not in data.names["train"] + data.names["test"] or not told
    found = proposal([str(tmp_path)], {}, {})
    copied = [r.path.stem for r in found.records if "copy" in [f.what for f in r.findings]]
    assert copied == [name] * told
