"""Noise of measured states: how strong it is, how little is left, and laws that are found in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from data.record import Record
from models.composition.states import (
    NOISY,
    are_of_one_motion,
    noise_of_deformations,
    smooth,
    white_noise,
)
from models.element_network_named import ElementNetworkNamed
from tests.models.test_named_laws import DT, error, shaken, two_storeys

STEP, SAMPLES = 0.01, 3000


def moved(seed: int, per: float = 1.0) -> Record:
    """Two channels of sines from any state; per: of the unit of length."""
    rng, t = np.random.default_rng(seed), STEP * np.arange(SAMPLES)
    w, phase = rng.uniform(1.0, 20.0, (2, 8)), rng.uniform(0.0, 6.0, (2, 8))
    angles = t[:, None, None] * w + phase
    x = (np.sin(angles) / w).sum(axis=2)
    v, a = np.cos(angles).sum(axis=2), -(w * np.sin(angles)).sum(axis=2)
    x, v, a = (torch.from_numpy(per * u) for u in (x, v, a))
    return Record(STEP, a, a.new_zeros(SAMPLES, 0), x, v)


def noisy(record: Record, level: float, seed: int) -> Record:
    """White noise on x, v and a, of a share of each channel's standard deviation."""
    draw = torch.Generator().manual_seed(seed)

    def more(u: torch.Tensor) -> torch.Tensor:
        random = torch.randn(u.shape, generator=draw, dtype=u.dtype)
        return u + level * u.std(dim=-2, keepdim=True) * random

    return replace(record, **{name: more(getattr(record, name)) for name in ("x", "v", "a")})


def told(record: Record) -> float:
    """Noise of each x by itself."""
    x, v, a = (u.numpy() for u in (record.x, record.v, record.a))
    return noise_of_deformations(x, v, a, record.dt, np.eye(2), x)


def off(record: Record, truth: Record, name: str) -> float:
    one, other = (getattr(r, name) for r in (record, truth))
    return float((one - other).norm() / other.norm())


@pytest.mark.parametrize("level", [0.01, 0.1])
def test_noise_is_told_and_most_of_it_is_gone(level):
    truth = moved(0)
    measured = noisy(truth, level, 1)
    assert told(measured) == pytest.approx(level, rel=0.1)
    better = smooth(measured)
    for name in ("x", "v"):
        assert off(better, truth, name) < 0.35 * off(measured, truth, name)
    assert torch.equal(better.a, measured.a)


@pytest.mark.parametrize(("level", "per"), [(0.0, 1e3), (0.02, 1.0), (0.1, 1e-3)])
def test_displacements_and_accelerations_tell_velocities(level, per):
    truth = moved(3, per)
    heard = replace(noisy(truth, level, 4), v=None)
    found = smooth(heard)
    assert are_of_one_motion(heard, found)
    for name in ("x", "v"):
        assert off(found, truth, name) < max(0.3 * level, 2e-3)
    wrong = replace(heard, x=(1.0 + max(5.0 * level, 0.05)) * heard.x)
    assert not are_of_one_motion(wrong, smooth(wrong))


def test_a_motion_without_noise_is_not_called_noisy():
    truth = moved(2)
    assert told(truth) < 0.1 * NOISY
    assert told(replace(truth, x=truth.x.round(decimals=4))) < NOISY  # the sensor's digits
    few = replace(truth.map(lambda u: u[::10]), dt=10 * STEP)  # three samples a cycle and more
    assert told(few) < NOISY
    assert not white_noise(few.x.numpy()).any()


def test_laws_of_a_chain_are_found_in_states_with_noise():
    """Without masses; in the states as they are, tenths of noise are yielding that never was."""
    structure = two_storeys(3e4, 3e4)
    records = [noisy(shaken(structure, i, size), 0.1, i) for i, size in enumerate((0.3, 0.22))]
    model = ElementNetworkNamed(
        2, 2, DT, "chain", None, [], laws=["MenegottoPinto", "SelfCentering"]
    )
    facts = model.identify(records)
    assert facts["laws"] == "MenegottoPinto, SelfCentering"
    assert str(facts["states"]).startswith("smoothed; noise of x is")
    assert error(model, [shaken(structure, 7, 0.3)]) < 2.0


@pytest.mark.parametrize(
    ("scale", "lag", "agrees"), [(1.0, 0, True), (1.1, 0, False), (1.0, 5, False)]
)
def test_a_displacement_that_is_wrongly_scaled_or_lags_is_told(scale, lag, agrees):
    measured = noisy(moved(0), 0.02, 1)
    wrong = replace(measured, x=scale * measured.x.roll(lag, dims=0))
    assert are_of_one_motion(wrong, smooth(wrong)) is agrees
