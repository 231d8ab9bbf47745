"""Wiener–Hammerstein system: derivatives, planted systems, units, beginnings, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.signal import lfilter

from data.record import Record
from models import WienerHammerstein
from models.block_structured import curve, filters
from models.block_structured.chain import Motion, chain_of, run
from models.block_structured.split import Allocations, linear

NOISE = 2e-3
SMALL = {"poles": 2, "finer": 1, "ramps": 6, "allocations": 1, "iterations": 40}
POLES = (0.75 * np.exp(0.5j), 0.6 * np.exp(1.1j))  # of the first and of the second filter


def planted(u: np.ndarray, bend: float = 0.5) -> np.ndarray:
    """Filter, saturation on one side, filter; both of the second order."""
    a1, a2 = (np.poly([p, p.conjugate()]).real for p in POLES)
    x = lfilter([0.15, 0.1], a1, u)
    return lfilter([0.5, 0.2, 0.1], a2, x - bend * np.logaddexp(0.0, 4.0 * (x - 0.2)) / 4.0)


def cut_out(samples: int, seed: int, noise: float = NOISE) -> Record:
    """A record of noise through the planted system, which begins in motion."""
    rng, before = np.random.default_rng(seed), 200
    u = rng.standard_normal(samples + before)
    y = planted(u) + 0.3 + noise * rng.standard_normal(len(u))
    f, a = (torch.from_numpy(s[before:, None].copy()) for s in (u, y))
    return Record(1e-3, a, f, warmup=40, initial_state="unknown", quantity="output")


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return [cut_out(4000, 0), cut_out(3000, 1)]


@pytest.fixture(scope="module")
def identified(records) -> WienerHammerstein:
    model = WienerHammerstein(1, 1, 1e-3, **SMALL)
    model.identify(records[:1])
    return model


def rms(model: WienerHammerstein, record: Record) -> float:
    error = (model(record) - record.a)[record.warmup :]
    return float(error.square().mean().sqrt())


def test_derivatives_are_those_of_differences():
    rng = np.random.default_rng(0)
    parts = {
        "d1": [0.3], "c1": rng.normal(size=(2, 2)), "a1": [[-1.2, 0.5], [-0.6, 0.0]],
        "beta": [0.8], "laws": [[0.5, -0.4, -0.5], [-0.7, 0.6, -1.0]],
        "d2": [0.7], "c2": rng.normal(size=(1, 2)), "a2": [[-1.0, 0.4]], "o0": [0.2],
    }  # fmt: skip
    chain = chain_of({name: np.array(part, dtype=float) for name, part in parts.items()}, 1)
    layout, u, begin = chain.layout, rng.normal(size=200), rng.normal(size=6)
    _, _, columns = run(layout, chain.values, u, begin, derived=True)
    assert columns.shape == (200, layout.size + layout.states)
    for i, column in enumerate(columns.T):
        sides = []
        for e in (1e-6, -1e-6):
            both = np.r_[chain.values, begin]
            both[i] += e
            sides.append(run(layout, both[: layout.size], u, both[layout.size :])[0])
        np.testing.assert_allclose(column, (sides[0] - sides[1]) / 2e-6, atol=1e-7)


def test_a_run_from_rest_is_that_of_scipys_filters():
    rng = np.random.default_rng(1)
    p = {
        "d1": [0.3], "c1": rng.normal(size=(2, 2)), "a1": [[-1.2, 0.5], [-0.6, 0.0]],
        "beta": [0.8], "laws": [[0.5, -0.4, -0.5]],
        "d2": [0.7], "c2": rng.normal(size=(2, 2)), "a2": [[-1.0, 0.4], [0.3, 0.1]], "o0": [0.2],
    }  # fmt: skip
    p = {name: np.array(part, dtype=float) for name, part in p.items()}
    p["c1"][1, 1] = 0.0
    chain, u = chain_of(p, 1, rate=2), rng.normal(size=201)
    x = filters.driven(0.3, p["a1"], p["c1"], u)
    y = filters.driven(0.7, p["a2"], p["c2"], curve.value(x, 0.8, p["laws"])) + 0.2
    found = run(chain.layout, chain.values, u, np.zeros(8))
    np.testing.assert_allclose(found[0], y[::2], atol=1e-12)
    np.testing.assert_allclose(found[1], x, atol=1e-12)


def test_sections_are_the_filter_of_scipy():
    rng = np.random.default_rng(0)
    poles = np.array([0.9, -0.3, 0.5, 0.4 + 0.5j, 0.4 - 0.5j])
    a = filters.sections_of(poles)
    np.testing.assert_allclose(np.sort_complex(filters.poles_of(a)), np.sort_complex(poles))
    numerator, z = [0.3, 0.2, -0.5, 0.1], np.exp(1j * np.linspace(0.0, np.pi, 50))
    H = np.polyval(numerator[::-1], 1.0 / z) / np.polyval(np.poly(poles)[::-1], 1.0 / z)
    d, c = filters.fitted_to(H, a, z, np.ones(50))
    u = rng.standard_normal(300)
    np.testing.assert_allclose(
        filters.driven(d, a, c, u), lfilter(numerator, np.poly(poles), u), atol=1e-10
    )
    zeros = np.roots(numerator)
    np.testing.assert_allclose(np.sort(filters.zeros_of(d, a, c)), np.sort(zeros), atol=1e-8)


def test_the_best_linear_approximation_has_the_poles_of_both_filters():
    u = np.random.default_rng(0).standard_normal(4000)
    y = planted(u, bend=0.1)
    motion = Motion(u / u.std(), (y - y.mean()) / y.std(), True, len(y))
    approximation = linear([motion], 4)
    found = filters.poles_of(approximation.parts["a1"])
    found = found[found.imag > 0.0]
    for pole in POLES:
        assert np.abs(found - pole).min() < 0.1
    ways = Allocations(approximation, motion)
    (best, *_) = ways.best(np.random.default_rng(0), 2)
    first = np.roots(ways.filters(best)[0][1])
    assert len(first) == 2
    assert np.abs(first - POLES[0]).min() < 0.1


def test_a_planted_system_that_begins_in_motion_is_recovered(identified, records):
    assert rms(identified, records[0]) < 1.05 * NOISE
    assert rms(identified, records[1]) < 1.2 * NOISE
    record = records[1]
    linear_part = np.corrcoef(identified(record)[:, 0].numpy(), record.a[:, 0].numpy())[0, 1]
    assert linear_part > 0.9999


def test_the_first_state_is_told_by_the_warm_up_samples_alone(identified, records):
    record = records[1]
    other = record.a.clone()
    other[record.warmup :] += 1.0
    assert torch.equal(identified(record), identified(replace(record, a=other)))
    at_rest = identified(replace(record, initial_state="rest"))
    early = slice(5, record.warmup)
    known = (identified(record) - record.a)[early].abs().max()
    assert known < 0.1 * (at_rest - record.a)[:5].abs().max()


@pytest.mark.parametrize(("u", "y"), [(1e3, 1e-3)])
def test_a_change_of_units_changes_nothing(u, y, identified, records):
    scaled = [replace(r, a=y * r.a, f=u * r.f, dt=1e3 * r.dt) for r in records]
    model = WienerHammerstein(1, 1, 1.0, **SMALL)
    model.identify(scaled[:1])
    difference = model(scaled[1]) / y - identified(records[1])
    assert float(difference.abs().max()) < 1e-4 * float(records[1].a.abs().max())


def test_a_batch_is_its_records_one_by_one_and_a_stored_model_the_same(identified, records):
    parts = [record.window(0, 500, 40) for record in records]
    batch = replace(parts[0].map(lambda s: s), a=torch.stack([p.a for p in parts]),
                    f=torch.stack([p.f for p in parts]))  # fmt: skip
    again = WienerHammerstein(1, 1, 1e-3, **SMALL)
    with pytest.raises(ValueError, match="not identified yet"):
        again(parts[0])
    again.load_state_dict(identified.state_dict())
    for together, part in zip(identified(batch), parts, strict=True):
        assert torch.equal(together, again(part))


@pytest.mark.parametrize(
    "wrong", [{"poles": 0}, {"finer": 3}, {"ramps": 0}, {"allocations": -1}, {"held_back": 0.9}]
)
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ValueError, match=r"model\."):
        WienerHammerstein(1, 1, 1e-3, **wrong)


def test_many_channels_and_few_samples_are_refused(records):
    with pytest.raises(ValueError, match="one input and one output"):
        WienerHammerstein(2, 1, 1e-3)
    with pytest.raises(ValueError, match="too few for 16 ramps"):
        WienerHammerstein(1, 1, 1e-3).identify([records[0].window(0, 100, 40)])
