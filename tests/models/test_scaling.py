"""Scaling to [−1, 1]: extents of the training motion, its inverse, constant channels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from data.record import Record
from models.layers.scaling import Extents
from models.mlp import GlobalMLP, ResidualMLP


def signal(*shape: int, seed: int = 0) -> torch.Tensor:
    """Noise whose channels differ in size and mean; never symmetric about zero."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** np.arange(-2, shape[-1] - 2)
    return torch.from_numpy(size * (0.7 + rng.standard_normal(shape)))


def motion(samples: int = 80, seed: int = 1) -> Record:
    """Two masses that move at random; nothing here solves an equation of motion."""
    rng = np.random.default_rng(seed)
    x, v, f, a = torch.from_numpy(0.7 + rng.standard_normal((4, samples, 2)))
    return Record(dt=0.01, a=a, f=3.0 * f, x=0.1 * x, v=v)


def scale_of(u: torch.Tensor, *shape: int) -> Extents:
    scale = Extents(*(shape or u.shape[-1:]))
    scale.fit([u])
    return scale


def test_the_inverse_undoes_the_scaling_both_ways():
    u = signal(30, 4)
    scale, other = scale_of(u), 2.0 * signal(30, 4, seed=3)
    assert torch.allclose(scale.inverse(scale(other)), other, rtol=1e-13, atol=1e-15)
    assert torch.allclose(scale(scale.inverse(other)), other, rtol=1e-12, atol=1e-12)
    assert not torch.allclose(scale(other), other)


def test_a_constant_channel_keeps_its_unit_and_loses_its_mean():
    u = signal(20, 3)
    u[:, 1] = -4.25
    scale = scale_of(u)
    assert float(scale.reach[1]) == 1.0
    assert torch.equal(scale(u)[:, 1], torch.zeros(20).double())
    assert torch.allclose(scale(u + 0.5)[:, 1], torch.full((20,), 0.5).double())


@pytest.mark.parametrize("model", [GlobalMLP, ResidualMLP])
def test_samples_that_only_warm_up_are_not_scaled_by(model):
    """Wild first samples; the delayed residual of the last of them is a counted input."""
    calm, wild = motion(), motion().map(lambda u: u.clone())
    for u in wild.signals().values():
        u[:5] *= 50.0
    estimators = [model(2, 2, 0.01) for _ in range(2)]
    estimators[0].identify([replace(calm, warmup=6)])
    wild.a[5], wild.x[5], wild.v[5], wild.f[5] = calm.a[5], calm.x[5], calm.v[5], calm.f[5]
    estimators[1].identify([replace(wild, warmup=6)])
    for one, other in zip(*(e.network.buffers() for e in estimators), strict=True):
        assert torch.allclose(one, other, rtol=1e-9, atol=1e-12)
