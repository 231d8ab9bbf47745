"""Starts behind an even curve: the direction by least squares, planted moduli recovered."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.signal import lfilter

from data.record import Record
from models import WienerHammerstein
from models.block_structured import filters, lifted
from models.block_structured.chain import Motion

NOISE = 0.01
POLE = 0.85 * np.exp(0.4j)


def planted(u: np.ndarray) -> np.ndarray:
    """A resonance, whose output is read without its sign."""
    return np.abs(lfilter([0.0, 0.2, 0.1], np.poly([POLE, POLE.conjugate()]).real, u))


def record(seed: int, samples: int = 400) -> Record:
    """A voltage that changes now and then, about no mean; the motion has begun before."""
    rng, before = np.random.default_rng(seed), 100
    u = np.repeat(rng.uniform(-1.0, 1.0, (samples + before) // 4), 4)
    y = planted(u) + NOISE * rng.standard_normal(len(u))
    f, a = (torch.from_numpy(s[before:, None].copy()) for s in (u, y))
    return Record(0.02, a, f, warmup=20, initial_state="unknown", hold="zero_order",
                  quantity="output")  # fmt: skip


def test_a_parabola_tells_the_direction_but_for_its_sign():
    rng = np.random.default_rng(0)
    phi, c = rng.standard_normal((4, 500)), np.array([0.5, -1.0, 0.2, 0.0])
    found = lifted.direction(phi, (c @ phi) ** 2 - 0.3 * (c @ phi) + 2.0)
    np.testing.assert_allclose(found * np.sign(found[0]) / np.linalg.norm(found),
                               c / np.linalg.norm(c), atol=1e-6)  # fmt: skip


def test_nothing_to_tell_is_no_direction():
    assert not lifted.direction(np.zeros((2, 50)), np.ones(50)).any()


@pytest.mark.parametrize("poles", [1, 2, 3, 4])
def test_drawn_poles_are_stable_and_in_pairs(poles):
    rng = np.random.default_rng(poles)
    for _ in range(50):
        drawn = lifted.drawn(poles, 300, 2, rng)
        assert len(drawn) == poles
        assert np.abs(drawn).max() < 1.0
        np.testing.assert_allclose(np.sort_complex(drawn), np.sort_complex(drawn.conj()))


def test_the_best_starts_follow_the_motion_though_nothing_linear_does():
    one = record(0)
    u, y = one.f[:, 0].numpy(), one.a[:, 0].numpy()
    motion = Motion(u / u.std(), (y - y.mean()) / y.std(), True, len(y))
    rng = np.random.default_rng(0)
    (best, *_) = lifted.starts([motion], 2, 6, rng, 3)
    assert best.error < 0.3  # of the output, before any training
    poles = filters.poles_of(best.parts["a1"])
    assert np.abs(poles - POLE).min() < 0.1


def test_a_planted_modulus_is_recovered():
    model = WienerHammerstein(1, 1, 0.02, poles=2, finer=1, ramps=4, iterations=60)
    facts = model.identify([record(0), record(1)])
    assert facts["held_back_linear_percent"] > 60.0
    other = record(2)
    error = (model(other) - other.a)[other.warmup :].square().mean().sqrt()
    assert float(error) < 2.0 * NOISE
