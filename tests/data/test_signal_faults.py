"""Faults planted in clean records are found at their place; clean records have none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from data.inspect.inspection import inspection
from data.measured.raw_record import Finding, RawRecord
from data.measured.signal_faults import blocking, findings
from data.measured.time_step import FULL, time_step, unwrapped
from data.measured.units import to_si
from tests.data.odd_files import table
from tests.experiments import measured

T, DT = 4000, 0.01


def clean(**channels: np.ndarray) -> RawRecord:
    """40 s at 100 Hz: broadband force, vibrations of 1.3 Hz."""
    rng = np.random.default_rng(1)
    t = DT * np.arange(T)
    motion = np.sin(2 * np.pi * 1.3 * t) + 0.1 * rng.standard_normal(T)
    usual = {"f1": rng.standard_normal(T), "a1": motion, "x1": 0.01 * motion}
    return RawRecord("clean", t, None, usual | channels)


def found(raw: RawRecord, what: str) -> Finding:
    """The only finding of a record, which is a `what`."""
    all_ = findings(raw)
    assert [f.what for f in all_] == [what], "; ".join(map(str, all_))
    assert "\n" not in all_[0].message
    assert all_[0].blocks == (all_[0] in blocking(raw))
    return all_[0]


def planted(at: slice | int, value: float) -> RawRecord:
    raw = clean()
    raw.channels["a1"][at] = value
    return raw


def test_a_clean_record_has_no_faults():
    assert findings(clean()) == []


@pytest.mark.parametrize("seed", range(3))
def test_simulated_records_have_no_faults(record_of, structure, excitation, seed):
    record = record_of(structure, excitation, 20.0, seed)
    signals = {"f": record.f, "a": record.a, "x": record.x, "v": record.v}
    channels = {f"{s}{i + 1}": u[:, i].numpy() for s, u in signals.items() for i in range(3)}
    raw = RawRecord("simulated", record.dt * np.arange(record.samples), None, channels)
    assert [str(f) for f in findings(raw)] == []


@pytest.mark.parametrize(
    ("at", "value", "what", "place", "remedy"),
    [
        (slice(1000, 1007), np.nan, "NaN run", "10 s (sample 1000)", "data.mend.fill=0.0701"),
        (2000, np.inf, "infinite values", "20 s (sample 2000)", "data.mend.fill=0.01"),
        (slice(0, 5), np.nan, "NaN run", "0 s (sample 0)", "data.start"),
        (slice(T - 5, T), np.nan, "NaN run", "(sample 3995)", "data.stop"),
        (1500, 30.0, "spike", "15 s (sample 1500)", "data.mend.fill=0.01"),
        (slice(1500, 1505), -99.0, "spike", "15 s (sample 1500)", "data.mend.fill=0.05"),
    ],
)
def test_planted_samples_are_found_at_their_place(at, value, what, place, remedy):
    fault = found(planted(at, value), what)
    assert fault.channel == "a1"
    assert place in fault.message
    assert remedy in fault.message
    assert fault.blocks == (not np.isfinite(value) or np.isnan(value))


@pytest.mark.parametrize(
    ("channel", "make", "what", "words"),
    [
        ("a1", lambda a: np.clip(a, -0.7, 2.0), "saturation", "at -0.7"),
        ("a1", lambda a: a + 9.80665, "offset", "gravity"),
        ("a1", lambda a: 0.1 * a + 1.01, "suspicious unit", "data.units.a=g"),
        ("a1", lambda a: a + 0.3, "offset", "data.mend.detrend=mean"),
        ("a1", lambda a: a - 0.03, "offset", "changes the velocity by more than all vibration"),
        ("a1", lambda a: a + np.linspace(-0.5, 0.5, T), "drift", "data.mend.detrend=linear"),
        ("a1", lambda a: 981.0 * a, "suspicious unit", "data.units.a"),
        ("a1", lambda a: 1e-5 * a, "suspicious unit", "data.units.a"),
        ("x1", lambda x: 1e5 * x, "suspicious unit", "if it is in mm say data.units.x"),
        ("x1", lambda x: x + 0.5, "offset", "mean of 0.5"),
        ("x2", lambda x: x, "copied channel", "same samples as x1"),
        ("x2", lambda x: 0.1 - 25.4 * x, "copied channel", "same samples as x1"),
        ("f1", lambda f: 0.0 * f + 3.0, "constant channel", "all samples are 3"),
    ],
)
def test_doubtful_channels_are_named_and_do_not_block(channel, make, what, words):
    raw = clean()
    raw.channels[channel] = make(raw.channels[channel.replace("2", "1")])
    fault = found(raw, what)
    assert fault.channel == channel
    assert words in fault.message
    assert not fault.blocks


@pytest.mark.parametrize("unit", ["m/s^2", "g", "gal", "-mg"])
@pytest.mark.parametrize(
    ("make", "what"),
    [(lambda a: a + 9.81, "offset"), (lambda a: a + 0.2, "offset"),
     (lambda a: 500.0 * a, "suspicious unit"), (lambda a: 1e-5 * a, "suspicious unit")],
)  # fmt: skip
def test_a_channel_has_the_faults_of_its_size_in_every_unit(tmp_path, make, what, unit):
    motion = make(clean().channels["a1"]) / to_si(unit, "a")
    own = unit.removeprefix("-")
    columns = {"time [s]": DT * np.arange(T), "force [N]": clean().channels["f1"]}
    path = table(tmp_path / "r.csv", columns | {f"acc [{own}]": motion}, "%.9g")
    said = {"a1": unit} if own != unit else {}
    faults = inspection(path, {}, said).findings
    assert [(f.what, f.channel) for f in faults] == [(what, "a1")]


@pytest.mark.parametrize(
    "signal",
    [
        np.round(20.0 * np.sin(0.02 * np.arange(T))),  # a coarse converter, slowly turning
        np.where(np.arange(T) % 400 < 200, 1.0, -1.0),  # two levels
        np.maximum(np.sin(0.05 * np.arange(T)), 0.0),  # at rest in between
    ],
)
def test_plateaus_that_are_no_saturation(signal):
    assert findings(clean(f1=signal, r1=2.0 * signal)) == []


def test_zero_first_row():
    raw = clean()
    channels = {c: np.concatenate(([0.0], x + 3.0)) for c, x in raw.channels.items() if c != "x1"}
    faults = findings(RawRecord("late", None, DT, channels))
    assert "zero first row" in [f.what for f in faults]
    at_rest = {c: np.concatenate(([0.0], np.cumsum(x))) for c, x in raw.channels.items()}
    assert "zero first row" not in [f.what for f in findings(RawRecord("", None, DT, at_rest))]


def with_clock(time: np.ndarray) -> RawRecord:
    raw = clean()
    return replace(raw, time=time, channels={c: x[: len(time)] for c, x in raw.channels.items()})


def test_dropped_samples():
    time = np.delete(DT * np.arange(T), [700, 701, 702, 2000])
    fault = found(with_clock(time), "dropped samples")
    assert fault.blocks
    assert "2 gaps, the longest of 3 samples (0.03 s) after 6.99 s (sample 699)" in fault.message
    assert "data.mend.fill=0.03" in fault.message
    assert time_step(time)[0] == pytest.approx(DT)


@pytest.mark.parametrize(
    ("time", "what", "words"),
    [
        (np.concatenate((DT * np.arange(600), DT * np.arange(599, 2000))), "duplicate times",
         "the first 5.99 s at sample 600"),
        (np.concatenate((DT * np.arange(600), DT * np.arange(100, 2000))), "decreasing times",
         "from 5.99 s to 1 s at sample 600"),
        (np.where(np.arange(T) == 9, np.nan, DT * np.arange(T)), "NaN run", "sample 9"),
        (np.zeros(T), "duplicate times", "all 4000 times"),
        (DT * (np.arange(T) + 0.2 * np.sin(np.arange(T))), "uneven time steps",
         "data.mend.resample=100"),
        (np.cumsum(np.random.default_rng(0).exponential(DT, T)), "uneven time steps", "worst"),
    ],
)  # fmt: skip
def test_broken_clocks_block(time, what, words):
    fault = found(with_clock(time), what)
    assert fault.blocks
    assert fault.channel == ""
    assert words in fault.message


def test_a_counter_that_ran_over():
    microseconds = (2**32 - 8333 * 1000 + 8333 * np.arange(T)) % 2**32
    fault = found(with_clock(microseconds * 1e-6), "decreasing times")
    assert "ran over" in fault.message


@pytest.mark.parametrize(
    ("rate", "decimals"), [(120.0, 2), (120.0, 3), (1024.0, 3), (128.0, 3), (300.0, 3)]
)
def test_rounded_time_stamps_are_no_jitter(rate, decimals):
    time = np.round(np.arange(T) / rate, decimals)
    fault = found(with_clock(time), "rounded time stamps")
    assert not fault.blocks
    assert time_step(time)[0] == pytest.approx(1.0 / rate, rel=1e-4)


@pytest.mark.parametrize(
    ("step", "words"),
    [(8333.0, "data.units.time=us (120 Hz)"), (10.0, "data.units.time=ms (100 Hz)"),
     (1.0, "put data.dt"), (1e7, "data.units.time=ns (100 Hz)"), (1e-7, "day or h")],
)  # fmt: skip
def test_clocks_in_other_units(step, words):
    fault = found(with_clock(step * np.arange(T)), "clock in other unit")
    assert words in fault.message
    assert not fault.blocks


def test_no_clock_and_unequal_lengths_block():
    raw = clean()
    assert "data.dt" in found(replace(raw, time=None), "no clock").message
    shorter = raw.channels | {"x1": raw.channels["x1"][:-3]}
    fault = found(replace(raw, channels=shorter), "unequal lengths")
    assert fault.blocks
    assert "x1 3997" in fault.message


def test_sensors_with_clocks_of_their_own():
    raw = clean()
    t = DT * np.arange(T)
    clocks = {"f1": t, "a1": t + 0.25, "x1": t + 0.25}
    fault = found(replace(raw, time=None, clocks=clocks), "sensors out of sync")
    assert "f1 0 s, a1, x1 0.25 s" in fault.message
    assert "data.mend.resample=100" in fault.message
    clocks["f1"] = 0.5 * t
    faults = findings(replace(raw, time=None, clocks=clocks))
    assert [f.what for f in faults] == ["different rates", "sensors out of sync"]
    assert "f1 200 Hz, a1, x1 100 Hz" in faults[0].message
    clocks["a1"] = clocks["x1"] = t
    assert "f1 200 Hz" in found(replace(raw, time=None, clocks=clocks), "different rates").message


@pytest.mark.parametrize("rate", [90.0, 99.0, 120.0])
def test_the_step_of_rounded_stamps_is_that_of_the_whole_clock(rate):
    """Lost samples among stamps that a rounding doubles or skips leave the step as it is."""
    lost = np.delete(np.arange(T), slice(500, 503))
    dt, faults = time_step(np.round(lost / rate, 2))
    assert dt == pytest.approx(1.0 / rate, rel=1e-6)
    assert {f.what for f in faults} == {"dropped samples", "rounded time stamps"}
    assert "of 3 samples" in next(f.message for f in faults if f.blocks)


@pytest.mark.parametrize(
    ("step", "ground", "said"),
    [
        (0.01, np.sin, ""),
        (0.01, np.ones_like, "constant channel in s_ddot1"),
        (0.01, lambda t: 1e3 * np.sin(t), "suspicious unit in s_ddot1"),
        (100.0, np.sin, "clock in other unit: steps of 100 s"),
        (1e-7, np.sin, "clock in other unit: steps of 1e-07 s"),
    ],
)
def test_training_doubts_what_an_inspection_does(step, ground, said, tmp_path):
    t = np.arange(400)
    columns = {"time": step * t, "s_ddot1": ground(0.3 * t), "a1": np.cos(0.3 * t)}
    table(tmp_path / "a.csv", columns)
    data = measured(tmp_path / "a.csv", units={"time": "s"})
    notes = [note for said in data.notes.values() for note in said]
    trained = [note.removeprefix("doubtful: ") for note in notes if "doubtful" in note]
    inspected = [str(f) for f in inspection(tmp_path / "a.csv", {}, {"time": "s"}).findings]
    for found in (trained, inspected):
        assert any(text.startswith(said) for text in found) if said else not found


@pytest.mark.parametrize("full", FULL)
def test_a_clock_that_begins_again_goes_on_and_one_that_restarts_does_not(full):
    rising = 0.7 * full + full / 1000.0 * np.arange(2500)
    whole, remark = unwrapped(np.round(rising % full, 9))
    np.testing.assert_allclose(np.diff(whole), full / 1000.0, rtol=1e-4)
    assert remark.startswith(f"the clock begins again after {full:.10g} s, 3 times")
    for other in (rising, np.concatenate([rising, rising]), rising[::-1]):
        same, remark = unwrapped(other)
        assert same is other
        assert not remark


def test_few_marks_in_a_long_record_are_no_fault_but_their_gaps():
    """Marks of events between the samples that stand for a long record."""
    marks = np.full(250_000, np.nan)
    marks[1::9999] = np.arange(26) % 5
    assert [f.what for f in findings(RawRecord("long", None, DT, {"mark": marks}))] == ["NaN run"]
