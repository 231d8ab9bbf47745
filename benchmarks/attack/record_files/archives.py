"""Zip archives of record files, and what may be wrong with an archive."""

from __future__ import annotations

import io
import random
import struct
import tempfile
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path

from benchmarks.attack.record_files.case import Case

METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
NAMES = (
    *("../../out.csv", "/tmp/out.csv", "C:\\out.csv", "..\\..\\out.csv", "a/../b.csv", "./r.csv"),
    *("a\x1b[31mb.csv", "\u202evsc.csv", "[red]x[/red].csv", "=1+1.csv", "a b.csv", "ü.csv"),
    "x" * 300,
    *("${oc.env:ATTACK_SECRET}.csv", "$(touch executed).csv", "-rf.csv", "CON.csv", ".hidden.csv"),
    *("__MACOSX/._r.csv", "r.zip", "R.CSV", "r.CSV", "a\nb.csv", "...", "..", "dir/", "a:b.csv"),
    *("/".join(["d"] * 300) + "/r.csv", ".csv", "r.csv.", "r.csv ", "~", "r", "executed", "'.csv"),
)  # fmt: skip
FIELDS = (  # of a member in the central directory: where, of what kind
    *((8, "<H"), (10, "<H"), (16, "<I"), (20, "<I"), (24, "<I"), (28, "<H"), (30, "<H")),
    *((38, "<I"), (42, "<I"), (6, "<H"), (12, "<I")),
)


def zipped(draw: random.Random, inner: Case) -> Case:
    """An archive of a file, good or odd; what is inside keeps its mapping of channels."""
    way = draw.choice(WAYS)
    seed = draw.randrange(2**32)

    def write(path: Path) -> None:
        path.write_bytes(way(random.Random(seed), _content(inner), f"record{inner.suffix}"))

    what = f"zip {way.__name__.strip('_')} of {inner.what}"
    return Case(what, draw.choice((".zip", ".zip", ".ZIP")), write, inner.mapped)


def _content(case: Case) -> bytes:
    with tempfile.TemporaryDirectory(prefix="attack-member") as folder:
        path = Path(folder) / f"member{case.suffix}"
        case.write(path)
        return path.read_bytes()


def _archive(members: list[tuple[str | zipfile.ZipInfo, bytes]], method: int = 8) -> bytes:
    """Packed lightly: a bomb is no smaller a bomb, and made in half the time."""
    file = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # two members of one name are wanted
        with zipfile.ZipFile(file, "w", method, compresslevel=1) as archive:
            for name, raw in members:
                archive.writestr(name, raw, compress_type=method)
    return file.getvalue()


def _good(draw: random.Random, raw: bytes, name: str) -> bytes:
    folder = draw.choice(("", "", "data/", "a/b/"))
    return _archive([(folder + name, raw)], draw.choice(METHODS))


def _several(draw: random.Random, raw: bytes, name: str) -> bytes:
    """Several members, some of odd names, some of one name."""
    names = draw.sample(NAMES, draw.choice((1, 2, 4)))
    if draw.random() < 0.3:
        names.append(name)
    return _archive([(name, raw), *((n, raw) for n in names)], draw.choice(METHODS))


def _foreign(draw: random.Random, raw: bytes, name: str) -> bytes:
    """A link, a device, or a mode that only the owner's programs may read."""
    member = zipfile.ZipInfo(name)
    member.external_attr = draw.choice((0o120777, 0o020666, 0o010644, 0o040755, 0)) << 16
    return _archive([(member, b"/etc/passwd"), (f"b{name}", raw)])


def _nested(draw: random.Random, raw: bytes, name: str) -> bytes:
    inner = _archive([(name, raw)])
    for _ in range(draw.choice((1, 5, 30))):
        inner = _archive([(draw.choice(("a.zip", "a.npz", "a.csv", "a.mat", "a.v2")), inner)])
    return inner


def _many(draw: random.Random, raw: bytes, name: str) -> bytes:
    count = draw.choice((900, 1500))
    return _archive([(f"{k}{name}", raw[:2000]) for k in range(count)])


def _bomb(draw: random.Random, raw: bytes, name: str) -> bytes:
    """Zeros, or rows, that unpack to a thousandfold; in one member or in many."""
    unit = draw.choice((bytes(2**20), b"0.0,0.0,0.0\n" * 2**16))
    count = draw.choice((1, 20))
    members = [
        (f"{k}{name}", raw[:100] + unit * (40 // count)) for k in range(count)
    ]  # packed soon
    return _archive(list(members), draw.choice(METHODS[1:]))


def _nothing(draw: random.Random, raw: bytes, name: str) -> bytes:
    return draw.choice((_archive([]), _archive([("d/", b"")]), _archive([(name, b"")]), b"PK\5\6"))


def _lying(draw: random.Random, raw: bytes, name: str) -> bytes:
    """Fields of the directory that say something else: flags, methods, sizes, offsets."""
    whole = bytearray(_archive([(name, raw)], draw.choice(METHODS)))
    at = whole.rindex(b"PK\x01\x02")
    for _ in range(draw.choice((1, 1, 2))):
        where, kind = draw.choice(FIELDS)
        most = 2**16 - 1 if kind == "<H" else 2**32 - 1
        value = draw.choice((0, 1, 2, 9, 12, 14, 97, 99, most // 2, most - 1, most, 65))
        whole[at + where : at + where + struct.calcsize(kind)] = struct.pack(kind, value)
    return bytes(whole)


def _encrypted(draw: random.Random, raw: bytes, name: str) -> bytes:
    whole = bytearray(_archive([(name, raw)]))
    flags = draw.choice((1, 0x41, 0x2001))
    for mark, offset in ((b"PK\x01\x02", 8), (b"PK\x03\x04", 6)):
        at = whole.rindex(mark)
        whole[at + offset : at + offset + 2] = struct.pack("<H", flags)
    return bytes(whole)


def _flipped(draw: random.Random, raw: bytes, name: str) -> bytes:
    whole = bytearray(_archive([(name, raw)], draw.choice(METHODS)))
    for _ in range(draw.choice((1, 1, 5))):
        whole[draw.randrange(len(whole))] ^= 1 << draw.randrange(8)
    return bytes(whole)


WAYS: tuple[Callable[[random.Random, bytes, str], bytes], ...] = (
    *(_good, _good, _several, _several, _foreign, _nested, _many, _bomb, _nothing),
    *(_lying, _lying, _encrypted, _flipped, _flipped),
)
