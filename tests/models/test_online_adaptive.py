"""One pass from nothing: what it learns, what it leaves alone, and that it comes back from disk."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import pytest
import torch

from data.sample import samples_of
from models.linear import EquivalentLinear
from models.mlp import ResidualMLP
from models.online.adaptive import Online
from models.online.laws.frozen import Frozen
from models.online.laws.recursive_least_squares import RecursiveLeastSquares
from models.polynomial import ModalPolynomial
from models.vwnn import VWNN

DT = 0.01
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


def test_with_the_adaptation_off_it_is_the_wrapped_estimator(online, bilinear_record):
    online.law = Frozen()
    expected = online.estimator(bilinear_record)
    assert torch.allclose(online(bilinear_record), expected, rtol=0, atol=1e-10)


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
    record = bilinear_records[1].measured()
    a = record.a.clone()
    a[400, 1], a[600:640, 0] = torch.nan, a[600, 0]
    estimate, sound = online(replace(record, a=a)), online(record)
    assert torch.isfinite(estimate).all()
    scale = float(record.a.abs().max())
    assert float((estimate - sound)[:401].abs().max()) < 1e-8 * scale
    assert float((estimate - sound)[700:].abs().max()) < 0.05 * scale


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
