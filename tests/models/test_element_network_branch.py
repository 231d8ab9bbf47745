"""Networks of branch laws: compiled against PyTorch, derivatives, units, equilibrium, planted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from data import MenegottoPinto
from data.record import Record, stack
from data.simulation.motion import simulate
from data.simulation.structure import Structure
from models.branch_element import BranchElement
from models.element_network_branch import ElementNetworkBranch
from models.starts import branch_laws
from tests.reference_networks import reference_run

DT = 0.02
MASSES = [3e4, 2e4]
SMALL = {
    **{"elements": "chain", "forced": [], "ramps": 3, "bends": 1, "law_starts": 1},
    **{"force_memory": False, "prior": 1e-6},
}


def ground(samples: int, seed: int, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Displacement and velocity of a support, at rest in the beginning."""
    rng, t = np.random.default_rng(seed), DT * np.arange(samples)
    w, phase = rng.uniform(3.0, 16.0, 8), rng.uniform(0.0, 6.0, 8)
    rise = np.minimum(t / 2.0, 1.0) ** 3
    s = rise * (np.sin(np.outer(t, w) + phase) / w**1.5).sum(axis=1)
    s *= size / np.abs(s).max()
    return s, np.gradient(s, DT)


def structure() -> Structure:
    common = {"hardening_ratio": 0.04, "damping": 6e4, "a1": 0.03, "a3": 0.03}
    first = MenegottoPinto(between=("s1", "x1"), yield_displacement=0.01, stiffness=1.5e7, **common)
    second = MenegottoPinto(between=("x1", "x2"), yield_displacement=0.01, stiffness=1e7, **common)
    return Structure(MASSES, {"first": first, "second": second})


def shaken(seed: int = 0, samples: int = 600, size: float = 0.12) -> Record:
    s, s_dot = ground(samples, seed, size)
    motion = simulate(structure(), np.zeros((samples, 2)), DT, s[:, None], s_dot[:, None])
    x, v, a, s_, w = (
        torch.from_numpy(u) for u in (motion.x, motion.v, motion.a, s[:, None], s_dot[:, None])
    )
    return Record(DT, a, a.new_zeros(samples, 0), x, v, s_, w)


@pytest.fixture(scope="module")
def model() -> ElementNetworkBranch:
    model = ElementNetworkBranch(2, 2, DT, masses=MASSES, **SMALL)
    model.identify([stack([shaken(0), shaken(1)])])
    return model


def other(model: ElementNetworkBranch, memory: bool = False) -> ElementNetworkBranch:
    """An untrained network with the units of `model`, its laws drawn at random."""
    new = ElementNetworkBranch(2, 2, DT, **{**SMALL, "force_memory": memory})
    new.identified.fill_(1.0)
    new.scale.copy_(model.scale)
    new.mass.start(torch.tensor(MASSES).double(), torch.tensor([0.1, -0.1]).double())
    drawn = torch.Generator().manual_seed(4)
    new.theta.data.copy_(0.3 * torch.randn(new.theta.shape, generator=drawn).double())
    new.theta.data[:, 0] = 0.0
    new.theta.data[:, 1] = 1.0  # E rises with y
    new.theta.data[:, -5] = -2.0
    return new


@pytest.mark.parametrize("memory", [False, True])
def test_the_compiled_run_and_its_derivatives_are_those_of_pytorch(model, memory):
    """Over 100 samples: soon after, laws drawn at random make 1e-10 out of 1e-12 of rounding."""
    record, ours = shaken(2, 100), other(model, memory)
    trace = ours.trace(record.drive(), derivatives=True)
    reference = reference_run(ours, record.drive())
    for name in "xva":
        wanted = getattr(reference, name).detach()
        assert torch.allclose(
            getattr(trace.response, name), wanted, atol=1e-10 * float(wanted.abs().max()), rtol=0.0
        )
    assert (trace.deformations.diff(dim=0).sign().diff(dim=0) != 0).any(dim=1).sum() > 8
    free = [p for p in ours.parameters() if p.requires_grad]
    for k in (30, 99):
        slopes = torch.autograd.grad(reference.a[k, 1], free, retain_graph=True)
        slope = torch.cat([s.reshape(-1) for s in slopes])
        assert torch.allclose(
            trace.jacobian[k, 1], slope, rtol=1e-6, atol=1e-8 * float(slope.abs().max())
        )


def test_derivatives_by_the_beginning_are_those_of_differences(model):
    record, ours = shaken(2, 100), other(model)
    begin = torch.tensor([0.01, -0.005, 0.02, 0.03]).double()
    slopes = ours.trace(record.drive(), derivatives=True, begin=begin).by_begin
    for i, step in enumerate((1e-7, 1e-7, 1e-6, 1e-6)):
        ends = [
            ours.trace(record.drive(), begin=begin + sign * step * torch.eye(4)[i].double())
            for sign in (1.0, -1.0)
        ]
        wanted = (ends[0].response.a - ends[1].response.a) / (2.0 * step)
        assert float((slopes[..., i] - wanted).norm() / wanted.norm()) < 1e-4


def test_forces_by_equilibrium_are_those_of_the_elements(model):
    record = shaken(3)
    motion = simulate(structure(), np.zeros((600, 2)), DT, record.s.numpy(), record.s_dot.numpy())
    ((y, rate, r, drag),) = model.element_tests(record, torch.ones(2).double())
    assert np.abs(y.numpy() - motion.y).max() < 1e-12
    assert np.abs(r.numpy() - motion.r).max() < 1e-6 * np.abs(motion.r).max()
    assert rate.shape == y.shape
    v = torch.from_numpy(motion.v) - record.s_dot
    above = (model.mass() * v).flip(1).cumsum(dim=1).flip(1)  # a chain carries all above
    torch.testing.assert_close(drag, above.detach())


def test_it_learns_steel_that_nobody_planted_and_holds_on_unseen_motions(monkeypatch):
    monkeypatch.setitem(branch_laws.SETTINGS, "iterations", 15)
    train, test = stack([shaken(i, 500) for i in (0, 1, 4)]), shaken(5, 500, 0.1)
    model = ElementNetworkBranch(
        2, 2, DT, masses=MASSES, elements="chain", forced=[], ramps=6, bends=2, law_starts=2,
        force_memory=True, prior=1e-6,
    )  # fmt: skip
    model.identify([train])
    with torch.no_grad():
        assert float((model.free_run(test.drive()).a - test.a).norm() / test.a.norm()) < 0.12


def _error_by(quantity: str, monkeypatch: pytest.MonkeyPatch) -> float:
    """Of the free run of unseen motion, in what was measured, with noise, of three others."""
    monkeypatch.setitem(branch_laws.SETTINGS, "iterations", 10)
    monkeypatch.setattr(branch_laws, "GROWING_STEPS", 5)
    test, drawn = shaken(5, 450, 0.2), torch.Generator().manual_seed(3)
    train = stack([_measured(shaken(k, 450, 0.2), drawn, quantity) for k in (0, 1, 4)])
    model = ElementNetworkBranch(
        2, 2, DT, masses=MASSES, elements="chain", forced=[], ramps=6, bends=2,
        law_starts=1, force_memory=False, prior=1e-5,
    )  # fmt: skip
    model.identify([train])
    with torch.no_grad():
        run = model.free_run(test.drive())
    found, true = (run.x, test.x) if quantity == "displacement" else (run.a, test.a)
    return float((found - true).norm() / true.norm())


def test_from_noisy_displacements_runs_that_grow_teach_what_equilibrium_has_lost(monkeypatch):
    assert _error_by("displacement", monkeypatch) < 0.1  # a third where they do not grow


def test_from_noisy_accelerations_it_simulates_steel_that_ends_out_of_place(monkeypatch):
    """Without a named law, whose masses would help."""
    monkeypatch.setattr(ElementNetworkBranch, "_named", lambda model, records: None)
    assert _error_by("acceleration", monkeypatch) < 0.2


def _measured(record: Record, drawn: torch.Generator, quantity: str) -> Record:
    """Accelerations or displacements alone, with noise of 2 or 1 %."""
    y, size = (record.a, 0.02) if quantity == "acceleration" else (record.x, 0.01)
    noise = size * y.std() * torch.randn(y.shape, generator=drawn).double()
    return replace(record, a=y + noise, x=None, v=None, quantity=quantity)


@pytest.mark.parametrize("amplitude", [0.2, 0.6, 1.0])
@pytest.mark.parametrize("centre", [0.0, 0.3])
def test_a_fitted_law_makes_no_energy_in_a_closed_cycle(model, amplitude, centre):
    samples = 200
    phase = 2.0 * np.pi * np.arange(4 * samples + 1) / samples
    for e in range(2):
        law = BranchElement(1, 2, DT, ramps=3, bends=1, force_memory=False)
        law.theta.data.copy_(model.theta[e : e + 1])
        law.scale[:4, 0], law.scale[4, 0] = model.scale[:, e], 0.0
        Y = float(model.scale[0, e])
        s = Y * torch.from_numpy(amplitude * np.sin(phase) + centre * np.minimum(phase, 1.0))
        rate = torch.gradient(s, spacing=DT)[0]
        none = s.new_zeros(len(s), 0)
        record = Record(DT, s[:, None], none, s=s[:, None], s_dot=rate[:, None], quantity="force")
        with torch.no_grad():
            r = law(record)[-samples - 1 :, 0]
        work = float(torch.trapezoid(r, s[-samples - 1 :]))
        assert work > -1e-3 * float(r.abs().max()) * amplitude * Y


def test_far_beyond_the_trained_motion_it_stays_finite(model):
    record = shaken(6, 800, 0.6)
    with torch.no_grad():
        run = model.free_run(record.drive())
    assert torch.isfinite(run.a).all()
    assert float(run.a.abs().max()) < 20.0 * float(record.a.abs().max())
