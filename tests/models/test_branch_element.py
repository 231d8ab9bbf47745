"""The branch law: compiled against PyTorch, its derivatives, limits, units, and planted laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from data.record import Record, stack
from models.branch_element import BranchElement
from models.composition.branch_law_compiled import KEPT, with_turning_points
from models.fit.objective import restore, state_of
from models.fit.problem import FreeRunProblem
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from tests.reference_networks import branch_forces

DT = 0.02
SETTLED = {"force_memory": True, "prior": 1e-7, "unsymmetric": False}  # nothing is chosen


def motion(samples: int = 500, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    rng = np.random.default_rng(seed)
    t = DT * np.arange(samples)
    w, phase, size = rng.uniform(2.0, 9.0, 6), rng.uniform(0.0, 6.0, 6), np.minimum(t, 2.0) / 2.0
    s = 0.02 * size * np.sin(np.outer(t, w) + phase).sum(axis=1)
    return torch.from_numpy(s)[:, None], torch.from_numpy(np.gradient(s, DT))[:, None]


def element_test(seed: int = 0, samples: int = 500, of: float = 1.0, per: float = 1.0) -> Record:
    """A bilinear element with friction that grows with the rate; force and length in any unit."""
    s, rate = motion(samples, seed)
    z, r = 0.0, []
    for k in range(samples):
        z = float(np.clip(z + float(s[k] - (s[k - 1] if k else 0.0)), -0.015, 0.015))
        r.append(30.0 * float(s[k]) + 170.0 * z * (1.5 - np.exp(-abs(float(rate[k])) / 0.1)))
    force = of * torch.tensor(r, dtype=torch.float64)[:, None]
    none = force.new_zeros(samples, 0)
    return Record(DT, force, none, s=per * s, s_dot=per * rate, quantity="force")


def identified(records: list[Record], **more: object) -> BranchElement:
    model = BranchElement(1, 2, DT, **{**SETTLED, **more})
    model.identify(records)
    return model


def fitted(model: BranchElement, record: Record, iterations: int) -> float:
    """Relative error of the best of a few starts, which the model keeps."""
    problem, best, kept = FreeRunProblem(model, record, None), float("inf"), []
    generator = torch.Generator().manual_seed(1)
    for _ in range(3):
        model.restart(generator)
        solver = LevenbergMarquardt(model.parameters(), iterations, 1e-2, 0.2, 4.0, scaled=True)
        while not solver.finished:
            solver.solve(problem)
        loss = float(problem.loss().detach()) ** 0.5
        if loss < best:
            best, kept = loss, state_of(model)
    restore(model, kept)
    return best


@pytest.mark.parametrize(
    ("force_memory", "times", "unsymmetric"), [(False, 1.3, True), (True, 8.0, False)]
)
def test_the_compiled_law_and_its_derivatives_are_those_of_pytorch(
    force_memory, times, unsymmetric
):
    """Beyond the data, too, and farther than deformations and forces are remembered."""
    record = element_test(samples=160)
    model = identified(
        [record], ramps=3, bends=2, force_memory=force_memory, unsymmetric=unsymmetric
    )
    record = replace(record, s=times * record.s, s_dot=times * record.s_dot)
    noise = torch.randn(model.theta.shape, generator=torch.Generator().manual_seed(3)).double()
    model.theta.data += 0.1 * noise
    ours, jacobian = model.restarted_jacobian(record, None)
    y, rate, turns, place = model._steps(record.s[:, 0].numpy(), record.s_dot[:, 0].numpy(), 0)
    assert (turns != 0).sum() > 5
    theta = model.theta.detach()[0].requires_grad_()
    steps = (torch.from_numpy(y), torch.from_numpy(rate), torch.from_numpy(turns))
    forces = float(model.scale[2, 0]) * branch_forces(
        theta, model.sizes, *steps, float(model.scale[3, 0])
    )
    sampled = forces[torch.from_numpy(place) >= 0]
    largest = float(model.scale[2, 0])
    assert (float(forces.detach()[turns != 0].abs().max()) > KEPT * largest) == (times > KEPT)
    assert torch.allclose(ours[:, 0], sampled.detach(), rtol=0.0, atol=1e-9)
    for k in (20, 90, 159):
        (slope,) = torch.autograd.grad(sampled[k], theta, retain_graph=True)
        assert torch.allclose(
            jacobian[k, 0], slope, rtol=1e-6, atol=1e-7 * float(slope.abs().max())
        )


def test_turning_points_are_those_of_the_motion_between_samples():
    t = 0.1 * np.arange(200)
    y, _, turns, _ = with_turning_points(np.sin(t), np.cos(t), 0.1, 0.0)
    inner = y[turns != 0][1:]
    assert len(inner) == 6
    assert np.abs(np.abs(inner) - 1.0).max() < 1e-5
    assert np.abs(np.abs(np.sin(t)).max() - 1.0) > 1e-7


def test_noise_in_a_motion_makes_no_turning_points_within_its_band():
    t, rng = 0.02 * np.arange(2000), np.random.default_rng(0)
    noisy, rate = np.sin(t) + 1e-3 * rng.standard_normal(2000), np.cos(t)
    rate = rate + 0.05 * rng.standard_normal(2000)
    counted = [int((with_turning_points(noisy, rate, 0.02, b)[2] != 0).sum()) for b in (0.0, 6e-3)]
    assert counted[0] > 50
    assert counted[1] == 1 + 13  # half-periods in 40 s


def test_it_learns_friction_that_depends_on_the_rate_and_holds_on_unseen_motions():
    test, train = element_test(1, 800), stack([element_test(i, 800) for i in (0, 2, 3)])
    model = identified([train], force_memory=False)
    assert fitted(model, train, 25) < 0.04  # the planted law turns at samples, not between them
    with torch.no_grad():
        assert float((model(test) - test.a).norm() / test.a.norm()) < 0.06


def test_beyond_the_trained_motion_it_goes_on_in_a_line():
    model = identified([element_test()])
    s = torch.linspace(0.0, 100.0 * float(model.scale[0, 0]), 2001).double()[:, None]
    rate = torch.full_like(s, 10.0 * float(model.scale[1, 0]))
    long = Record(DT, s, s.new_zeros(2001, 0), s=s, s_dot=rate, quantity="force")
    with torch.no_grad():
        r = model(long)[1000:, 0]
    assert float(r.diff(n=2).abs().max()) < 1e-2 * float(r.diff().abs().max()) + 1e-9
    assert torch.isfinite(r).all()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [({"ramps": -1}, "ramps=-1"), ({"bends": 10**6}, "bends=1000000"), ({"prior": -1.0}, "prior")],
)
def test_settings_that_make_no_sense_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        BranchElement(1, 2, DT, **wrong)


def test_other_records_are_refused():
    with pytest.raises(ValueError, match="element test"):
        BranchElement(1, 1, DT)
    record = element_test()
    other, model = replace(record, quantity="acceleration"), BranchElement(1, 2, DT)
    with pytest.raises(ValueError, match="force"):
        model.identify([other])
