"""Memory and prior of branch laws, and their polish, are chosen on motion that was held back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from data.record import Record
from models.branch_element import BranchElement
from models.composition.branch_law import learned, of_sizes
from models.starts import branch_laws

DT = 0.02
SIZES = (0.02, 0.03, 0.015)  # of the motions [m]


def element_test(seed: int, size: float) -> Record:
    """A bilinear element whose friction grows with the rate."""
    rng, t = np.random.default_rng(seed), DT * np.arange(400)
    s = np.sin(np.outer(t, rng.uniform(2.0, 9.0, 6)) + rng.uniform(0.0, 6.0, 6)).sum(axis=1)
    s *= size * np.minimum(t, 2.0) / 2.0 / np.abs(s).max()
    rate, z, r = np.gradient(s, DT), 0.0, np.zeros(len(s))
    for k in range(1, len(s)):
        z = float(np.clip(z + s[k] - s[k - 1], -0.008, 0.008))
        r[k] = 30.0 * s[k] + 170.0 * z * (1.3 - np.exp(-abs(rate[k]) / 0.1))
    moved, fast, force = (torch.from_numpy(u)[:, None] for u in (s, rate, r))
    return Record(DT, force, force.new_zeros(400, 0), s=moved, s_dot=fast, quantity="force")


def element(**more: object) -> BranchElement:
    return BranchElement(1, 2, DT, **{"ramps": 3, "bends": 1, "law_starts": 1, **more})


@pytest.mark.parametrize(("pushed", "sides"), [(1.0, "alike"), (0.4, "differ")])
def test_sides_differ_where_motion_held_back_says_so(monkeypatch, pushed, sides):
    monkeypatch.setitem(branch_laws.SETTINGS, "iterations", 40)

    def of(record: Record) -> Record:
        return replace(record, a=record.a * torch.where(record.a < 0.0, pushed, 1.0))

    records = [of(element_test(seed, size)) for seed, size in enumerate(SIZES)]
    model = element(force_memory=False, prior=1e-5, law_starts=2, ramps=6)
    assert model.identify(records)["tension_compression"] == sides


@pytest.mark.parametrize("own", [(False, False), (True, False), (False, True)])
def test_a_smaller_law_is_the_same_among_larger_ones_and_stays_one(own):
    record = element_test(0, 0.02)
    small, large = (
        element(force_memory=memory, unsymmetric=sides, prior=0.0)
        for memory, sides in (own, (True, True))
    )
    small.identify([record])
    large.scale.copy_(small.scale)
    large.theta.data[0] = of_sizes(small.theta.detach()[0], small.sizes, large.sizes)
    with torch.no_grad():
        assert torch.allclose(large(record), small(record), rtol=1e-12)
    _, slopes = large.restarted_jacobian(record, None)
    stays = ~learned(large.theta, large.sizes)[0]
    assert int(stays.sum()) == large.theta.numel() - small.theta.numel()
    assert not slopes[:, 0, stays].any()
    assert torch.equal(slopes[:, 0, ~stays], small.restarted_jacobian(record, None)[1][:, 0])
