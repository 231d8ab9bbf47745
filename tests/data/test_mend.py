"""Mending against known signals: what was lost, late, slow or noisy comes back as it was."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, detrend, sosfiltfilt

from data.measured.mend import Mending
from data.measured.raw_record import RawRecord

DT, T = 0.01, 3000


def motion(t: np.ndarray, highest: float = 8.0) -> np.ndarray:
    """Sines up to `highest` [Hz]."""
    rng = np.random.default_rng(2)
    frequencies, phases = rng.uniform(0.3, highest, 12), rng.uniform(0.0, 6.3, 12)
    return np.sin(2 * np.pi * np.multiply.outer(t, frequencies) + phases).sum(axis=-1)


def raw_at(time: np.ndarray, **channels: np.ndarray) -> RawRecord:
    return RawRecord("rec", time, None, {"a1": motion(time), "f1": motion(0.7 * time)} | channels)


@pytest.fixture
def even() -> RawRecord:
    return raw_at(DT * np.arange(T))


def error(found: np.ndarray, true: np.ndarray) -> float:
    """Relative rms, away from the ends."""
    inner = slice(len(true) // 20, -len(true) // 20)
    return float(np.linalg.norm((found - true)[inner]) / np.linalg.norm(true[inner]))


def test_faults_block_with_one_line(even):
    even.channels["a1"][5], even.channels["f1"][7] = np.nan, np.inf
    with pytest.raises(ValueError, match=r"^rec: NaN run in a1: .*data\.mend\.fill.*1 more\)$"):
        Mending()(even)


def test_gaps_are_filled_and_measured_samples_kept(even):
    true = even.channels["a1"].copy()
    even.channels["a1"][[500, 501, 900]] = np.nan
    even.channels["a1"][1200] = np.inf
    _, channels, done = Mending(fill=0.02)(even)
    assert done == ["a1: 3 gaps, the longest 0.02 s, interpolated"]
    kept = np.isfinite(even.channels["a1"])
    np.testing.assert_array_equal(channels["a1"][kept], true[kept])
    np.testing.assert_allclose(channels["a1"][~kept], true[~kept], atol=0.1 * true.std())
    assert np.isnan(even.channels["a1"][500])  # the record itself stays as it was


def test_lost_samples_come_back():
    keep = np.delete(np.arange(T), [700, 1500, 1501])
    dt, channels, done = Mending(fill=0.05)(raw_at(DT * keep))
    assert dt == pytest.approx(DT)
    assert done == ["a1, f1: 2 gaps, the longest 0.02 s, interpolated"]
    true = motion(DT * np.arange(T))
    assert len(channels["a1"]) == T
    np.testing.assert_allclose(channels["a1"][keep], true[keep])
    assert error(channels["a1"], true) < 0.01


@pytest.mark.parametrize(
    ("place", "words"),
    [(slice(100, 120), r"gap of 0.2 s at 1 s, longer than data.mend.fill=0.1"),
     (slice(0, 2), r"begins with missing samples.*data.start"),
     (slice(T - 2, T), r"ends with missing samples.*data.stop")],
)  # fmt: skip
def test_gaps_that_are_not_filled(even, place, words):
    even.channels["a1"][place] = np.nan
    with pytest.raises(ValueError, match=words):
        Mending(fill=0.1)(even)


def test_of_two_samples_at_one_time_the_first_is_kept():
    order = np.insert(np.arange(T), 600, 599)
    raw = raw_at(DT * order)
    raw.channels["a1"][600] = 77.0
    with pytest.raises(ValueError, match="duplicate times"):
        Mending(resample=100.0)(raw)
    dt, channels, done = Mending(fill=0.01)(raw)
    assert done == ["1 samples left out that share a time with another"]
    assert dt == pytest.approx(DT)
    np.testing.assert_array_equal(channels["a1"], motion(DT * np.arange(T)))


def test_decreasing_times_are_never_mended(even):
    even.time[1000:] -= 5.0
    with pytest.raises(ValueError, match="decreasing times"):
        Mending(fill=1.0, resample=50.0)(even)


def test_jitter_is_resampled_to_an_even_clock():
    rng = np.random.default_rng(0)
    time = DT * (np.arange(T) + rng.uniform(-0.2, 0.2, T))
    with pytest.raises(ValueError, match=r"uneven time steps.*data\.mend\.resample=100"):
        Mending()(raw_at(time))
    dt, channels, done = Mending(resample=100.0)(raw_at(time))
    assert dt == 0.01
    assert "resampled" in done[0]
    grid = time[0] + dt * np.arange(len(channels["a1"]))
    assert error(channels["a1"], motion(grid)) < 1e-4


def test_resampling_down_keeps_the_band_and_does_not_alias():
    time = np.arange(8192) / 1000.0
    high = np.sin(2 * np.pi * 90.0 * time)  # would come out at 10 Hz
    dt, channels, done = Mending(resample=100.0)(raw_at(time, a2=motion(time) + high))
    true = motion(dt * np.arange(len(channels["a1"])))
    assert error(channels["a1"], true) < 1e-3
    assert error(channels["a2"], true) < 1e-3
    assert done[1] == "anti-alias low-pass 40 Hz before it"


def test_sensors_out_of_sync_recover_a_common_signal():
    fast, slow = 0.013 + np.arange(4000) / 200.0, 0.4 + np.arange(1800) / 99.0
    raw = RawRecord(
        "two", None, None, {"a1": motion(fast), "a2": motion(slow)}, {"a1": fast, "a2": slow}
    )
    with pytest.raises(ValueError, match="different rates"):
        Mending()(raw)
    dt, channels, done = Mending(resample=100.0)(raw)
    true = motion(0.4 + dt * np.arange(len(channels["a1"])))
    assert len(channels["a1"]) == len(channels["a2"])
    assert error(channels["a1"], true) < 1e-3
    assert error(channels["a2"], true) < 1e-3
    assert error(channels["a1"], channels["a2"]) < 1e-4
    assert done[0].startswith("resampled from 99 and 200 Hz to 100 Hz")


@pytest.mark.parametrize(("kind", "name"), [("constant", "mean"), ("linear", "linear")])
def test_detrend_is_that_of_scipy(even, kind, name):
    _, channels, done = Mending(detrend=name)(even)
    np.testing.assert_array_equal(channels["a1"], detrend(even.channels["a1"], type=kind))
    assert name in done[0]


def test_filters_are_those_of_scipy_for_all_channels_alike(even):
    _, channels, done = Mending(low_pass=20.0, high_pass=0.5, order=3)(even)
    low, high = (butter(3, f, k, fs=100.0, output="sos") for f, k in ((20, "low"), (0.5, "high")))
    for name, signal in even.channels.items():
        expected = sosfiltfilt(high, sosfiltfilt(low, signal))
        np.testing.assert_allclose(channels[name], expected, rtol=1e-9, atol=1e-12)
    assert done == [
        "low-pass 20 Hz, order 3 there and back",
        "high-pass 0.5 Hz, order 3 there and back",
    ]


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"low_pass": 50.0}, r"low_pass=50 Hz must lie below the Nyquist frequency 50 Hz"),
        ({"low_pass": 20.0, "resample": 30.0}, r"Nyquist frequency 15 Hz"),
        ({"high_pass": 60.0}, r"high_pass=60 Hz must lie below"),
        ({"high_pass": 3.0, "low_pass": 2.0}, r"high_pass=3 Hz must lie below data.mend.low_pass"),
        ({"resample": 0.0}, r"data.mend.resample=0.0 must be positive"),
        ({"fill": -1.0}, r"data.mend.fill=-1.0 must be positive"),
        ({"detrend": "both"}, r"data.mend.detrend=both must be mean, linear or null"),
        ({"order": 0}, r"data.mend.order=0 must be a whole number"),
        ({"order": 2.5}, r"data.mend.order=2.5 must be a whole number"),
        ({"low_pass": float("nan")}, r"low_pass=nan must be positive"),
    ],
)
def test_settings_that_cannot_be(even, settings, words):
    with pytest.raises(ValueError, match=words):
        Mending(**settings)(even)
