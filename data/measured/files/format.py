"""File formats: what a format declares of itself, and the format of a file."""

from __future__ import annotations

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
    b"\xd0\xcf\x11\xe0": "an old Office document",
    b"%PDF": "PDF",
    b"ARROW1": "Arrow IPC",
    **{bytes((0x80, n)): "a Python pickle, which could run code" for n in range(2, 6)},
}


def _nothing(head: bytes) -> str:
    return ""


@dataclass(frozen=True)
class Format:
    """One file format: how its files are recognised, and the reader of such files.

    `signatures` and `content` name what the first bytes are; a format without either takes any
    file of its suffixes whose content no other format recognises.
    """

    name: str
    suffixes: tuple[str, ...]  # in lower case, the usual one first
    read: Callable[[Path, Request], Contents]
    signatures: Mapping[bytes, str] = field(default_factory=dict)  # bytes → name of such content
    places: tuple[int, ...] = (0,)  # possible offsets of a signature
    content: Callable[[bytes], str] = _nothing  # name of content without signature, "": another's
    options: tuple[str, ...] = ()  # fields of Request that mean something in this format

    def signed(self, head: bytes) -> str:
        """Name of content that begins with `head` and bears a signature of this format, or ""."""
        at = ((place, start) for place in self.places for start in self.signatures)
        return next((self.signatures[s] for place, s in at if head.startswith(s, place)), "")


def suffixes_of(formats: Iterable[Format]) -> list[str]:
    """All suffixes, in lower case, such as ".csv"."""
    return [suffix for format_ in formats for suffix in format_.suffixes]


def format_of(path: Path, formats: Sequence[Format]) -> Format:
    """The one of `formats` that the suffix of `path` promises and its content does not belie.

    Raises FileError for an empty or packed file, an unknown suffix, and content of another format.
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
    if promised is None:
        raise FileError(
            f"{path.name}: suffix {suffix!r} is not known; expected one of "
            f"{', '.join(suffixes_of(formats))}; export the record as one of these"
        )
    content, actual = _content(head, promised, formats)
    if content and actual is not promised:
        remedy = f"rename it to {actual.suffixes[0]}" if actual else "export it again"
        raise FileError(
            f"{path.name}: suffix {suffix} promises {promised.name}, but the content is {content}; "
            f"{remedy}"
        )
    return promised


def _content(head: bytes, promised: Format, formats: Sequence[Format]) -> tuple[str, Format | None]:
    """Name of the content, "" where nothing is known of it, and its format where that is read."""
    foreign = _beginning(head, FOREIGN)
    if foreign:
        return foreign, None
    for format_ in sorted(formats, key=lambda format_: len(format_.places)):
        signed = format_.signed(head)
        if signed:
            return signed, format_
    page = head.lstrip()
    if page[:9].lower().startswith((b"<!doctype", b"<html", b"<?xml")):
        return f"a web page or XML: {shorten(page[:20].decode('latin-1'))}", None
    for format_ in (promised, *formats):
        content = format_.content(head)
        if content:
            return content, format_
    return "", None


def _beginning(head: bytes, names: Mapping[bytes, str]) -> str:
    return next((name for start, name in names.items() if head.startswith(start)), "")
