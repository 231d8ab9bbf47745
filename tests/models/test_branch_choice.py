"""Memory and prior of branch laws, and their polish, are chosen on motion that was held back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from data.record import Record, stack
from data.simulation.elements import MenegottoPinto
from data.simulation.motion import simulate
from data.simulation.structure import Structure
from models.branch_element import BranchElement
from models.composition.branch_law import learned, of_sizes
from models.element_network_branch import ElementNetworkBranch
from models.starts import branch_choice, branch_polish
from models.starts.branch_choice import (
    largest_motion,
    parted,
    records_of,
)
from models.starts.branch_polish import polish_weight

DT = 0.02
SIZES = (0.02, 0.03, 0.015)  # of the motions [m]


def element_test(seed: int, size: float, of: float = 1.0, per: float = 1.0) -> Record:
    """A bilinear element whose friction grows with the rate."""
    rng, t = np.random.default_rng(seed), DT * np.arange(400)
    s = np.sin(np.outer(t, rng.uniform(2.0, 9.0, 6)) + rng.uniform(0.0, 6.0, 6)).sum(axis=1)
    s *= size * np.minimum(t, 2.0) / 2.0 / np.abs(s).max()
    rate, z, r = np.gradient(s, DT), 0.0, np.zeros(len(s))
    for k in range(1, len(s)):
        z = float(np.clip(z + s[k] - s[k - 1], -0.008, 0.008))
        r[k] = 30.0 * s[k] + 170.0 * z * (1.3 - np.exp(-abs(rate[k]) / 0.1))
    moved, fast, force = (torch.from_numpy(u)[:, None] for u in (per * s, per * rate, of * r))
    return Record(DT, force, force.new_zeros(400, 0), s=moved, s_dot=fast, quantity="force")


@pytest.fixture
def short(monkeypatch):
    """Fits of a few iterations."""
    monkeypatch.setattr(branch_choice, "ITERATIONS", 4)
    monkeypatch.setattr(branch_choice, "FIRST", 3)
    monkeypatch.setattr(branch_choice, "WEIGHTS", (1e-4, 1e-6))


def element(**more: object) -> BranchElement:
    return BranchElement(1, 2, DT, **{"ramps": 3, "bends": 1, "law_starts": 1, **more})


@pytest.mark.parametrize(("pushed", "sides"), [(1.0, "alike"), (0.4, "differ")])
def test_sides_differ_where_motion_held_back_says_so(monkeypatch, pushed, sides):
    monkeypatch.setattr(branch_choice, "ITERATIONS", 40)

    def of(record: Record) -> Record:
        return replace(record, a=record.a * torch.where(record.a < 0.0, pushed, 1.0))

    records = [of(element_test(seed, size)) for seed, size in enumerate(SIZES)]
    model = element(force_memory=False, prior=1e-5, law_starts=2, ramps=6)
    assert model.identify(records)["sides"] == sides


def test_the_largest_motion_is_held_back_and_of_a_single_one_its_end():
    tests = [(r.s, r.s_dot, r.a) for r in (element_test(i, s) for i, s in enumerate(SIZES))]
    assert largest_motion([y for y, _, _ in tests]) == 1
    records = records_of(tests, DT)
    rest, judged = parted(records, 1)
    assert rest == [records[0], records[2]]
    assert judged is records[1]
    (begun,), end = parted(records[:1], 0)
    assert begun.samples == end.warmup < end.samples == 400
    power = records[0].a.square().sum()
    assert float(records[0].a[end.warmup :].square().sum() / power) == pytest.approx(0.2, abs=0.02)


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


def shaken(seed: int, size: float) -> Record:
    """Two storeys of steel on a shaking ground."""
    rng, t = np.random.default_rng(seed), DT * np.arange(400)
    w, phase = rng.uniform(3.0, 16.0, 8), rng.uniform(0.0, 6.0, 8)
    s = np.minimum(t / 2.0, 1.0) ** 3 * (np.sin(np.outer(t, w) + phase) / w**1.5).sum(axis=1)
    s = (size * s / np.abs(s).max())[:, None]
    rate = np.gradient(s, DT, axis=0)
    common = {"hardening_ratio": 0.04, "damping": 6e4, "yield_displacement": 0.01}
    elements = {
        "a": MenegottoPinto(between=("s1", "x1"), stiffness=1.5e7, **common),
        "b": MenegottoPinto(between=("x1", "x2"), stiffness=1e7, **common),
    }
    motion = simulate(Structure([3e4, 2e4], elements), np.zeros((400, 2)), DT, s, rate)
    x, v, a, s, rate = (torch.from_numpy(u) for u in (motion.x, motion.v, motion.a, s, rate))
    return Record(DT, a, a.new_zeros(400, 0), x, v, s, rate)


def network(masses: list[float]) -> ElementNetworkBranch:
    return ElementNetworkBranch(
        2, 2, DT, "chain", masses, [], ramps=3, bends=1, law_starts=1, force_memory=False
    )


def test_the_polish_is_the_one_whose_free_run_is_nearest_to_what_was_held_back(short, monkeypatch):
    monkeypatch.setattr(branch_polish, "STEPS", 2)
    records = [shaken(0, 0.06), shaken(1, 0.12)]
    model = network([3e4, 2e4])
    told = model.identify([stack(records)])
    start, *errors = (float(e) for e in str(told["held_back_percent"]).split(", "))
    near = [e <= branch_polish.HARM * min(errors) + 0.01 for e in errors]
    weakest = min(w for w, well in zip(branch_polish.WEIGHTS, near, strict=True) if well)
    assert told["prior"] == weakest == float(model.weight)
    assert errors[0] == pytest.approx(start, rel=0.5)
    before = model.theta.detach().clone()
    weight, _ = polish_weight(model, [stack(records)], 1)
    assert torch.equal(model.theta, before)
    assert weight in branch_polish.WEIGHTS
    assert model.pull(True)[0] == model.weight
