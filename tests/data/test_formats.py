"""Files of loggers, agencies and programs, in layouts that users have: read as they were meant."""

from __future__ import annotations

import numpy as np
import pytest

from data.measured.files.table import FileError, read_table
from data.measured.units import to_si
from tests.agency_files import cesmd_v1, cesmd_v2, knet, lvm

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
