"""Sliding mass: exact motions, derivatives, planted friction, units, beginnings, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from benchmarks.stand_ins.drives import Positioner, moves, positioned
from data.record import Drive, Record
from models import SlidingMass
from models.sliding.fit import first_state
from models.sliding.problem import Mass, Motion, simulated

NOISE = 1e-4
SMALL = {"knots": 12, "prior": 1e-6, "iterations": 60}
KNOTS = np.array([0.02, 0.1, 0.4, 1.0])
FRICTION = [-0.1, -0.05, 0.2, 0.6, -0.05, 0.0, 0.3, 0.5]


def mass(beta=1.3, offset=0.1, jump=0.35, friction=FRICTION, knots=KNOTS) -> Mass:
    values = np.r_[beta, offset, np.log(jump), friction]
    return Mass(np.asarray(knots, dtype=float), values, np.zeros((1, 2)))


def ran(one: Mass, u: np.ndarray, h: float, begin=(0.0, 0.0)) -> tuple[np.ndarray, np.ndarray]:
    return simulated(one, np.asarray(u, dtype=float)[:, None], h, np.array(begin))[:2]


def record(seed: int, samples: int = 8000, **law) -> Record:
    """A positioner under its controller, from rest."""
    rng = np.random.default_rng(seed)
    pushes = np.repeat(rng.uniform(-0.3, 0.3, samples // 50), 50) * (rng.random(samples) < 0.9)
    u, q = positioned(Positioner(**law), moves(samples, 1e-3, rng), pushes, 1e-3)
    y = q + NOISE * rng.standard_normal(samples)
    f, a = (torch.from_numpy(s[:, None].copy()) for s in (u, y))
    return Record(1e-3, a, f, warmup=20, initial_state="unknown", hold="zero_order",
                  quantity="displacement")  # fmt: skip


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return [record(0, 16000), record(1)]


@pytest.fixture(scope="module")
def identified(records) -> SlidingMass:
    model = SlidingMass(1, 1, 1e-3, **SMALL)
    model.identify(records[:1])
    return model


def rms(model: SlidingMass, one: Record) -> float:
    return float((model(one) - one.a)[one.warmup :].square().mean().sqrt())


def test_derivatives_are_those_of_differences():
    rng = np.random.default_rng(0)
    u, begin, one = np.repeat(rng.normal(size=60) * 1.2, 10).reshape(-1, 2), [0.0, 0.3], mass()
    _, v, rows = simulated(one, u, 0.035, np.array(begin), True)
    assert (v == 0.0).any()  # it sticks
    assert v.min() < -1.0 < 1.0 < v.max()  # turns, and passes all knots
    for i in range(rows.shape[1]):
        sides = []
        for e in (1e-7, -1e-7):
            both = np.r_[one.values, begin]
            both[i] += e
            sides.append(simulated(replace(one, values=both[:-2]), u, 0.035, both[-2:])[0])
        np.testing.assert_allclose(rows[:, i], (sides[0] - sides[1]) / 2e-7, atol=3e-6)


def test_without_friction_it_is_a_free_mass():
    u = np.random.default_rng(0).normal(size=200)
    x, v = ran(mass(2.0, 0.0, 1e-30, np.zeros(8)), u, 0.1, (0.5, -1.0))
    speed = -1.0 + np.r_[0.0, np.cumsum(2.0 * 0.1 * u)]
    np.testing.assert_allclose(v, speed, atol=1e-12)
    np.testing.assert_allclose(x[1:], 0.5 + np.cumsum(0.05 * (speed[1:] + speed[:-1])), atol=1e-12)


def test_it_sticks_until_the_input_breaks_it_loose():
    one = mass(1.0, 0.2, 0.5)
    held, _ = ran(one, np.linspace(0.0, 0.699, 100), 1.0)
    assert np.abs(held).max() == 0.0
    loose, _ = ran(one, [0.701, 0.701], 1.0)
    assert loose[-1] > 0.0
    backwards, _ = ran(one, [-0.299, -0.301, -0.301], 1.0)
    assert backwards[1] == 0.0 > backwards[-1]


def test_dry_friction_stops_it_where_its_energy_is_spent():
    x, v = ran(mass(1.0, 0.0, 0.5, np.zeros(8)), np.zeros(50), 0.1, (0.0, 1.5))
    assert x[-1] == pytest.approx(1.5**2 / 2.0 / 0.5, rel=1e-12)
    assert v[-1] == 0.0


def test_viscous_friction_ends_at_the_speed_that_the_input_holds():
    viscous = 0.8 * np.r_[KNOTS, KNOTS]  # straight beyond the last knot
    x, v = ran(mass(1.0, 0.0, 0.5, viscous), np.full(400, 2.5), 0.1)
    assert v[-1] == pytest.approx((2.5 - 0.5) / 0.8, rel=1e-12)
    time = 0.1 * np.arange(401)
    np.testing.assert_allclose(v, 2.5 * (1.0 - np.exp(-0.8 * time)), rtol=1e-10)
    np.testing.assert_allclose(x, 2.5 * (time - (1.0 - np.exp(-0.8 * time)) / 0.8), atol=1e-9)


def test_what_the_input_gives_is_motion_and_heat():
    u, h = np.repeat(np.random.default_rng(1).normal(size=200) * 1.5, 40), 0.005
    one = mass(offset=0.0)
    x, v = ran(one, u, h)
    given = float(np.sum(1.3 * u * np.diff(x)))
    w = np.abs(0.5 * (v[1:] + v[:-1]))
    G = [np.interp(w, np.r_[0.0, KNOTS], np.r_[0.0, FRICTION[i : i + 4]]) for i in (0, 4)]
    assert w.max() < 1.6
    beyond = [(w > 1.0) * (w - 1.0) * (FRICTION[i + 3] - FRICTION[i + 2]) / 0.6 for i in (0, 4)]
    force = 0.35 + np.where(np.diff(x) > 0.0, G[0] + beyond[0], G[1] + beyond[1])
    heat = float(np.sum(force * np.abs(np.diff(x))))
    assert given == pytest.approx(heat + 0.5 * v[-1] ** 2, rel=2e-3)


def test_friction_by_another_formula_is_recovered(identified, records):
    assert rms(identified, records[0]) < 1.2 * NOISE
    assert rms(identified, records[1]) < 2.5 * NOISE  # another motion, a free run of 8 s
    size_u, size_y, _, time = identified.scales.tolist()
    gain = float(identified.theta[0]) * size_y / time**2 / size_u
    assert gain == pytest.approx(35.0 / 95.0, rel=0.02)


def test_a_mass_begins_at_rest_unless_its_samples_say_otherwise():
    rng, one = np.random.default_rng(0), mass()
    u, begins = np.zeros((30, 1)), {}
    for speed in (0.0, 0.6):
        x, _, _ = simulated(one, u, 0.02, np.array([0.4, speed]))
        motion = Motion(u, x + 1e-3 * rng.standard_normal(31), 0.02)
        begins[speed] = first_state(one, motion)
    assert begins[0.0][1] == 0.0
    assert begins[0.6][1] == pytest.approx(0.6, abs=0.02)
    assert begins[0.0][0] == pytest.approx(0.4, abs=1e-3)


def test_the_first_state_is_told_by_the_warm_up_samples_alone(identified, records):
    one = records[1]
    other = one.a.clone()
    other[one.warmup :] += 1.0
    assert torch.equal(identified(one), identified(replace(one, a=other)))


@pytest.mark.parametrize(("u", "y"), [(1e6, 1e-6)])
def test_a_change_of_units_changes_nothing(u, y, identified, records):
    scaled = [replace(r, a=y * r.a, f=u * r.f, dt=1e3 * r.dt) for r in records]
    model = SlidingMass(1, 1, 1.0, **SMALL)
    model.identify(scaled[:1])
    difference = model(scaled[1]) / y - identified(records[1])
    assert float(difference.abs().max()) < 0.5 * NOISE


def test_a_place_far_from_zero_changes_nothing(identified, records):
    moved = [replace(r, a=r.a + 50.0) for r in records]
    model = SlidingMass(1, 1, 1e-3, **SMALL)
    model.identify(moved[:1])
    difference = model(moved[1]) - 50.0 - identified(records[1])
    assert float(difference.abs().max()) < 0.5 * NOISE


def test_a_batch_is_its_records_one_by_one_and_a_stored_model_the_same(identified, records):
    parts = [one.window(0, 500, 20) for one in records]
    batch = replace(parts[0].map(lambda s: s), a=torch.stack([p.a for p in parts]),
                    f=torch.stack([p.f for p in parts]))  # fmt: skip
    again = SlidingMass(1, 1, 1e-3, **SMALL)
    with pytest.raises(ValueError, match="not identified yet"):
        again(parts[0])
    again.load_state_dict(identified.state_dict())
    for together, part in zip(identified(batch), parts, strict=True):
        assert torch.equal(together, again(part))


def test_a_free_run_begins_where_it_is_told(identified):
    drive = Drive(1e-3, torch.zeros(50, 1), torch.tensor([0.1]), torch.tensor([0.05]))
    run = identified.free_run(drive)
    assert float(run.x[0]) == pytest.approx(0.1)
    assert float(run.v[0]) == pytest.approx(0.05)
    assert float(run.v[-1]) < 0.05  # friction slows it down
    assert torch.equal(run.a, run.x)


@pytest.mark.parametrize(
    "wrong", [{"knots": 0}, {"prior": -1.0}, {"iterations": 0}, {"held_back": 0.9}]
)
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ValueError, match=r"model\."):
        SlidingMass(1, 1, 1e-3, **wrong)


def test_what_is_no_motion_of_a_mass_is_refused(records):
    with pytest.raises(ValueError, match="one input and one output"):
        SlidingMass(1, 2, 1e-3)
    model, one = SlidingMass(1, 1, 1e-3), records[0]
    with pytest.raises(ValueError, match="too few for 6 knots"):
        model.identify([one.window(0, 60, 10)])
    with pytest.raises(ValueError, match="the record holds acceleration"):
        model.identify([replace(one, quantity="acceleration")])
    with pytest.raises(ValueError, match="never changes"):
        model.identify([replace(one, a=torch.ones_like(one.a))])
    broken = one.a.clone()
    broken[7] = torch.nan
    with pytest.raises(ValueError, match="finite"):
        model.identify([replace(one, a=broken)])
