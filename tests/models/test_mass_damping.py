"""Damping of the masses: found beside learned laws, of a chain that is simulated with it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from data import MenegottoPinto, Polynomial
from data.record import Record, stack
from data.simulation.motion import simulate
from data.simulation.structure import Structure
from models.element_network_branch import ElementNetworkBranch, mass_damping, without
from models.starts import branch_laws
from models.starts.branch_laws import Choice

DT, MASSES, SAMPLES = 0.02, [3e4, 2e4], 700


def shaken(alpha: float, seed: int, size: float = 1.2) -> Record:
    """Steel on a base that shakes, against which masses are damped by α m."""
    rng, t = np.random.default_rng(seed), DT * np.arange(SAMPLES)
    w, phase = rng.uniform(4.0, 40.0, 12), rng.uniform(0.0, 6.0, 12)
    ground = size * np.minimum(t / 2.0, 1.0) ** 2 * np.sin(np.outer(t, w) + phase).sum(axis=1)
    common = {"hardening_ratio": 0.05, "damping": 3e4}
    parts = {
        "r1": MenegottoPinto(
            between=("ground", "x1"), yield_displacement=0.02, stiffness=1.5e7, **common
        ),
        "r2": MenegottoPinto(
            between=("x1", "x2"), yield_displacement=0.015, stiffness=1e7, **common
        ),
    }
    for i, mass in enumerate(MASSES, start=1):
        parts[f"d{i}"] = Polynomial(
            between=("ground", f"x{i}"), stiffness=0.0, damping=alpha * mass
        )
    motion = simulate(Structure(MASSES, parts), -np.outer(ground, MASSES), DT)
    x, v, a = (torch.from_numpy(u) for u in (motion.x, motion.v, motion.a))
    return Record(DT, a, torch.from_numpy(-ground)[:, None], x, v)


def network(**settings) -> ElementNetworkBranch:
    return ElementNetworkBranch(
        2, 1, DT, "chain", MASSES, "base", ramps=10, bends=3, force_memory=True, law_starts=3,
        prior=1e-6, unsymmetric=False, **settings,
    )  # fmt: skip


@pytest.mark.parametrize("alpha", [0.0, 0.8])
def test_damping_of_the_masses_is_told_apart_from_that_of_the_laws(alpha):
    """0.8 / s, where forces are that of the dampers for 6 %, and laws are some per cent off."""
    model, records = network(), [shaken(alpha, seed) for seed in (2, 3)]
    stiffness = torch.tensor([1.5e7, 1e7]).double()
    tests = [test for record in records for test in model.element_tests(record, stiffness)]
    kept = [test[:3] for test in tests]
    drags = [test[3] for test in tests]
    found = mass_damping(model._single, kept, drags, Choice(True, 1e-6, 2, 0, False))
    assert abs(found - alpha) < 0.1
    torch.testing.assert_close(without(kept, drags, alpha)[0][2], kept[0][2] - alpha * drags[0])


def test_a_chain_on_a_shaken_base_learns_it_and_runs_with_it(monkeypatch):
    monkeypatch.setitem(branch_laws.SETTINGS, "iterations", 12)
    model, test = network(), shaken(0.8, 2, 0.4)
    model.identify([stack([shaken(0.8, seed, 0.4) for seed in (0, 1)])])
    told = {one.name: one for one in model.physical_parameters()}["mass_damping"]
    assert told.value == pytest.approx(0.8, abs=0.1)
    assert told.unit == "1/s"
    with torch.no_grad():
        error = (model.free_run(test.drive()).a - test.a).norm() / test.a.norm()
        model.drag.start(torch.tensor(1e-6).double())
        undamped = (model.free_run(test.drive()).a - test.a).norm() / test.a.norm()
    assert float(error) < 0.3
    assert float(undamped) > 2.0 * float(error)
