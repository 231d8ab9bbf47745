"""What a file really is, told by its first bytes and not by its suffix."""

from __future__ import annotations

from pathlib import Path

from data.measured.files.columns import FileError, shorten

SUFFIXES = {
    ".csv": "text", ".tsv": "text", ".txt": "text", ".dat": "text", ".mat": "mat",
    ".parquet": "parquet", ".h5": "hdf5", ".hdf5": "hdf5", ".npz": "npz", ".npy": "npy",
    ".json": "json",
}  # fmt: skip
HDF5 = b"\x89HDF\r\n\x1a\n"
# first bytes → (kind, what to call it); order matters
SIGNATURES: list[tuple[bytes, str, str]] = [
    (b"PAR1", "parquet", "Parquet"),
    (b"\x93NUMPY", "npy", "NPY"),
    (b"PK\x03\x04", "npz", "a zip archive, such as NPZ or XLSX"),
    (b"PK\x05\x06", "npz", "an empty zip archive"),
    (b"MATLAB 7.3 MAT-file", "mat", "MAT v7.3"),
    (b"MATLAB ", "mat", "MAT"),
    (HDF5, "hdf5", "HDF5"),
    (b"\x1f\x8b", "packed", "gzip"),
    (b"BZh", "packed", "bzip2"),
    (b"\xfd7zXZ", "packed", "xz"),
    (b"\x28\xb5\x2f\xfd", "packed", "zstandard"),
    (b"7z\xbc\xaf", "packed", "7-zip"),
    (b"\xd0\xcf\x11\xe0", "other", "an old Office document"),
    (b"%PDF", "other", "PDF"),
    (b"ARROW1", "other", "Arrow IPC"),
    (b"\x80\x02", "other", "a Python pickle, which could run code"),
    (b"\x80\x03", "other", "a Python pickle, which could run code"),
    (b"\x80\x04", "other", "a Python pickle, which could run code"),
    (b"\x80\x05", "other", "a Python pickle, which could run code"),
]
PROPER = {
    "text": ".csv", "mat": ".mat", "parquet": ".parquet", "hdf5": ".h5", "npz": ".npz",
    "npy": ".npy", "json": ".json",
}  # fmt: skip


def kind_of(path: Path) -> str:
    """The format of `path`: text, mat, hdf5, parquet, npz, npy or json.

    Raises FileError for an unknown suffix, a packed file, and content that belies its suffix.
    """
    suffix = path.suffix.lower()
    with path.open("rb") as file:
        head = file.read(4096)
    if not head:
        raise FileError(f"{path.name} is empty; expected at least a header and two rows")
    kind, called = _content(head)
    if kind == "packed":
        raise FileError(f"{path.name} is packed with {called}; unpack it first")
    if suffix not in SUFFIXES:
        raise FileError(
            f"{path.name}: suffix {suffix!r} is not known; expected one of {', '.join(SUFFIXES)}; "
            "export the record as one of these"
        )
    expected = SUFFIXES[suffix]
    if expected == "json":
        kind = "json" if kind == "text" else kind
    if kind not in (expected, "unknown"):
        remedy = f"rename it to {PROPER[kind]}" if kind in PROPER else "export it again"
        raise FileError(
            f"{path.name}: suffix {suffix} promises {expected}, but the content is {called}; "
            f"{remedy}"
        )
    return expected


def _content(head: bytes) -> tuple[str, str]:
    for signature, kind, called in SIGNATURES:
        if head.startswith(signature):
            return kind, called
    if HDF5 in (head[512:520], head[1024:1032], head[2048:2056]):  # behind a user block
        return "hdf5", "HDF5"
    if head.lstrip()[:9].lower().startswith((b"<!doctype", b"<html", b"<?xml")):
        return "other", f"a web page or XML: {shorten(head.lstrip()[:20].decode('latin-1'))}"
    if head.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"{":
        return "json", "JSON"
    if b"\0" not in head:
        return "text", "text"
    return "unknown", "unknown"
