"""Accelerograms and archives of strangers: quick, and refused in one line."""

from __future__ import annotations

import io
import os
import tempfile
import time
import zipfile
from pathlib import Path

import pytest
from hypothesis import given, settings

from data.measured.files.columns import FileError
from data.measured.files.table import read_table
from data.measured.files.zipped import unpacked
from data.measured.reading import read_records
from tests.hostile_records import File, record_files

EXAMPLES = int(os.environ.get("HOSTILE_EXAMPLES", "30"))
HEAD = "CORRECTED ACCELEROGRAM\n"
SERIES = "1 points of accel data equally spaced at .02 sec, in cm/sec2. (8f10.3)\n     1.000\n"


@pytest.mark.parametrize(
    "text",
    [
        HEAD + SERIES * 9000,  # a header was read again for each series: 3 min
        HEAD + "1 accel pts, " + "units=" * 20_000 + "\n" + SERIES,
        HEAD + "1 accel pts, units=" + " " * 20_000 + "\n" + SERIES,
        HEAD + "/&" + " " * 50_000 + "x\n" + SERIES,
        HEAD + ("location:" * 20_000 + "\n") * 5 + SERIES,
    ],
    ids=["series", "units", "spaces", "end", "location"],
)
def test_no_text_keeps_the_reader_of_accelerograms_busy(tmp_path, text):
    (tmp_path / "a.v2").write_text(text)
    began = time.process_time()
    with pytest.raises(FileError, match="1 row; expected at least 2"):
        read_table(tmp_path / "a.v2")
    assert time.process_time() - began < 2.0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("1 points", "1000000000000 points", "announces 1000000000000 values and 1 follow"),
        ("1 points", "9" * 5000 + " points", r"a\.v2 announces no accelerations"),
        (".02", "1.2.3", r"a\.v2 announces no accelerations"),
        (".02", "1e-400", "acc1 0 s.*expected one"),
        ("8f10.3", "8f999999", "has the format '8f999999'; expected 8F10.3"),
        ("cm/sec2", "counts", "is in 'counts'; expected cm/sec2"),
        ("points of", "pts of", r"a\.v2 announces no accelerations"),
        ("1 points", "9 points", "cut off"),
    ],
)
def test_hostile_headers_are_named_with_their_file(tmp_path, old, new, message):
    (tmp_path / "a.v2").write_text(HEAD + SERIES.replace(old, new))
    with pytest.raises(FileError, match=message):
        read_table(tmp_path / "a.v2")


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA, zipfile.ZIP_DEFLATED])
def test_damage_within_an_archive_is_named_however_it_is_packed(tmp_path, method):
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", method) as archive:
        archive.writestr("a.csv", "t,a1\n" + "".join(f"{k},{k * k % 7}\n" for k in range(30)))
    content, refused = bytearray(whole.getvalue()), 0
    first = content.index(b"a.csv") + len("a.csv")
    for k in range(30):
        content[first + k] ^= 255
        (tmp_path / "a.zip").write_bytes(content)
        try:
            read_records(tmp_path / "a.zip", {"a1": "a1"})
        except FileError as error:
            refused += "a.zip is damaged: " in str(error)
        content[first + k] ^= 255
    assert refused > 20


@pytest.mark.parametrize("file", ["../out.csv", "/etc/passwd", "..", "a/out.csv"])
def test_channels_of_an_archive_are_inside(tmp_path, file):
    (tmp_path / "out.csv").write_text("t,a1\n0,1\n1,2\n")
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.write(tmp_path / "out.csv", "a.csv")
    with pytest.raises(ValueError, match=r"is not in a\.zip; name its files without"):
        read_records(tmp_path / "a.zip", {"a1": f"{file}:a1", "f1": "a.csv:t"})


@settings(deadline=None, max_examples=EXAMPLES, derandomize=True)
@given(record_files())
def test_any_file_is_read_or_refused_in_a_line(file: File):
    """Of every format, odd, damaged, in archives; nothing is left beside it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"record{file.suffix}"
        path.write_bytes(file.content)
        try:
            records = read_records(path, file.mapped)
        except ValueError as error:
            assert len(str(error).splitlines()) == 1  # noqa: PT017
        else:
            assert all(len(u) > 1 for raw in records.values() for u in raw.channels.values())
        assert list(Path(folder).iterdir()) == [path]


def test_an_archive_of_rows_that_hardly_differ_is_taken_for_a_bomb(tmp_path):
    """Reading twenty members of 8 MB of the same row would take minutes; the file is small."""
    rows = b"time,f1,a1\n" + b"0.0,0.0,0.0\n" * 350_000
    with zipfile.ZipFile(tmp_path / "rows.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for k in range(20):
            archive.writestr(f"{k}.csv", rows)
    with pytest.raises(FileError, match="claim to unpack"), unpacked(tmp_path / "rows.zip"):
        pass
