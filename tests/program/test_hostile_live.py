"""Damaged streams: outliers, honest events that look like them, time stamps, lines, sources."""

from __future__ import annotations

import io
import math
import os
import random
import socket
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from data.record import Record
from data.sample import Sample
from data.stream import LONGEST, SampleLines
from models.online.adaptive import Online
from models.online.guard import Guard
from models.online.laws.frozen import Frozen
from models.online.laws.normalised_gradient import NormalisedGradient
from models.online.laws.random_walk import RandomWalk
from models.online.laws.recursive_least_squares import RecursiveLeastSquares
from models.online.outliers import YOUNG
from models.online.stream import Stream, started
from models.online.vwnn_stream import VWNNStream
from models.vwnn import VWNN

DT, T = 0.01, 1500
QUICK = settings(deadline=None, max_examples=10, derandomize=True)
EXAMPLES = int(os.environ.get("HOSTILE_EXAMPLES", "10"))  # 3000: the long form, some minutes


def oscillator(force: np.ndarray) -> np.ndarray:
    """Acceleration (T, 1) of a damped oscillator, 1 kg and 1.5 Hz, under a force (T, 1)."""
    x = v = 0.0
    a = np.empty_like(force)
    for k, f in enumerate(force[:, 0].tolist()):
        a[k, 0] = f - 0.6 * v - 90.0 * x
        v += DT * a[k, 0]
        x += DT * v
    return a


def shaken(seed: int, size: np.ndarray | float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed noise of a size (T, 1) as a force, and the acceleration."""
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((T + 2, 1))
    force = (white[:-2] + white[1:-1] + white[2:]) / 2.0 * size
    return oscillator(force), force


def follow(a: np.ndarray, f: np.ndarray, kind=VWNNStream, **guard) -> tuple[np.ndarray, Stream]:
    stream = kind(VWNN(1, 1, DT), RecursiveLeastSquares(0.999), guard=Guard(**guard))
    samples = zip(torch.from_numpy(a), torch.from_numpy(f), strict=True)
    return np.stack([stream.step(Sample(f=u, a=y)).numpy() for y, u in samples]), stream


def error(estimate: np.ndarray, a: np.ndarray) -> float:
    """Relative error of the last two thirds."""
    tail = slice(T // 3, None)
    return float(np.linalg.norm((estimate - a)[tail]) / np.linalg.norm(a[tail]))


def record_of(a: np.ndarray, f: np.ndarray) -> Record:
    return Record(DT, torch.from_numpy(a), torch.from_numpy(f))


# Outliers


@pytest.fixture(scope="module")
def expected() -> np.ndarray:
    """Estimates of a motion that nothing hit."""
    return follow(*shaken(0))[0]


@pytest.mark.parametrize(
    ("size", "channel", "run"), [(20.0, "a1", 3), (1e2, "f1", 1), (1e6, "f1", 3), (1e300, "a1", 1)]
)
def test_one_outlier_is_named_and_leaves_the_model_as_it_was(size, channel, run, expected):
    a, f = shaken(0)
    hit = {"a1": a.copy(), "f1": f.copy()}
    signs = np.array([[1.0], [-1.0], [1.0]])[:run]
    hit[channel][700 : 700 + run] += size * hit[channel].std() * signs
    estimates, stream = follow(hit["a1"], hit["f1"])
    assert [(e.sample, e.kind, e.channel) for e in stream.events] == [(700, "outlier", channel)]
    assert error(estimates, a) < 1.2 * error(expected, a)
    assert Guard().finds(record_of(hit["a1"], hit["f1"]))


def test_the_readable_stream_does_as_the_compiled_one():
    a, f = shaken(1, np.where(np.arange(T)[:, None] < 900, 1.0, 300.0))  # an event to go through
    a[500] = 1e6
    ours, compiled = (follow(a, f, kind) for kind in (Stream, VWNNStream))
    assert np.abs(ours[0] - compiled[0]).max() < 1e-6 * np.abs(a[:500]).max()
    assert ours[1].events == compiled[1].events


@QUICK
@given(st.integers(0, 10**9), st.sampled_from([20.0, 1e3, 1e9, 1e200]), st.integers(100, T - 20))
def test_outliers_anywhere_are_named(seed, size, at):
    a, f = shaken(seed)
    draw = random.Random(seed)
    name = draw.choice(["a1", "f1"])
    hit = {"a1": a.copy(), "f1": f.copy()}
    hit[name][at] += draw.choice([-1, 1]) * size * hit[name].std()
    estimates, stream = follow(hit["a1"], hit["f1"])
    assert [(e.sample, e.kind, e.channel) for e in stream.events] == [(at, "outlier", name)]
    assert error(estimates, a) < 1.2 * error(follow(a, f)[0], a)


# The first samples

LAWS = {
    "recursive_least_squares": RecursiveLeastSquares(),
    "forgetting": RecursiveLeastSquares(0.999),
    "random_walk": RandomWalk(),
    "normalised_gradient": NormalisedGradient(),
    "frozen": Frozen(),
}
BAD: dict[str, Callable[[float], float]] = {
    "nan": lambda u: math.nan,
    "inf": lambda u: math.inf,
    "1e9": lambda u: 1e9,
    "-1e9": lambda u: -1e9,
    "1e300": lambda u: 1e300,
    "a thousand times": lambda u: 1e3 * u,
    "thirty times": lambda u: 30.0 * u,
    "five times": lambda u: 5.0 * u,
}


@cache
def trained() -> Online:
    """A model that has learnt from a motion."""
    model = Online(1, 1, DT, law=RecursiveLeastSquares(variance=1e4))
    model.identify([record_of(*shaken(99))])
    return model


def stream_by(law: str, begins: str, kind: type[Stream] = VWNNStream) -> Stream:
    """A stream from nothing or from a trained model, adapted by a law."""
    model = trained()
    states = started(model.estimator, LAWS[law], from_nothing=begins == "nothing")
    return kind(model.estimator, LAWS[law], states)


def late_error(stream: Stream, a: np.ndarray, f: np.ndarray, truth: np.ndarray) -> float:
    """Relative error of the second half."""
    samples = zip(torch.from_numpy(a), torch.from_numpy(f), strict=True)
    estimates = np.stack([stream.step(Sample(f=u, a=y)).numpy() for y, u in samples])
    half = slice(len(a) // 2, None)
    return float(np.linalg.norm((estimates - truth)[half]) / np.linalg.norm(truth[half]))


def replaced(u: np.ndarray, at: int, how: str) -> np.ndarray:
    bad = u.copy()
    bad[at] = BAD[how](float(u[at, 0]))
    return bad


def check_replacement(law: str, begins: str, seed: int, at: int, how: str, where: str) -> None:
    """One bad sample among the first hundred leaves the model as good, or it begins anew."""
    a, f = shaken(seed)
    sound = stream_by(law, begins)
    expected = late_error(sound, a, f, a)
    assert not sound.events
    stream = stream_by(law, begins)
    bad = (replaced(u, at, how) if name in where else u for name, u in (("a", a), ("f", f)))
    error_of_bad = late_error(stream, *bad, a)
    assert error_of_bad <= 1.2 * expected or stream.watch.kinds["restarted"]


REPLACEMENTS = (
    st.sampled_from([*LAWS]),
    st.sampled_from(["nothing", "trained"]),
    st.integers(0, 10**6),
    st.one_of(st.integers(0, 25), st.integers(0, 99)),
    st.sampled_from([*BAD]),
    st.sampled_from(["a", "f", "af"]),
)


@settings(QUICK, max_examples=EXAMPLES)
@given(*REPLACEMENTS)
def test_any_bad_sample_among_the_first_is_survived(law, begins, seed, at, how, where):
    check_replacement(law, begins, seed, at, how, where)


@pytest.mark.parametrize(
    ("kind", "places"),
    [(VWNNStream, [0]), (Stream, [7]), (VWNNStream, [19]), (VWNNStream, [3, 11]), (Stream, [4, 5])],
)
def test_outliers_among_the_first_are_named_and_as_if_they_had_not_come(kind, places):
    """The weights are those of a stream in which these values were missing."""
    a, f = shaken(5)
    hit, missing = a.copy(), a.copy()
    hit[places], missing[places] = 1e9, math.nan
    streams = [stream_by("recursive_least_squares", "nothing", kind) for _ in range(2)]
    for stream, values in zip(streams, (hit, missing), strict=True):
        late_error(stream, values[:300], f[:300], a[:300])
    kinds = [[(e.sample, e.channel) for e in stream.events] for stream in streams]
    assert kinds[0] == kinds[1]
    assert set(streams[0].watch.kinds) == {"outlier"}
    assert torch.equal(streams[0].weights[0], streams[1].weights[0])
    assert Guard().finds(record_of(hit, f))


def test_a_sudden_onset_among_the_first_is_no_outlier():
    """Nor is one after rest, nor after a twitch of one bit at rest."""
    for begin in range(1, 32, 5):
        rest = np.random.default_rng(begin).standard_normal((begin, 1)) * 1e-4
        for quiet in (rest, 0.0 * rest, 1e-3 * (np.arange(begin)[:, None] == begin // 2)):
            a, f = (np.concatenate([quiet, u])[:400] for u in shaken(begin))
            estimates, stream = follow(a, f)
            plain_estimates, plain = follow(a, f, outlier=None)
            assert not stream.events
            if begin < YOUNG or not quiet.all():  # else what came meanwhile is gone through again
                assert np.array_equal(estimates, plain_estimates)
            assert torch.equal(stream.weights[0], plain.weights[0])
            assert not Guard().finds(record_of(a, f))


# A model that is worse than none


@pytest.mark.parametrize(
    ("law", "kind"),
    [("recursive_least_squares", Stream), ("random_walk", VWNNStream),
     ("normalised_gradient", VWNNStream)],
)  # fmt: skip
def test_a_ruined_model_begins_anew_once_and_says_so(law, kind):
    a, f = shaken(6)
    hit = a.copy()
    hit[30] = 1e9
    stream = stream_by(law, "nothing", kind)
    stream.watch.guard.outlier, stream.watch.ranges.times = None, None
    assert late_error(stream, hit, f, a) < 1.2
    assert [(e.kind, e.channel) for e in stream.events] == [("restarted", "all")]
    assert stream.events[0].sample < T // 2


# Honest data

k = np.arange(T)[:, None]
HONEST = {
    "noise": lambda seed: shaken(seed),
    "an earthquake a thousand times the noise": lambda seed: shaken(
        seed, np.where(k < 900, 1e-3, np.exp(-np.maximum(k - 900, 0) / 400))
    ),
    "an earthquake after rest": lambda seed: shaken(seed, np.where(k < 900, 0.0, 1.0)),
    "ten times louder": lambda seed: shaken(seed, np.where(k < 700, 1.0, 10.0)),
    "thirty times louder": lambda seed: shaken(seed, np.where(k < 700, 1.0, 30.0)),
    "thirty times softer": lambda seed: shaken(seed, np.where(k < 700, 30.0, 1.0)),
    "a sweep": lambda seed: both(np.sin(2e-4 * (1 + seed % 7) * k**1.7)),
    "a step": lambda seed: both(1.0 * (k >= 300 + seed % 100)),
    "steps": lambda seed: both(np.sign(np.sin(0.02 * (k + seed % 100)))),
    "free motion": lambda seed: both(1.0 * (k < 30 + seed % 30)),
}


def both(force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return oscillator(force), force


@pytest.mark.parametrize("scene", HONEST)
def test_honest_data_are_never_refused_for_good(scene):
    """Nor does anything change: the weights afterwards are the same to the last bit."""
    for seed in range(2):
        a, f = HONEST[scene](seed)
        estimates, stream = follow(a, f)
        plain_estimates, plain = follow(a, f, outlier=None)
        assert stream.events == plain.events
        assert not Guard().finds(record_of(a, f))
        assert torch.equal(stream.weights[0], plain.weights[0])
        assert int((estimates != plain_estimates).any(axis=1).sum()) <= 24


def test_the_decision_at_a_sample_uses_none_after_it():
    a, f = shaken(4)
    a[700] = 1e3
    whole = follow(a, f)[0]
    for end in (701, 705, 900):
        assert np.array_equal(follow(a[:end], f[:end])[0], whole[:end])


# Lines and sources

HEAD = b"t,f1,a1,a2\n"
LINE = st.one_of(
    st.binary(max_size=60).map(lambda u: u.replace(b"\n", b"")),
    st.sampled_from(
        [b"0.1,1_0,1,1", b"0.1,0x1,1,1", b"0.1,nan,inf,-inf", b"1e999,1,1,1", b"#", HEAD]
    ),
    st.lists(st.floats().map(repr), min_size=2, max_size=6).map(lambda u: ",".join(u).encode()),
)


@QUICK
@given(st.lists(LINE, max_size=60), st.sampled_from([b"\n", b"\r\n"]))
def test_any_lines_are_samples_or_named(rows, end):
    lines = SampleLines(io.BytesIO(HEAD + end.join(rows)), DT)
    samples = []
    for _, sample in lines:
        samples.append(sample)
        lines.stamps._stamps.clear()  # rates are tested elsewhere
    named = sum(bool(row.strip()) for row in end.join(rows).split(b"\n"))
    assert len(samples) + lines.bad == named
    assert all(len(fault) < 200 for fault in lines.faults)
    assert all(math.isfinite(sample.time) for sample in samples)


@QUICK
@given(st.integers(30, 400), st.sampled_from([1e18, -1.0, -1e300, math.nan, 7.0, 0.5, 1e9]))
def test_one_wild_stamp_is_named_and_costs_no_other_sample(at, wild):
    stamps = [wild if k == at else round(DT * k, 6) for k in range(500)]
    text = HEAD + "\n".join(f"{stamp!r},1,2,3" for stamp in stamps).encode()
    lines = SampleLines(io.BytesIO(text), DT)
    seen = [sample.time for _, sample in lines]
    assert sum(abs(u - DT * k) > 1e-6 for k, u in enumerate(seen)) <= 1
    near = not math.isnan(wild) and -100 <= wild / DT - at < 3.5
    assert near or (lines.mistimed == 1 and f"line {at + 2}: the time stamp" in lines.faults[-1])


def test_a_client_that_leaves_in_the_middle_ends_the_lines():
    ours, theirs = socket.socketpair()
    theirs.sendall(HEAD + b"0.00,1,2,3\n0.01,1,2")
    theirs.close()
    with ours, ours.makefile("rb") as file:
        lines = SampleLines(file, DT)
        assert len(list(lines)) == 1
    assert lines.bad == 1


def test_too_many_channels_are_refused():
    head = ",".join(["f1", *(f"a{i}" for i in range(1, 9000))])
    assert len(head) < LONGEST
    with pytest.raises(ValueError, match="9,000 channels; expected at most 256"):
        SampleLines(io.BytesIO(head.encode()), DT)
