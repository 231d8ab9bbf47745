"""Tank cascade: derivatives, planted tanks with overflow, units, first levels, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from benchmarks.stand_ins.systems import Tanks as Planted
from benchmarks.stand_ins.systems import filled
from data.record import Record
from models import TankCascade
from models.tanks.fit import Tanks, simulated, size_of

NOISE = 0.02
SMALL = {"draws": 300}


def reading(seed: int, samples: int = 700, begin: tuple[float, float] = (4.0, 5.2)) -> Record:
    """Levels [V] under an inflow that changes now and then; the lower tank runs over."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(1.5, 5.0, samples // 20), 20)
    y = filled(Planted(begin=begin), u, 4.0, steps=50) + NOISE * rng.standard_normal(samples)
    f, a = (torch.from_numpy(s[:, None].copy()) for s in (u, y))
    return Record(4.0, a, f, warmup=50, initial_state="unknown", hold="zero_order",
                  quantity="output")  # fmt: skip


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return [reading(0), reading(1, begin=(6.0, 3.0))]


@pytest.fixture(scope="module")
def identified(records) -> TankCascade:
    model = TankCascade(1, 1, 4.0, **SMALL)
    model.identify(records[:1])
    return model


def rms(model: TankCascade, record: Record) -> float:
    error = (model(record) - record.a)[record.warmup :]
    return float(error.square().mean().sqrt())


def test_derivatives_are_those_of_differences():
    theta = np.array([np.log(0.2), 0.1, 0.1, 0.93, np.log(0.15), -1.1, 0.8, 0.2, -3.0, -2.5,
                      np.log(0.14), -1.0, 0.9, 0.0, -3.0, -2.0])  # fmt: skip
    assert len(theta) == size_of(2)
    rng = np.random.default_rng(0)
    u, begin = np.repeat(rng.uniform(0.3, 1.2, 20), 10), np.array([0.4, 0.5])
    y, levels, jacobian = simulated(Tanks(theta, begin[None]), u, begin, True)
    assert levels[:, 0].max() == pytest.approx(0.8)  # it runs over
    assert y.max() == pytest.approx(0.93)  # the reading ends
    for i in range(jacobian.shape[1]):
        sides = []
        for e in (1e-7, -1e-7):
            both = np.r_[theta, begin]
            both[i] += e
            sides.append(simulated(Tanks(both[:16], begin[None]), u, both[16:])[0])
        np.testing.assert_allclose(jacobian[:, i], (sides[0] - sides[1]) / 2e-7, atol=1e-6)


def test_water_is_neither_lost_nor_made():
    """What flows in is what has flowed out and what both hold; nothing runs over here."""
    theta = Tanks(np.zeros(size_of(2)), np.ones((1, 2))).values
    theta[[2, 3, 6, 12]] = 0.0, 1e3, 1e3, 1e3
    theta[[4, 10]] = np.log([0.05, 1e-9])  # the lower one has hardly an outlet
    theta[[8, 9, 14, 15]] = -30.0
    theta[0] = np.log(0.01)
    u = np.full(200, 2.0)
    _, levels, _ = simulated(Tanks(theta, np.ones((1, 2))), u, np.ones(2))
    total = levels.sum(axis=1)
    np.testing.assert_allclose(np.diff(total), 0.02, rtol=1e-6)


def test_planted_tanks_that_run_over_are_recovered(identified, records):
    assert rms(identified, records[0]) < 1.1 * NOISE
    assert rms(identified, records[1]) < 1.5 * NOISE  # from other levels


def test_first_levels_are_told_by_the_warm_up_samples_alone(identified, records):
    other = records[1].a.clone()
    other[records[1].warmup :] += 1.0
    assert torch.equal(identified(records[1]), identified(replace(records[1], a=other)))
    assert not torch.equal(identified(records[1]), identified(replace(records[1], warmup=0)))


@pytest.mark.parametrize(("u", "y"), [(1e3, 1e-3)])
def test_a_change_of_units_changes_nothing(u, y, identified, records):
    scaled = [replace(r, a=y * r.a, f=u * r.f, dt=1e3 * r.dt) for r in records]
    model = TankCascade(1, 1, 4e3, **SMALL)
    model.identify(scaled[:1])
    difference = model(scaled[1]) / y - identified(records[1])
    assert float(difference.abs().max()) < 0.1 * NOISE


def test_a_batch_is_its_records_one_by_one_and_a_stored_model_the_same(identified, records):
    batch = replace(records[0].map(lambda s: s), a=torch.stack([r.a for r in records]),
                    f=torch.stack([r.f for r in records]))  # fmt: skip
    again = TankCascade(1, 1, 4.0, **SMALL)
    with pytest.raises(ValueError, match="not identified yet"):
        again(records[0])
    again.load_state_dict(identified.state_dict())
    for together, record in zip(identified(batch), records, strict=True):
        assert torch.equal(together, again(record))


@pytest.mark.parametrize("wrong", [{"tanks": 0}, {"draws": 0}, {"prior": -1.0}])
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ValueError, match=r"model\."):
        TankCascade(1, 1, 4.0, **wrong)


def test_many_channels_and_few_samples_are_refused(records):
    with pytest.raises(ValueError, match="one input and one output"):
        TankCascade(1, 2, 4.0)
    with pytest.raises(ValueError, match="too few for 2 tanks"):
        TankCascade(1, 1, 4.0).identify([records[0].window(0, 30, 10)])
