"""Records that were cut out of a motion: the state in which they begin is estimated."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from data.record import Drive, Record
from models import ElementNetwork, LevenbergMarquardt
from models.composition.trace import traced
from models.estimator import simulate
from models.fit.free_run_objective import FreeRun
from models.fit.growing import grow
from models.fit.problem import Joint, run_problem
from tests.reference_networks import simulate as simulate_in_pytorch

DT, CUT = 0.01, 700


def yielding(dofs: int = 2) -> ElementNetwork:
    """A yielding chain with every law known."""
    chain = [["ground", "x1"], *([f"x{i}", f"x{i + 1}"] for i in range(1, dofs))]
    masses = [2.0, 1.5, 1.0][:dofs]
    model = ElementNetwork(dofs, dofs, DT, chain, masses, hinges=1, units=2)
    ones = torch.ones(dofs, dtype=torch.float64)
    with torch.no_grad():
        model.mass.start(torch.tensor(masses, dtype=torch.float64))
        model.laws.start(300.0 * ones, 1.0 * ones, 1.0 * ones, (0.5, 0.5))
        model.laws.unit_stiffness.theta.fill_(0.4)
        model.laws.unit_limit.theta.fill_(-1.0)
        model.identified.fill_(1.0)
    return model


def motion_of(model: ElementNetwork, seed: int = 0, samples: int = 1600) -> Record:
    """A motion from rest that yields."""
    draw = torch.Generator().manual_seed(seed)
    t = DT * torch.arange(samples, dtype=torch.float64)[:, None]
    f = 25.0 * torch.sin(6.0 * t + torch.arange(model.dofs))
    f = f + 15.0 * torch.randn(f.shape, generator=draw, dtype=torch.float64)
    rest = torch.zeros(model.dofs, dtype=torch.float64)
    with torch.no_grad():
        run = model.free_run(Drive(DT, f, rest, rest))
    return Record(DT, run.a, f, run.x, run.v)


def cut_out(whole: Record, warmup: int) -> Record:
    part = whole.map(lambda u: u[CUT:])
    return replace(part, x=None, v=None, warmup=warmup, initial_state="unknown")


@torch.no_grad()
def error(run: torch.Tensor, record: Record) -> float:
    counted = slice(record.warmup, None)
    return float((run - record.a)[counted].norm() / record.a[counted].norm())


@pytest.fixture(scope="module")
def model() -> ElementNetwork:
    return yielding()


@pytest.fixture(scope="module")
def whole(model) -> Record:
    return motion_of(model)


def test_both_twins_begin_in_the_same_state_and_its_derivatives_are_those_of_differences(model):
    record = motion_of(model, samples=120)
    begin = torch.tensor([0.1, -0.05, 0.4, -0.3, *([0.01, -0.02] * 2)], dtype=torch.float64)
    composition, drive = model.composition(), record.drive()

    def run(begin: torch.Tensor) -> torch.Tensor:
        return traced(composition, drive, 2, begin=begin).response.a

    trace = traced(composition, drive, 2, begin=begin, by_begin=True)
    readable = simulate_in_pytorch(composition, drive, 2, begin).a
    assert torch.allclose(trace.response.a, readable, rtol=0, atol=1e-10)
    assert trace.jacobian.shape[-1] == 0
    for j, step in enumerate(1e-7 * torch.eye(len(begin), dtype=torch.float64)):
        slope = (run(begin + step) - run(begin - step)) / 2e-7
        size = float(slope.abs().max())
        assert torch.allclose(trace.by_begin[..., j], slope, rtol=0, atol=2e-5 * max(size, 1.0))


def test_the_first_samples_tell_how_a_motion_begins(model, whole):
    record = cut_out(whole, 200)
    at_rest = model.free_run(record.drive()).a
    assert error(simulate(model, record).a, record) < 0.1 * error(at_rest, record)


def test_a_motion_after_the_first_samples_is_not_looked_at(model, whole):
    record = cut_out(whole, 200)
    later = record.a.clone()
    later[200:] = 0.0
    assert torch.equal(simulate(model, record).a, simulate(model, replace(record, a=later)).a)


def test_records_that_were_cut_share_parameters_and_each_has_a_first_state(model):
    """Vector and matrix of both together are those of each, behind the parameters of both."""
    parts = [cut_out(motion_of(model, seed, CUT + 200 + 100 * seed), 50) for seed in (1, 2)]
    problems = [run_problem(model, part, None) for part in parts]
    both = Joint(problems)
    count, states = sum(p.numel() for p in both.free), [p.own[0].numel() for p in problems]
    matrix, vector = both.normal_equations()
    assert matrix.shape == (count + sum(states),) * 2
    begin = count
    for share, problem, size in zip(both.shares, problems, states, strict=True):
        own, place = problem.normal_equations()[0], slice(begin, begin + size)
        weight = share * both.y.numel() / problem.y.numel()
        assert torch.allclose(matrix[place, place], weight * own[count:, count:])
        assert torch.allclose(matrix[:count, place], weight * own[:count, count:])
        begin += size
    assert not matrix[count : count + states[0], count + states[0] :].any()
    assert len(vector) == begin


def test_a_network_grows_on_records_that_begin_in_motion():
    model = yielding(1)
    parts = [cut_out(motion_of(model, seed, CUT + 400), 50) for seed in (1, 2)]
    with torch.no_grad():
        model.laws.unit_limit.theta.add_(0.3)
    assert grow(model, parts) < 0.05


def test_a_planted_law_is_recovered_from_parts_of_motions():
    """Planted, and started away from the truth; forces and masses in µN and µg."""
    model, started = yielding(1), yielding(1)
    parts = [cut_out(motion_of(model, seed, CUT + 400), 50) for seed in (1, 2)]
    batch = replace(
        parts[0], a=torch.stack([p.a for p in parts]), f=torch.stack([p.f for p in parts])
    )
    batch = replace(batch, f=1e6 * batch.f)
    with torch.no_grad():
        for part in (started.mass, started.laws.stiffness, started.laws.damping):
            part.unit.mul_(1e6)
        for part in (started.laws.cubic, started.laws.hinge_stiffness, started.laws.unit_stiffness):
            part.unit.mul_(1e6)
        started.laws.unit_stiffness.theta.fill_(0.3)
        started.laws.stiffness.theta.fill_(0.03)
    laws = started.laws
    free = [laws.stiffness.theta, laws.damping.theta, laws.unit_stiffness.theta]
    for parameter in started.parameters():
        parameter.requires_grad_(any(parameter is p for p in free))
    objective = FreeRun((None,))
    solver = LevenbergMarquardt(free, iterations=40, scaled=True)
    losses: list[float] = []
    while not solver.finished:
        losses += solver.solve(objective.problem(started, batch, 0))
    assert losses[-1] < 1e-9 < 1e-3 < losses[0]
    assert float(laws.unit_stiffness.theta.detach().sub(0.4).abs().max()) < 1e-6
    unseen = cut_out(motion_of(model, 3), 200)
    unseen = replace(unseen, f=1e6 * unseen.f)
    assert error(simulate(started, unseen).a, unseen) < 1e-3
