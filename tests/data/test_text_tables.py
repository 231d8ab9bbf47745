"""Text files as loggers and people write them: names, units and values by what rows are."""

from __future__ import annotations

import re
import time

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.readers import outcome
from data.annotations import fits
from data.inspect.proposal import proposal
from data.measured.files.columns import FileError
from data.measured.files.table import read_table
from data.measured.mend import Mending
from data.measured.reading import read_record
from data.measured.signal_faults import blocking
from runner.config.compose import composed
from tests.data.odd_files import DT, T, clock, shaken, table
from tests.data.written_files import written

ROWS = "\n".join(f"{0.01 * k:.2f},{k % 7 - 3},{k % 5 - 2}" for k in range(40))


@settings(
    deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.integers(0, 10**6), st.booleans())
def test_no_written_file_is_misread(tmp_path, seed, held):
    end = outcome(written(seed, held), tmp_path / "record.csv")
    assert end != "WRONG"
    assert not end.startswith("refused")


def read(tmp_path, text: str, **reader):
    path = tmp_path / "record.csv"
    path.write_text(text)
    return read_table(path, **reader)


HEADS = {  # what stands above the rows
    "a logger's": '"TOA5","S","CR6","7"\n"t","a","b"\n"s","g","mm"\n"","Smp","Smp"',
    "units above names": "s,g,mm\nt,a,b",
    "a unit that opens with a percent sign": "a title\n\nt,a,b\ns,g,mm",
    "a title of as many cells": "run 1,north,2nd test\nt [s],a [g],b [mm]",
    "keys, one of them a time": "dt,0.01\nrate,100\nt [s],a (g),b, mm".replace("b, mm", '"b, mm"'),
    "names between tabs": "t [s]\ta [g]\tb [mm]",
    "a comment": "# t [s],a [g],b [mm]",
    "keys with a value for each column": "No,C1,C2\nt,a,b\nRange,50,50\nUnit,g,mm".replace(
        "Unit", "s"
    ),
    "results of few rows, of as many cells": '"","Load","At"\n"","(kN)","(mm)"\n"1","17","2"\n\n'
    "t,a,b\n(s),(g),(mm)",
}


@pytest.mark.parametrize("head", HEADS.values(), ids=list(HEADS))
def test_names_and_units_are_found_by_what_rows_are(tmp_path, head):
    found = read(tmp_path, f"{head}\n{ROWS}\n")
    assert [name[0] for name in found.columns] == ["t", "a", "b"]
    path = tmp_path / "record.csv"
    names = dict(zip(("time", "s_ddot1", "x1"), found.columns, strict=True))
    raw = read_record(path, names)
    assert raw.channels["s_ddot1"][0] == pytest.approx(-3 * 9.80665)
    assert raw.channels["x1"][0] == pytest.approx(-2e-3)
    assert not raw.unsaid


def test_the_spelling_of_a_clock_stands_in_a_row_of_units(tmp_path):
    rows = "".join(f"10:00:{k:02d},{k},{k * k}\n" for k in range(20))
    found = read(tmp_path, f"Time,Base,Roof\nhh:mm:ss,g,mm\n{rows}")
    assert found.units == {"Time": "s", "Base": "g", "Roof": "mm"}


def test_a_percent_sign_of_a_unit_is_no_comment(tmp_path):
    assert read(tmp_path, f"a,b,c\n%g,g,mm\n{ROWS}\n").units["a"] == "%g"


def test_a_remark_behind_a_row_and_rows_without_values_are_left_out(tmp_path):
    first, *rows = ROWS.splitlines()
    text = "\n".join(["t,a,b,Events", f"{first}, Start", *rows, *[",,"] * 30_000])
    found = read(tmp_path, text + "\n")
    assert [len(u) for u in found.columns.values()] == [40, 40, 40]
    assert "30000 rows without values at the end left out" in found.notes


@pytest.mark.parametrize(
    ("footer", "note"),
    [
        ("End of data,,\n\nSigned: A. B.\n", "2 lines without a number at the end left out"),
        ("# mean 0.5\n", "comments at the end left out"),
        ("# mean 0.5\nThe end", "2 lines without a number at the end left out"),
        ("", ""),
    ],
)
def test_words_behind_the_rows_are_left_out_and_told(tmp_path, footer, note):
    found = read(tmp_path, f"t,a,b\n{ROWS}\n{footer}")
    assert [len(u) for u in found.columns.values()] == [40, 40, 40]
    assert note in (*found.notes, "")


@pytest.mark.parametrize("footer", ["Max,3,2", "0.40,x"])
def test_a_number_behind_the_rows_is_no_footer(tmp_path, footer):
    with pytest.raises(FileError, match="line 42"):
        read(tmp_path, f"t,a,b\n{ROWS}\n{footer}\n")


def test_one_series_in_several_columns_is_one_or_asked_about(tmp_path):
    values = np.sin(0.1 * np.arange(157))
    rows = [" ".join(f"{v:.6f}" for v in values[k : k + 8]) for k in range(0, 157, 8)]
    said = "ACCELERATION UNIT: CM/SEC/SEC\nNO. OF POINTS: 157 EQUALLY SPACED INTERVALS OF: 0.02 SEC"
    found = read(tmp_path, "\n".join([said, *rows]))
    assert np.abs(found.columns["acceleration"] - values).max() < 1e-6
    assert (found.units, found.facts) == ({"acceleration": "CM/SEC/SEC"}, {"dt": 0.02})
    for reader in ({}, {"header": False}):
        with pytest.raises(FileError, match="look like one series") as caught:
            read(tmp_path, "\n".join(rows[:-1]), **reader)
        remedy = re.search(r"'(points: )N'", str(caught.value))
        assert remedy is not None
        found = read(tmp_path, "\n".join([f"{remedy[1]}{8 * len(rows[:-1])}", *rows[:-1]]))
        assert len(found.columns["values"]) == 152


def test_several_series_and_rows_that_are_channels_are_told_as_such(tmp_path):
    """With advice that helps: one file for each, a column for each."""
    values = np.sin(0.1 * np.arange(156))
    rows = [" ".join(f"{v:.6f}" for v in values[k : k + 6]) for k in range(0, 156, 6)]
    head = "TIMESERIES A_B_HNE, 156 samples, 100 sps, 2024-03-12T10:12:00.000, SLIST, FLOAT, M/S**2"
    with pytest.raises(FileError, match="begins another series; write a file for each"):
        read(tmp_path, "\n".join(2 * [head, *rows]))
    alone = read(tmp_path, "\n".join([head, *rows]))
    assert (len(alone.columns["values"]), alone.facts) == (156, {"dt": 0.01})
    channels = [
        f"{name},{','.join(f'{v:.4f}' for v in values)}" for name in ("Time", "Ground", "1F")
    ]
    with pytest.raises(FileError, match=r"is a channel, as is each; .*\(transpose\)"):
        read(tmp_path, "\n".join(channels))


def test_keys_in_letters_that_are_not_known_are_keys_too(tmp_path):
    names = '"CH名称","振動台","1F"\n"単位","G","G"\n"校正係数","1.0","1.0"\n'
    (tmp_path / "r.csv").write_bytes(f"{names}{ROWS}\n".encode("shift_jis"))
    found = read_table(tmp_path / "r.csv")
    assert [len(u) for u in found.columns.values()] == [40, 40, 40]
    assert found.units == {"c2": "G", "1F": "G"}


def test_columns_that_are_said_are_read_though_another_cannot_be(tmp_path):
    """The remedy "leave the column out (data.channels)" works without a word about the clock."""
    rows = ROWS.replace("\n0.20,", "\n0.20,OVER")
    (tmp_path / "r.csv").write_text(f"n,Table acc [g],Roof acc [g]\n{rows}\n")
    with pytest.raises(FileError, match="leave the column out"):
        proposal([str(tmp_path / "r.csv")], {}, {})
    found = proposal([str(tmp_path / "r.csv")], {"a1": "Roof acc"}, {})
    assert found.columns == {"a1": "Roof acc"}


def test_numbers_that_fill_their_columns_are_separated_at_the_minus(tmp_path):
    values = np.stack([0.01 * np.arange(40), 900.0 * np.cos(np.arange(40)), -1e3 - np.arange(40)])
    rows = "\n".join("".join(f"{v:8.2f}" for v in row) for row in values.T)
    assert re.search(r"\d-\d", rows)
    found = read(tmp_path, f"    TIME    ACC1    ACC2\n{rows}\n")
    assert list(found.columns) == ["TIME", "ACC1", "ACC2"]
    assert np.abs(np.stack(list(found.columns.values())) - values).max() < 0.006
    with pytest.raises(FileError, match="line 3"):
        read(tmp_path, "t a b\n0.0 1.0-2.0\n0.1 1.0\n0.2 1.0-2.0\n" + "0.3 1.0 2.0\n" * 20)


@pytest.mark.parametrize("longer", [0, 7])
def test_recordings_side_by_side_are_records(tmp_path, longer):
    names = ["t [s]", "Base [g]", "Roof [g]"]
    head = f"Run 1,,,,Run 2,,\n{','.join(names)},,{','.join(names)}\n"
    rows = [f"{0.01 * k:.2f},{k % 7 - 3},{k % 5}" for k in range(40 + longer)]
    both = [f"{rows[k]},," + (rows[k] if k < 40 else ",,") for k in range(len(rows))]
    first, second = (read(tmp_path, head + "\n".join(both), record=k) for k in (1, 2))
    assert (first.records, list(second.columns)) == (2, ["t", "Base", "Roof"])
    assert [len(table.columns["t"]) for table in (first, second)] == [40 + longer, 40]
    assert second.units == {"t": "s", "Base": "g", "Roof": "g"}
    whole = read(tmp_path, head + "\n".join(both), columns=["Run 2 t", "Run 2 Base"])
    assert whole.records == 1


@pytest.mark.parametrize(
    ("second", "steps", "asked"),
    [("Time B [s]", 0.02, True), ("Time B [s]", 0.01, False), ("Time B [ms]", 10.0, False),
     ("Time B [ms]", 5.0, True), ("Timestamp", 10.0, False), ("Timestamp", 0.005, True)],
)  # fmt: skip
def test_a_second_clock_of_other_steps_is_asked_about(tmp_path, second, steps, asked):
    base, roof = shaken()
    t = np.arange(len(base))
    columns = {"Time A [s]": DT * t, "Base [g]": base, second: steps * t, "Roof [g]": roof}
    path = table(tmp_path / "r.csv", columns)
    found = proposal([str(path)], {}, {})
    assert ("data.channels.time" in [option for _, option in found.questions]) == asked
    assert not proposal([str(path)], {"time": "Time A"}, {}).questions


@pytest.mark.parametrize("rows", [157, 160])
def test_one_series_whose_key_has_as_many_words_as_its_rows_have_values_is_read(tmp_path, rows):
    values = np.sin(0.1 * np.arange(rows))
    lines = ["  ".join(f"{v:.6f}" for v in values[k : k + 4]) for k in range(0, rows, 4)]
    said = ["ACCELERATION UNIT: m s^-2", f"NO. OF POINTS: {rows} INTERVAL: 0.02 SEC"]
    found = read(tmp_path, "\n".join([*said, *lines]))
    assert np.abs(found.columns["acceleration"] - values).max() < 1e-6


@pytest.mark.parametrize(
    ("keys", "unit"),
    [
        ("STATION_CODE: T1A\nUNITS: cm/s^2\nSAMPLING_INTERVAL_S: 0.010000\nNDATA: 40\n"
         "DATA_TYPE: ACCELERATION\nUSER1: \n", "cm/s^2"),  # of ESM
        ("DATE_TIME_FIRST_SAMPLE_PRECISION: milliseconds\nSAMPLING_INTERVAL_S: 0.010000\n"
         "NDATA: 40\nUNITS: cm/s^2\n", "cm/s^2"),  # whose precision is no name of the column
        ("# Tasa de muestreo: 100 muestras/s\n# Aceleracion, unidades: m/s/s\n"
         "# Numero de muestras: 40\n", "m/s/s"),
    ],
)  # fmt: skip
def test_one_column_below_keys_has_their_step_and_unit(tmp_path, keys, unit):
    values = np.sin(0.1 * np.arange(40))
    found = read(tmp_path, keys + "\n".join(f"{v:.6f}" for v in values))
    ((name, column),) = found.columns.items()
    assert np.abs(column - values).max() < 1e-6
    assert (found.units, found.facts) == ({name: unit}, {"dt": 0.01})


REFUSED = ["0,2\n1,3\n2,4\n", "A station\n\n0,2,1\n1,3,1\n2,4,1\n", "t,1,2\n0,2,3\n1,3,4\n",
           "a\n0,5\n1,5\n2,5\n", "A;B\n1,234;5\n2,345;6\n", "t a\n0,2,3\n1,3,4\n"]  # fmt: skip


@pytest.mark.parametrize("text", REFUSED)
def test_advice_on_reading_works_where_it_is_given(tmp_path, text):
    reader = {}
    with pytest.raises(FileError) as caught:
        read(tmp_path, text)
    for key, value in re.findall(r"data\.(\w+)=(\S+?)[,;]?(?= |$)", str(caught.value)):
        reader[key] = {"false": False}.get(value, int(value) if value.isdigit() else value[1:-1])
    assert not reader or read(tmp_path, text, **reader).columns


def test_rows_from_the_last_time_to_the_first_are_turned(tmp_path):
    base, roof = shaken()
    columns = {"Time (s)": clock(), "Ground (g)": base, "Roof (g)": roof}
    for turn in (1, -1):
        path = table(tmp_path / "r.csv", {name: u[::turn] for name, u in columns.items()}, "%.9g")
        found = proposal([str(path)], {}, {})
        assert not found.questions
        raw = read_record(path, found.columns)
        assert raw.channels["a1"] == pytest.approx(9.80665 * roof, abs=1e-6)


def test_times_that_fall_and_occur_twice_are_turned_too(tmp_path):
    rows = "".join(f"{k // 2},{k}\n" for k in range(40, 0, -1))
    assert read(tmp_path, f"time,a1\n{rows}").columns["a1"].tolist() == list(range(1, 41))


def test_of_columns_of_hours_minutes_and_seconds_the_one_that_rises_is_the_clock(tmp_path):
    base, roof = shaken()
    hours = {"Hour": np.full(T, 9.0), "Minute": np.floor(clock() / 8.0)}
    columns = {**hours, "Second": 12.0 + clock(), "Ground (g)": base, "Roof (g)": roof}
    found = proposal([str(table(tmp_path / "r.csv", columns, "%.9g"))], {}, {})
    assert found.columns["time"] == "Second"
    assert not found.questions


@pytest.mark.parametrize(("code", "known"), [(-9999, False), (999.99, False), (-40.5, True)])
def test_nines_far_from_all_other_values_are_no_value(tmp_path, code, known):
    base, roof = shaken()
    roof = np.where(np.arange(T) % 1000 == 500, code, roof)
    columns = {"time": clock(), "s_ddot1": base, "a1": roof, "u1": np.arange(7600.0, 7600.0 + T)}
    contents = read_table(table(tmp_path / "r.csv", columns, "%.9g"))
    assert np.isnan(contents.columns["a1"]).sum() == (0 if known else 2)
    assert contents.columns["u1"].max() == 9999.0
    assert any("is taken for no value" in note for note in contents.notes) == (not known)


def test_empty_cells_of_a_slower_channel_are_its_rate(tmp_path):
    base, roof = shaken(samples=400)
    path = table(tmp_path / "two.csv", {"time": clock(400), "s_ddot1": base, "a1": roof})
    lines = path.read_text().splitlines()
    cut = [
        line.rpartition(",")[0] + "," if k % 2 == 0 and k else line for k, line in enumerate(lines)
    ]
    path.write_text("\n".join(cut))
    raw = read_record(path)
    (fault,) = blocking(raw)
    assert (fault.what, len(raw.channels["a1"])) == ("different rates", 200)
    rate = float(re.search(r"data\.mend\.resample=([\d.]+)", fault.message)[1])
    dt, channels, _ = Mending(resample=rate)(raw)
    assert dt == pytest.approx(2 * DT)
    off = channels["a1"] - roof[::2][: len(channels["a1"])]  # by the low-pass of 20 Hz
    assert np.abs(off).max() < 0.01 * np.abs(roof).max()


def test_a_clock_that_runs_slowly_is_named_with_its_rate(tmp_path):
    base, roof = shaken()
    table(tmp_path / "base.csv", {"time": clock(), "acc [m/s^2]": base})
    table(tmp_path / "roof.csv", {"time": 1.0008 * clock(), "acc [m/s^2]": roof})
    where = {"time": "time", "s_ddot1": "base.csv:acc", "a1": "roof.csv:acc"}
    (fault,) = blocking(read_record(tmp_path, where))
    assert "s_ddot1 100 Hz, a1 99.92 Hz, which drift apart by 0.0192 s" in fault.message
    assert "data.mend.resample=100 " in fault.message


# Units


def questions(path, channels, units=None) -> list[str]:
    return [str(fault) for fault in blocking(read_record(path, channels, units))]


def test_no_unit_is_assumed_of_a_name_that_is_not_ours(tmp_path):
    base, roof = shaken()
    path = table(tmp_path / "r.csv", {"time": clock(), "Acc Ground": base, "a1": roof})
    where = {"time": "time", "s_ddot1": "Acc Ground", "a1": "a1"}
    (asked,) = questions(path, where)
    assert "no unit is understood in 'Acc Ground'" in asked
    assert "m/s^2 is taken only with data.units.s_ddot=m/s^2" in asked
    assert questions(path, where, {"s_ddot": "m/s^2"}) == []


@pytest.mark.parametrize("size", [1e-3, 1.0, 3e3, 1e5])
def test_no_unit_is_taken_by_the_size_of_numbers_alone(tmp_path, size):
    """Neither where one unit fits, as g does small vibration, nor where none does: counts."""
    base, roof = shaken()
    columns = {"t": clock(), "Ground": size * base, "Roof": size * roof}
    found = proposal([str(table(tmp_path / "r.csv", columns))], {}, {})
    assert [o.partition("=")[0] for _, o in found.questions] == [
        "data.units.s_ddot",
        "data.units.a",
    ]
    assert "units" not in found.settings


def test_the_g_of_a_name_is_the_ground_where_others_have_no_unit(tmp_path):
    base, roof = shaken()
    where = {"time": "time", "s_ddot1": "acc_g", "a1": "acc_1"}
    path = table(tmp_path / "ground.csv", {"time": clock(), "acc_g": base, "acc_1": roof})
    assert len(questions(path, where)) == 2
    path = table(tmp_path / "gravity.csv", {"time": clock(), "acc_g": base, "acc_1_g": roof})
    raw = read_record(path, {**where, "a1": "acc_1_g"})
    assert raw.channels["a1"] == pytest.approx(9.80665 * roof, rel=1e-4, abs=1e-5)


@pytest.mark.parametrize(("unit", "factor"), [("mm/s^2", 1e-3), ("g", 9.80665), ("in/s^2", 0.0254)])
def test_a_displacement_tells_the_unit_of_an_acceleration(tmp_path, unit, factor):
    base, roof = shaken()
    moved = np.cumsum(np.cumsum(base)) * DT**2 + 0.01 * clock()
    columns = {
        "time": clock(),
        "Disp [mm]": 1e3 * moved,
        "Acc": base / factor,
        "Top": roof / factor,
    }
    path = table(tmp_path / "r.csv", columns, "%.12g")
    where = {"time": "time", "s1": "Disp", "s_ddot1": "Acc", "a1": "Top"}
    asked = questions(path, where)
    assert len(asked) == 2
    assert all(f"={unit}" in text and "second derivative of 's1'" in text for text in asked)
    assert questions(path, where, {"a": unit, "s_ddot": unit}) == []


def test_a_clock_in_no_unit_that_cannot_be_in_seconds_is_asked_about(tmp_path):
    base, roof = shaken()
    path = table(tmp_path / "r.csv", {"time": 1e3 * clock(), "s_ddot1": base, "a1": roof})
    (asked,) = questions(path, None)
    assert "no unit in time" in asked
    assert "data.units.time=ms" in asked
    assert questions(path, None, {"time": "ms"}) == []
    columns = {"Zeit": 1e3 * clock(), "Boden (g)": base, "Dach (g)": roof}
    found = proposal([str(table(tmp_path / "zeit.csv", columns))], {}, {})
    assert [option for _, option in found.questions] == ["data.units.time=ms"]


STAMPS = {"in hours to 24": "{h:02d}:{m:02d}:{s:06.3f}",
          "behind a date": "5.3.2024 {h}:{m:02d}:{s:06.3f}",
          "in hours to 12": "3/5/2024 {c}:{m:02d}:{s:06.3f} PM"}  # fmt: skip


@pytest.mark.parametrize("stamp", STAMPS.values(), ids=list(STAMPS))
def test_times_of_the_day_are_a_clock_that_runs_on_at_midnight(tmp_path, stamp):
    """40 samples of 10 ms across midnight, or across one o'clock in the afternoon."""
    rows = ["time,a1 [g]"]
    for k, t in enumerate((13 if "PM" in stamp else 24) * 3600.0 - 0.2 + 0.01 * np.arange(40)):
        h, m, s = int(t // 3600) % 24, int(t % 3600 // 60), t % 60
        rows.append(stamp.format(h=h, c=(h - 1) % 12 + 1, m=m, s=s) + f",{k % 3}")
    found = read(tmp_path, "\n".join([*rows, ""]))
    assert np.diff(found.columns["time"]) == pytest.approx(0.01, abs=1e-6)


def test_hours_to_12_count_from_midnight(tmp_path):
    stamps = ("12:30:00 AM", "01:30:00 AM", "12:30:00 PM", "01:30:00 PM")
    found = read(tmp_path, "\n".join(["time,a1 [g]", *(f"{stamp},1" for stamp in stamps), ""]))
    assert found.columns["time"].tolist() == [1800.0, 5400.0, 45_000.0, 48_600.0]


def test_words_beside_units_are_no_names(tmp_path):
    """A testing machine counts segments; a clock with hours and minutes says how it is written."""
    found = read(tmp_path, "Running Time,Load,Count\nSec,kN,segments\n" + ROWS)
    assert found.units == {"Running Time": "Sec", "Load": "kN"}
    rows = "\n".join(f"10:12:{1 + 0.01 * k:06.3f};{k % 7};" for k in range(40))
    found = read(tmp_path, f"Time[hh:mm:ss];Base [g];\n{rows}\n")
    assert found.units == {"Time": "s", "Base": "g"}


def test_blanks_of_any_script_are_blanks_and_other_signs_are_none(tmp_path):
    """Wide blanks of Japanese names, and what would move the cursor of a terminal."""
    base, roof = shaken()
    names = ["時刻\u3000(s)", "地盤\u3000加速度 (g)", "1階\xa0\x1b[31m (g)"]
    path = table(tmp_path / "r.csv", dict(zip(names, (clock(), base, roof), strict=True)))
    found = proposal([str(path)], {}, {})
    assert found.columns == {
        "time": "時刻", "s_ddot1": "地盤 加速度", "a1": "1階 _[31m"
    }  # fmt: skip
    assert composed(*found.words).data.channels == found.columns
    assert fits(found.columns, dict[str, str])


@pytest.mark.parametrize(
    "line", ["fs" + 30_000 * " " + "x", 20_000 * "dt[", "no. " + 30_000 * "of "]
)
def test_a_long_line_above_the_rows_takes_no_time(tmp_path, line):
    begun = time.process_time()
    assert len(read(tmp_path, f"{line}\nt,a,b\n{ROWS}\n").columns) == 3
    assert time.process_time() - begun < 2.0


def test_words_amid_the_rows_are_no_names_of_another_table(tmp_path):
    first, *rows = ROWS.splitlines()
    with pytest.raises(FileError, match="line 3, column 't': 'START' is no number"):
        read(tmp_path, "\n".join(["t,a,b", first, "START,OF,EVENT", *rows, ""]))


def test_a_size_is_judged_in_si_where_columns_have_the_names_of_channels(tmp_path):
    path = tmp_path / "r.csv"
    path.write_text("time,a1,ground\ns,mm/s2,mm/s2\n" + ROWS.replace(",3,", ",9000,"))
    (record,) = proposal([str(path)], {}, {}).records
    assert "suspicious unit" not in {one.what for one in record.findings}


def test_bars_lines_of_objects_utf_16_and_exponents_of_fortran_are_read(tmp_path):
    wide = "| t [s] | a [g] |\n|---|---|\n" + "".join(f"| {k} | {k % 7} |\n" for k in range(40))
    lines = "".join(f'{{"t": {k}, "a": {k % 7}}}\n' for k in range(40))
    fortran = "t a\n" + "".join(f" {k}.0D+00 {k % 7}0.0d-01\n" for k in range(40))
    texts = {"a.csv": wide, "b.jsonl": lines, "c.json": lines, "d.dat": fortran}
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "e.txt").write_text(wide.replace("|", "\t"), encoding="utf-16")
    for name in (*texts, "e.txt"):
        columns = read_table(tmp_path / name).columns
        assert columns["t"].tolist() == list(range(40)), name
        assert columns["a"].tolist() == [k % 7 for k in range(40)], name
    (tmp_path / "e.txt").write_bytes((tmp_path / "e.txt").read_bytes()[:-1])
    with pytest.raises(FileError, match=r"e\.txt is cut UTF-16 text"):
        read_table(tmp_path / "e.txt")


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_a_clock_that_counts_from_1970_says_its_unit_by_its_size(tmp_path, unit):
    size = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    stamps = (1_700_000_000 * size + k * size / 100 for k in range(40))
    rows = (f"{stamp if size == 1 else int(stamp)},{k % 7}" for k, stamp in enumerate(stamps))
    read(tmp_path, "\n".join(["timestamp,acc [g]", *rows, ""]))
    raw = read_record(tmp_path / "record.csv", {"time": "timestamp", "a1": "acc"})
    assert np.diff(raw.time) == pytest.approx(0.01, abs=1e-6)
    assert not raw.unsaid
    rows = (f"{1_200_000_000 + 8333 * k},{k % 7}" for k in range(40))  # µs since it was switched on
    assert "timestamp" not in read(tmp_path, "\n".join(["timestamp,acc [g]", *rows, ""])).units


@pytest.mark.parametrize("day", [44_963, 738_923])
def test_dates_of_a_spreadsheet_and_of_matlab_count_days(tmp_path, day):
    rows = (f"{day + k / 8_640_000:.11f},{k % 7}" for k in range(400))
    read(tmp_path, "\n".join(["timestamp,acc [g]", *rows, ""]))
    raw = read_record(tmp_path / "record.csv", {"time": "timestamp", "a1": "acc"})
    assert np.diff(raw.time) == pytest.approx(0.01, abs=1e-4)
    assert not raw.unsaid
    rows = (f"{day + 0.01 * k:.2f},{k % 7}" for k in range(40))  # s since it was switched on
    assert "timestamp" not in read(tmp_path, "\n".join(["timestamp,acc [g]", *rows, ""])).units


@pytest.mark.parametrize("by_turns", [False, True])
def test_a_long_table_whose_series_have_numbers_is_refused_and_cycles_are_not(tmp_path, by_turns):
    pairs = [(j, k) for k in range(40) for j in (1, 2, 3)]
    pairs = pairs if by_turns else sorted(pairs)
    rows = [f"{j} {0.01 * k:.2f} {(k + j) % 7}" for j, k in pairs]
    with pytest.raises(FileError, match=r"'Joint' says .* \(1, 2, 3\), and each 'Step' comes 3"):
        read(tmp_path, "\n".join(["Joint Step U1", "Text Sec m/sec2", *rows, ""]))
    rows = [f"{1 + k // 40},{0.1 * k:.1f},{k % 40},{k % 7}" for k in range(120)]
    assert "Cycle" in read(tmp_path, "\n".join(["Cycle,Time,mm,kN", *rows, ""])).columns


def test_a_long_table_is_refused_for_its_rows_say_which_series_they_are_of(tmp_path):
    """Else both sensors would be read as one of twice the rate; a remark of one word is none."""
    rows = [f"{0.01 * k:.2f},{s},{k % 7}" for k in range(40) for s in ("base", "roof")]
    with pytest.raises(FileError, match=r"'sensor' says of which series each row is .*a pivot"):
        read(tmp_path, "\n".join(["time,sensor,acc_g", *rows, ""]))
    rows = [f"{0.01 * k:.2f},{'ok' if k % 2 else 'high'},{k % 7}" for k in range(40)]
    assert "time" in read(tmp_path, "\n".join(["time,state,acc_g", *rows, ""])).columns


@pytest.mark.parametrize(
    "said",
    [
        "SAMPLING_INTERVAL_S: 0.01",
        "sampling interval (ms): 10",
        "dt_ms = 10",
        "SAMPLE RATE HZ: 100",
        "X-Increment: 0.01",
        "TIMESERIES A_B, 40 samples, 100 sps, 2024-03-12T10:12:00",
        "Frecuencia de muestreo: 100 Hz",
    ],
)
def test_a_step_in_the_lines_above_has_its_unit_where_people_write_it(tmp_path, said):
    rows = "\n".join(f"{k % 7 - 3},{k % 5 - 2}" for k in range(40))
    assert read(tmp_path, f"{said}\nsite: A\na1 [g],a2 [g]\n{rows}\n").facts["dt"] == 0.01


@pytest.mark.parametrize("said", ["Scan rate: 6000 per minute", "fs = 60 samples/min"])
def test_a_rate_that_is_not_of_a_second_is_asked_about(tmp_path, said):
    rows = "\n".join(f"{k % 7 - 3},{k % 5 - 2}" for k in range(40))
    assert not read(tmp_path, f"{said}\na1 [g],a2 [g]\n{rows}\n").facts


@pytest.mark.parametrize(
    ("said", "dt"),
    [("Sample rate: 1,000 Hz", 1e-3), ("fs,100,100,100", 0.01), ("fs: 12,5 Hz", 0.08),
     ("dt = 0,005 s", 0.005), ("fs: 1,024.0 Hz", 1 / 1024), ("fs 200.000 Hz", 0.005)],
)  # fmt: skip
@pytest.mark.parametrize("decimal", [".", ","])
def test_a_comma_above_the_rows_parts_thousands_or_decimals_as_in_the_rows(
    tmp_path, said, dt, decimal
):
    """A point in a file of decimal commas may do either, and is asked about, as is 1,000."""
    rows = "\n".join(f"{k % 7 - 3}{decimal}5;{k % 5 - 2}{decimal}25" for k in range(40))
    if decimal == ",":
        dt = {"Sample rate: 1,000 Hz": 1.0, "fs 200.000 Hz": None}.get(said, dt)
        dt = None if "1,024.0" in said else dt
    assert read(tmp_path, f"{said}\na1 [g];a2 [g]\n{rows}\n").facts.get("dt") == dt
