"""Records that begin at rest, and parts that begin in motion, whatever units and offsets."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from data.measured.assembly import begins_in_motion
from data.record import Record
from tests.models.test_starts import motion, planted


def shaken(base: bool, seed: int) -> Record:
    return motion(planted(base, 0.5), 2000, noise=0.02, seed=seed)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("seed", range(2))
def test_a_record_from_rest_and_a_part_of_it_are_told_apart(seed, size):
    whole = shaken(True, seed)
    whole = replace(whole, a=size * whole.a, f=size * whole.f)
    assert not begins_in_motion(whole, based=True)
    assert all(begins_in_motion(whole.window(k, 1000), based=True) for k in (500, 700, 900))


def test_an_offset_of_the_sensors_is_no_motion():
    whole = shaken(True, 0)
    assert not begins_in_motion(replace(whole, a=whole.a + 9.81), based=True)


def test_slow_motion_from_rest_has_a_mean_in_its_first_part():
    t = 0.01 * torch.arange(1000, dtype=torch.float64)
    slow = (t**2 * torch.exp(-0.3 * t))[:, None]  # rises for seconds
    noise = 0.002 * torch.randn(1000, 1, generator=torch.Generator().manual_seed(0)).double()
    record = Record(0.01, slow + noise, torch.sin(t)[:, None])
    assert not begins_in_motion(record, based=False)
    assert not begins_in_motion(replace(record, a=record.a + record.f), based=True)


@pytest.mark.parametrize("seed", range(2))
def test_a_displacement_that_begins_with_a_slope_moves(seed):
    t = 0.01 * torch.arange(1000, dtype=torch.float64)
    noise = 0.005 * torch.randn(1000, generator=torch.Generator().manual_seed(seed)).double()
    u = torch.zeros(1000, 1, dtype=torch.float64)
    for x, moves in ((t**2 * torch.sin(5.0 * t) / 25.0, False), (torch.sin(5.0 * t), True)):
        record = Record(0.01, (3.0 + x + noise)[:, None], u, quantity="displacement")
        assert begins_in_motion(record, based=False) == moves


def test_a_force_that_is_on_from_the_first_sample_tells_nothing():
    assert not begins_in_motion(shaken(False, 0).window(500, 1000), based=False)
