"""Low-pass cascade against scipy, its impulse response, and what it must not see."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.signal import lfilter

from models.layers.filters import LowPassCascade

DT = 0.01


def noise(*shape: int) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(0).standard_normal(shape))


@pytest.mark.parametrize(("samples", "cutoff"), [(1, 50.0), (3, 300.0), (1000, 0.5)])
def test_the_cascade_equals_scipy(samples, cutoff):
    u, decay = noise(samples, 3), math.exp(-cutoff * DT)
    expected, stage = [], u.numpy()
    for _ in range(3):
        stage = lfilter([0.0, 1.0 - decay], [1.0, -decay], stage, axis=0)
        expected.append(stage)
    ours, _ = LowPassCascade(cutoff, 3, DT)(u)
    assert np.abs(ours.numpy() - np.concatenate(expected, axis=1)).max() < 1e-12


def test_the_impulse_response_is_a_delayed_exponential_and_its_convolution():
    impulse = torch.zeros(200, 1).double()
    impulse[0] = 1.0
    xi, _ = LowPassCascade(50.0, 2, DT)(impulse)
    k, decay = torch.arange(200.0).double(), math.exp(-0.5)
    once = torch.where(k > 0, (1 - decay) * decay ** (k - 1), 0.0)
    twice = torch.where(k > 1, (k - 1) * (1 - decay) ** 2 * decay ** (k - 2), 0.0)
    assert torch.allclose(xi, torch.stack([once, twice], dim=1), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("k", [0, 50])
def test_no_output_at_k_sees_the_input_at_k(k):
    u = noise(100, 2)
    other = u.clone()
    other[k] += 1.0
    cascade = LowPassCascade(50.0, 2, DT)
    one, two = cascade(u)[0], cascade(other)[0]
    assert torch.equal(one[: k + 1], two[: k + 1])
    assert (one[k + 1, :2] != two[k + 1, :2]).all()


@pytest.mark.parametrize("cuts", [[1, 2, 3], [7, 500]])
def test_chunks_that_hand_over_their_state_equal_the_whole(cuts):
    u, cascade = noise(1000, 3), LowPassCascade(2.0, 3, DT)
    whole, last = cascade(u)
    state, parts = None, []
    for chunk in torch.tensor_split(u, cuts):
        xi, state = cascade(chunk, state)
        parts.append(xi)
    assert torch.allclose(torch.cat(parts), whole, rtol=0, atol=1e-13)
    assert torch.allclose(state, last, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("cutoff", "stages", "message"),
    [
        (400.0, 2, "cutoff=400 rad/s lies above the Nyquist frequency 314 rad/s"),
        (0.0, 2, "cutoff=0 rad/s"),
        (-5.0, 2, "cutoff=-5 rad/s"),
        (math.nan, 2, "cutoff=nan"),
        (50.0, 0, "stages=0 must be a whole number from 1 to"),
    ],
)
def test_filters_that_cannot_be_are_refused(cutoff, stages, message):
    with pytest.raises(ValueError, match=message):
        LowPassCascade(cutoff, stages, DT)


def test_a_held_input_gives_the_exact_solution_of_the_differential_equation():
    xi, _ = LowPassCascade(50.0, 1, DT)(torch.ones(100, 1).double())
    t = DT * torch.arange(100.0).double()[:, None]
    assert torch.allclose(xi, 1.0 - torch.exp(-50.0 * t), rtol=1e-12, atol=1e-15)
