"""Memory and prior of branch laws, and their polish, are chosen on motion that was held back."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from data.record import Record, stack
from data.simulation.elements import MenegottoPinto
from data.simulation.motion import simulate
from data.simulation.structure import Structure
from models import element_network_branch
from models.branch_element import BranchElement
from models.composition.branch_law import learned, of_sizes
from models.element_network_branch import ElementNetworkBranch
from models.starts import branch_choice, branch_polish, shared_forces
from models.starts.branch_choice import (
    Choice,
    Chosen,
    chosen,
    largest_motion,
    parted,
    records_of,
)
from models.starts.branch_polish import motions_of, polish_weight

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


def element_tests(of: float = 1.0, per: float = 1.0) -> Record:
    return stack([element_test(seed, size, of, per) for seed, size in enumerate(SIZES)])


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


def test_of_several_motions_that_is_largest_which_is_so_for_most_elements():
    ways = [torch.tensor([[1.0, 10.0, 1.0]]), torch.tensor([[0.9, 20.0, 2.0]])]
    assert largest_motion(ways) == 1
    assert largest_motion([1e3 * y for y in ways]) == 1


def test_the_choice_is_the_one_with_the_least_error_on_what_was_held_back(short):
    tests = [(r.s, r.s_dot, r.a) for r in (element_test(i, s) for i, s in enumerate(SIZES))]

    def make(larger: bool, unsymmetric: bool, prior: float) -> BranchElement:
        return element(force_memory=larger, prior=prior, unsymmetric=unsymmetric)

    found = {
        (memory, prior): chosen(make, tests, 1, Choice(memory, prior, 1))
        for memory in (False, True)
        for prior in (1e-4,)
    }
    best = chosen(make, tests, 1, Choice(None, 1e-4, 1))
    less, more = (found[memory, 1e-4].error for memory in (False, True))
    assert best.error == pytest.approx(more if more < branch_choice.WORTH * less else less)
    held = element_test(1, SIZES[1])
    with torch.no_grad():
        off = float((best.law(held) - held.a).norm() / held.a.norm())
    assert best.error == pytest.approx(off, rel=1e-9)


def test_a_weaker_prior_is_taken_until_it_harms(monkeypatch):
    errors = iter([0.010, 0.011, 0.014])
    tests = [(r.s, r.s_dot, r.a) for r in (element_test(i, s) for i, s in enumerate(SIZES))]
    monkeypatch.setattr(branch_choice, "minimised", lambda *given, **more: None)
    monkeypatch.setattr(
        branch_choice, "_tried", lambda law, weight, *rest: Chosen(law, weight, next(errors))
    )
    best = chosen(
        lambda larger, sides, prior: element(force_memory=larger, unsymmetric=sides, prior=prior),
        tests,
        1,
        Choice(False, None, 1),
    )
    assert best.weight == branch_choice.WEIGHTS[1]


def test_a_law_that_is_never_finite_elsewhere_is_not_taken(short, monkeypatch):
    errors = iter([math.nan, 0.2])
    tests = [(r.s, r.s_dot, r.a) for r in (element_test(i, s) for i, s in enumerate(SIZES))]

    class Judged:
        def __init__(self, *given: object, **more: object) -> None:
            pass

        def loss(self) -> torch.Tensor:
            return torch.tensor(next(errors))

    monkeypatch.setattr(branch_choice, "minimised", lambda *given, **more: None)
    problem = branch_choice.FreeRunProblem
    monkeypatch.setattr(
        branch_choice,
        "FreeRunProblem",
        lambda *given, **more: Judged() if "prior" in more else problem(*given, **more),
    )
    best = chosen(
        lambda larger, sides, prior: element(force_memory=larger, unsymmetric=sides, prior=prior),
        tests,
        1,
        Choice(None, 1e-4, 1),
    )
    assert best.error == pytest.approx(0.2**0.5)


@pytest.mark.parametrize(("of", "per"), [(1e3, 1.0), (1.0, 1e3), (1e-3, 1e-3)])
def test_a_change_of_units_changes_no_choice(short, of, per):
    models = []
    for units in ((1.0, 1.0), (of, per)):
        models.append(element())
        models[-1].identify([element_tests(*units)])
    plain, other = models
    assert torch.equal(plain.weights, other.weights)
    assert torch.equal(learned(plain.theta, plain.sizes), learned(other.theta, other.sizes))
    record = element_test(5, 0.02)
    with torch.no_grad():
        ours = other(replace(record, s=per * record.s, s_dot=per * record.s_dot)) / of
        assert float((plain(record) - ours).norm() / ours.norm()) < 1e-4


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


def test_the_choice_is_told_and_training_may_go_on(short):
    model = element()
    told = model.identify([element_tests()])
    assert told["memory"] in {"more", "less"}
    assert float(told["law_prior"]) in {1e-4, 1e-6}
    weight, deviation = model.pull(True)
    assert weight.shape == deviation.shape
    model.restart(torch.Generator().manual_seed(3))
    assert torch.isfinite(model.theta).all()


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


def scaled(record: Record, length: float) -> Record:
    return record.map(lambda u: length * u)


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


def test_polish_that_harms_the_motion_held_back_is_not_taken(monkeypatch):
    ends = iter([(False, 0.10), (False, 0.104), (False, 0.2)])
    monkeypatch.setattr(branch_polish, "minimised", lambda *given: None)
    monkeypatch.setattr(branch_polish, "free_run_error", lambda *given: 0.1)
    monkeypatch.setattr(branch_polish, "_judged", lambda *given: next(ends))
    weight, told = polish_weight(network([3e4, 2e4]), [shaken(0, 0.06), shaken(1, 0.12)], 1)
    assert weight == told["prior"] == branch_polish.WEIGHTS[1]


def test_where_no_polished_model_stands_the_free_run_has_its_way(monkeypatch):
    ends = iter([(True, 0.1), (True, 0.2), (True, 0.3)])
    monkeypatch.setattr(branch_polish, "minimised", lambda *given: None)
    monkeypatch.setattr(branch_polish, "free_run_error", lambda *given: 0.1)
    monkeypatch.setattr(branch_polish, "_judged", lambda *given: next(ends))
    weight, _ = polish_weight(network([3e4, 2e4]), [shaken(0, 0.06), shaken(1, 0.12)], 1)
    assert weight == branch_polish.BY_DEFAULT


def test_of_forces_that_equilibrium_leaves_open_the_polish_alone_is_chosen(short, monkeypatch):
    monkeypatch.setattr(branch_polish, "STEPS", 1)
    monkeypatch.setattr(shared_forces, "ITERATIONS", 2)
    judged = []

    def polished(model: ElementNetworkBranch, records: list[Record], place: int):
        judged.append(place)
        return 1e-3, {"prior": 1e-3}

    monkeypatch.setattr(element_network_branch, "polish_weight", polished)
    model = ElementNetworkBranch(2, 2, DT, "all", [3e4, 2e4], [], ramps=3, bends=1, law_starts=1)
    fitted_to = []
    together = shared_forces.fit_together

    def fit(network: ElementNetworkBranch, motions: list[Record]) -> float:
        fitted_to.append([float(m.a.abs().max()) for m in motions])
        return together(network, motions)

    monkeypatch.setattr(element_network_branch, "fit_together", fit)
    records = [shaken(0, 0.06), shaken(1, 0.12)]
    told = model.identify([stack(records)])
    largest = [float(r.a.abs().max()) for r in records]
    assert judged == [1]
    assert fitted_to == [largest[:1], largest]  # the motion that judges is not seen before
    assert "memory" not in told
    assert float(model.weight) == told["prior"] == 1e-3


def test_units_change_neither_the_laws_nor_the_polish_of_a_network(short, monkeypatch):
    monkeypatch.setattr(branch_polish, "STEPS", 1)
    models = []
    for force, length in ((1.0, 1.0), (1e-3, 1e3)):
        models.append(network([force / length * m for m in (3e4, 2e4)]))
        records = [scaled(shaken(seed, size), length) for seed, size in ((0, 0.06), (1, 0.12))]
        models[-1].identify([stack(records)])
    plain, other = models
    assert float(plain.weight) == float(other.weight)
    drive = shaken(2, 0.08).drive()
    with torch.no_grad():
        a = plain.free_run(drive).a
        b = other.free_run(replace(drive, u=1e3 * drive.u)).a / 1e3
    assert float((a - b).norm() / a.norm()) < 1e-4


def test_every_motion_is_a_record_of_its_own():
    records = [shaken(0, 0.06), shaken(1, 0.12)]
    motions = motions_of([stack(records), records[0]])
    assert len(motions) == 3
    assert torch.equal(motions[1].a, records[1].a)
