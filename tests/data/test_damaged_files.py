# ruff: noqa: E501 — a table reads best with one case a line
"""Damaged and odd files: each either comes out right or is refused with a line that helps."""

from __future__ import annotations

import gzip
import io
import json
import os
import pickle
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]  # type: ignore[import-untyped]
import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
import pytest
import scipy.io
import scipy.sparse
from scipy.io.matlab import MatlabObject

from data.measured.files.table import Contents, FileError, read_table
from tests.agency_files import knet, lvm, mat_object, tdms
from tests.agency_files import xlsx as book

# Writers of damaged and odd files, and checks of what comes out
Write = Callable[[Path], object]
NAN, INF = float("nan"), float("inf")
LONG = np.arange(2000.0)


def text(content: str | bytes) -> Write:
    raw = content.encode() if isinstance(content, str) else content
    return lambda path: path.write_bytes(raw)


def mat(**arrays: Any) -> Write:
    return lambda path: scipy.io.savemat(path, arrays)


def npz(**arrays: Any) -> Write:
    return lambda path: np.savez(path, **arrays)


def parquet(**columns: Any) -> Write:
    return lambda path: pq.write_table(pa.table(columns), path)


def halved(write: Write) -> Write:
    def cut(path: Path) -> None:
        write(path)
        whole = path.read_bytes()
        path.write_bytes(whole[: len(whole) // 2])

    return cut


def hdf5(fill: Callable[[h5py.File], object]) -> Write:
    def write(path: Path) -> None:
        with h5py.File(path.parent / "elsewhere.h5", "w") as other:
            other["secret"] = np.arange(4.0)
        with h5py.File(path, "w") as file:
            fill(file)

    return write


def put(**arrays: Any) -> Callable[[h5py.File], None]:
    def fill(file: h5py.File) -> None:
        for name, value in arrays.items():
            file[name] = value

    return fill


def virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout(shape=(4,), dtype="f8")
    layout[:] = h5py.VirtualSource("elsewhere.h5", "secret", shape=(4,))
    file.create_virtual_dataset("a", layout)


def by_way_of_a_link(file: h5py.File) -> None:
    file["out"] = h5py.ExternalLink("elsewhere.h5", "/")
    file["a"] = h5py.SoftLink("/out/secret")


def external_storage(file: h5py.File) -> None:
    file.create_dataset("a", (4,), "f8", external=[("/etc/passwd", 0, 32)])


def own_parent(file: h5py.File) -> None:
    file["a"] = np.arange(4.0)
    file["again"] = file["/"]


class Planted:
    """Unpickling this would create a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.path),)


def planted(path: Path) -> np.ndarray:
    array = np.empty(3, dtype=object)
    array[:] = [Planted(path.parent / "PICKLE_RAN")] * 3
    return array


def bomb(path: Path) -> None:
    """Four members of 512 MiB of zeros; the declared sizes say so before anything is unpacked."""
    header = io.BytesIO()
    count = 2**29 // 8
    form = {"descr": "<f8", "fortran_order": False, "shape": (count,)}
    np.lib.format.write_array_header_1_0(header, form)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", header.getvalue() + bytes(2**16))
    raw = bytearray(path.read_bytes())
    at = raw.rindex(b"PK\x01\x02")  # the central directory, which readers trust
    raw[at + 24 : at + 28] = struct.pack("<I", 2**32 - 2)
    path.write_bytes(raw)


def lying_header(path: Path) -> None:
    """An array of a petabyte, of which three numbers are there."""
    form = {"descr": "<f8", "fortran_order": False, "shape": (2**47,)}
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, form)
    if path.suffix == ".npy":
        path.write_bytes(header.getvalue() + bytes(24))
        return
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.npy", header.getvalue() + bytes(24))


def spoilt_header(path: Path) -> None:
    np.save(path, LONG)
    path.write_bytes(path.read_bytes().replace(b"}", b"(", 1))


def huge_hdf5(file: h5py.File) -> None:
    file.create_dataset("a", (2**40,), "f8", chunks=(2**16,), compression="gzip")


def huge_mat(path: Path) -> None:
    """A compressed variable whose tag declares 4 GiB."""
    scipy.io.savemat(path, {"a": LONG}, do_compression=True)
    raw = path.read_bytes()
    body = bytearray(zlib.decompress(raw[136:]))
    body[4:8] = struct.pack("<I", 2**32 - 8)
    packed = zlib.compress(bytes(body))
    path.write_bytes(raw[:128] + struct.pack("<II", 15, len(packed)) + packed)


def xlsx(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("[Content_Types].xml", "<Types/>")


def stamped(path: Path) -> None:
    """Times in nanoseconds since 1970, 1 µs apart, which float64 would round to 256 ns."""
    rows = [f"{1741263967123456789 + 1000 * k},{k}" for k in range(4)]
    path.write_text("\n".join(["t,a", *rows]))


def columns(**expected: Sequence[float]) -> Callable[[Contents], None]:
    """A check that exactly these columns come out."""

    def check(table: Contents) -> None:
        assert list(table.columns) == list(expected)
        for name, values in expected.items():
            np.testing.assert_array_equal(table.columns[name], values)

    return check


def noted(fragment: str, **expected: Sequence[float]) -> Callable[[Contents], None]:
    """A check that these columns come out and that a note says why."""

    def check(table: Contents) -> None:
        columns(**expected)(table)
        assert any(fragment in note for note in table.notes), table.notes

    return check


def with_units(table: Contents) -> None:
    columns(t=[0, 1], acc=[2, 3], disp=[4, 5], **{"x (raw)": [6, 7]})(table)
    assert table.units == {"t": "s", "acc": "m/s^2", "disp": "in"}


def with_unit_row(table: Contents) -> None:
    noted("line 2 holds units", t=[0, 1], acc=[2, 3])(table)
    assert table.units == {"t": "s", "acc": "m/s^2"}


def flattened(table: Contents) -> None:
    columns(**{"run.acc": [1, 2, 3], "run.time": [0, 1, 2]})(table)
    assert table.facts == {"run.fs": 100.0}


pytestmark = pytest.mark.usefixtures("read_here")
TA = {"t": [0.0, 1.0], "a": [2.0, 3.0]}
CELL = np.array([1.0, "x"], dtype=object)
ROWS: list[list[object]] = [["t", "a1"], [0.0, 1.0], [0.1, 2.0], [0.2, 3.0]]
KNET = knet(np.arange(100.0), 0.01)
LVM = lvm({"a1": np.arange(40.0), "a2": np.arange(40.0)}, 0.01, decimal=",")
# name: file, how to write it, options, what the message must match or a check of what comes out
CASES: dict[str, tuple[str, Write, dict[str, Any], str | Callable[[Contents], None]]] = {
    # --- text: the file as a whole
    "empty": ("a.csv", text(""), {}, r"a\.csv is empty"),
    "blank lines only": ("a.csv", text("\n\n \n"), {}, r"none is left"),
    "header only": ("a.csv", text("t,a\n"), {}, r"a header and no rows"),
    "one row": ("a.csv", text("t,a\n0,1\n"), {}, r"has 1 row; expected at least 2"),
    "one column": ("a.csv", text("a\n1\n2.5\n"), {}, columns(a=[1, 2.5])),
    "wrong delimiter": ("a.csv", text("t,a\n0,2\n1,3\n"), {"delimiter": ";"}, r"';' occurs in no row.*data\.delimiter=','"),
    "byte-order mark": ("a.csv", text("\ufefft,a\n0,2\n1,3\n"), {}, noted("byte-order mark", **TA)),
    "UTF-16": ("a.csv", text("t,a\n0,2\n1,3\n".encode("utf-16")), {}, noted("UTF-16 text", **TA)),
    "UTF-16 without mark": ("a.csv", text("t,a\n0,2\n1,3\n".encode("utf-16-le")), {}, r"NUL|UTF-16"),
    "Windows-1252": ("a.csv", text("t [µs],a\n0,2\n1,3\n".encode("cp1252")), {}, noted("Windows-1252", **TA)),
    "Shift-JIS": ("a.csv", text("時刻,1階(g),地盤(g),a\n0,2,4,2\n1,3,5,3\n".encode("shift_jis")), {}, noted("neither UTF-8 nor", **{"c1": [0, 1], "1": [2, 3], "c3": [4, 5], "a": [2, 3]})),
    "GB18030": ("a.csv", text("测试,加速度\nt,a\n0,2\n1,3\n".encode("gb18030")), {}, noted("neither UTF-8 nor", **TA)),
    "Mac Roman": ("a.csv", text("Geb\u00e4ude\nt,a\n0,2\n1,3\n".encode("mac_roman")), {}, noted("neither UTF-8 nor", **TA)),
    "Windows-1251": ("a.csv", text("Время,a\n0,2\n1,3\n".encode("cp1251")), {}, noted("neither UTF-8 nor", c1=[0, 1], a=[2, 3])),
    "marks of Windows-1252": ("a.csv", text("# –––––– “…” 20 °C ±½°\nt [s],Boden [m/s²]\n0,2\n1,3\n".encode("cp1252")), {}, noted("Windows-1252", **{"t": [0, 1], "Boden": [2, 3]})),
    "words of Windows-1252": ("a.csv", text("t,Größe – “g’s”\n0,2\n1,3\n".encode("cp1252")), {}, noted("Windows-1252", **{"t": [0, 1], "Größe – “g’s”": [2, 3]})),
    "mixed line ends": ("a.csv", text("t,a\r\n0,2\r\n1,3\n"), {}, noted("mixed line ends", **TA)),
    "old Mac line ends": ("a.csv", text("t,a\r0,2\r1,3\r"), {}, columns(**TA)),
    "no end of last line": ("a.csv", text("t,a\n\n0,2\n\n1,3"), {}, columns(**TA)),
    "gzip": ("a.csv", lambda p: p.write_bytes(gzip.compress(b"t,a\n0,2\n")), {}, r"packed with gzip; unpack it first"),
    "web page": ("a.csv", text("<!DOCTYPE html><html>"), {}, r"the content is a web page"),
    "JSON named CSV": ("a.csv", text('{"a": [1, 2]}'), {}, r"the content is JSON; rename it to \.json"),
    "parquet named CSV": ("a.csv", parquet(a=[1.0, 2.0]), {}, r"promises text, but the content is Parquet; rename"),
    "CSV named MAT": ("a.mat", text("t,a\n0,2\n1,3\n"), {}, r"promises MAT, but the content is text"),
    "spreadsheet": ("a.xlsx", xlsx, {}, r"a\.xlsx is damaged"),
    "spreadsheet named NPZ": ("a.npz", xlsx, {}, r"is it a spreadsheet\? rename it to \.xlsx"),
    "unknown suffix of text": ("a.log", text("t,a\n0,2\n1,3\n"), {}, columns(**TA)),
    "unknown suffix, no table": ("a.log", text("Dear all,\nsee below.\n"), {}, r"a\.log: line 1|a\.log: column|no column of numbers|a\.log"),
    "unknown suffix, no text": ("a.xyz", text(b"\x01\x00\x02" * 99), {}, r"suffix '\.xyz' is not known and the content is no text; export the record as one of \.h5"),
    "figure of MATLAB": ("a.fig", text(b"\x01\x00\x02" * 99), {}, r"in MATLAB: L = findobj\(openfig\('a'\), 'Type', 'line'\)"),
    "program": ("a.tcl", text("recorder Node -file a.out\n"), {}, r"is a program; give the file of numbers it writes"),
    "K-NET without scale": ("a.ew", text(KNET.replace("Scale Factor", "Scale")), {}, r"expected such as 3920\(gal\)/6182761"),
    "K-NET without rate": ("a.ew", text(KNET.replace("100Hz", "fast")), {}, r"'sampling freq\(hz\)' 'fast'; expected a number above 0"),
    "K-NET with a rate of zero": ("a.ew", text(KNET.replace("100Hz", "0Hz")), {}, r"expected a number above 0"),
    "K-NET cut off": ("a.ew", text(KNET[: -len(KNET) // 4]), {}, r"announces 100 counts and \d+ follow"),
    "K-NET with text": ("a.ew", text(KNET.replace(" 17 ", " xx ")), {}, r"invalid literal.*expected whole counts"),
    "K-NET of huge counts": ("a.ew", text(KNET.replace("Duration Time(s)  1", "Duration Time(s)  99999999999")), {}, r"announces 9999999999900 counts and 100 follow"),
    "LabVIEW without end of header": ("a.lvm", text("LabVIEW Measurement\t\nSeparator\tTab\n0\t1\n"), {}, r"its header does not end"),
    "LabVIEW without rows": ("a.lvm", text(LVM.partition("X_Value")[0]), {}, r"a\.lvm"),
    "LabVIEW cut off": ("a.lvm", text(LVM[:-16]), {}, r"line \d+ has 2 cells; expected 3"),
    "LabVIEW with a strange decimal sign": ("a.lvm", text(LVM.replace("Decimal_Separator\t,", "Decimal_Separator\tx")), {}, r"the decimal sign 'x'"),
    "LabVIEW, clocks that differ": ("a.lvm", text(LVM.replace("X_Value\ta1", "X_Value\tX_Value")), {}, r"clocks of their own, and 'X_Value 2' differs"),
    "spreadsheet cut off": ("a.xlsx", halved(lambda p: book(p, Run=ROWS)), {}, r"a\.xlsx is damaged"),
    "spreadsheet of text": ("a.xlsx", lambda p: book(p, Notes=[["see"], ["below"], ["there"]]), {}, r"no sheet holds a table of numbers"),
    "spreadsheet, no such sheet": ("a.xlsx", lambda p: book(p, Run=ROWS), {"group": "Walk"}, r"no sheet 'Walk'; data\.group may name 'Run'"),
    "spreadsheet bomb": ("a.xlsx", bomb, {}, r"claim to unpack to 4 GiB"),
    "old spreadsheet of noise": ("a.xls", text(b"\xd0\xcf\x11\xe0" + bytes(range(256)) * 9), {}, r"a\.xls is damaged"),
    "TDMS cut off": ("a.tdms", halved(lambda p: tdms(p, {"g": {"a": LONG}}, 0.01)), {}, noted("cut off in its last segment", a=np.arange(990))),
    "TDMS of noise": ("a.tdms", text(b"TDSm" + bytes(range(256)) * 9), {}, r"a\.tdms"),
    "TDMS of unequal groups": ("a.tdms", lambda p: tdms(p, {"g": {"a": LONG}, "h": {"b": LONG[:9]}}, 0.01), {}, r"differ in length: a has 2000, b has 9.*data\.group"),
    "TDMS, no such group": ("a.tdms", lambda p: tdms(p, {"g": {"a": LONG}}, 0.01), {"group": "h"}, r"no group 'h'; data\.group may name 'g'"),
    "miniSEED of noise": ("a.mseed", text(b"000001D " + bytes(range(256)) * 9), {}, r"a\.mseed is damaged|need the package obspy"),
    "table of MATLAB": ("a.mat", lambda p: mat_object(p, "T", "table"), {}, r"'T' is a MATLAB table.*in MATLAB: S = table2struct\(T, 'ToScalar', true\); save\('a_plain\.mat', '-struct', 'S'\)"),
    "timetable of MATLAB": ("a.mat", lambda p: mat_object(p, "run", "timetable"), {}, r"timetable2table\(run, 'ConvertRowTimes', false\), 'ToScalar', true\); S\.time = seconds\(run\.Properties\.RowTimes - run\.Properties\.RowTimes\(1\)\); save\("),
    "object of MATLAB": ("a.mat", lambda p: mat_object(p, "M", "containers.Map"), {}, r"'M' is a MATLAB object or function"),
    "recorder cut off": ("a.out", text("0 1 2\n0.1 1 2\n0.2 1\n"), {}, r"line 3 has 2 cells; expected 3"),
    "recorder of XML": ("a.out", text("<?xml version='1.0'?><OpenSees/>"), {}, r"a web page or XML"),
    "response spectra": ("a.V3", text("Response and Fourier Amplitude Spectra\n" * 3), {}, r"volume 3\), from which no motion comes back; take volume 2"),
    "volume 2 with a count beyond all": ("a.V2", text("Corrected accelerogram\n999999999999999999 points of accel data equally spaced at .01 sec, in cm/sec2. (8f10.3)\n  1.0\n"), {}, r"announces 999999999999999999 values and 1 follow"),
    "pickle named CSV": ("a.csv", lambda p: p.write_bytes(pickle.dumps(Planted(p.parent / "PICKLE_RAN"))), {}, r"pickle, which could run code"),
    "NUL bytes in a row": ("a.csv", text("t,a\n0,2\n1\0,3\n"), {}, r"line 3 holds a NUL byte"),
    "NUL bytes far down": ("a.csv", text("t,a\n" + "0,2\n" * 60000 + "\0" * 50), {}, r"line 60002 holds a NUL byte"),
    "huge header line": ("a.csv", text("a" * (2**20 + 10) + "\n1\n2\n"), {}, r"line 1 is longer than 1048576 bytes"),
    "wide header": ("a.csv", text(",".join(f"a{k}" for k in range(5000)) + ("\n" + ",".join(["1"] * 5000)) * 2), {}, columns(**{f"a{k}": [1, 1] for k in range(5000)})),
    # --- text: header and preamble
    "preamble": ("a.csv", text("Logger 5\nStation,B\n\nt,a\n0,2\n1,3\n"), {}, noted("header found in line 4", **TA)),
    "preamble skipped": ("a.csv", text("Logger 5\nStation,B\n\nt,a\n0,2\n1,3\n"), {"skip_rows": 3}, noted("3 preamble lines skipped", **TA)),
    "too much skipped": ("a.csv", text("t,a\n0,2\n1,3\n"), {"skip_rows": 1}, r"line 2 holds numbers, not names"),
    "sep= of Excel": ("a.csv", text("sep=;\nt;a\n0;2\n1;3\n"), {}, noted("announces the delimiter ';'", **TA)),
    "no header": ("a.csv", text("0,2\n1,3\n"), {}, r"line 1 holds numbers, not names; set data\.header=false"),
    "no header, as told": ("a.csv", text("0,2\n1,3\n"), {"header": False}, noted("no header", c1=[0, 1], c2=[2, 3])),
    "preamble without header": ("a.txt", text("Station B\n\n0 2 4\n1 3 5\n"), {"header": False}, r"line 3 looks like the first row.*data\.skip_rows=2"),
    "comment before header": ("a.csv", text("# Station B\nt,a\n0,2\n1,3\n"), {}, noted("header found in line 2", **TA)),
    "header as comment": ("a.txt", text("# t a\n0 2\n1 3\n"), {}, noted("'#' before the header", **TA)),
    "comment amid rows": ("a.csv", text("t,a\n0,2\n# gap\n1,3\n"), {}, r"line 3 is a comment amid the rows: '# gap'"),
    "comments at the end": ("a.csv", text("t,a\n0,2\n1,3\n# end\n# bye\n"), {}, noted("comments at the end left out", **TA)),
    "repeated header": ("a.csv", text("t,a\n0,2\nt,a\n1,3\n"), {}, r"line 3 repeats the header"),
    "comment in one column": ("a.csv", text("a\n1\n# gap\n2\n"), {}, r"line 3, column 'a': '# gap' is a comment"),
    "duplicate names": ("a.csv", text("t,a,a\n0,2,4\n1,3,5\n"), {}, r"columns 2 and 3 are both named 'a'"),
    "duplicate but for units": ("a.csv", text("t,a [g],a [V]\n0,2,4\n1,3,5\n"), {}, columns(**{"t": [0, 1], "a [g]": [2, 3], "a [V]": [4, 5]})),
    "unnamed column": ("a.csv", text("t,,a\n0,9,2\n1,9,3\n"), {}, noted("has no name, called 'c2'", t=[0, 1], c2=[9, 9], a=[2, 3])),
    "trailing delimiter": ("a.csv", text("t,a,\n0,2,\n1,3,\n"), {}, noted("column 3 left out", **TA)),
    "trailing delimiter in rows": ("a.csv", text("t,a\n0,2,\n1,3,\n"), {}, noted("column 3 left out", **TA)),
    "a second table of other columns": ("a.csv", text("t;a;b\n" + "0;1;2\n" * 300 + "t;d\n" + "0;1\n" * 210), {}, r"line 302, 't;d', begins another table, unlike that above it; write a file for each"),
    "spoilt numbers below too few names": ("a.csv", text("Run;;;\nt;a\n" + "0,5;2.345,6;;\n0,6;3.345,6;;\n" * 6), {"decimal": "."}, r"'0,5' is no number with data\.decimal=\"\.\"; set data\.decimal=\",\""),
    "names and numbers mixed": ("a.csv", text("t,1,2\n0,2,3\n1,3,4\n"), {}, r"line 1 mixes names such as 't' with numbers"),
    "units in header": ("a.csv", text("t [s],acc (m/s^2),disp[in],x (raw)\n0,2,4,6\n1,3,5,7\n"), {}, with_units),
    "units in second line": ("a.csv", text("t,acc\ns,m/s^2\n0,2\n1,3\n"), {}, with_unit_row),
    # --- text: cells
    "decimal commas": ("a.csv", text("t;a\n0,0;2,5\n0,1;3,5\n"), {}, noted("decimal commas", t=[0, 0.1], a=[2.5, 3.5])),
    "decimal points told, commas there": ("a.csv", text("t;a\n0,0;2,5\n0,1;3,5\n"), {"decimal": "."}, r"line 2, column 't': '0,0' is no number.*set data\.decimal=\",\""),
    "decimal commas, one column": ("a.csv", text("a\n0,5\n1,5\n"), {}, r"set data\.decimal=\",\""),
    "decimal commas between commas": ("a.csv", text("t,a\n0,0,2,5\n0,1,3,5\n"), {}, r"if the commas are decimal"),
    "decimal points, commas told": ("a.csv", text("t;a\n0.0;2.5\n0.1;3.5\n"), {"decimal": ","}, r"set data\.decimal=\"\.\""),
    "late decimal comma": ("a.csv", text("t;a\n" + "0;1.5\n" * 400 + "1;1,5\n"), {}, r"line 402, column 'a': '1,5'"),
    "Unicode minus": ("a.csv", text("t;a\n0;1.5\n1;\u22122.5\n"), {}, columns(t=[0, 1], a=[1.5, -2.5])),
    "Unicode minus throughout, decimal commas": ("a.csv", text("t;a\n0;\u22121,5\n1;\u22122,5e\u22121\n"), {}, columns(t=[0, 1], a=[-1.5, -0.25])),
    "error of a spreadsheet": ("a.csv", text("t,a\n0,1\n1,#DIV/0!\n2,3\n"), {}, columns(t=[0, 1, 2], a=[1, np.nan, 3])),
    "a word amid numbers": ("a.csv", text("t,a\n0,1\n1,OVER\n2,3\n"), {}, r"line 3, column 'a': 'OVER' is no number; .*empty the cell"),
    "thousands": ("a.csv", text("t;a\n0;1,234.5\n1;2,345.5\n"), {}, r"'1,234\.5' is a number with separators of thousands"),
    "thousands with decimal commas": ("a.csv", text("t;a\n0;1.234,5\n1;2.345,5\n"), {"decimal": ","}, r"separators of thousands"),
    "thousands parted by points, the others whole": ("a.csv", text("t;a\n0;694\n1;1.980\n2;-2.105\n3;12\n"), {}, r"column 'a': 1\.980 is a number with separators of thousands"),
    "three decimals above 1, and whole ones": ("a.csv", text("t;a\n0;694\n1;1.98\n2;-2.105\n3;12\n"), {}, columns(t=[0, 1, 2, 3], a=[694, 1.98, -2.105, 12])),
    "thousands or decimals": ("a.csv", text('t,a\n0,"1,234"\n1,"2,345"\n'), {}, r"'1,234'.*thousands"),
    "text among numbers": ("a.csv", text("t,a\n0,2\n1,error\n2,3\n"), {}, r"line 3, column 'a': 'error' is no number"),
    "number among text": ("a.csv", text("t,a\n0,ok\n1,3\n2,ok\n"), {}, r"line 2, column 'a': 'ok' is no number"),
    "late number among text": ("a.csv", text("t,a\n" + "0,ok\n" * 400 + "1,3\n"), {}, r"line 402, column 'a': '3' is a number in a column of text"),
    "text column": ("a.csv", text("t,tag,a\n0,ok,2\n1,bad,3\n"), {}, noted("'tag' left out: text", **TA)),
    "text column wanted": ("a.csv", text("t,tag\n0,ok\n1,bad\n"), {"columns": ["tag"]}, r"column 'tag' holds text"),
    "NaN, infinite and empty": ("a.csv", text("t,a,b,c\n0,NaN,inf,\n1,,-inf,NA\n2,5,6,7\n"), {}, columns(t=[0, 1, 2], a=[NAN, NAN, 5], b=[INF, -INF, 6], c=[NAN, NAN, 7])),
    "signs, blanks, exponents": ("a.csv", text("t,a\n+1, 2 \n.5,-1E-2\n   ,3.\n"), {}, columns(t=[1, 0.5, NAN], a=[2, -0.01, 3])),
    "empty column": ("a.csv", text("t,gap,a\n0,,2\n1,,3\n"), {}, noted("'gap' is empty", t=[0, 1], gap=[NAN, NAN], a=[2, 3])),
    "column that fills late": ("a.csv", text("t,a\n" + "0,\n" * 300 + "1,5.5\n"), {}, columns(t=[0] * 300 + [1], a=[NAN] * 300 + [5.5])),
    "complex": ("a.csv", text("t,a\n0,1+2j\n1,3-1j\n2,5\n"), {}, r"line 2, column 'a': '1\+2j' is complex"),
    "lone minus": ("a.csv", text("t,a\n0,2\n1,-\n2,3\n"), {}, r"line 3, column 'a': '-' is no number"),
    "hexadecimal": ("a.csv", text("t,a\n0,2\n1,0x1F\n2,3\n"), {}, r"'0x1F' is hexadecimal"),
    "units in cells": ("a.csv", text("t,a\n0,9.81\n1,9.82 m/s2\n"), {}, r"'9\.82 m/s2' is not a bare number; write the unit into the header"),
    "date among numbers": ("a.csv", text("t,a\n0,2\n1,03/06/2025\n"), {}, r"'03/06/2025' is a date"),
    "clock times": ("a.csv", text("clock,a\n12:00:01,2\n12:00:02,3\n"), {}, noted("times of the day", clock=[43201, 43202], a=[2, 3])),
    "complex throughout": ("a.csv", text("t,a\n0,1+2j\n1,3-1j\n"), {}, r"'1\+2j' is complex"),
    "units in all cells": ("a.csv", text("t,a\n0,9.81 m/s2\n1,9.82 m/s2\n"), {}, r"line 2, column 'a': '9\.81 m/s2' is not a bare number"),
    "blank cells beside integers beyond 2^53": ("a.csv", text(f"t,a\n{2**60 + 1},  \n{2**60 + 4},3\n"), {}, noted("subtracted", t=[0, 3], a=[NAN, 3])),
    "dates": ("a.csv", text("day,a\n3/6/2025,2\n3/7/2025,3\n"), {}, noted("'day' left out: text", a=[2, 3])),
    "ISO times": ("a.csv", text("when,a\n2025-03-06T12:00:00.25,2\n2025-03-06T12:00:01.5,3\n"), {}, noted("seconds since 2025-03-06T12:00:00.25", when=[0, 1.25], a=[2, 3])),
    "ISO times with zone": ("a.csv", text("when,a\n2025-03-06 12:00:00Z,2\n2025-03-06 12:00:02Z,3\n"), {}, columns(when=[0, 2], a=[2, 3])),
    "ISO times, one broken": ("a.csv", text("when,a\n" + "2025-03-06 12:00:00,2\n" * 300 + "soon,3\n"), {}, r"line 302, column 'when': 'soon' is no time"),
    "integers beyond 2^53": ("a.csv", stamped, {}, noted("first entry 1741263967123456789 subtracted", t=[0, 1000, 2000, 3000], a=[0, 1, 2, 3])),
    "integers far apart": ("a.csv", text("t,a\n1,2\n9007199254740993777,3\n"), {}, r"more than the 2\^53 that float64 holds"),
    "ragged: too few": ("a.csv", text("t,a\n0,2\n1\n2,3\n"), {}, r"line 3 has 1 cells; expected 2"),
    "ragged: too many": ("a.csv", text("t,a\n0,2\n1,3,9\n2,3\n"), {}, r"line 3 has 3 cells; expected 2"),
    "ragged: white space": ("a.txt", text("t  a\n0\t2\n1  3 9\n2 3\n"), {}, r"line 3 has 3 cells; expected 2"),
    "header too short": ("a.csv", text("t,a\n0,2,3\n1,3,4\n"), {}, r"line 1 has 2 cells, line 2 has 3"),
    "last line cut off": ("a.csv", text("t,a,b\n0,2,4\n1,3,5\n2,"), {}, r"line 4 has 2 cells; expected 3"),
    "line of blanks": ("a.csv", text("t,a\n0,2\n   \n1,3\n"), {}, r"line 3 has 1 cells; expected 2"),
    "quoted cells": ("a.csv", text('"t","a, raw"\n"0","2"\n"1","3"\n'), {}, columns(**{"t": [0, 1], "a, raw": [2, 3]})),
    "quote never closed": ("a.csv", text('t,a,tag\n0,2,"ok\n1,3,fine\n2,4,fine\n'), {}, r"line 2 has a quote that is never closed"),
    "quote never closed, column not read": ("a.csv", text('t,tag\n0,"ok\n1,"fine\n2,fine\n'), {"columns": ["t"]}, r"line 2 has a quote that is never closed"),
    "quote over two lines": ("a.csv", text('t,tag\n0,"o\nk"\n1,fine\n'), {}, r"line 2 has a quote"),
    # --- MAT
    "truncated MAT": ("a.mat", halved(mat(a=LONG)), {}, r"a\.mat is damaged"),
    "MAT of noise": ("a.mat", text(bytes(range(256)) * 4), {}, r"a\.mat is damaged"),
    "MAT with lying size": ("a.mat", huge_mat, {}, r"claim to unpack to 4 GiB|is damaged"),
    "MATLAB struct": ("a.mat", mat(run={"acc": [1.0, 2, 3], "time": [0.0, 1, 2], "fs": 100.0}), {}, flattened),
    "MATLAB struct array": ("a.mat", mat(a=np.zeros(3, dtype=[("x", "f8")])), {}, r"'a' is an array of 3 structs"),
    "MATLAB cell": ("a.mat", mat(c=CELL, a=LONG), {}, r"'c' is a cell array.*data\.channels"),
    "MATLAB cell left out": ("a.mat", mat(c=CELL, a=[1.0, 2.0]), {"columns": ["a"]}, noted("'c' left out", a=[1, 2])),
    "MATLAB char": ("a.mat", mat(unit="g", a=[1.0, 2.0]), {}, noted("text 'unit' = 'g'", a=[1, 2])),
    "MATLAB object": ("a.mat", mat(o=MatlabObject(np.zeros((1, 1), dtype=[("x", "O")]), "inline"), a=LONG), {}, r"'o' is a MATLAB object"),
    "MATLAB sparse": ("a.mat", mat(s=scipy.sparse.eye_array(3, format="csc"), a=LONG), {}, r"'s' is a sparse matrix"),
    "MATLAB complex": ("a.mat", mat(a=LONG * 1j), {}, r"'a' holds complex numbers"),
    "MAT without arrays": ("a.mat", mat(unit="g"), {}, r"no column of numbers"),
    # --- HDF5
    "truncated HDF5": ("a.h5", halved(hdf5(put(a=LONG))), {}, r"a\.h5 is damaged"),
    "HDF5 external link": ("a.h5", hdf5(put(b=LONG, a=h5py.ExternalLink("elsewhere.h5", "/secret"))), {}, r"'a' is an external link to 'elsewhere\.h5'"),
    "HDF5 external link wanted": ("a.h5", hdf5(put(a=h5py.ExternalLink("elsewhere.h5", "/secret"))), {"columns": ["a"]}, r"'a' is an external link"),
    "HDF5 external group": ("a.h5", hdf5(put(g=h5py.ExternalLink("elsewhere.h5", "/"))), {"group": "g"}, r"no group 'g'"),
    "HDF5 soft link within": ("a.h5", hdf5(put(**{"g/x": [1.0, 2.0], "a": h5py.SoftLink("/g/x")})), {"columns": ["a"]}, columns(a=[1, 2])),
    "HDF5 soft link to nothing": ("a.h5", hdf5(put(b=LONG, a=h5py.SoftLink("/nowhere"))), {}, r"'a' is a soft link to '/nowhere'"),
    "HDF5 soft link out": ("a.h5", hdf5(by_way_of_a_link), {"columns": ["a"]}, r"'a' is a soft link to '/out/secret'"),
    "HDF5 virtual dataset": ("a.h5", hdf5(virtual), {}, r"'a' is a virtual dataset"),
    "HDF5 external storage": ("a.h5", hdf5(external_storage), {}, r"'a' is kept in an external file"),
    "HDF5 group within itself": ("a.h5", hdf5(own_parent), {}, r"'again' is a second name of a group"),
    "HDF5 without datasets": ("a.h5", hdf5(lambda f: f.create_group("g")), {}, r"no column of numbers"),
    "HDF5 too large": ("a.h5", hdf5(huge_hdf5), {}, r"claim to unpack to 8192 GiB"),
    "HDF5 text": ("a.h5", hdf5(put(a=[1.0, 2.0], tag=["x", "y"])), {}, noted("text 'tag'", a=[1, 2])),
    "HDF5 compound": ("a.h5", hdf5(put(r=np.array([(0, 2), (1, 3)], dtype=[("t", "f8"), ("a", "i4")]))), {}, columns(**TA)),
    "HDF5 complex": ("a.h5", hdf5(put(a=LONG * 1j)), {}, r"'a' holds complex numbers"),
    # --- Parquet
    "truncated parquet": ("a.parquet", halved(parquet(a=LONG)), {}, r"a\.parquet is damaged"),
    "parquet text": ("a.parquet", parquet(a=[1.0, None], tag=["x", "y"]), {}, noted("'tag' left out: string", a=[1, NAN])),
    "parquet nested lists": ("a.parquet", parquet(a=[1.0, 2.0], w=[[1.0], [2.0, 3.0]]), {}, r"'w' is nested \(list<"),
    "parquet nested left out": ("a.parquet", parquet(a=[1.0, 2.0], w=[[1.0], [2.0]]), {"columns": ["a"]}, columns(a=[1, 2])),
    "parquet dictionary of text": ("a.parquet", parquet(a=[1.0, 2.0], tag=pa.array(["x", "y"]).dictionary_encode()), {}, noted("'tag' left out", a=[1, 2])),
    "parquet dictionary of numbers": ("a.parquet", parquet(a=pa.array([4.0, 5.0, 4.0]).dictionary_encode()), {}, columns(a=[4, 5, 4])),
    "parquet times": ("a.parquet", parquet(t=np.array([10, 12], dtype="datetime64[s]")), {}, noted("seconds since", t=[0, 2])),
    "parquet integers beyond 2^53 with a gap": ("a.parquet", parquet(t=[2**60 + 1, None]), {}, r"2\^53|damaged.*out of bounds|not in range"),
    "parquet integers beyond 2^53": ("a.parquet", parquet(t=[2**60 + 1, 2**60 + 4]), {}, noted("subtracted", t=[0, 3])),
    "parquet one row": ("a.parquet", parquet(t=[1.0]), {}, r"has 1 row"),
    # --- NPZ, NPY
    "truncated NPZ": ("a.npz", halved(npz(a=LONG)), {}, r"a\.npz is damaged"),
    "truncated NPY": ("a.npy", halved(lambda p: np.save(p, LONG)), {}, r"a\.npy is damaged"),
    "NPZ bomb": ("a.npz", bomb, {}, r"claim to unpack to 4 GiB"),
    "NPZ with lying header": ("a.npz", lying_header, {}, r"is damaged: 'a' of shape .* needs"),
    "NPY with lying header": ("a.npy", lying_header, {}, r"is damaged: 'a' of shape .* needs"),
    "NPY with spoilt header": ("a.npy", spoilt_header, {}, r"a\.npy is damaged"),
    "NPZ pickle": ("a.npz", lambda p: np.savez(p, a=planted(p)), {}, r"'a' is an object array \(a pickle"),
    "NPZ pickle left out": ("a.npz", lambda p: np.savez(p, a=planted(p), b=[1.0, 2.0]), {"columns": ["b"]}, noted("'a' left out", b=[1, 2])),
    "NPY pickle": ("a.npy", lambda p: np.save(p, planted(p), allow_pickle=True), {}, r"is an object array \(a pickle"),
    "NPZ lengths differ": ("a.npz", npz(a=[1.0, 2.0], b=[1.0, 2.0, 3.0]), {}, r"differ in length: a has 2, b has 3"),
    "NPZ three dimensions": ("a.npz", npz(a=np.zeros((4, 3, 2))), {}, r"'a' has the shape \(4, 3, 2\)"),
    "NPZ on its side": ("a.npz", npz(a=np.zeros((3, 40))), {}, noted("its rows are taken for channels", a1=[0] * 40, a2=[0] * 40, a3=[0] * 40)),
    "NPZ row vector": ("a.npz", npz(a=[[1.0, 2.0, 3.0]]), {}, noted("row vector", a=[1, 2, 3])),
    "NPZ scalars only": ("a.npz", npz(dt=0.1, fs=10), {}, r"no column of numbers"),
    "NPZ unsigned beyond 2^53": ("a.npz", npz(t=np.array([2**63 + 5, 2**63 + 2], dtype=np.uint64)), {}, noted("subtracted", t=[0, -3])),
    "NPZ name twice": ("a.npz", npz(a=np.zeros((4, 2)), a1=np.zeros(4)), {}, r"both named 'a1'"),
    "NPZ empty": ("a.npz", npz(), {}, r"no column of numbers"),
    # --- JSON
    "JSON objects": ("a.json", text('[{"t": 0, "a": 2}, {"a": 3, "t": 1}]'), {}, columns(**TA)),
    "JSON lines": ("a.json", text('{"t": 0, "a": 2}\n{"a": 3, "t": 1}\n'), {}, columns(**TA)),
    "JSON lines of objects": ("a.jsonl", text('{"t": 0, "acc": {"a": 2}}\n{"t": 1, "acc": {"a": 3}}\n'), {}, columns(**{"t": [0, 1], "acc.a": [2, 3]})),
    "JSON of pandas by columns": ("a.json", text('{"t": {"0": 0, "1": 1}, "a": {"0": 2, "1": 3}}'), {}, columns(**TA)),
    "JSON of pandas by rows": ("a.json", text('{"0": {"t": 0, "a": 2}, "1": {"t": 1, "a": 3}}'), {}, columns(**TA)),
    "JSON of pandas split": ("a.json", text('{"columns": ["t", "a"], "data": [[0, 2], [1, 3]]}'), {"columns": ["t", "a"]}, columns(**TA)),
    "JSON rows": ("a.json", text('{"data": [[0, 2], [1, 3]], "dt": 1, "u": "in"}'), {}, noted("u: 'in'", c1=[0, 1], c2=[2, 3])),
    "JSON ragged rows": ("a.json", text('{"data": [[0, 2], [1]]}'), {}, r"row 2 has 1 values; expected 2"),
    "JSON lengths differ": ("a.json", text('{"t": [0, 1], "a": [1, 2, 3]}'), {}, r"t has 2, a has 3"),
    "JSON objects differ": ("a.json", text('[{"t": 0, "a": 2}, {"t": 1, "b": 3}]'), {}, r"row 2 lacks 'a'"),
    "JSON NaN and null": ("a.json", text('{"a": [NaN, null, -Infinity, 4]}'), {}, columns(a=[NAN, NAN, -INF, 4])),
    "JSON numbers as text": ("a.json", text('{"a": [1, "2", 3]}'), {}, r"a, row 2: '2' is no number"),
    "JSON text": ("a.json", text('{"a": [1, 2], "tag": ["x", "y"]}'), {}, noted("'tag' left out", a=[1, 2])),
    "JSON nested deeply": ("a.json", text("[" * 100000), {}, r"nested too deeply|is no JSON"),
    "JSON nested values": ("a.json", text('{"a": [[1, 2], [3, 4]]}'), {}, r"a, row 1: '\[1, 2\]' is no number"),
    "JSON name twice": ("a.json", text('{"a": [1, 2], "a": [3, 4]}'), {}, r"'a' occurs twice"),
    "JSON cut off": ("a.json", text('{"a": [1, 2'), {}, r"is no JSON"),
    "JSON scalar": ("a.json", text("5"), {}, r"expected named lists"),
    "JSON integers too large": ("a.json", text(json.dumps({"a": [10**30, 1]})), {}, r"2\^53|float64"),
    # --- paths
    "folder": ("a.csv", Path.mkdir, {}, r"is a folder; name one file in it"),
    "missing, near name": ("flor_1.csv", lambda p: (p.parent / "floor_1.csv").touch(), {}, r"does not exist; did you mean 'floor_1\.csv'\?"),
    "missing folder": ("none/a.csv", lambda p: None, {}, r"nor does its folder"),
    "pipe": ("a.csv", os.mkfifo, {}, r"a device or a pipe"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_odd_file(case: str, tmp_path: Path) -> None:
    name, write, options, expected = CASES[case]
    path = tmp_path / name
    write(path)
    if callable(expected):
        expected(read_table(path, **options))
    else:
        with pytest.raises(FileError, match=expected) as caught:
            read_table(path, **options)
        message = str(caught.value)
        assert "\n" not in message
        assert path.name in message
        assert len(message) < 400 + len(str(path))
        assert caught.value.__cause__ is None
        assert caught.value.__suppress_context__ or caught.value.__context__ is None
    assert not (tmp_path / "PICKLE_RAN").exists()


def test_the_planted_pickle_would_run(tmp_path: Path) -> None:
    """Otherwise the tests above would prove nothing."""
    np.save(tmp_path / "a.npy", planted(tmp_path / "a.npy"), allow_pickle=True)
    np.load(tmp_path / "a.npy", allow_pickle=True)
    assert (tmp_path / "PICKLE_RAN").is_dir()


def test_unreadable_file(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,a\n0,2\n1,3\n")
    path.chmod(0)
    if os.access(path, os.R_OK):
        path.chmod(stat.S_IRUSR | stat.S_IWUSR)
        pytest.skip("this user may read everything")
    with pytest.raises(FileError, match="grant yourself read permission"):
        read_table(path)
