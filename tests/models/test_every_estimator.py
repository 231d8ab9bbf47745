"""The contract that every estimator meets."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import fields, replace

import numpy as np
import pytest
import torch

import models.vwnn
from data.record import Record, Truth, stack
from data.simulation.excitation import BandLimitedGaussian, Excitation
from models.estimator import Estimator
from models.named_laws import free_run
from models.vwnn import VWNN
from tests.models.zoo import DT, ESTIMATORS, SEE_ACCELERATION, SEE_FORCE, SIMULATORS, SOLVED, ZOO

SHORT = 500  # samples, enough to be identified from


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
    """Every estimator of the zoo, identified; named laws by a few steps of their search."""
    torch.manual_seed(0)
    estimators = {name: make(3, 3, DT) for name, make in ZOO.items()}
    with pytest.MonkeyPatch.context() as few:
        few.setattr(free_run, "ITERATIONS", (1, 1, 1))
        few.setattr(free_run, "RIVAL_ITERATIONS", 1)
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


def permuted(record: Record, order: list[int]) -> Record:
    moved = {name: u[..., order] for name, u in record.signals().items()}
    return replace(record.measured(), **moved)


@pytest.mark.parametrize("k", [0, 1, 500, 999])
def test_an_estimate_does_not_see_the_acceleration_it_estimates(anyone, bilinear_record, k):
    changed = changed_from(bilinear_record, "a", k)
    assert difference(anyone, bilinear_record, changed)[: k + 1].max() == 0.0


@pytest.mark.parametrize("name", SEE_ACCELERATION)
def test_an_estimate_sees_the_acceleration_just_before(identified, bilinear_record, name):
    changed = changed_from(bilinear_record, "a", 500, 501)
    assert difference(identified[name], bilinear_record, changed)[501] > 1e-3


@pytest.mark.parametrize("signal", ["f", "x", "v"])
def test_an_estimate_does_not_see_what_is_to_come(anyone, bilinear_record, signal):
    changed = changed_from(bilinear_record, signal, 501)
    assert difference(anyone, bilinear_record, changed)[:501].max() == 0.0


@pytest.mark.parametrize("name", SEE_FORCE)
def test_an_estimate_sees_the_force(identified, bilinear_record, name):
    changed = changed_from(bilinear_record, "f", 500, 501)
    assert difference(identified[name], bilinear_record, changed)[500:502].max() > 1e-3


def test_gradients_reach_the_past_of_the_acceleration_and_nothing_else(estimator, bilinear_record):
    record = bilinear_record.window(0, 300).map(lambda u: u.clone().requires_grad_())
    estimator(record)[200].sum().backward()
    if "a" in estimator.reads:
        assert (record.a.grad[199] != 0.0).all()
        assert not record.a.grad[200:].any()
    if "x" in estimator.reads:
        assert (record.x.grad[200] != 0.0).all()
    assert record.truth.a.grad is None


def test_a_batch_is_estimated_record_by_record(anyone, bilinear_records):
    together = anyone(stack(bilinear_records))
    assert together.shape == (3, 1000, 3)
    for estimate, record in zip(together, bilinear_records, strict=True):
        assert torch.allclose(estimate, anyone(record), rtol=0, atol=1e-8)


def test_estimates_are_finite_and_in_double_precision(anyone, bilinear_record):
    estimate = anyone(bilinear_record)
    assert estimate.dtype == torch.float64
    assert estimate.shape == bilinear_record.a.shape
    assert torch.isfinite(estimate).all()


def test_what_was_identified_may_be_saved(anyone):
    values = {k: v for k, v in anyone.state_dict().items() if v.is_floating_point()}
    assert [name for name, value in values.items() if not torch.isfinite(value).all()] == []


def test_the_truth_is_never_read(anyone, bilinear_record):
    """`identified` has none to read."""
    blind = anyone(without_truth(bilinear_record))
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
    fresh = ZOO[name](3, 3, DT)
    fresh.load_state_dict(identified[name].state_dict())
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


@pytest.mark.parametrize("missing", ["x", "v"])
def test_a_missing_signal_is_named(identified, bilinear_record, missing):
    with pytest.raises(ValueError, match=f"EquivalentLinear reads {missing}, which the record"):
        identified["linear"](replace(bilinear_record, **{missing: None}))


def test_accelerations_and_forces_alone_are_enough_for_all_others(identified, bilinear_record):
    poor = Record(DT, bilinear_record.a, bilinear_record.f)
    for name in SEE_ACCELERATION:
        assert torch.equal(identified[name](poor), identified[name](bilinear_record))


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


@pytest.mark.parametrize("name", ["vwnn_first_order", "vwnn", "linear"])
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


@pytest.mark.parametrize("name", ["vwnn_first_order", "vwnn", "linear"])
def test_renumbered_masses_give_renumbered_estimates(identified, bilinear_records, name):
    order = [2, 0, 1]
    estimator = ESTIMATORS[name](3, 3, DT)
    estimator.identify([permuted(record, order) for record in bilinear_records[:2]])
    estimate = estimator(permuted(bilinear_records[2], order))
    expected = identified[name](bilinear_records[2])[:, order]
    assert torch.allclose(estimate, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("chunk", [1, 7, 64, 999])
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


@pytest.mark.parametrize("name", SIMULATORS)
def test_a_simulation_from_the_drive_alone_is_finite_and_causal(identified, bilinear_record, name):
    calm = bilinear_record.map(lambda u: 0.2 * u)
    pushed = changed_from(calm, "f", 501)
    with torch.no_grad():
        run, other = (identified[name].free_run(r.drive()) for r in (calm, pushed))
    for signal in ("x", "v", "a"):
        one, two = getattr(run, signal), getattr(other, signal)
        assert one.shape == calm.a.shape
        assert torch.isfinite(one).all()
        assert torch.equal(one[:501], two[:501])
    assert (run.a[501:] != other.a[501:]).any()


def test_baselines_have_nothing_to_identify(identified, bilinear_record):
    for name in ("last_value", "two_point", "filtered_extrapolation"):
        assert identified[name].identified_parameters == 0
        assert identified[name].identify([bilinear_record]) == {}


@pytest.mark.parametrize("make", ZOO.values(), ids=ZOO)
@pytest.mark.parametrize(("dofs", "inputs", "dt"), [(0, 3, DT), (3, -1, DT), (3, 3, 0.0)])
def test_an_estimator_of_nothing_is_refused(make, dofs, inputs, dt):
    with pytest.raises(ValueError, match=r"dofs=|dt="):
        make(dofs, inputs, dt)


def test_a_vwnn_above_the_nyquist_frequency_is_refused():
    with pytest.raises(ValueError, match="Nyquist"):
        VWNN(3, 3, 0.1)


@pytest.mark.parametrize("name", ZOO)
@pytest.mark.parametrize("records", [(), (2,)], ids=["one record", "two records"])
def test_a_structure_that_nothing_drives_is_identified_or_refused(records, name):
    """A free decay has no channels of excitation; what needs some says so."""
    t = DT * torch.arange(300.0, dtype=torch.float64)[:, None]
    x = torch.exp(-0.1 * t) * torch.cos(torch.tensor([5.0, 9.0]) * t)
    v = torch.gradient(x, spacing=DT, dim=0)[0]
    a = torch.gradient(v, spacing=DT, dim=0)[0]
    signals = (u.expand(*records, -1, -1) for u in (a, x.new_zeros(300, 0), x, v))
    record = Record(DT, *signals)
    with suppress(ValueError):
        estimator = ZOO[name](2, 0, DT)
        estimator.identify([record])
        with torch.no_grad():
            assert estimator(record).shape == record.a.shape
