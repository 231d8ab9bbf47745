"""Files of loggers, agencies and programs, in layouts that users have: read as they were meant."""

from __future__ import annotations

import importlib.util
import json
import os
import zipfile
from pathlib import Path

import h5py  # type: ignore[import-untyped]
import numpy as np
import pytest
import scipy.io

from data.inspect.folders import of_folders
from data.inspect.inspection import inspections, places, suggest
from data.measured.files.table import FileError, read_table
from data.measured.floors import floor_numbers, height, least_storeys, without_shared
from data.measured.places import named_records
from data.measured.reading import read_record, read_records, stated_dt
from data.measured.units import to_si
from tests.agency_files import cesmd_v1, cesmd_v2, knet, lvm, tdms, xlsx

pytestmark = pytest.mark.usefixtures("read_here")
DT, T = 0.01, 600


@pytest.fixture
def a() -> np.ndarray:
    """An acceleration [m/s²]."""
    return np.random.default_rng(3).standard_normal(T)


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
@pytest.mark.parametrize("decimals", [3, 4, 5])
def test_volume_2_is_read_though_its_header_repeats_that_of_volume_1(tmp_path, a, decimals, ending):
    text = cesmd_v2(2, "90 Deg, 2nd Floor", a, DT, decimals).replace("\r\n", ending)
    (tmp_path / "CHAN002.V2").write_bytes(text.encode())
    table = read_table(tmp_path / "CHAN002.V2")
    assert list(table.columns) == ["acc2", "vel2", "disp2"]
    assert table.facts == {"dt": DT}
    assert table.labels["acc2"] == "90 Deg, 2nd Floor"
    assert np.abs(0.01 * table.columns["acc2"] - a).max() < 0.6 * 10.0 ** -(decimals + 2)


def test_all_channels_of_a_station_in_one_file_of_volume_2(tmp_path, a):
    places = {1: "180 Deg", 2: "Up, Roof: Center", 3: "90 Deg, Basement"}
    text = "".join(cesmd_v2(n, place, n * a, DT) for n, place in places.items())
    (tmp_path / "ce12345.txt").write_text(text)  # saved from a browser
    table = read_table(tmp_path / "ce12345.txt")
    assert [c for c in table.columns if c.startswith("acc")] == ["acc1", "acc2", "acc3"]
    assert table.labels["acc2"] == "Up, Roof: Center"
    for n in places:
        assert np.abs(0.01 * table.columns[f"acc{n}"] - n * a).max() < 1e-7


def test_volume_1_of_today_is_in_g(tmp_path, a):
    (tmp_path / "CHAN005.V1").write_text(cesmd_v1(5, "270 Deg", a, 0.005))
    table = read_table(tmp_path / "CHAN005.V1")
    assert (table.units, table.facts) == ({"acc5": "g"}, {"dt": 0.005})
    assert np.abs(9.80665 * table.columns["acc5"] - a).max() < 1e-5


def test_no_unit_is_assumed_for_what_is_uncorrected(tmp_path, a):
    text = cesmd_v1(5, "270 Deg", a, 0.005).replace("Units of uncor accel are g", "")
    (tmp_path / "CHAN005.V1").write_text(text.replace(", in g.", ""))
    with pytest.raises(FileError, match="line 28 is in 'a unit that it does not say'; expected"):
        read_table(tmp_path / "CHAN005.V1")


@pytest.mark.parametrize(
    ("name", "direction", "scale", "dt"),
    [
        ("XXX0031412312349.EW", "E-W", "3920(gal)/6182761", 0.01),
        ("TCGH130007210339.NS2", "4", "2000(gal)/8388608", 0.005),
        ("saved.txt", "U-D", "7845(gal)/8223790", 0.01),
    ],
)
def test_knet_counts_become_gal(tmp_path, a, name, direction, scale, dt):
    (tmp_path / name).write_text(knet(a, dt, direction, scale))
    table = read_table(tmp_path / name)
    assert (table.units, table.facts) == ({"acc": "gal"}, {"dt": dt})
    found = 0.01 * table.columns["acc"]
    assert np.ptp(found - a) < 1e-4
    assert table.labels["acc"].startswith("station XXX003, ")
    assert table.labels["acc"].endswith({"4": "N-S, surface"}.get(direction, direction))


LVMS = {
    "point": {},
    "decimal comma": {"decimal": ","},
    "commas between cells": {"separator": "Comma"},
    "a clock each": {"clock": "Multi", "ending": "\n"},
    "no clock": {"clock": "No", "decimal": ","},
    "no units": {"units": None},
}


@pytest.mark.parametrize("case", LVMS)
@pytest.mark.parametrize("suffix", [".lvm", ".txt", ".dat"])
def test_labview_says_units_and_step_in_its_header(tmp_path, a, case, suffix):
    channels = {"Table": a, "Floor_1": 2 * a, "Floor_2": -a}
    (tmp_path / f"run{suffix}").write_bytes(lvm(channels, DT, **LVMS[case]).encode())
    table = read_table(tmp_path / f"run{suffix}")
    clock = [] if case == "no clock" else ["X_Value"]
    assert list(table.columns) == [*clock, *channels]
    assert table.facts == {"dt": DT}
    said = {} if case == "no units" else dict.fromkeys(channels, "g")
    assert table.units == said | dict.fromkeys(clock, "s")
    for name, u in channels.items():
        assert np.abs(table.columns[name] - u).max() <= 0.51e-6
    if clock:
        assert np.abs(table.columns["X_Value"] - DT * np.arange(T)).max() < 1e-6
    assert to_si(table.units.get("Floor_1", "g"), "a") == 9.80665


def test_segments_of_labview_are_records(tmp_path, a):
    (tmp_path / "run.lvm").write_text(lvm({"Table": a, "Floor": -a}, DT, segments=3))
    for record in (1, 2, 3):
        table = read_table(tmp_path / "run.lvm", record=record)
        assert table.records == 3
        assert np.abs(table.columns["Table"] - record * a).max() < 1e-6


# Spreadsheets, TDMS, recorders, JSON, arrays of MATLAB.


def rows_of(a: np.ndarray) -> list[list[object]]:
    return [[float(round(DT * k, 6)), float(u), float(-u)] for k, u in enumerate(a)]


@pytest.mark.parametrize(
    "above",
    [
        [["t [s]", "Table (g)", "Floor 1 [g]"]],
        [["Test of 5 March"], [], ["t [s]", "Table (g)", "Floor 1 [g]"]],
        [["t", "Table", "Floor 1"], ["s", "g", "g"]],
    ],
)
def test_the_sheet_with_a_table_is_read_as_text_is(tmp_path, a, above):
    xlsx(tmp_path / "run.xlsx", Notes=[["see next sheet"]], Data=[*above, *rows_of(a)], Empty=[])
    table = read_table(tmp_path / "run.xlsx")
    assert list(table.columns) == ["t", "Table", "Floor 1"]
    assert table.units == {"t": "s", "Table": "g", "Floor 1": "g"}
    assert np.array_equal(table.columns["Floor 1"], -a)
    assert "sheet 'Data'" in table.notes


def test_sheets_of_one_table_are_records_and_others_are_asked_for(tmp_path, a):
    head = ["t", "a1", "a2"]
    runs = {f"Run {k}": [head, *rows_of(k * a)] for k in (1, 2)}
    xlsx(tmp_path / "runs.xlsx", **runs)
    table = read_table(tmp_path / "runs.xlsx", record=2, columns=["a1"])
    assert (table.records, list(table.columns)) == (2, ["a1"])
    assert "2 records, one in a sheet; this is sheet 'Run 2'" in table.notes
    assert np.array_equal(table.columns["a1"], 2 * a)
    xlsx(tmp_path / "odd.xlsx", One=runs["Run 1"], Other=[["t", "f1", "x1"], *rows_of(a)])
    with pytest.raises(FileError, match=r"unlike tables; say which one, data\.group=One"):
        read_table(tmp_path / "odd.xlsx")
    assert list(read_table(tmp_path / "odd.xlsx", group="Other").columns) == ["t", "f1", "x1"]
    sensors = [["Channel", "Gain"], *([k, 1.0] for k in range(5))]
    xlsx(tmp_path / "two.xlsx", Sensors=sensors, Data=runs["Run 1"])
    with pytest.raises(FileError, match=r"say which one, data\.group=Data"):
        read_table(tmp_path / "two.xlsx")


def test_blank_cells_and_decimal_commas_of_a_spreadsheet(tmp_path, a):
    rows = rows_of(a)
    rows[5][1] = None
    xlsx(tmp_path / "run.xlsx", Data=[["t", "a1", "a2"], *rows])
    for decimal in (".", ","):
        table = read_table(tmp_path / "run.xlsx", decimal=decimal)
        assert np.isnan(table.columns["a1"][5])
        assert np.array_equal(table.columns["a2"], -a)


def test_tdms_has_units_and_a_step(tmp_path, a):
    tdms(tmp_path / "run.tdms", {"Fast": {"Table": a, "Roof": -a}}, 0.005, "m/s^2")
    table = read_table(tmp_path / "run.tdms")
    assert table.facts == {"dt": 0.005}
    assert table.units == {"Table": "m/s^2", "Roof": "m/s^2"}
    assert np.array_equal(table.columns["Roof"], -a)


def test_the_step_of_a_tdms_channel_with_a_unit_in_its_name_counts(tmp_path, a):
    tdms(tmp_path / "run.tdms", {"Fast": {"Acc (g)": a}}, 0.005)
    assert read_table(tmp_path / "run.tdms").facts == {"dt": 0.005}


def test_dates_are_seconds_whatever_their_column_is_called(tmp_path):
    stamps = [f"2024-01-01T00:00:00.{k:02d}" for k in range(60)]
    for name in ("run.json", "run.npz"):
        place = tmp_path / name
        if place.suffix == ".json":
            place.write_text(json.dumps({"time [ms]": stamps, "a1": list(range(60))}))
        else:
            np.savez(place, time_ms=np.array(stamps, "datetime64[ms]"), a1=np.arange(60.0))
        time = next(n for n in read_table(place).columns if n.startswith("time"))
        raw = read_record(place, {"time": time, "a1": "a1"})
        np.testing.assert_allclose(np.diff(raw.own_time()), 0.01, rtol=1e-9)


def test_a_group_of_tdms_is_chosen(tmp_path, a):
    groups = {"Fast": {"Table": a, "Roof": -a}, "Slow": {"Table": a[:100]}}
    tdms(tmp_path / "run.tdms", groups, DT)
    table = read_table(tmp_path / "run.tdms", group="Fast")
    assert list(table.columns) == ["Table", "Roof"]
    table = read_table(tmp_path / "run.tdms", columns=["Slow/Table"])
    assert np.array_equal(table.columns["Slow/Table"], a[:100])


@pytest.mark.parametrize(
    ("name", "module", "extra"),
    [("a.xlsx", "python_calamine", "excel"), ("a.tdms", "nptdms", "tdms"),
     ("a.mseed", "obspy", "seismic")],
)  # fmt: skip
def test_a_package_that_is_missing_is_named_with_its_extra(
    tmp_path, monkeypatch, name, module, extra
):
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n: None if n == module else found(n))
    first = {"a.xlsx": b"PK\x03\x04", "a.tdms": b"TDSm", "a.mseed": b"000001D "}
    (tmp_path / name).write_bytes(first[name] + bytes(100))
    message = rf"need the package .*pip install -c constraints\.txt -e '\.\[{extra}\]'"
    with pytest.raises(FileError, match=message):
        read_table(tmp_path / name)
    pyproject = (Path(__file__).parents[2] / "pyproject.toml").read_text()
    assert f"\n{extra} = [" in pyproject


@pytest.mark.parametrize("kind", ["MSEED", "SAC"])
def test_traces_of_obspy(tmp_path, a, kind):
    obspy = pytest.importorskip("obspy")
    about = {"station": "XX01", "channel": "HNE", "location": "00", "delta": 0.005}
    path = tmp_path / {"MSEED": "a.mseed", "SAC": "a.sac"}[kind]
    obspy.Trace(a.astype(np.float32), about).write(str(path), format=kind)
    table = read_table(path)
    assert list(table.columns) == ["acc_HNE_00"]
    assert table.facts["dt"] == pytest.approx(0.005)
    assert np.abs(table.columns["acc_HNE_00"] - a).max() < 1e-6


@pytest.mark.parametrize("named", [True, False])
def test_a_recorder_of_opensees_has_its_name_and_time(tmp_path, a, named):
    np.savetxt(tmp_path / "Disp.out", np.c_[DT * np.arange(T), a, -a])
    np.savetxt(tmp_path / "RFrc.out", a if not named else np.c_[DT * np.arange(T), a])
    table = read_table(tmp_path / "Disp.out")
    assert list(table.columns) == ["time", "Disp1", "Disp2"]
    assert np.array_equal(table.columns["Disp2"], -a)
    expected = ["time", "RFrc"] if named else ["RFrc"]
    assert list(read_table(tmp_path / "RFrc.out").columns) == expected
    assert list(read_table(tmp_path / "Disp.out", columns=["Disp2"]).columns) == ["Disp2"]


def test_a_folder_of_recorders_is_one_test_of_an_element(tmp_path):
    y = np.sin(0.05 * np.arange(T)) * np.linspace(0.2, 1.0, T)
    for name, u in (("Disp", y), ("Reaction", -3e4 * y)):
        np.savetxt(tmp_path / f"{name}.out", np.c_[DT * np.arange(T), u])
    seen = [one for path, _ in places([str(tmp_path)], {}) for one in inspections(path, {}, {})]
    channels = of_folders(tmp_path, seen)
    assert channels == {"time": "time", "s1": "Disp.out:Disp", "r1": "Reaction.out:Reaction"}
    (record,) = named_records(str(tmp_path), channels)[0].values()
    assert np.abs(record.channels["r1"] + 3e4 * y).max() < 1e-9


def test_attributes_of_hdf5_that_do_not_differ_are_facts(tmp_path):
    """The rate of a dataset, deep in the file, is that of the record; two rates are none."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, gain in (("base", 1.0), ("roof", 2.0)):
            dataset = file.create_dataset(f"event/{name}", data=np.arange(40.0))
            dataset.attrs.update(units="g", fs=200.0, gain=gain)
    table = read_table(tmp_path / "a.h5")
    assert table.facts == {"fs": 200.0}
    assert "the series differ in gain: not used" in table.notes
    assert table.units == {"event/base": "g", "event/roof": "g"}


def test_what_netcdf_packs_is_unpacked(tmp_path):
    """Whole numbers with a factor, an offset and a number for no value; seconds since a date."""
    with h5py.File(tmp_path / "a.nc", "w") as file:
        file["time"] = 0.01 * np.arange(40)
        file["time"].attrs["units"] = "seconds since 2024-05-06 10:00:00"
        file["acc"] = np.array([-99, *range(39)], dtype="i2")
        packed = {"scale_factor": [0.02], "add_offset": 1.0, "_FillValue": np.int16(-99)}
        file["acc"].attrs.update(packed)
    table = read_table(tmp_path / "a.nc")
    assert table.units == {"time": "seconds"}
    np.testing.assert_allclose(table.columns["acc"], [np.nan, *(1.0 + 0.02 * np.arange(39))])


def test_the_rate_of_sensors_in_json_is_that_of_the_record(tmp_path):
    for name, rates in (("one", (200, 200)), ("two", (200, 100))):
        sensors = [
            {"name": sensor, "unit": "g", "fs": rate, "start": f"10:00:0{k}", "data": [k] * 40}
            for k, (sensor, rate) in enumerate(zip(("base", "roof"), rates, strict=True))
        ]
        (tmp_path / f"{name}.json").write_text(json.dumps(sensors))
    one, two = (read_table(tmp_path / f"{name}.json") for name in ("one", "two"))
    assert (one.facts, two.facts) == ({"fs": 200.0}, {})
    assert "the series differ in start: not used" in one.notes
    assert "the series differ in fs, start: not used" in two.notes


@pytest.mark.parametrize("suffix", ["h5", "mat"])
def test_groups_of_the_same_names_are_records_where_each_has_the_ground(tmp_path, a, suffix):
    events = {n: {"t": DT * np.arange(T), "base": k * a, "roof": a}
              for n, k in (("Kobe", 1.0), ("Event2", 2.0))}  # fmt: skip
    path = tmp_path / f"a.{suffix}"
    if suffix == "mat":
        scipy.io.savemat(path, events)
    else:
        with h5py.File(path, "w") as file:
            for event, signals in events.items():
                file.create_group(event).update(signals)
    found = read_records(path, {"time": "t", "s_ddot1": "base", "a1": "roof"}, {"a": "g"})
    assert sorted(np.ptp(r.channels["s_ddot1"]) / np.ptp(a) for r in found.values()) == [1.0, 2.0]
    own = next(iter(events)) + ("/" if suffix == "h5" else ".")
    single = read_table(path, columns=[f"{own}t", f"{own}base"])
    assert (single.records, list(single.columns)) == (1, [f"{own}t", f"{own}base"])


@pytest.mark.parametrize("groups", [("ground", "floor 1"), ("S1", "S2")])
def test_groups_of_sensors_are_one_record(tmp_path, a, groups):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for group in groups:
            file[f"{group}/t"], file[f"{group}/acc"] = DT * np.arange(T), a
    table = read_table(tmp_path / "a.h5")
    assert table.records == 1
    assert len(table.columns) == 4


def test_nested_json_is_read_by_path(tmp_path, a):
    test = {"units": {"force": "kN", "displacement": "mm"}, "force": a.tolist()}
    test |= {"displacement": (-a).tolist(), "rate": 100.0, "remark": "none"}
    samples = [{"t": DT * k, "load": u} for k, u in enumerate(a)]
    source = [{"title": "a test", "year": 2020}, {"title": "b", "year": 2021}]
    content = {"source": source, "test": test, "more": {"deep": {"samples": samples}}}
    (tmp_path / "a.json").write_text(json.dumps(content))
    table = read_table(tmp_path / "a.json")
    deep = ["more.deep.samples.t", "more.deep.samples.load"]
    assert list(table.columns) == ["test.force", "test.displacement", *deep]
    assert table.units == {"test.force": "kN", "test.displacement": "mm"}
    assert table.facts == {"test.rate": 100.0}
    assert np.array_equal(table.columns["test.displacement"], -a)
    assert np.array_equal(table.columns[deep[1]], a)


@pytest.mark.parametrize("within", [True, False])
def test_a_list_of_sensors_of_json_is_columns(tmp_path, a, within):
    sensors = [{"name": n, "unit": "g", "fs": 100, "data": (k * a).tolist()}
               for k, n in enumerate(("ground", "floor 1"), start=1)]  # fmt: skip
    content = {"meta": {"fs": 100}, "channels": sensors} if within else sensors
    (tmp_path / "a.json").write_text(json.dumps(content))
    table = read_table(tmp_path / "a.json")
    assert table.units == {"ground": "g", "floor 1": "g"}
    assert np.array_equal(table.columns["floor 1"], 2 * a)
    assert stated_dt(table) == 0.01


def test_words_in_cells_of_matlab_are_left_out_and_told(tmp_path, a):
    words = np.array(["Ground", "Roof", "1F"], dtype=object)
    scipy.io.savemat(tmp_path / "r.mat", {"data": np.column_stack([a, -a]), "labels": words})
    found = read_table(tmp_path / "r.mat")
    assert list(found.columns) == ["data1", "data2"]
    assert "text 'labels' left out" in found.notes


def test_a_wide_array_of_matlab_is_channels_or_by_its_name_records(tmp_path, a):
    t = DT * np.arange(T)
    scipy.io.savemat(tmp_path / "a.mat", {"t": t, "acc": np.stack([a, 2 * a, 3 * a])})
    table = read_table(tmp_path / "a.mat")
    assert list(table.columns) == ["t", "acc1", "acc2", "acc3"]
    assert np.array_equal(table.columns["acc3"], 3 * a)
    assert any("if they are records, name acc itself" in note for note in table.notes)
    records, _ = named_records(str(tmp_path / "a.mat"), {"time": "t", "a1": "acc"})
    assert list(records) == ["a_1", "a_2", "a_3"]
    for k, record in enumerate(records.values(), start=1):
        assert np.array_equal(record.channels["a1"], k * a)


# Floors, by what they are called.


@pytest.mark.parametrize(
    "from_below",
    [
        ["Basement", "8th Fl", "Roof"],
        ["1F", "2F", "RF"],
        ["B2", "B1", "1F", "10F", "PH"],
        ["Ground Level", "2nd Floor: North", "3rd Floor: North", "Roof: Center"],
        ["floor_0", "floor_9", "floor_10"],
        ["Base acc. (g's)", "Floor1 Acc/g", "Floor2 Acc/g", "Roof Acc/g"],
        ["L1", "L2", "L3", "L12"],
        ["Acc Table", "Acc1F", "Acc2F", "AccRF"],
        ["Level -1", "Level 0", "Level 1", "Level 2"],
        ["Foundation", "Girder", "Roof"],
        ["ground floor", "mezzanine", "first floor", "third floor"],
        ["borehole, N-S", "surface, N-S"],
        ["base", "3/F", "deck midspan"],
        ["2nd basement", "1st basement", "1st storey", "Top of 3rd storey"],
        ["EG_ground", "1. OG", "2. OG", "Dach"],
        ["地動", "1階", "2階"],
        ["地面", "1层", "12层"],
        ["Основание", "Этаж 1", "2 этаж"],
        ["Zemin", "Kat 1", "2. kat", "Çatı"],
        ["Fundament", "Decke 1", "Beschl_Decke2", "Decke3"],
        ["Mesa", "Piso 1", "Nivel 2", "Azotea"],
        ["Solo", "Andar 1", "Cobertura"],
        ["GL", "1F", "R/F"],
        ["Ch3 Floor 1", "Ch1 Floor 2", "Ch2 Floor 12"],
        ["1 Floor", "2 Floor north", "3rd Floor 1"],
        ["振動台", "1階", "屋上"],
        ["台面", "2层", "顶层"],
    ],
)
def test_floors_rise_with_their_names(from_below):
    heights = [height(name) for name in from_below]
    assert None not in heights
    assert heights == sorted(set(heights))


def test_what_all_names_begin_with_says_no_floor_unless_nothing_else_does():
    assert without_shared(["Run 1 Floor 2", "Run 1 Base"]) == ["Floor 2", "Base"]
    assert without_shared(["Floor 1 East", "Floor 1 West"]) == ["Floor 1 East", "Floor 1 West"]
    assert without_shared(["Floor 1", "Floor 2"]) == ["Floor 1", "Floor 2"]
    assert least_storeys(["Run 9 Floor 1", "Run 9 Floor 2"]) == 1
    assert floor_numbers(["Run 1 Floor 2", "Run 1 Floor 3"]) == [2, 3]


@pytest.mark.parametrize("name", ["Acc_X", "a1", "Channel 2", "acc [m/s^2]", "stopwatch", "x"])
def test_other_names_say_no_height(name):
    assert height(name) is None


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        (["Acc RF", "Acc 1F", "Acc Table"], "Acc Table, Acc 1F, Acc RF"),
        (["Roof", "8th Fl", "Basement"], "Basement, 8th Fl, Roof"),
        (["A L3 [g]", "A L2 [g]", "A L1 [g]", "A ground [g]"],
         "A ground [g], A L1 [g], A L2 [g], A L3 [g]"),
        (["ag [g]", "Acc10 [g]", "Acc9 [g]"], "ag [g], Acc9 [g], Acc10 [g]"),
        (["1st floor", "Basement", "Ground level"], "Basement, Ground level, 1st floor"),
        (["Free field", "Basement", "Roof"], "Basement, Roof"),
        (["Run 1 2F", "Run 1 1F", "Run 1 Base"], "Run 1 Base, Run 1 1F, Run 1 2F"),
        (["Test3.a2_g", "Test3.a1_g", "Test3.ag_g"], "Test3.ag_g, Test3.a1_g, Test3.a2_g"),
    ],
)  # fmt: skip
def test_tables_with_the_roof_first_are_numbered_from_below(columns, expected):
    units = dict.fromkeys(columns, "g")
    guesses = suggest(columns, units)
    base, *floors = expected.split(", ")
    assert guesses == {base: "s_ddot1"} | {f: f"a{k}" for k, f in enumerate(floors, start=1)}


@pytest.mark.parametrize("word", ["cmd", "command", "demand", "setpoint", "desired"])
def test_what_a_machine_was_told_is_no_motion(word):
    columns = [f"Table acc {word} [g]", "Table acc fbk [g]", "Floor 1 acc [g]"]
    guesses = suggest(columns, dict.fromkeys(columns, "g"))
    assert guesses == {"Table acc fbk [g]": "s_ddot1", "Floor 1 acc [g]": "a1"}
    test = {f"Stroke {word} [mm]": "mm", "Stroke [mm]": "mm", "Load [kN]": "kN"}
    assert suggest(list(test), test) == {"Stroke [mm]": "s1", "Load [kN]": "r1"}


def test_displacements_have_the_numbers_of_their_floors():
    columns = ["Acc table [g]", "Acc 3F [g]", "Acc 2F [g]", "Acc 1F [g]", "Disp 3F [mm]"]
    units = {c: c.partition("[")[2].rstrip("]") for c in columns}
    guesses = suggest(columns, units)
    assert guesses["Disp 3F [mm]"] == "x3"
    assert guesses["Acc 3F [g]"] == "a3"


# Folders of folders, in either order.

MOTIONS = {"ground": 1.0, "2nd Floor": 2.0, "Roof": 3.0}
BY_FLOOR = {
    "files of one name": lambda event, floor, n: f"{event}/{floor}.csv",
    "channels of an agency": lambda event, floor, n: f"{event}/CHAN{n:03d}.V2",
    "names begin with the event": lambda event, floor, n: f"{event}/{event}_x.HNE.{n:02d}.V2",
    "a folder of each floor": lambda event, floor, n: f"{floor}/{event}.csv",
}


def write_folders(root: Path, name: str, a: np.ndarray) -> None:
    for k, event in enumerate(("quake_A", "quake_B"), start=1):
        for n, (floor, times) in enumerate(MOTIONS.items(), start=1):
            place = root / BY_FLOOR[name](event, floor, n)
            place.parent.mkdir(parents=True, exist_ok=True)
            u = k * times * a
            if place.suffix == ".V2":
                place.write_text(cesmd_v2(n, f"90 Deg, {floor}", u, DT, 4))
            else:
                rows = (f"{DT * k:.2f},{v:.9g}\n" for k, v in enumerate(u))
                place.write_text("time,acc [m/s^2]\n" + "".join(rows))


@pytest.mark.parametrize("name", BY_FLOOR)
def test_a_folder_of_folders_is_proposed_as_records_and_read_so(tmp_path, a, name):
    write_folders(tmp_path, name, a)
    seen = [one for path, _ in places([str(tmp_path)], {}) for one in inspections(path, {}, {})]
    channels = of_folders(tmp_path, seen)
    assert set(channels) - {"time"} == {"s_ddot1", "a1", "a2"}
    records, left_out = named_records(str(tmp_path), channels)
    assert (sorted(records), left_out) == (["quake_A", "quake_B"], {})
    for k, record in enumerate(records.values(), start=1):
        for channel, times in zip(("s_ddot1", "a1", "a2"), MOTIONS.values(), strict=True):
            assert np.abs(record.channels[channel] - k * times * a).max() < 1e-6


@pytest.mark.parametrize("events", [1, 2])
def test_an_archive_of_channels_is_proposed_as_one_record(tmp_path, a, events):
    for event in range(events):
        with zipfile.ZipFile(tmp_path / f"quake_{event}.zip", "w") as archive:
            for n, (floor, times) in enumerate(MOTIONS.items(), start=1):
                text = cesmd_v2(n, f"90 Deg, {floor}", times * a, DT, 4)
                archive.writestr(f"ce12345/CHAN{n:03d}.V2", text)
                spectra = f"Response and Fourier Amplitude Spectra  Chan {n}\n"
                archive.writestr(f"ce12345/CHAN{n:03d}.V3", spectra)
    place = tmp_path / "quake_0.zip" if events == 1 else tmp_path
    seen = [one for path, _ in places([str(place)], {}) for one in inspections(path, {}, {})]
    channels = of_folders(place, seen)
    assert channels == {c: f"CHAN00{n}.V2:acc{n}" for n, c in enumerate(("s_ddot1", "a1", "a2"), 1)}
    records, _ = named_records(str(place), channels)
    assert len(records) == events


def test_links_that_lead_out_of_a_folder_are_not_followed(tmp_path, a):
    write_folders(tmp_path / "elsewhere", "a folder of each floor", a)
    (tmp_path / "here" / "ground").mkdir(parents=True)
    os.symlink(tmp_path / "elsewhere" / "ground" / "quake_A.csv", tmp_path / "here/ground/q.csv")
    where = {"s_ddot1": "ground/*.csv:acc"}
    with pytest.raises(ValueError, match=r"no record has all of ground/\*\.csv"):
        named_records(str(tmp_path / "here"), where)


@pytest.mark.parametrize("file", ["../*.csv", "*/*.csv"])
def test_a_star_is_one_and_within_the_folder(tmp_path, a, file):
    write_folders(tmp_path / "here", "a folder of each floor", a)
    with pytest.raises(ValueError, match=r"expected one \* in the name of a file of the folder"):
        named_records(str(tmp_path / "here"), {"a1": f"{file}:acc"})
