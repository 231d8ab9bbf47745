"""Delays of sensors: planted ones come back within their error, what a structure does is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.delays import channels_of, frames, late
from data.datamodule import Data
from data.inspect.__main__ import main as inspect
from data.measured.delays import delay_findings, delay_of, delays
from data.measured.mend import Mending
from data.measured.raw_record import RawRecord
from runner.config.compose import composed
from tests.data.odd_files import table
from tests.experiments import data_from, measured

DT = 0.01
SHARED = Path(__file__).parents[3] / "shared" / "data" / "shake_table_3story"


@pytest.fixture(scope="module")
def frame() -> tuple[np.ndarray, np.ndarray]:
    """A linear frame whose first mode is high enough to tell delays of a sample."""
    rng = np.random.default_rng(3)
    base, floors = frames(rng, 12, 2, 3000, yielding=False)
    stiff = [np.abs(np.fft.rfft(a[:, 0])).argmax() / (3000 * DT) for a in floors]
    return base[int(np.argmax(stiff))], floors[int(np.argmax(stiff))]


def planted(frame: tuple[np.ndarray, np.ndarray], seconds: float) -> dict[str, np.ndarray]:
    return channels_of(np.random.default_rng(0), frame[0], late(frame[1], seconds), 0.001)


@settings(max_examples=15, deadline=None)
@given(seconds=st.floats(0.01, 0.05), early=st.booleans(), unit=st.floats(1e-3, 1e3))
def test_a_planted_delay_comes_back_in_any_unit(frame, seconds, early, unit):
    seconds = -seconds if early else seconds
    channels = planted(frame, seconds)
    found = delays([(DT, channels)])
    assert set(found) == {"a1", "a2"}
    for delay in found.values():
        assert delay.sure
        assert abs(delay.seconds - seconds) < 4.0 * delay.error < 0.5 * abs(seconds)
    other = delays([(DT, {c: unit * u for c, u in channels.items()})])
    assert other["a1"].seconds == pytest.approx(found["a1"].seconds, rel=1e-6)


@pytest.mark.parametrize("yielding", [False, True])
def test_what_a_structure_does_is_no_delay(yielding):
    rng = np.random.default_rng(11)
    told = 0
    for base, floors in zip(*frames(rng, 60, 2, 1500, yielding), strict=True):
        told += bool(delay_findings(channels_of(rng, base, floors, 0.01), DT))
    assert told <= 1


def test_one_sensor_that_is_late_is_told_alone(frame):
    channels = planted(frame, 0.0)
    channels["a2"] = planted(frame, 0.04)["a2"]
    (finding,) = delay_findings(channels, DT)
    assert finding.channel == "a2"
    assert "after s_ddot1" in finding.message
    assert "data.delay.a2=0.0" in finding.message


def wave(t: np.ndarray) -> np.ndarray:
    return np.sin(2 * np.pi * 3.0 * t) + np.sin(2 * np.pi * 7.3 * t + 1.0)


@settings(max_examples=20, deadline=None)
@given(seconds=st.floats(-0.05, 0.05).filter(lambda d: abs(d) > 1e-4))
def test_there_and_back_leaves_the_inside(seconds):
    t = DT * np.arange(2000)
    raw = RawRecord("rec", t, None, {"a1": wave(t), "s_ddot1": wave(t)})
    dt, once, done = Mending()(raw, {"a": seconds})
    assert f"a1 shifted to {abs(seconds):g} s" in done[0]
    count = len(once["a1"])
    assert count == 2000 - np.ceil(abs(seconds) / DT - 1e-6)  # cut off, and none is made up
    time = max(0.0, -seconds) + dt * np.arange(count)
    inner = slice(20, -20)
    np.testing.assert_allclose(once["a1"][inner], wave(time + seconds)[inner], atol=1e-3)
    _, back, _ = Mending()(RawRecord("rec", time, None, once), {"a": -seconds})
    time = time[0] + max(0.0, seconds) + dt * np.arange(len(back["a1"]))
    np.testing.assert_allclose(back["a1"][inner], wave(time)[inner], atol=1e-3)


@pytest.fixture
def record(frame, tmp_path) -> Path:
    channels = {"time": DT * np.arange(len(frame[0]))} | planted(frame, 0.033)
    return table(tmp_path / "late.csv", channels, "%.9g")


def doubts(data: Data) -> list[str]:
    return [note for said in data.notes for note in [said, *data.notes[said]] if "doubtful" in note]


def test_the_remedy_that_is_told_is_a_key_that_mends(record, capsys):
    inspect([str(record)])
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "note: delay" in line]
    word = next(word for word in line.split() if word.startswith("data.delay.a="))
    words = ("data=measured", f"data.path={record}", "model=linear_modes")
    assert not any("delay" in note for note in doubts(data_from(composed(*words, word))))
    assert any("delay in a1, a2" in str(x) for x in data_from(composed(*words)).notes.items())


def test_an_estimate_is_of_the_training_part_alone_and_settles_the_config(record):
    data = measured(record, delay="estimate")
    seconds = data.settled["delay"]
    assert seconds["a1"] == seconds["a2"] == pytest.approx(0.033, abs=0.004)
    assert seconds["s_ddot1"] == 0.0
    assert any("after s_ddot1" in x for x in data.notes["delays, by the training records"])
    rows = np.loadtxt(record, delimiter=",", skiprows=1)
    rows[1510:, 1:] = np.random.default_rng(0).standard_normal(rows[1510:, 1:].shape)
    names = record.read_text().splitlines()[0].split(",")
    table(record, dict(zip(names, rows.T, strict=True)), "%.9g")
    assert measured(record, delay="estimate").settled == data.settled


@pytest.mark.parametrize(
    ("delay", "words"),
    [
        ({"a7": 0.01}, r"data\.delay\.a7 fits no signal or channel of .*s_ddot1, a1, a2$"),
        ({"a1": float("inf")}, r"data\.delay\.a1=inf must be a time in seconds"),
        ({"s_ddot1": "estimate"}, r"say seconds, as in data\.delay\.s_ddot1=0\.019"),
        ({"a1": 1e6}, r"no common time.*data\.delay"),
    ],
)
def test_delays_that_cannot_be_are_refused_in_one_line(record, delay, words):
    with pytest.raises(ValueError, match=words) as raised:
        measured(record, delay=delay)
    assert "\n" not in str(raised.value)


@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared records are not here")
@pytest.mark.parametrize("event", ["northridge", "sine_1_5"])
def test_a_real_frame_whose_sensors_are_in_step_has_no_delay(event):
    files = {"s_ddot1": "floor_0.csv:Acc_X", "time": "SampleTimeFine"}
    files |= {f"a{i}": f"floor_{i}.csv:Acc_X" for i in (1, 2, 3)}
    units = {"time": "us", "a": "m/s^2", "s_ddot": "m/s^2"}
    data = measured(SHARED / event, channels=files, units=units, skip_rows=6)
    assert not any("delay" in note for note in doubts(data))


@pytest.mark.parametrize("zeta", [0.02, 0.1, 0.2])
def test_the_phase_of_a_dashpot_is_no_delay(zeta):
    """Of f³ below the first mode: taken for one of f², it would look like a millisecond."""
    rng = np.random.default_rng(1)
    base = np.convolve(rng.standard_normal(12000), np.ones(4) / 4, "same")
    r = np.fft.rfftfreq(48000, DT) / 3.0
    h = (1.0 + 2j * zeta * r) / (1.0 - r**2 + 2j * zeta * r)
    floor = np.fft.irfft(h * np.fft.rfft(base, 48000), 48000)[:12000]
    found = delay_of(base, floor + 1e-4 * rng.standard_normal(12000), DT)
    assert found is not None
    assert abs(found.seconds) < 2.0 * found.error < 4e-4
