"""The contract that every estimator meets."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields, replace

import numpy as np
import pytest
import torch

import models.vwnn
from data import Bilinear
from data.record import Record, Truth, stack
from data.simulation.element_test import force
from data.simulation.excitation import BandLimitedGaussian, Excitation
from models.estimator import Estimator
from models.named_laws import free_run
from models.named_laws.differences import Differences
from models.starts import branch_laws
from tests.models.zoo import (
    DT,
    ELEMENT_TESTS,
    ESTIMATORS,
    SEE_FORCE,
    SIMULATORS,
    SOLVED,
    ZOO,
)  # fmt: skip

SHORT = 500  # samples, enough to be identified from
INTEGRATED = (  # a law of the acceleration, followed by Runge and Kutta or exactly
    *("linear", "power_series_residual", "power_series_restoring_force"),
    *("chebyshev_restoring_force", "global_mlp", "residual_mlp"),
)


def without_truth(record: Record) -> Record:
    """Its own copy of what was measured; the truth is nowhere a number."""
    unknown = Truth(*(torch.full((record.samples, 1), torch.nan) for _ in fields(Truth)))
    return replace(record.map(torch.clone), truth=unknown)


@pytest.fixture(scope="module")
def given(bilinear_records) -> dict[str, list[Record]]:
    """What every estimator of the zoo is identified from: two records of the yielding structure.

    Those that simulate are given their beginnings: each of their steps costs a run.
    """
    lengths = {name: SHORT if name in SIMULATORS else 1000 for name in ZOO}
    return {
        name: [without_truth(record.window(0, length)) for record in bilinear_records[:2]]
        for name, length in lengths.items()
    }


@pytest.fixture(scope="module")
def identified(given) -> dict[str, Estimator]:
    """Every estimator of the zoo, identified; laws by a few steps of their search."""
    torch.manual_seed(0)
    estimators = {name: make(3, 3, DT) for name, make in ZOO.items()}
    with pytest.MonkeyPatch.context() as few:
        few.setattr(free_run, "ITERATIONS", (1, 1, 1))
        few.setattr(free_run, "RIVAL_ITERATIONS", 1)
        few.setattr(Differences, "jump", lambda *_: False)
        few.setitem(branch_laws.SETTINGS, "iterations", 5)
        few.setattr(branch_laws, "FIRST", 3)
        for name, estimator in estimators.items():
            estimator.identify(given[name])
    return estimators


@pytest.fixture(params=ESTIMATORS)
def estimator(request, identified) -> Estimator:
    return identified[request.param]


@pytest.fixture(params=ZOO)
def anyone(request, identified) -> Estimator:
    return identified[request.param]


def changed_from(record: Record, name: str, k: int, end: int | None = None) -> Record:
    signal = getattr(record, name).clone()
    signal[k:end] += 1.0
    return replace(record, **{name: signal})


def difference(estimator: Estimator, one: Record, other: Record) -> torch.Tensor:
    with torch.no_grad():
        return (estimator(one) - estimator(other)).abs().amax(dim=-1)  # (T,)


@pytest.mark.parametrize("k", [0, 500])
def test_an_estimate_does_not_see_the_acceleration_it_estimates(anyone, bilinear_record, k):
    changed = changed_from(bilinear_record, "a", k)
    assert difference(anyone, bilinear_record, changed)[: k + 1].max() == 0.0


def test_an_estimate_does_not_see_what_is_to_come(anyone, bilinear_record):
    changed = bilinear_record
    for signal in ("f", "x", "v"):
        changed = changed_from(changed, signal, 501)
    assert difference(anyone, bilinear_record, changed)[:501].max() == 0.0


@pytest.mark.parametrize("name", SEE_FORCE)
def test_an_estimate_sees_the_force(identified, bilinear_record, name):
    changed = changed_from(bilinear_record, "f", 500, 501)
    assert difference(identified[name], bilinear_record, changed)[500:502].max() > 1e-3


def test_a_batch_is_estimated_record_by_record(anyone, bilinear_records):
    together = anyone(stack(bilinear_records))
    assert together.shape == (3, 1000, 3)
    for estimate, record in zip(together, bilinear_records, strict=True):
        assert torch.allclose(estimate, anyone(record), rtol=0, atol=1e-8)


def test_estimates_are_finite_in_double_precision_and_never_read_the_truth(anyone, bilinear_record):
    """`identified` has none to read."""
    blind = anyone(without_truth(bilinear_record))
    assert blind.dtype == torch.float64
    assert blind.shape == bilinear_record.a.shape
    assert torch.isfinite(blind).all()
    assert torch.equal(blind, anyone(bilinear_record))


@pytest.mark.parametrize("name", ZOO)
def test_a_record_is_left_as_it_was(identified, given, bilinear_records, name):
    """By its identification, and by an estimate."""
    identified[name](given[name][0])
    for ours, record in zip(given[name], bilinear_records, strict=False):
        for signal, kept in record.window(0, ours.samples).signals().items():
            assert torch.equal(getattr(ours, signal), kept)


@pytest.mark.parametrize("name", ZOO)
def test_a_saved_state_restores_the_estimates_exactly(identified, bilinear_record, name):
    state, fresh = identified[name].state_dict(), ZOO[name](3, 3, DT)
    assert all(u.isfinite().all() for u in state.values() if u.is_floating_point())
    fresh.load_state_dict(state)
    assert torch.equal(fresh(bilinear_record), identified[name](bilinear_record))


@pytest.mark.parametrize("name", SOLVED)
def test_an_estimator_that_was_not_identified_says_so(bilinear_record, name):
    with pytest.raises(ValueError, match=r"is not identified yet; call identify"):
        ESTIMATORS[name](3, 3, DT)(bilinear_record)


@pytest.mark.parametrize("name", SOLVED)
def test_identification_is_solved_and_leaves_nothing_to_a_solver(identified, name):
    assert not any(p.requires_grad for p in identified[name].parameters())
    heads = dict(identified[name].named_parameters())
    assert identified[name].identified_parameters == sum(w.numel() for w in heads.values())
    assert heads


def test_a_record_of_another_time_step_is_refused(estimator, bilinear_record):
    with pytest.raises(ValueError, match=r"dt=0\.02 s, the estimator was built for dt=0\.01 s"):
        estimator(replace(bilinear_record, dt=0.02))


def test_a_record_of_another_structure_is_refused(anyone, bilinear_record):
    smaller = {name: getattr(bilinear_record, name)[:, :2] for name in "xva"}
    with pytest.raises(ValueError, match="has 2 DOFs and 3 channels"):
        anyone(replace(bilinear_record.measured(), **smaller))
    with pytest.raises(ValueError, match="has 3 DOFs and 2 channels"):
        anyone(replace(bilinear_record, f=bilinear_record.f[:, :2]))


@pytest.mark.parametrize(
    ("name", "dofs"),
    [
        (name, dofs)
        for name in ESTIMATORS
        for dofs in (1, 5)
        if (name, dofs) != ("vwnn_third_order", 5)
    ],
)
def test_structures_of_any_size_are_identified(linear_chain, record_of, name, dofs):
    excitation = Excitation(force=BandLimitedGaussian(2.0, (0.0, 4.5)))
    records = [record_of(linear_chain(dofs), excitation, 6.0, seed) for seed in range(2)]
    estimator = ESTIMATORS[name](dofs, dofs, DT)
    estimator.identify(records)
    batch = stack(records)
    assert estimator(batch).shape == (2, 600, dofs)
    assert (estimator(batch) - batch.a).norm() < 0.25 * batch.a.norm()


@pytest.mark.parametrize("name", ["vwnn", "linear"])
def test_fewer_forces_than_masses_and_moving_supports_are_channels(
    linear_structure, record_of, name
):
    shaken = Excitation(
        force=BandLimitedGaussian(2.0, (0.0, 4.5)),
        support=BandLimitedGaussian(0.05, (0.0, 4.0)),
        dofs=[2],
    )
    record = record_of(linear_structure, shaken, 20.0)
    estimator = ESTIMATORS[name](3, 7, DT)
    estimator.identify([record])
    assert (estimator(record) - record.a).norm() < 0.15 * record.a.norm()


@pytest.mark.parametrize("name", SOLVED)
def test_records_one_by_one_in_a_batch_or_in_another_order_identify_the_same(
    identified, bilinear_records, name
):
    one, two = bilinear_records[:2]
    reference = identified[name](bilinear_records[2])
    for batches in ([stack([one, two])], [two, one]):
        estimator = ESTIMATORS[name](3, 3, DT)
        estimator.identify(batches)
        estimate = estimator(bilinear_records[2])
        assert torch.allclose(estimate, reference, rtol=0, atol=1e-6 * float(reference.abs().max()))


@pytest.mark.parametrize("chunk", [1, 64])
def test_a_vwnn_in_chunks_equals_the_whole(monkeypatch, identified, bilinear_records, chunk):
    whole = identified["vwnn_unfiltered"]
    monkeypatch.setattr(models.vwnn, "CHUNK", 2 * chunk)
    batch = stack(bilinear_records[:2])
    assert torch.allclose(whole(batch)[0], whole(bilinear_records[0]), rtol=0, atol=1e-9)
    if chunk > 1:
        chunked = ESTIMATORS["vwnn_unfiltered"](3, 3, DT)
        chunked.identify([batch])
        difference = chunked(bilinear_records[2]) - whole(bilinear_records[2])
        assert difference.abs().max() < 1e-9


@pytest.mark.parametrize("name", ["vwnn_first_order", "linear"])
def test_warm_up_samples_are_not_fitted(monkeypatch, bilinear_record, name):
    warm = replace(bilinear_record, warmup=300)
    estimator, cut = (ESTIMATORS[name](3, 3, DT) for _ in range(2))
    monkeypatch.setattr(models.vwnn, "CHUNK", 128)
    estimator.identify([warm])
    features = (
        torch.cat([phi for _, phi in estimator.features(warm)])
        if name == "vwnn_first_order"
        else estimator.state(warm)
    )
    by_hand = np.linalg.lstsq(features[300:].numpy(), warm.a[300:].numpy())[0]
    assert np.abs(estimator.weights.numpy() - by_hand).max() < 1e-9
    cut.identify([bilinear_record])
    assert (cut.weights - estimator.weights).abs().max() > 1e-6


def test_after_the_warm_up_a_window_is_estimated_as_in_its_record(estimator, bilinear_record):
    whole = estimator(bilinear_record)[400:800]
    window = estimator(bilinear_record.window(300, 500, warmup=100))[100:]
    assert torch.allclose(window, whole, rtol=0, atol=1e-8)


@pytest.mark.parametrize("name", [*SIMULATORS, *INTEGRATED])
def test_a_simulation_from_the_drive_alone_is_finite_and_causal(identified, bilinear_record, name):
    """And that of a batch is that of its records."""
    calm = bilinear_record.map(lambda u: 0.2 * u)
    pushed = changed_from(calm, "f", 501)
    with torch.no_grad():
        run, other = (identified[name].free_run(r.drive()) for r in (calm, pushed))
        together = identified[name].free_run(stack([pushed, calm]).drive())
    assert torch.allclose(together.a[1], run.a, rtol=0, atol=1e-8)
    for signal in ("x", "v", "a"):
        one, two = getattr(run, signal), getattr(other, signal)
        assert one.shape == calm.a.shape
        assert torch.isfinite(one).all()
        assert torch.equal(one[:501], two[:501])
    assert (run.a[501:] != other.a[501:]).any()


@pytest.mark.parametrize("make", ZOO.values(), ids=ZOO)
def test_an_estimator_of_nothing_is_refused(make):
    for dofs, inputs, dt in ((0, 3, DT), (3, -1, DT), (3, 3, 0.0)):
        with pytest.raises(ValueError, match=r"(dofs|inputs|dt)="):
            make(dofs, inputs, dt)


@pytest.mark.parametrize("name", ZOO)
def test_a_structure_that_nothing_drives_is_identified_or_refused(name):
    """A free decay has no channels of excitation; what needs some says so."""
    t = DT * torch.arange(300.0, dtype=torch.float64)[:, None]
    x = torch.exp(-0.1 * t) * torch.cos(torch.tensor([5.0, 9.0]) * t)
    v = torch.gradient(x, spacing=DT, dim=0)[0]
    a = torch.gradient(v, spacing=DT, dim=0)[0]
    record = stack([Record(DT, a, x.new_zeros(300, 0), x, v)] * 2)
    with suppress(ValueError):
        estimator = ZOO[name](2, 0, DT)
        estimator.identify([record])
        with torch.no_grad():
            assert estimator(record).shape == record.a.shape


# element tests


def element_test(seed: int) -> Record:
    """A bilinear element under a random smooth motion of 6 s; its force is what is measured."""
    rng, t = np.random.default_rng(seed), DT * np.arange(600)
    w, phase = rng.uniform(2.0, 9.0, 6), rng.uniform(0.0, 6.0, 6)
    s = 0.01 * np.minimum(t, 2.0) * np.sin(np.outer(t, w) + phase).sum(axis=1)
    spring = Bilinear(
        between=("ground", "x1"), yield_displacement=0.01, stiffness=200.0, post_yield_stiffness=30
    )
    rate = np.gradient(s, DT)
    s, rate, r = (torch.from_numpy(u)[:, None] for u in (s, rate, force(spring, s, DT, rate)))
    return Record(DT, r, r.new_zeros(600, 0), s=s, s_dot=rate, quantity="force")


@pytest.fixture(scope="module", params=ELEMENT_TESTS)
def element(request) -> tuple[Callable[..., Estimator], Estimator]:
    """How one is built, and one that is identified."""
    torch.manual_seed(0)
    make = ELEMENT_TESTS[request.param]
    model = make(1, 2, DT)
    model.identify([stack([element_test(0), element_test(1)])])
    return make, model


@torch.no_grad()
def test_an_element_is_simulated_from_its_motion_alone(element):
    """Record by record as in a batch, by a stored model, and without what is to come."""
    make, model = element
    records = [element_test(2), element_test(3)]
    runs = [model.free_run(record.drive()).a for record in records]
    for together, alone in zip(model.free_run(stack(records).drive()).a, runs, strict=True):
        assert torch.allclose(together, alone, rtol=0.0, atol=1e-9 * float(alone.abs().max()))
    stored = make(1, 2, DT)
    with pytest.raises(ValueError, match="not identified"):
        stored.free_run(records[0].drive())
    stored.load_state_dict(model.state_dict())
    assert torch.equal(stored.free_run(records[0].drive()).a, runs[0])
    pushed = changed_from(changed_from(records[0], "s", 301), "s_dot", 301)
    other = model.free_run(pushed.drive()).a
    assert torch.equal(other[:300], runs[0][:300])
    assert not torch.equal(other[300:], runs[0][300:])


def test_a_record_that_is_no_element_test_is_refused(element):
    make, _ = element
    with pytest.raises(ValueError, match=r"element test|holds acceleration"):
        make(1, 2, DT).identify([replace(element_test(0), quantity="acceleration")])
    with pytest.raises(ValueError, match=r"element test|s_dot1|channels"):
        make(1, 1, DT)


def permuted(record: Record, order: list[int]) -> Record:
    moved = {name: u[..., order] for name, u in record.signals().items()}
    return replace(record.measured(), **moved)


@pytest.mark.parametrize("name", ["vwnn_first_order", "vwnn", "linear"])
def test_renumbered_masses_give_renumbered_estimates(identified, bilinear_records, name):
    order = [2, 0, 1]
    estimator = ESTIMATORS[name](3, 3, DT)
    estimator.identify([permuted(record, order) for record in bilinear_records[:2]])
    estimate = estimator(permuted(bilinear_records[2], order))
    expected = identified[name](bilinear_records[2])[:, order]
    assert torch.allclose(estimate, expected, rtol=0, atol=1e-9)
