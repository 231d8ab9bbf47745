"""File formats: what a format declares of itself, and the format of a file."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from data.measured.files.columns import Contents, FileError, Request, shorten

HEAD = 4096  # first bytes of a file that say what it is
PACKED = {
    b"\x1f\x8b": "gzip",
    b"BZh": "bzip2",
    b"\xfd7zXZ": "xz",
    b"\x28\xb5\x2f\xfd": "zstandard",
    b"7z\xbc\xaf": "7-zip",
}
FOREIGN = {  # formats that are recognised in order to be refused by name
    b"%PDF": "PDF",
    b"ARROW1": "Arrow IPC",
    **{bytes((0x80, n)): "a Python pickle, which could run code" for n in range(2, 6)},
}
WAYS_OUT = {  # suffixes of programs → how a record leaves them
    (".fig",): "in MATLAB: L = findobj(openfig('NAME'), 'Type', 'line'), then writematrix of "
    "[L.XData; L.YData]' to a .csv",
    (".m", ".mlx", ".py", ".ipynb", ".tcl"): "it is a program; give the file of numbers it writes",
    (".rsp", ".drv", ".rpc"): "export it as text from RPC Pro, or by its ASCII translator",
    (".dxd", ".dwd", ".d7d"): "export it as MAT or CSV from DewesoftX",
    (".pkl", ".pickle"): "in Python: numpy.savez('NAME.npz', **arrays)",
    (".evt", ".gcf"): "convert it to miniSEED by its maker's program",
    (".rds", ".rdata"): "in R: write.csv(x, 'NAME.csv', row.names = FALSE)",
    (".docx", ".doc", ".pdf", ".png", ".jpg"): "a document holds no record; take its table as CSV",
}


@dataclass(frozen=True)
class Package:
    """What reads the files of a format, beside what is always installed."""

    name: str  # that Python imports
    project: str  # that pip installs
    extra: str  # of pyproject.toml, which brings it
    instead: str = ""  # what else a person may do


@dataclass(frozen=True)
class Format:
    """One file format: how its files are recognised, and the reader of such files.

    A format without signatures takes any file of its suffixes whose content no other format
    recognises, text included.
    """

    name: str
    suffixes: tuple[str, ...]  # in lower case, the usual one first
    read: Callable[[Path, Request], Contents]
    signatures: Mapping[bytes, str] = field(default_factory=dict)  # bytes → name of such content
    places: tuple[int, ...] = (0,)  # possible offsets of a signature
    opening: bytes = b""  # pattern of the first bytes of content without a signature
    called: str = ""  # what such content is called
    options: tuple[str, ...] = ()  # fields of Request that mean something in this format
    layout: bool = False  # text of a known layout, which files of any suffix of text may have
    plain: bool = False  # any text: what no other format recognises
    package: Package | None = None
    tried_apart: bool = False  # its library may crash or never end on damage: apart.py tries it

    def signed(self, head: bytes) -> str:
        """Name of content that begins with `head` and bears a signature of this format, or ""."""
        at = ((place, start) for place in self.places for start in self.signatures)
        return next((self.signatures[s] for place, s in at if head.startswith(s, place)), "")

    def content(self, head: bytes) -> str:
        """Name of content that opens with `head` as files of this format do, or ""."""
        return self.called if self.opening and re.match(self.opening, head, re.DOTALL) else ""


def suffixes_of(formats: Iterable[Format]) -> list[str]:
    """All suffixes, in lower case, such as ".csv"."""
    return [suffix for format_ in formats for suffix in format_.suffixes]


def format_of(path: Path, formats: Sequence[Format]) -> Format:
    """The one of `formats` that the suffix of `path` promises and its content does not belie.

    Content decides where the suffix is unknown, and which layout of text it is. Raises FileError
    for an empty or packed file, and for content that is not read or that the suffix belies.
    """
    with path.open("rb") as file:
        head = file.read(HEAD)
    if not head:
        raise FileError(f"{path.name} is empty; expected at least a header and two rows")
    packed = _beginning(head, PACKED)
    if packed:
        raise FileError(f"{path.name} is packed with {packed}; unpack it first")
    suffix = path.suffix.lower()
    promised = next((format_ for format_ in formats if suffix in format_.suffixes), None)
    content, actual = _content(head, promised, formats)
    way_out = next((way for suffixes, way in WAYS_OUT.items() if suffix in suffixes), "")
    if promised is None and (actual is None or (way_out and actual.plain)):
        known = ", ".join(suffixes_of(formats))
        raise FileError(
            f"{path.name}: suffix {suffix!r} is not known"
            f"{f', and the content is {content}' if content else ' and the content is no text'}; "
            f"{way_out.replace('NAME', path.stem[:60]) or f'export the record as one of {known}'}"
        )
    if actual is not None and (promised is None or (actual.layout and promised.plain)):
        return actual
    assert promised is not None
    unsure = actual is not None and actual.plain and not promised.signatures
    if content and actual is not promised and not unsure:
        remedy = f"rename it to {actual.suffixes[0]}" if actual else "export it again"
        raise FileError(
            f"{path.name}: suffix {suffix} promises {promised.name}, but the content is {content}; "
            f"{remedy}"
        )
    return promised


def _content(
    head: bytes, promised: Format | None, formats: Sequence[Format]
) -> tuple[str, Format | None]:
    """Name of the content, "" where nothing is known of it, and its format where that is read."""
    foreign = _beginning(head, FOREIGN)
    if foreign:
        return foreign, None
    page = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    if page[:9].lower().startswith((b"<!doctype", b"<html", b"<?xml")):
        return f"a web page or XML: {shorten(page[:20].decode('latin-1'))}", None
    for format_ in sorted(formats, key=lambda one: (one is not promised, len(one.places))):
        signed = format_.signed(head)
        if signed:
            return signed, format_
    for format_ in sorted(formats, key=lambda format_: (format_.plain, format_ is not promised)):
        content = format_.content(head)
        if content:
            return content, format_
    return "", None


def _beginning(head: bytes, names: Mapping[bytes, str]) -> str:
    return next((name for start, name in names.items() if head.startswith(start)), "")
