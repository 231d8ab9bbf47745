"""What the sensors saw: noise, integrated motion, and what must stay as it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from data.record import Record
from data.simulation.scenario import Composed, Integrated, Noisy


def measured(scenario, record, seed=0):
    return scenario(record, np.random.default_rng(seed))


def same(one: Record, other: Record, name: str) -> bool:
    return torch.equal(getattr(one, name), getattr(other, name))


def accelerogram(a: torch.Tensor) -> Record:
    """A record of which only the acceleration is known."""
    return Record(0.01, a, torch.zeros_like(a))


@pytest.mark.parametrize("level", [0.1, 0.5])
def test_noise_is_that_fraction_of_each_channel(bilinear_record, level):
    noisy = measured(Noisy(level), bilinear_record)
    for name in ("x", "v", "a"):
        clean = getattr(bilinear_record, name)
        noise = getattr(noisy, name) - clean
        assert torch.allclose(noise.std(dim=0) / clean.std(dim=0), torch.tensor(level).double(),
                              rtol=0.1)  # fmt: skip
        assert (noise.mean(dim=0).abs() < 0.15 * noise.std(dim=0)).all()


def test_noise_is_white_and_independent_between_channels(bilinear_record):
    noisy = measured(Noisy(), bilinear_record)
    noise = torch.cat([getattr(noisy, n) - getattr(bilinear_record, n) for n in "xva"], dim=1).T
    across = torch.corrcoef(noise)[~torch.eye(9, dtype=torch.bool)]
    assert across.abs().max() < 0.15
    along = [torch.corrcoef(torch.stack([u[1:], u[:-1]]))[0, 1].abs() for u in noise]
    assert max(along) < 0.15


def test_the_force_stays_clean_unless_asked_for(bilinear_record):
    assert same(measured(Noisy(), bilinear_record), bilinear_record, "f")
    only_force = measured(Noisy(0.1, ("f",)), bilinear_record)
    assert not same(only_force, bilinear_record, "f")
    assert all(same(only_force, bilinear_record, name) for name in ("a", "x", "v"))
    twice = measured(Composed([Noisy(0.1, ("f",)), Noisy(0.1, ("f",))]), bilinear_record)
    assert same(twice.truly_driven(), bilinear_record, "f")


@pytest.mark.parametrize(
    ("scenario", "changed"), [(Noisy(), ("x", "v", "a")), (Integrated(), ("x", "v"))]
)
def test_the_truth_stays_and_the_measurement_differs_from_it(bilinear_record, scenario, changed):
    true = {name: getattr(bilinear_record.truth, name).clone() for name in "xvayr"}
    record = measured(scenario, bilinear_record)
    assert all(torch.equal(getattr(record.truth, name), u) for name, u in true.items())
    assert all(same(bilinear_record, bilinear_record.truth, name) for name in "xva")
    assert not any(same(record, record.truth, name) for name in changed)


def test_noise_comes_from_the_generator_alone(bilinear_record):
    one, again, other = (measured(Noisy(), bilinear_record, seed) for seed in (0, 0, 1))
    assert same(one, again, "a")
    assert not same(one, other, "a")


def perturbed(record: Record, k: int) -> Record:
    a = record.a.clone()
    a[k] += 1.0
    return replace(record, a=a)


@pytest.mark.parametrize("k", [0, 1, 500])
def test_causal_integration_at_k_does_not_see_the_acceleration_at_k(bilinear_record, k):
    before = measured(Integrated(), bilinear_record)
    after = measured(Integrated(), perturbed(bilinear_record, k))
    for name in ("x", "v"):
        one, other = getattr(before, name), getattr(after, name)
        assert torch.equal(one[: k + 1], other[: k + 1])
        assert not torch.isclose(one[k + 1], other[k + 1], rtol=0, atol=1e-6).any()


def test_acausal_integration_at_k_sees_what_is_and_what_follows(bilinear_record):
    before = measured(Integrated(causal=False), bilinear_record)
    after = measured(Integrated(causal=False), perturbed(bilinear_record, 500))
    assert ((before.v - after.v).abs()[490:500] > 1e-3).all()
    assert ((before.x - after.x).abs()[500] > 1e-4).all()


def sinusoid(hertz: float, samples: int = 6000):
    t = 0.01 * torch.arange(samples).double()[:, None]
    return t, 2.0 * np.pi * hertz, accelerogram(torch.sin(2.0 * np.pi * hertz * t))


@pytest.mark.parametrize("hertz", [0.1, 0.5, 1.5])
def test_causal_integration_of_a_sinusoid_has_the_gain_of_two_and_four_filters(hertz):
    t, omega, record = sinusoid(hertz, 12000)
    integrated = measured(Integrated(cutoff=0.05, order=2), record)
    s, corner = 1j * omega, 2.0 * np.pi * 0.05
    high_pass = s**2 / (s**2 + np.sqrt(2.0) * corner * s + corner**2)
    rotating, late = torch.exp(s * t), slice(11000, 12000)
    for ours, gain in ((integrated.v, high_pass**2 / s), (integrated.x, high_pass**4 / s**2)):
        assert torch.allclose(ours[late], (gain * rotating).imag[late], atol=0.01 * abs(gain))


def test_acausal_integration_of_a_sinusoid_keeps_its_phase():
    t, omega, record = sinusoid(1.5)
    integrated = measured(Integrated(cutoff=0.05, causal=False), record)
    middle = slice(2500, 3500)
    assert torch.allclose(integrated.v[middle], -torch.cos(omega * t)[middle] / omega, atol=2e-3)
    assert torch.allclose(integrated.x[middle], -torch.sin(omega * t)[middle] / omega**2, atol=2e-3)


def test_an_accelerometer_with_an_offset_does_not_drift_away():
    record = measured(Integrated(cutoff=0.05), accelerogram(torch.full((20000, 1), 0.1).double()))
    assert record.x.abs().max() < 5.0  # 2 km without high-pass filters
    assert record.x[-1].abs() < 1e-6
    assert record.v[-1].abs() < 1e-6


def test_integration_of_noisy_accelerations_differs_from_noise_on_integrated_motion(
    bilinear_record,
):
    noisy_first = measured(Composed([Noisy(), Integrated()]), bilinear_record)
    assert same(noisy_first, measured(Noisy(), bilinear_record), "a")
    assert same(noisy_first, measured(Integrated(), noisy_first), "v")
    integrated_first = measured(Composed([Integrated(), Noisy()]), bilinear_record)
    assert same(integrated_first, measured(Noisy(), measured(Integrated(), bilinear_record)), "v")
    assert not same(integrated_first, noisy_first, "v")


@pytest.mark.parametrize(
    ("make", "arguments", "message"),
    [
        (Noisy, {"level": -0.1}, "level=-0.1 must"),
        (Noisy, {"level": np.nan}, "level=nan is not finite"),
        (Noisy, {"level": np.inf}, "level=inf is not finite"),
        (Noisy, {"signals": ("a", "y")}, "signals=.* must be a list of one of x, v"),
        (Integrated, {"cutoff": 50.0}, r"scenario\.cutoff=50\.0 Hz .*Nyquist frequency 50 Hz"),
        (Integrated, {"cutoff": 0.0}, "cutoff=0.0 must be a number above 0"),
        (Integrated, {"order": 0}, "order=0 must be a whole number from 1"),
    ],
)
def test_a_scenario_that_cannot_be_is_refused(bilinear_record, make, arguments, message):
    with pytest.raises(ValueError, match=message):
        measured(make(**arguments), bilinear_record)
