"""Sample by sample: the batch estimator where nothing adapts, and what bad samples do."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
import torch

from data.record import Record
from data.sample import Sample, samples_of
from models.linear import EquivalentLinear
from models.linear_in_weights import LinearInWeights
from models.mlp import ResidualMLP
from models.online import scores
from models.online.adaptive import Online
from models.online.guard import Guard
from models.online.guard_compiled import BEFORE, LARGEST, SAME
from models.online.laws.frozen import Frozen
from models.online.laws.recursive_least_squares import RecursiveLeastSquares
from models.online.stream import Stream
from models.online.vwnn_stream import VWNNStream
from models.polynomial import ModalPolynomial
from models.vwnn import VWNN

DT = 0.01
ESTIMATORS = {
    "vwnn": VWNN,
    "vwnn_first_order": partial(VWNN, order=1),
    "vwnn_third_order": partial(VWNN, order=3, stages=1),
    "vwnn_odd": partial(VWNN, order=[1, 3], stages=1, bias=False),
    "vwnn_unfiltered": partial(VWNN, unfiltered_excitation=True, squares=False),
    "vwnn_three_stages": partial(VWNN, order=1, stages=3),
    "equivalent_linear": EquivalentLinear,
    "power_series_residual": partial(ModalPolynomial, fits="residual", order=3),
    "chebyshev_restoring_force": partial(ModalPolynomial, basis="chebyshev", order=3),
    "coupled_modes": partial(ModalPolynomial, order=2, pairs=[["u1", "u2"], ["u1", "u1_dot"]]),
}
STREAMS = [(name, Stream) for name in ESTIMATORS]
STREAMS += [(name, VWNNStream) for name in ESTIMATORS if "vwnn" in name]


@pytest.fixture(scope="module")
def identified(bilinear_records) -> dict[str, LinearInWeights]:
    zoo = {name: build(3, 3, DT) for name, build in ESTIMATORS.items()}
    for estimator in zoo.values():
        estimator.identify(bilinear_records[:1])
    return zoo


@pytest.fixture(scope="module")
def record(bilinear_records) -> Record:
    return bilinear_records[1].window(0, 500).measured()


@pytest.fixture(scope="module")
def short(record) -> Record:
    return record.window(0, 200)


def run(stream: Stream, record: Record) -> torch.Tensor:
    return torch.stack([stream.step(sample) for sample in samples_of(record)])


def spoilt(record: Record, name: str, k: int, value: float, channel: int = 0) -> Record:
    signal = getattr(record, name).clone()
    signal[k, channel] = value
    return replace(record, **{name: signal})


def found(stream: Stream) -> list[tuple[int, str, str]]:
    return [(event.sample, event.kind, event.channel) for event in stream.events]


@pytest.mark.parametrize(("name", "kind"), STREAMS)
def test_a_frozen_stream_is_the_batch_estimator(identified, short, name, kind):
    stream = kind(identified[name], Frozen())
    whole = identified[name](short)
    assert torch.allclose(run(stream, short), whole, rtol=0, atol=1e-11 * float(whole.abs().max()))
    assert not stream.events


@pytest.mark.parametrize("name", [name for name in ESTIMATORS if "vwnn" in name])
def test_the_compiled_stream_adapts_as_that_in_pytorch(identified, short, name):
    law = RecursiveLeastSquares(0.995, variance=1e3)
    ours, compiled = (kind(identified[name], law) for kind in (Stream, VWNNStream))
    assert torch.allclose(run(compiled, short), run(ours, short), rtol=0, atol=1e-7)
    assert torch.allclose(compiled.weights[0], ours.weights[0], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "outlier"),
    [("vwnn", 4.0), ("vwnn_odd", None), ("vwnn_unfiltered", 4.0), ("vwnn_three_stages", None)],
)
def test_one_call_does_what_two_do_whatever_comes(identified, record, name, outlier, monkeypatch):
    """Missing values, outliers, a stuck sensor, silence, an event, a gap, a sample twice."""
    a, f = record.a.clone(), record.f.clone()
    a[100, 1] = f[130, 0] = torch.nan
    a[160, 0], f[190, 2] = 9.0 * a.abs().max(), -9.0 * f.abs().max()
    a[220:226, 2] = a[220, 2]
    a[250:253] = f[250:253] = a[280:290] = f[280:290] = 0.0
    a[320:] *= 30.0
    samples = [Sample(f=u, a=y, time=DT * k) for k, (u, y) in enumerate(zip(f, a, strict=True))]
    samples = [*samples[:400], samples[399], *samples[405:]]
    law, guard = RecursiveLeastSquares(0.995, variance=1e3), Guard(outlier=outlier)
    one, two = (VWNNStream(identified[name], law, guard=guard) for _ in range(2))
    slow, by_parts = [], Stream.estimate

    def estimate(stream: Stream, sample: Sample) -> torch.Tensor:
        slow.append(sample)
        return by_parts(stream, sample)

    for sample in samples:
        expected = two.estimate(sample)
        two.update(sample.a)
        with monkeypatch.context() as counted:
            counted.setattr(Stream, "estimate", estimate)
            assert torch.allclose(one.step(sample), expected, rtol=1e-7, atol=1e-7)
        assert (one.watch.sample, one.watch.time) == (two.watch.sample, two.watch.time)
    assert 20 < len(slow) < 200
    assert {event.kind for event in one.events} >= {"not_finite", "repeated", "dropped"}
    assert one.events == two.events
    assert torch.allclose(one.weights[0], two.weights[0], rtol=1e-6, atol=1e-6)
    assert torch.equal(one.estimate(samples[-1]), one.newest)  # again: the guard has its numbers
    for kept in ("unsettled", "blind"):
        assert getattr(one.watch, kept) == getattr(two.watch, kept)
    for name, numbers in two.watch.ranges.of.items():
        assert np.allclose(one.watch.ranges.of[name], numbers, rtol=1e-6, atol=0.0)
    ours, theirs = (np.asarray(stream.watch.ranges.of["a"]) for stream in (one, two))
    assert (ours[[BEFORE, SAME, LARGEST]] == theirs[[BEFORE, SAME, LARGEST]]).all()


@pytest.mark.parametrize(("name", "kind"), STREAMS)
def test_an_estimate_is_made_before_its_acceleration_is_used(identified, short, name, kind):
    law = RecursiveLeastSquares(0.99, variance=1e2)
    stream, other = kind(identified[name], law), kind(identified[name], law)
    here = run(stream, short)
    there = run(other, spoilt(short, "a", 150, 5.0))
    assert torch.equal(here[:151], there[:151])
    assert not torch.equal(here[151:], there[151:])


@pytest.mark.parametrize(("value", "kind"), [(torch.nan, "not_finite"), (99.0, "saturated")])
@pytest.mark.parametrize("stream", [Stream, VWNNStream])
def test_a_bad_acceleration_is_named_and_survived(identified, record, value, kind, stream):
    """Nothing is learnt from it, and soon the estimates are those of a record without it."""
    record, law = record.window(0, 300), RecursiveLeastSquares(1.0, variance=1e3)
    guard = Guard(full_scale=50.0)
    sound, hit = (stream(identified["vwnn"], law, guard=guard) for _ in range(2))
    expected = run(sound, record)
    estimates = run(hit, spoilt(record, "a", 200, value, channel=1))
    assert found(hit) == [(200, kind, "a2")]
    assert hit.events[0].time == pytest.approx(2.0)
    assert torch.equal(estimates[:201], expected[:201])
    scale = float(record.a.abs().max())
    assert float((estimates - expected)[201:].abs().max()) < 0.2 * scale
    assert float((estimates - expected)[260:].abs().max()) < 0.01 * scale


@pytest.mark.parametrize("name", ["vwnn", "equivalent_linear"])
def test_a_bad_input_keeps_its_last_sound_value(identified, record, name):
    record, law = record.window(0, 300), Frozen()
    nan = spoilt(record, "f", 200, torch.nan, channel=2)
    held = spoilt(record, "f", 200, float(record.f[199, 2]), channel=2)
    stream = Stream(identified[name], law)
    assert torch.equal(run(stream, nan), run(Stream(identified[name], law), held))
    assert found(stream) == [(200, "not_finite", "f3")]


def test_a_stuck_sensor_is_found_and_a_structure_at_rest_is_not(identified, record):
    record = record.window(0, 250)
    stuck = record.a.clone()
    stuck[200:240, 0] = stuck[200, 0]
    stream = Stream(identified["vwnn"], Frozen(), guard=Guard(repeats=3))
    run(stream, replace(record, a=stuck))
    assert found(stream) == [(203, "repeated", "a1")]
    still = record.map(lambda u: torch.cat([torch.zeros_like(u[:100]), u[:50]]))
    quiet = Stream(identified["vwnn"], Frozen())
    run(quiet, still)
    assert not quiet.events
    assert not Guard().finds(still)
    assert Guard().finds(replace(record, a=stuck))


@pytest.mark.parametrize("kind", [Stream, VWNNStream])
def test_samples_that_did_not_come_are_bridged(identified, record, kind):
    samples = list(samples_of(record))
    stream = kind(identified["vwnn"], Frozen())
    estimates = [stream.step(s) for s in samples[:200] + samples[205:]]
    assert found(stream) == [(200, "dropped", "all")]
    whole = identified["vwnn"](record)
    scale = float(record.a.abs().max())
    assert torch.allclose(torch.stack(estimates[260:]), whole[265:], rtol=0, atol=0.01 * scale)


def test_a_sample_that_does_not_fit_says_how(identified, record):
    sample = next(samples_of(record))
    with pytest.raises(ValueError, match="2 channels of excitation"):
        Stream(identified["vwnn"], Frozen()).step(replace(sample, f=sample.f[:2]))
    with pytest.raises(ValueError, match="must be float64"):
        VWNNStream(identified["vwnn"], Frozen()).step(replace(sample, a=sample.a.float()))
    with pytest.raises(ValueError, match="EquivalentLinear reads x, which the sample lacks"):
        Stream(identified["equivalent_linear"], Frozen()).step(replace(sample, x=None))
    with pytest.raises(ValueError, match="give its records one by one"):
        next(samples_of(record.map(lambda u: u[None])))
    with pytest.raises(ValueError, match="Guard: repeats=0 must"):
        Guard(repeats=0)


@pytest.mark.parametrize("kind", [Stream, VWNNStream])
@pytest.mark.parametrize("first", [0, 300], ids=["a clock that is set anew", "a gap"])
def test_after_a_long_gap_the_filters_begin_at_rest(identified, record, kind, first):
    samples = list(samples_of(record))
    stream = kind(identified["vwnn"], Frozen(), guard=Guard(longest=20))
    for sample in samples[:200]:
        stream.step(sample)
    later = torch.stack([stream.step(s) for s in samples[first : first + 200]])
    anew = identified["vwnn"](record.window(first, 200))
    assert torch.allclose(later, anew, rtol=0, atol=1e-11)
    if kind is Stream and not first:
        assert found(stream) == [(200, "dropped", "all")]


# One pass from nothing: what it learns, what it leaves alone, and that it comes back from disk


BATCH = {
    "vwnn": partial(VWNN, order=1),
    "chebyshev_restoring_force": partial(ModalPolynomial, basis="chebyshev", order=3),
}


@pytest.fixture(params=BATCH)
def build(request):
    return partial(BATCH[request.param], 3, 3, DT)


@pytest.fixture
def online(build, bilinear_records) -> Online:
    model = Online(3, 3, DT, build(), RecursiveLeastSquares(variance=1e9))
    model.identify(bilinear_records[:1])
    return model


def test_one_pass_of_least_squares_is_the_batch_fit(build, online, bilinear_records):
    batch = build()
    batch.identify(bilinear_records[:1])
    frozen = online.estimates(bilinear_records[1])["frozen"]
    expected = batch(bilinear_records[1])
    assert torch.allclose(frozen, expected, rtol=0, atol=1e-5 * float(expected.abs().max()))


def test_a_record_is_followed_as_its_stream(online, bilinear_record):
    stream, short = online.stream(), bilinear_record.window(0, 150)
    made = torch.stack([stream.step(sample) for sample in samples_of(short)])
    assert torch.allclose(made, online(short), rtol=0, atol=1e-8)


def test_from_nothing_begins_at_zero_and_knows_no_training(online, bilinear_record):
    nothing = online.estimates(bilinear_record)["from_nothing"]
    zero = online.estimator.known(bilinear_record)
    assert torch.equal(nothing[0], torch.zeros(3, dtype=torch.float64) if zero is None else zero[0])
    other = Online(3, 3, DT, online.estimator, online.law)
    assert torch.equal(other.estimates(bilinear_record)["from_nothing"], nothing)


def test_bad_samples_of_a_record_are_survived(online, bilinear_records):
    record = bilinear_records[1].window(0, 500).measured()
    a = record.a.clone()
    a[200, 1], a[300:340, 0] = torch.nan, a[300, 0]
    estimate, sound = online(replace(record, a=a)), online(record)
    assert torch.isfinite(estimate).all()
    scale = float(record.a.abs().max())
    assert float((estimate - sound)[:201].abs().max()) < 1e-8 * scale
    assert float((estimate - sound)[400:].abs().max()) < 0.05 * scale


def test_an_estimator_that_is_not_linear_in_its_weights_is_refused():
    with pytest.raises(ValueError, match="ResidualMLP, whose weights do not enter linearly"):
        Online(3, 3, DT, ResidualMLP(3, 3, DT))
    with pytest.raises(ValueError, match="not identified yet"):
        Online(3, 3, DT).stream()


def test_forgetting_follows_a_structure_that_changes(bilinear_records):
    """Half way all accelerations halve: what forgets is right again, what does not is not."""
    record = bilinear_records[0].measured()
    a = record.a.clone()
    a[500:] *= 0.5
    changed = replace(record, a=a)
    errors = []
    for forgetting in (0.98, 1.0):
        model = Online(3, 3, DT, EquivalentLinear(3, 3, DT), RecursiveLeastSquares(forgetting))
        model.identify([record])
        late = model(changed)[800:] - a[800:]
        errors.append(float(late.norm() / a[800:].norm()))
    assert errors[0] < 0.5 * errors[1]


def test_warm_up_samples_teach_nothing(online, bilinear_record):
    warm = replace(bilinear_record, warmup=300)
    frozen = online.estimates(warm)["frozen"]
    assert torch.equal(online(warm)[:301], frozen[:301])
    assert not torch.equal(online(warm)[301:], frozen[301:])


@pytest.mark.parametrize("dt", [0.01, 0.03, 0.015, 1.0 / 51.2])
def test_the_learning_curve_has_its_seconds_at_any_rate(monkeypatch, dt):
    class Learner:
        estimator = law = None

        def stretches(self, train, law, states, every):
            cuts = [*range(0, train.samples, every), train.samples]
            return ((range(*pair), None) for pair in pairwise(cuts))

        def follow(self, test, law, states):
            return 0.5 * test.a, None

    monkeypatch.setattr(scores, "started", lambda *_, **__: None)
    a = torch.ones(round(30.0 / dt), 1).double()
    record = Record(dt, a, a)
    curve = scores.learning_curve(Learner(), record, record)
    assert curve == dict.fromkeys([1.0, 2.0, 5.0, 10.0, 20.0, 30.0], pytest.approx(50.0))
