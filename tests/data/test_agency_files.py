"""Accelerograms of agencies, zip archives and universal files: read as they were written."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest

from data.inspect.inspection import suggest
from data.measured.files.table import FileError, read_table
from data.measured.files.zipped import unpacked
from data.measured.reading import read_records
from tests.agency_files import cosmos, csmip_v1, csmip_v2, peer, uff58

pytestmark = pytest.mark.usefixtures("read_here")
DT, T = 0.02, 1500
PLACES = {1: "90 Deg, Ground: West", 13: "90 Deg, Roof: Center"}


@pytest.fixture
def motion() -> dict[int, tuple[str, np.ndarray]]:
    """Accelerations of two sensors [m/s²], so large that numbers of fixed columns touch."""
    rng = np.random.default_rng(0)
    shaken = np.exp(-(((np.arange(T) - 600) / 300) ** 2)) * rng.standard_normal((2, T))
    return {n: (place, u) for (n, place), u in zip(PLACES.items(), shaken, strict=True)}


VARIANTS = {
    "a.v2": (lambda m: csmip_v2(m, DT), 1e-5),
    "b.V2": (lambda m: csmip_v2(m, DT, motions=False), 1e-5),
    "c.V1": (lambda m: csmip_v1(m, DT), 1e-3),
    "d.V2c": (lambda m: cosmos(m, DT), 1e-7),
    "e.v2c": (lambda m: cosmos(m, DT, "cgs"), 1e-6),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_accelerations_of_all_channels_are_read(tmp_path, motion, name):
    write, error = VARIANTS[name]
    (tmp_path / name).write_text(write(motion))
    table = read_table(tmp_path / name)
    assert table.facts["dt"] == pytest.approx(DT, rel=1e-9)
    factor = {"cm/s^2": 0.01, "0.1*g": 0.980665}[table.units["acc13"]]
    for number, (_, a) in motion.items():
        assert np.abs(factor * table.columns[f"acc{number}"] - a).max() <= error
    assert "Roof" in table.labels["acc13"]


def test_a_step_that_does_not_fit_the_announced_length_is_not_taken(tmp_path, motion):
    """Seconds where milliseconds belong, in a header that does not say the length again."""
    text = cosmos({1: motion[1]}, DT)
    length = f"{DT * T:15.6f}"
    spoilt = text.replace(f"{1e3 * DT:15.6f}{length}", f"{DT:15.6f}{-999.0:15.6f}", 1)
    assert spoilt != text
    (tmp_path / "a.V2c").write_text(spoilt)
    assert read_table(tmp_path / "a.V2c").facts["dt"] == pytest.approx(DT)


def test_peer_files_are_measured_records_too(tmp_path, motion):
    (tmp_path / "a.AT2").write_text(peer(motion[1][1], DT))
    table = read_table(tmp_path / "a.AT2")
    assert (table.units, table.facts) == ({"acc": "g"}, {"dt": DT})
    assert np.abs(9.80665 * table.columns["acc"] - motion[1][1]).max() < 1e-6


def test_a_peer_file_may_have_a_time_before_each_value(tmp_path, motion):
    a = motion[1][1] / 9.80665
    head = f"PEER\nQuake\nACCELERATION IN UNITS OF G\nNPTS= {len(a)}, DT= {DT} SEC\n"
    rows = "\n".join(f"{DT * k:.6E}  {v:.7E}" for k, v in enumerate(a))
    (tmp_path / "a.txt").write_text(head + rows)
    table = read_table(tmp_path / "a.txt")
    assert np.abs(table.columns["acc"] - a).max() < 1e-6


# Archives


def pack(path, **files: str) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in files.items():
            archive.writestr(name, text)


def test_an_archive_is_its_one_file_or_its_folder(tmp_path, motion):
    pack(tmp_path / "one.zip", **{"CE12345/a.v2": csmip_v2(motion, DT)})
    where = {"s_ddot1": "acc1", "a1": "acc13"}
    (record,) = read_records(tmp_path / "one.zip", where).values()
    ground = {1: motion[1]}
    roof = {13: motion[13]}
    files = {"CE/HNE.1.V2c": cosmos(ground, DT), "CE/HNE.13.V2c": cosmos(roof, DT)}
    pack(tmp_path / "two.zip", **files, **{"CE/readme.pdf": "%PDF"})
    named = {"s_ddot1": "HNE.1.V2c:acc1", "a1": "HNE.13.V2c:acc13"}
    (other,) = read_records(tmp_path / "two.zip", named).values()
    for channel in where:
        assert other.channels[channel] == pytest.approx(record.channels[channel], abs=2e-5)


@pytest.mark.parametrize(
    ("names", "kept"),
    [
        (["../../escaped.csv", "/abs.csv"], ["abs.csv", "escaped.csv"]),
        (["a/x.csv", "b/x.csv"], ["a_x.csv", "b_x.csv"]),
        (["x.csv", "inner.zip", "__MACOSX/x.csv", ".hidden"], ["x.csv"]),
        (["..\\..\\evil.csv"], ["evil.csv"]),
    ],
)
def test_nothing_leaves_the_folder_of_an_archive(tmp_path, names, kept):
    pack(tmp_path / "a.zip", **dict.fromkeys(names, "t,a1\n0,1\n1,2\n"))
    with unpacked(tmp_path / "a.zip") as folder:
        assert sorted(p.name for p in folder.rglob("*")) == kept
    assert not folder.exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.zip"]


def test_more_than_an_archive_says_is_not_written(tmp_path):
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.csv", bytes(10**6))
    lie = whole.getvalue().replace((10**6).to_bytes(4, "little"), (10).to_bytes(4, "little"))
    (tmp_path / "a.zip").write_bytes(lie)
    with pytest.raises(FileError, match=r"damaged|unpacks to more"), unpacked(tmp_path / "a.zip"):
        pass


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"no archive at all"])
def test_damaged_archives_are_named(tmp_path, content):
    (tmp_path / "a.zip").write_bytes(content)
    with pytest.raises(FileError, match=r"a\.zip is damaged"), unpacked(tmp_path / "a.zip"):
        pass


# Universal files


@pytest.mark.parametrize("binary", [True, False])
def test_universal_files_are_read(tmp_path, motion, binary):
    a = motion[1][1]
    pytest.importorskip("pyuff")
    (tmp_path / "a.uff").write_bytes(uff58({1: a, 2: 2.0 * a}, DT, binary))
    table = read_table(tmp_path / "a.uff")
    assert list(table.columns) == ["acc_1X", "acc_2X"]
    assert np.abs(table.columns["acc_2X"] - 2.0 * a).max() < 1e-5
    assert table.facts["dt"] == pytest.approx(DT)
    assert table.units["acc_1X"] == "m/s^2"
    assert table.labels == {}  # the title of the test, which both bear, is no place


def test_what_a_universal_file_calls_a_response_says_what_it_is(tmp_path, motion):
    a = motion[1][1]
    pytest.importorskip("pyuff")
    names = {1: "Table", 2: "Floor 1", 3: "Floor 2"}
    (tmp_path / "a.uff").write_bytes(uff58({n: n * a for n in names}, DT, False, names))
    table = read_table(tmp_path / "a.uff")
    guesses = suggest(list(table.columns), table.units, table.labels)
    assert guesses == {"acc_1X": "s_ddot1", "acc_2X": "a1", "acc_3X": "a2"}


def test_a_sensor_against_an_axis_of_a_universal_file_is_turned_and_told(tmp_path, motion):
    a = motion[1][1]
    pytest.importorskip("pyuff")
    sets = uff58({1: a}, DT, False) + uff58({2: -a}, DT, False, along=-1)
    (tmp_path / "a.uff").write_bytes(sets)
    table = read_table(tmp_path / "a.uff")
    assert np.abs(table.columns["acc_2X"] - a).max() < 1e-5
    assert "acc_2X: its sensor points against the axis; sign reversed" in table.notes


@pytest.mark.parametrize(("length", "unit"), [(1.0, "m/s^2"), (1000.0, None)])
def test_a_response_without_a_unit_is_in_si_unless_the_file_says_other_units(
    tmp_path, motion, length, unit
):
    pytest.importorskip("pyuff")
    factors = "".join(f"{factor:25.16E}" for factor in (length, 1.0, 1.0))
    said = f"{-1:6d}\n{164:6d}\n{5:10d}{'mm (milli-newton)':<20}{2:10d}\n{factors}\n"
    said += f"{0.0:25.16E}\n{-1:6d}\n"
    sets = uff58({1: motion[1][1]}, DT, False).replace(b"m/s^2", b"NONE ")
    (tmp_path / "a.uff").write_bytes(said.encode() + sets)
    assert read_table(tmp_path / "a.uff").units.get("acc_1X") == unit


def test_a_universal_file_that_was_cut_off_is_refused(tmp_path, motion):
    a = motion[1][1]
    pytest.importorskip("pyuff")
    cut = uff58({1: a[:-9]}, DT, False)
    (tmp_path / "a.uff").write_bytes(cut.replace(b"      1491", b"      1500", 1))
    with pytest.raises(FileError, match=r"announces 1500 values of 'acc_1X' and 1491 follow"):
        read_table(tmp_path / "a.uff")


@pytest.mark.parametrize(
    "content", [b"    -1\n", b"    -1\n    58\n junk\n    -1\n", b"PK\x03\x04"]
)
def test_damaged_universal_files_are_named(tmp_path, content):
    pytest.importorskip("pyuff")
    (tmp_path / "a.uff").write_bytes(content)
    with pytest.raises(FileError, match=r"a\.uff"):
        read_table(tmp_path / "a.uff")
