"""Several records, sensors and arrays as they come: used whole, in step, and as what they are."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from omegaconf import OmegaConf

from data.datamodule import matching
from data.inspect.command import mends_of
from data.inspect.proposal import proposal
from data.measured.assembly import begins_in_motion
from data.measured.clocks import aligned
from data.measured.datamodule import split_records
from data.measured.floors import from_below, height, is_base
from data.measured.onset import onset_of
from data.measured.places import named_records
from data.measured.plausible import driven_floor, plausibility
from data.measured.raw_record import Finding, RawRecord
from data.measured.reading import read_record, read_records
from data.record import Record
from data.simulation.laws.polynomial import Polynomial
from data.simulation.motion import simulate
from data.simulation.structure import Structure
from data.windows import after_rest
from models.hysteretic_element import HystereticElement
from runner.config.compose import composed
from tests.data.odd_files import DT, T, clock, shaken, table
from tests.experiments import estimator_from, measured
from tests.models.test_starts import chain, motion

SI = {"a": "m/s^2", "s_ddot": "m/s^2"}


def write(path, samples: int, dt: float = DT, **more):
    base, roof = shaken(samples=samples)
    return table(path, {"time": clock(samples, dt), "s_ddot1": base, "a1": roof, **more}, "%.17g")


# Several records


def test_records_of_unequal_length_are_trained_on_whole(tmp_path):
    for name, samples in (("one", 1200), ("two", 2000), ("three", 1500)):
        write(tmp_path / f"{name}.csv", samples)
    data = measured(tmp_path, test="three", onset=False)
    (batch,) = data.train_dataloader()
    assert batch.a.shape == (2, 2000, 1)
    assert batch.initial_state == "rest"
    for record, padded in zip(data.records["train"], batch.a, strict=True):
        assert torch.equal(padded[-record.samples :], record.a)
        assert not padded[: 2000 - record.samples].any()


def events_of_one_file(folder, *, lacks=()):
    """Folders of events, each with a file of one and the same name."""
    for event in ("first", "second", "third"):
        (folder / event).mkdir(parents=True)
        base, roof = shaken()
        columns = {"t": clock(), "base": base, "top": roof}
        columns = {c: u for c, u in columns.items() if event not in lacks or c != "top"}
        table(folder / event / "acc.csv", columns)
    return {"time": "t", "s_ddot1": "base", "a1": "top"}


def test_files_of_one_name_in_folders_of_events_are_records_by_their_folders(tmp_path):
    where = events_of_one_file(tmp_path / "events")
    data = measured(tmp_path / "events", channels=where, units=SI, test="third_acc")
    assert data.names["train"] == ["first_acc", "second_acc"]


def test_a_record_that_lacks_a_channel_is_left_out_and_named(tmp_path):
    where = events_of_one_file(tmp_path / "events", lacks=("second",))
    data = measured(tmp_path / "events", channels=where, units=SI, test="third_acc")
    assert data.names["train"] == ["first_acc"]
    (said,) = (notes for name, notes in data.notes.items() if name.startswith("left out"))
    assert "'top'" in said[0]
    with pytest.raises(ValueError, match="names second_acc, which lacks a channel"):
        measured(tmp_path / "events", channels=where, units=SI, test="second_acc")


def test_where_one_training_record_begins_in_motion_all_begin_in_an_unknown_state(tmp_path):
    for name, first in (("rest", 0), ("cut", 900), ("other", 0)):
        base, roof = (u[first:] for u in shaken(samples=2400))
        table(tmp_path / f"{name}.csv", {"time": clock(len(base)), "s_ddot1": base, "a1": roof})
    data = measured(tmp_path, test="other", onset=False)
    (batch,) = data.train_dataloader()
    # of the one that was cut in motion a tenth of the energy comes in 13 samples, a tenth of the
    # time is 150 with nearly half of it
    assert (batch.initial_state, batch.warmup, len(batch.a)) == ("unknown", 20, 3)
    (told,) = data.notes["train: each record"]
    assert re.search(r"the first 0\.2 s, with \d+% of the motion's energy, are used", told)
    assert data.records["test"][0].initial_state == "rest"


def test_rest_before_a_record_changes_no_motion(tmp_path):
    """The response of a linear system to f, begun later, is its response, later."""
    write(tmp_path / "r.csv", 1200)
    (record,) = measured(tmp_path / "r.csv", split=0.9, onset=False).records["train"]
    later = after_rest(record, record.samples + 300)
    assert later.samples == record.samples + 300
    for name, u in record.signals().items():
        assert torch.equal(getattr(later, name)[300:], u)
        assert not getattr(later, name)[:300].any()


@pytest.mark.parametrize("deep", [False, True])
def test_arrays_of_records_by_samples(tmp_path, deep):
    pairs = [shaken(seed, 800) for seed in range(5)]
    base, roof = (np.stack(u) for u in zip(*pairs, strict=True))
    response = np.stack([roof, 2.0 * roof], axis=-1) if deep else roof
    np.savez(tmp_path / "r.npz", ground=base, acc=response, time=clock(800), level=np.arange(5))
    where = {"time": "time", "s_ddot1": "ground", "a1": "acc1" if deep else "acc"}
    records = read_records(tmp_path / "r.npz", where)
    assert list(records) == [f"r_{k}" for k in range(1, 6)]
    for raw, expected in zip(records.values(), roof, strict=True):
        assert np.array_equal(raw.channels["a1"], expected)
    data = measured(tmp_path / "r.npz", channels=where, units=SI, test=["r_4", "r_5"], onset=False)
    assert [len(data.records[split]) for split in ("train", "test")] == [3, 2]


# Onsets


def test_a_quiet_start_is_cut_and_told_and_a_moving_one_is_not(tmp_path):
    base, roof = shaken(samples=3000)
    quiet = 1e-5 * np.random.default_rng(0).standard_normal((2, 900))
    columns = {
        "time": clock(3900), "s_ddot1": np.concatenate([quiet[0], base]),
        "a1": np.concatenate([quiet[1], roof]),
    }  # fmt: skip
    table(tmp_path / "late.csv", columns)
    data = measured(tmp_path / "late.csv")
    (note,) = {n for notes in data.notes.values() for n in notes if "quiet" in n}
    assert "cut off" in note
    assert data.records["train"][0].samples < 0.5 * 3300
    assert measured(tmp_path / "late.csv", onset=False).records["train"][0].samples == 1950
    assert onset_of({"a": np.sin(clock()), "b": np.cos(clock())}, DT) == 0
    assert onset_of({"a": clock() * np.sin(9.0 * clock())}, DT) == 0  # growing from rest


def test_what_sensors_show_at_rest_is_taken_off_and_told(tmp_path):
    base, roof = shaken(samples=3000)
    quiet = 1e-5 * np.random.default_rng(0).standard_normal((2, 900))
    tilted = {
        "time": clock(3900), "s_ddot1": np.concatenate([quiet[0], base]) + 0.3,
        "a1": np.concatenate([quiet[1], roof]) - 0.2, "x1": np.concatenate([quiet[1], roof]) + 0.1,
    }  # fmt: skip
    level = {**tilted, "s_ddot1": tilted["s_ddot1"] - 0.3, "a1": tilted["a1"] + 0.2}
    table(tmp_path / "tilted.csv", tilted)
    table(tmp_path / "level.csv", level)
    of_tilted, of_level = (measured(tmp_path / f"{name}.csv") for name in ("tilted", "level"))
    for split in ("train", "test"):
        one, other = of_tilted.records[split][0], of_level.records[split][0]
        assert torch.allclose(one.a, other.a, atol=1e-6)
        assert torch.allclose(one.f, other.f, atol=1e-6)
        assert torch.equal(one.x, other.x)  # where it stands may be meant
    (note,) = {n for notes in of_tilted.notes.values() for n in notes if "quiet" in n}
    assert "s_ddot1 0.3, a1 -0.2" in note


def test_an_onset_does_not_depend_on_what_follows():
    signal = np.where(clock() > 8.0, np.sin(9.0 * clock()), 1e-6 * np.cos(40.0 * clock()))
    other = np.where(clock() > 16.0, 100.0, signal)
    assert onset_of({"a": signal}, DT) == onset_of({"a": other}, DT) == 800


# Sensors


def test_counters_without_a_common_zero_are_aligned_on_request(tmp_path):
    base, roof = shaken()
    table(tmp_path / "ground.csv", {"t": clock(), "acc": base})
    table(tmp_path / "roof.csv", {"t": clock() + 5000.0, "acc": roof})
    where = {"time": "t", "s_ddot1": "ground.csv:acc", "a1": "roof.csv:acc"}
    with pytest.raises(ValueError, match=r"no common time.*data\.align=start"):
        measured(tmp_path, channels=where)
    raw = read_record(tmp_path, where, align="start")
    assert np.abs(raw.channels["a1"] - roof).max() < 1e-5


@pytest.mark.parametrize("written", ["datetime64[ms]", "int64"])
def test_sensors_with_dates_that_began_at_other_times_are_in_step(tmp_path, written):
    base, roof = shaken()
    stamps = np.datetime64("2024-05-06T10:00:00") + (clock() * 1e3).round().astype(
        "timedelta64[ms]"
    )
    if written == "int64":
        stamps = stamps.astype("datetime64[ns]").astype(np.int64)  # too large for float64
    for name, signal, late in (("ground", base, 0), ("roof", roof, 100)):
        rows = zip(stamps[late:], signal[late:], strict=True)
        text = "".join(f"{stamp},{value:.17g}\n" for stamp, value in rows)
        (tmp_path / f"{name}.csv").write_text(f"timestamp,acc [m/s2]\n{text}")
    where = {"time": "timestamp", "s_ddot1": "ground.csv:acc", "a1": "roof.csv:acc"}
    raw = read_record(tmp_path, where)
    assert np.array_equal(raw.channels["s_ddot1"], base[100:])
    assert np.array_equal(raw.channels["a1"], roof[100:])


def test_files_that_say_other_rates_are_not_read_at_the_rate_of_the_first(tmp_path):
    base, roof = shaken()
    for name, signal, rate in (("ground", base, 200), ("roof", roof, 100)):
        text = "".join(f"{value:.17g}\n" for value in signal)
        (tmp_path / f"{name}.txt").write_text(f"Sampling rate: {rate} Hz\nacc [m/s2]\n{text}")
    where = {"s_ddot1": "ground.txt:acc", "a1": "roof.txt:acc"}
    with pytest.raises(ValueError, match=r"other steps \[s\].*0\.005.*0\.01.*data\.align=start"):
        read_record(tmp_path, where)
    raw = read_record(tmp_path, where, align="start")
    assert [clock[1] for clock in raw.clocks.values()] == [0.005, 0.01]


def test_sensors_of_unlike_length_are_split_within_the_time_that_they_share():
    clocks = {"s_ddot1": clock(1001), "a1": clock(2001)}
    raw = RawRecord("two", None, None, {c: np.sin(t) for c, t in clocks.items()}, clocks)
    for parts in split_records({"two": raw}, None, None, 0.5).values():
        (part,) = parts.values()
        assert len(part.channels["s_ddot1"]) in (500, 501)


def test_alignment_by_motion_finds_and_tells_the_lag():
    base, _ = shaken()
    other = np.roll(base, 130)
    clocks = {"s_ddot1": clock(), "a1": clock() + 77.0}
    raw = aligned(RawRecord("r", None, None, {"s_ddot1": base, "a1": other}, clocks), "motion")
    assert any("a1 shifted by -1.3 s onto s_ddot1" in note for note in raw.notes)
    noise = np.random.default_rng(0).standard_normal(len(base))
    with pytest.raises(ValueError, match="finds nothing of s_ddot1 in a1"):
        aligned(RawRecord("r", None, None, {"s_ddot1": base, "a1": noise}, clocks), "motion")


# What channels mean


def test_relative_accelerations_are_taken_as_said_and_doubted_otherwise(tmp_path):
    base, roof = shaken()
    path = table(tmp_path / "r.csv", {"time": clock(), "s_ddot1": base, "a1": roof - base}, "%.17g")
    absolute = measured(path)
    assert any("accelerations=relative" in n for notes in absolute.notes.values() for n in notes)
    relative = measured(path, accelerations="relative")
    assert not any("doubtful" in n for notes in relative.notes.values() for n in notes)
    first = relative.records["train"][0]
    assert np.allclose(first.a[:, 0], (roof - base)[: first.samples])


@pytest.mark.parametrize("factor", [1e-6, 1.0, 1e6])
def test_base_and_response_fit_together_in_any_unit(factor):
    base, roof = shaken()
    assert plausibility({"s_ddot1": factor * base, "a1": factor * roof}, DT) == []
    (fault,) = plausibility({"s_ddot1": factor * base, "a1": factor * roof / 9.81}, DT)
    assert fault.what == "units that do not fit"
    assert "9.807 times apart, as g and m/s^2 are" in fault.message
    (fault,) = plausibility({"s_ddot1": factor * base, "a1": 386.0886 * factor * roof}, DT)
    assert "386.1 times apart, as in/s^2 and g are" in fault.message
    (fault,) = plausibility({"s_ddot1": factor * base, "a1": 980.665 * factor * roof}, DT)
    assert all(f"apart, as {unit} and g are" in fault.message for unit in ("cm/s^2", "mg"))


def displacement(a: np.ndarray) -> np.ndarray:
    """∬a dt² (T,) of a band above 0.3 Hz."""
    f = np.fft.rfftfreq(len(a), DT)
    rates = np.where(f > 0.3, -((2.0 * np.pi * np.maximum(f, 0.3)) ** 2), np.inf)
    return np.fft.irfft(np.fft.rfft(a) / rates, len(a))


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("accelerations", ["absolute", "relative"])
def test_displacements_from_a_point_at_rest_are_told_by_their_second_derivative(
    tmp_path, noise, accelerations
):
    """A laser beside the table measures the table's motion, too; such columns are left out."""
    base, roof = shaken()
    near, ground = displacement(roof - base), displacement(base)
    rng = np.random.default_rng(1)
    for x, said in ((near, []), (near + ground, ["absolute displacements"])):
        x = x + noise * x.std() * rng.standard_normal(len(x))
        a = roof if accelerations == "absolute" else roof - base
        found = plausibility({"s_ddot1": base, "a1": a, "x1": x}, DT, accelerations)
        assert [one.what for one in found] == said
        alone = plausibility({"s_ddot1": base, "x1": x}, DT)
        assert [(one.what, one.blocks) for one in alone] == [(what, True) for what in said]
        unsaid = plausibility({"s_ddot1": base, "a1": roof - base, "x1": x}, DT)
        assert [one.what for one in unsaid] == ["relative accelerations", *said]
        columns = {"t": clock(), "Table acc [m/s^2]": base, "Roof acc [m/s^2]": roof}
        path = table(tmp_path / "r.csv", {**columns, "Roof disp [m]": x}, "%.9g")
        assert ("x1" in proposal([str(path)], {}, {}).columns) == (not said)


@pytest.mark.parametrize(("factor", "asked"), [(1.0, ""), (1e3, "mm and m"), (1.4, "")])
@pytest.mark.parametrize("motion", ["x", "v"])
def test_a_motion_and_its_rate_in_units_that_cannot_both_be_right_are_asked_about(
    tmp_path, motion, factor, asked
):
    """Known to a factor, the derivative of a motion is the rate beside it."""
    base, roof = shaken()
    x = displacement(roof - base)
    signal, unit = (x, "m") if motion == "x" else (np.gradient(x, DT), "m/s")
    columns = {"t": clock(), "Table acc [m/s^2]": base, "Roof acc [m/s^2]": roof}
    path = table(tmp_path / "r.csv", {**columns, f"Roof [{unit}]": factor * signal}, "%.9g")
    questions = proposal([str(path)], {}, {}).questions
    assert [option for _, option in questions] == [f"data.units.{motion}"] * bool(asked)
    assert all(asked in text for text, _ in questions)
    assert proposal([str(path)], {}, {motion: f"m{unit}"}).questions == [] or not asked


def test_a_harmonic_motion_puts_no_unit_in_doubt():
    """Well below resonance a drift is a share of the motion of its floor, at one frequency."""
    t, rate = clock(), 2.0 * np.pi * 1.3
    s, x = (size * np.sin(rate * t + turn) for size, turn in ((1e-2, 0.0), (1e-3, -0.1)))
    a = -(rate**2) * (s + x)
    noise = np.random.default_rng(0).standard_normal((2, len(t)))
    x, a = (u + 0.01 * u.std() * e for u, e in zip((x, a), noise, strict=True))
    assert plausibility({"s1": s, "x1": x, "a1": a}, DT) == []


@pytest.mark.parametrize("clock_below", [True, False])
def test_names_below_those_of_groups_belong_to_them(tmp_path, clock_below):
    """Ground, and below it X and Y: the axis is no floor of its own."""
    rows = np.column_stack([clock(), *(k * shaken(seed=k)[1] for k in range(1, 5))])
    path = tmp_path / "r.csv"
    first, second = ("", "Time") if clock_below else ("Time", "")
    head = f"{first},Ground,,Floor 1,\n{second},X,Y,X,Y\ns,g,g,g,g"
    np.savetxt(path, rows, delimiter=",", header=head, comments="")
    columns = {"time": "Time", "s_ddot1": "Ground Y", "a1": "Floor 1 Y"}
    assert proposal([str(path)], {}, {}).columns == columns


def test_a_clock_that_counts_samples_is_none_where_the_file_says_their_step(tmp_path):
    base, roof = shaken()
    path = tmp_path / "r.csv"
    for head, named in ((f"# fs = {1 / DT:g} Hz\n", False), ("", True)):
        rows = np.column_stack([np.arange(T), base, roof])
        head += "Time,Ground acc (g),Roof acc (g)"
        np.savetxt(path, rows, delimiter=",", header=head, comments="")
        found = proposal([str(path)], {}, {})
        assert ("time" in found.columns) == named
        assert found.records[0].raw.dt == (None if named else pytest.approx(DT))


@pytest.mark.parametrize("name", ["Roof rel. acc (g)", "roof_rel (g)", "Roof relay acc (g)"])
def test_names_say_that_accelerations_are_relative(tmp_path, name):
    path = table(
        tmp_path / "r.csv",
        {"t": clock()[:99], "Ground (g)": clock()[:99] ** 2, name: clock()[:99] ** 3},
    )
    relative = proposal([str(path)], {}, {}).settings.get("accelerations") == "relative"
    assert relative == ("relay" not in name)


def test_floors_of_a_german_house_are_in_order():
    words = ["Dach", "2. OG", "1. OG", "EG", "Keller"]
    assert sorted(words, key=height, reverse=True) == words
    assert is_base("Keller")


def test_a_floor_in_another_unit_than_its_base_is_asked_about(tmp_path):
    base, roof = shaken()
    for gain, questions in ((1.0, 0), (1.0 / 9.80665, 1), (0.2, 0)):
        columns = {"time": clock(), "s_ddot1": base, "a1": gain * roof}
        found = proposal([str(table(tmp_path / "r.csv", columns, "%.9g"))], {}, {})
        assert [option for _, option in found.questions] == ["data.units.a1"] * questions


def test_a_sensor_that_points_the_other_way_gets_a_minus_before_its_unit(tmp_path):
    """Well below resonance a floor moves with its base; an element supplies no energy.

    But what it held when the record began: one that is let go is as it should be.
    """
    let_go = {"Extension (mm)": 3.0 - clock() / 9.0, "Load (kN)": 3.0 - clock() / 9.0}
    assert "units" not in proposal([str(table(tmp_path / "r.csv", let_go))], {}, {}).settings
    base, roof = shaken(seed=1)
    s = np.interp(
        np.arange(T), np.linspace(0, T, 9), [0.0, 1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 3.0, 0.0]
    )
    held = np.zeros(T)
    for k in range(1, T):
        held[k] = np.clip(held[k - 1] + s[k] - s[k - 1], -0.5, 0.5)
    records = {
        "a1": {"t": clock(), "Table acc (g)": base, "Roof acc (g)": roof},
        "r1": {"Extension (mm)": s, "Load (kN)": held + 0.1 * s},
        "r1 elastic": {"Extension (mm)": s, "Load (kN)": s + 0.1 * s**3},
        "r1 damper": {"Extension (mm)": s, "Load (kN)": np.gradient(s)},
    }
    for name, columns in records.items():
        channel, last = name[:2], list(columns)[-1]
        unit = last.rpartition("(")[2].strip(")")
        for sign, said in ((1.0, {}), (-1.0, {channel: f"-{unit}"})):
            turned = {**columns, last: sign * columns[last]}
            path = table(tmp_path / "r.csv", turned, "%.9g")
            found = proposal([str(path)], {}, {})
            assert found.settings.get("units", {}) == said, (name, sign)
            assert dict(composed(*found.words).data.units).items() >= said.items()
            raw = read_record(path, found.columns, found.settings.get("units"))
            factor = 9.80665 if unit == "g" else 1e3
            assert raw.channels[channel] == pytest.approx(factor * columns[last], abs=1e-5)


def shaken_floor(floor: int, band: float, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """A force (T,) up to `band` [Hz] on a floor of a chain of 0.8 to 3.2 Hz; accelerations."""
    rng, f = np.random.default_rng(floor), np.fft.rfftfreq(T, DT)
    force = np.fft.rfft(rng.standard_normal(T)) * ((f > 0.2) & (f < band))
    squares, modes = np.linalg.eigh(
        np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    )
    w, rates = 2.0 * np.pi * f, (2.0 * np.pi * 1.78) ** 2 * squares
    below = rates[:, None] - w**2 + 0.06j * np.sqrt(rates)[:, None] * w
    a = np.fft.irfft(-(w**2) * (modes @ (modes[floor, :, None] / below)) * force, T)
    return np.fft.irfft(force, T), a + noise * a.std() * rng.standard_normal(a.shape)


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize("floor", range(3))
def test_the_floor_that_a_force_drives_takes_up_power_at_every_frequency(tmp_path, floor, noise):
    """A force below the second mode moves all floors alike: then somebody has to say it."""
    for band, found in ((10.0, floor + 1), (1.5, None)):
        force, a = shaken_floor(floor, band, noise if found else 0.1)
        assert driven_floor(1e6 * force, {i + 1: 1e-3 * a[i] for i in range(3)}) == found
        names = ("Shaker (N)", "Floor 1 (g)", "Floor 2 (g)", "Roof (g)")
        columns = {"t": clock(), **dict(zip(names, (force, *a), strict=True))}
        path = str(table(tmp_path / "r.csv", columns, "%.9g"))
        proposed = proposal([path], {}, {})
        assert proposed.columns[f"f{found or 1}"] == "Shaker"
        assert [option for _, option in proposed.questions] == (
            [] if found else ["data.channels.f1=COLUMN"]
        )
        said = proposal([path], {"f2": "Shaker"}, {})  # one answer, and the rest is as guessed
        assert not said.questions
        assert {c: said.columns[c] for c in ("time", "a1", "a3", "f2")} == {
            "time": "t", "a1": "Floor 1", "a3": "Roof", "f2": "Shaker",
        }  # fmt: skip


def building(seed: int = 0, samples: int = 2000) -> dict[str, np.ndarray]:
    """Absolute accelerations of the ground and of three floors that yield, with 2 % of noise."""
    record = motion(chain(base=True, yielding=0.5), samples, noise=0.02, seed=seed)
    ground = -record.f[:, 0]
    floors = (record.a + ground[:, None]).T
    return dict(zip(("ground", "1", "2", "3"), map(np.asarray, (ground, *floors)), strict=True))


@pytest.mark.parametrize("seed", range(4))
def test_floors_whose_names_say_no_height_are_in_the_order_of_their_motion(tmp_path, seed):
    """In the first mode floors move the more the higher they are; noise says no order."""
    a = building(seed)
    names = {"ground": "Base (g)", "3": "Attika (g)", "2": "z=7.0 (g)", "1": "z=3.5 (g)"}
    path = table(tmp_path / "r.csv", {"t": clock(2000)} | {n: a[c] for c, n in names.items()})
    found = proposal([str(path)], {}, {})
    assert [found.columns[f"a{k}"] for k in (1, 2, 3)] == ["z=3.5", "z=7.0", "Attika"]
    assert from_below(a["ground"], {c: a[c] for c in "312"}) == ["1", "2", "3"]
    assert from_below(a["ground"], {}) == from_below(a["ground"], {"1": a["1"]}) == []
    noise = np.random.default_rng(seed).standard_normal((4, 2000))
    assert from_below(noise[0], dict(zip("123", noise[1:], strict=True))) == []


@pytest.mark.parametrize(("below", "above"), [(3e4, 1e5), (1e5, 1e5), (3e5, 3e5), (1e6, 1e5)])
def test_floors_under_a_ground_faster_than_the_frame_are_not_put_upside_down(below, above):
    """Above its resonance the lower floor moves more against the ground than the upper one."""
    rng, T = np.random.default_rng(5), 2500
    parts = {
        "r1": Polynomial(between=("ground", "x1"), stiffness=below, damping=0.02 * below),
        "r2": Polynomial(between=("x1", "x2"), stiffness=above, damping=0.02 * above),
    }
    frame = Structure([1e4, 1e4], parts)
    octaves = np.log(np.maximum(np.fft.rfftfreq(T, 0.01), 0.01) / 3.0) / 0.6
    phases = 2j * np.pi * rng.random(len(octaves))
    a = np.fft.irfft(np.exp(phases - 0.5 * octaves**2), T) * np.minimum(np.arange(T) / 300.0, 1.0)
    run = simulate(frame, -a[:, None] * frame.masses, 0.01)
    lower, upper = (run.a + a[:, None]).T
    assert from_below(a, {"upper": upper, "lower": lower}) in ([], ["lower", "upper"])


def test_an_order_that_the_motion_contradicts_is_told(tmp_path):
    a = building()
    columns = {"t": clock(2000), "Base (g)": a["ground"]}
    for upwards in (True, False):
        floors = {f"Acc {k} (g)": a[str(k if upwards else 4 - k)] for k in (1, 2, 3)}
        found = proposal([str(table(tmp_path / "r.csv", {**columns, **floors}))], {}, {})
        told = [f.message for f in found.records[0].findings if f.what == "order of floors"]
        assert len(told) == (not upwards)
        assert all("order a3, a2, a1 from the lowest floor up" in text for text in told)
        assert not found.questions


@pytest.mark.parametrize("words", [("Long", "Trans"), ("H1", "V"), ("E", "Z"), ("raw", "clean")])
def test_sensors_of_one_place_are_chosen_by_the_same_word(tmp_path, words):
    """Whatever the word means, in any order of the columns: never one floor along, one across."""
    along, across = building(0), {c: 0.5 * u for c, u in building(1).items()}
    names = {"ground": "Ground", "3": "Roof", "1": "1st floor", "2": "2nd floor"}
    columns = {"t": clock(2000)}
    for k, (c, name) in enumerate(names.items()):
        pair = [(f"{name} {words[0]} (g)", along[c]), (f"{name} {words[1]} (g)", across[c])]
        columns |= dict(pair[:: 1 if k % 2 else -1])
    found = proposal([str(table(tmp_path / "r.csv", columns))], {}, {})
    chosen = [column for c, column in found.columns.items() if c != "time"]
    assert chosen == [f"{names[c]} {words[0]}" for c in ("ground", "1", "2", "3")]


def test_integrals_of_absolute_accelerations_in_a_folder_are_left_out(tmp_path):
    """Programs write acceleration, velocity and displacement of each sensor, from a rest."""
    a = building()
    for name, u in {"Base": a["ground"], "Floor 1": a["1"], "Roof": a["3"]}.items():
        v = np.cumsum(u - u.mean()) * DT
        columns = {"Time (s)": DT * np.arange(len(u)), "Acc (m/s^2)": u - u.mean()}
        columns |= {"Vel (m/s)": v, "Disp (m)": np.cumsum(v - v.mean()) * DT}
        table(tmp_path / f"{name}.csv", columns, "%.9g")
    found = proposal([str(tmp_path)], {}, {})
    assert set(found.columns) == {"time", "s_ddot1", "a1", "a2"}
    assert found.settings["channels"] == found.columns
    assert not found.questions


def test_beside_a_ground_that_is_said_the_others_are_of_its_axis(tmp_path):
    along, across = building(0), building(1)
    columns = {"t": clock(2000)}
    for k, c in enumerate(("ground", "1", "2", "3")):
        columns |= {f"Acc {k} EW (g)": across[c], f"Acc {k} NS (g)": along[c]}
    found = proposal([str(table(tmp_path / "r.csv", columns))], {"s_ddot1": "Acc 0 NS"}, {})
    assert not found.questions
    assert found.columns == {
        "time": "t", "s_ddot1": "Acc 0 NS", **{f"a{k}": f"Acc {k} NS" for k in (1, 2, 3)}
    }  # fmt: skip


def test_other_inputs_of_an_element_are_excitation(tmp_path):
    s = 0.01 * np.sin(5.0 * clock())
    volts = 2.0 + np.sin(clock())
    columns = {"time": clock(), "s1": s, "r1": volts * s, "u1": volts}
    path = table(tmp_path / "r.csv", columns, "%.17g")
    data = measured(path, units={"u1": "V"})
    (record,) = data.records["train"]
    assert data.inputs == 3
    assert np.allclose(record.excitation[:, 2], volts[: record.samples])
    assert data.units["u1"] == "V"
    model = {"_target_": "models.HystereticElement", "name": "hysteretic_element"}
    element = estimator_from(OmegaConf.create({**model, "other_inputs": None}), data)
    assert isinstance(element, HystereticElement)
    assert element.others is not None
    branch = OmegaConf.create({"_target_": "models.BranchElement", "name": "branch_element"})
    with pytest.raises(ValueError, match=r"branch_element has no .* u1; .*model.laws=units"):
        estimator_from(branch, data)


# Records that begin at rest, and parts that begin in motion


def of_a_chain(base: bool, seed: int) -> Record:
    return motion(chain(base, 0.5), 2000, noise=0.02, seed=seed)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("seed", range(2))
def test_a_record_from_rest_and_a_part_of_it_are_told_apart(seed, size):
    whole = of_a_chain(True, seed)
    whole = replace(whole, a=size * whole.a, f=size * whole.f)
    assert not begins_in_motion(whole, based=True)
    assert all(begins_in_motion(whole.window(k, 1000), based=True) for k in (500, 700, 900))


def test_an_offset_of_the_sensors_is_no_motion():
    whole = of_a_chain(True, 0)
    assert not begins_in_motion(replace(whole, a=whole.a + 9.81), based=True)


def test_slow_motion_from_rest_has_a_mean_in_its_first_part():
    t = 0.01 * torch.arange(1000, dtype=torch.float64)
    slow = (t**2 * torch.exp(-0.3 * t))[:, None]  # rises for seconds
    noise = 0.002 * torch.randn(1000, 1, generator=torch.Generator().manual_seed(0)).double()
    record = Record(0.01, slow + noise, torch.sin(t)[:, None])
    assert not begins_in_motion(record, based=False)
    assert not begins_in_motion(replace(record, a=record.a + record.f), based=True)


@pytest.mark.parametrize("seed", range(2))
def test_a_displacement_that_begins_with_a_slope_moves(seed):
    t = 0.01 * torch.arange(1000, dtype=torch.float64)
    noise = 0.005 * torch.randn(1000, generator=torch.Generator().manual_seed(seed)).double()
    u = torch.zeros(1000, 1, dtype=torch.float64)
    for x, moves in ((t**2 * torch.sin(5.0 * t) / 25.0, False), (torch.sin(5.0 * t), True)):
        record = Record(0.01, (3.0 + x + noise)[:, None], u, quantity="displacement")
        assert begins_in_motion(record, based=False) == moves


def test_a_force_that_is_on_from_the_first_sample_tells_nothing():
    assert not begins_in_motion(of_a_chain(False, 0).window(500, 1000), based=False)


# Read wrongly without a word before


def test_units_of_labview_go_to_their_columns_in_any_order(tmp_path):
    head = "LabVIEW Measurement\nSeparator\tTab\nDecimal_Separator\t.\n***End_of_Header***\n"
    head += "Channels\t2\nY_Unit_Label\tg\tm/s^2\n***End_of_Header***\nX_Value\tRoof\tBase\n"
    rows = "\n".join(f"{0.01 * k:.2f}\t{k % 3}\t{k % 5}" for k in range(60))
    (tmp_path / "test.lvm").write_text(head + rows + "\n")
    raw = read_record(tmp_path / "test.lvm", {"time": "X_Value", "s_ddot1": "Base", "a1": "Roof"})
    assert raw.channels["s_ddot1"].max() == 4.0
    assert raw.channels["a1"].max() == pytest.approx(2.0 * 9.80665)


def test_two_recordings_of_a_minute_are_no_clock_that_begins_again(tmp_path):
    minute = clock(6000)
    base, roof = shaken(samples=12_000)
    columns = {"time": np.concatenate([minute, minute]), "s_ddot1": base, "a1": roof}
    raw = read_record(table(tmp_path / "two.csv", columns))
    assert (np.diff(raw.own_time()) < 0.0).sum() == 1


def test_clocks_of_sensors_a_minute_apart_are_not_put_in_step(tmp_path):
    for name, start in (("a", 59.0), ("b", 60.5)):
        columns = {"time": (start + clock(12_000)) % 60.0, "Acc": shaken(samples=12_000)[1]}
        table(tmp_path / f"{name}.csv", columns)
    places = {"time": "time", "s_ddot1": "a.csv:Acc", "a1": "b.csv:Acc"}
    raw = read_record(tmp_path, places)
    assert len(raw.clocks) == 2 or (np.diff(raw.own_time()) < 0.0).any()


def test_strain_in_percent_is_a_hundredth_and_a_rate_of_ten_milliseconds_a_step(tmp_path):
    (tmp_path / "rate.csv").write_text(
        "Sampling rate: 10 ms\nstrain1 [%],a1 [m/s^2]\n"
        + "\n".join(f"{k % 7},{k % 5}" for k in range(60))
    )
    raw = read_record(tmp_path / "rate.csv")
    assert raw.dt == pytest.approx(0.01)
    assert raw.channels["strain1"].max() == pytest.approx(0.06)


def test_records_of_files_and_folders_of_one_name_are_all_kept(tmp_path):
    for place in ("x1/run", "y1/run"):
        (tmp_path / place).mkdir(parents=True)
        np.savez(tmp_path / place / "e.npz", a1=np.random.default_rng(0).normal(size=(3, 100, 1)))
    found, _ = named_records([str(tmp_path / place / "e.npz") for place in ("x1/run", "y1/run")])
    assert len(found) == 6


def test_a_record_with_brackets_is_called_by_its_name():
    assert matching(["run[1]", "run[2]"], "run[1]", "test") == ["run[1]"]


def test_a_column_named_as_a_setting_is_none():
    faults = [Finding("no unit", "", "'Roof data.mend.fill=9' has none; the floor's offset: "
                      "data.mend.detrend=mean removes the sensor's")]  # fmt: skip
    assert mends_of(faults) == ["data.mend.detrend=mean"]
