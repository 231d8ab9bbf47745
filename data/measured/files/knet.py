"""K-NET and KiK-net ASCII: one component of one station, whole counts times a scale factor in gal.

Seventeen lines of header, a name and a value in each, then eight counts in a line. Source: NIED,
"About K-NET ASCII format".   T samples.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from data.measured.files.columns import Contents, FileError, Request, check_size, choose, shorten
from data.measured.files.format import Format

HEADER, NAME = 17, 18  # lines of the header; characters of a name in it
SCALE = re.compile(r"([0-9.]{1,20})\s*\(gal\)\s*/\s*([0-9.]{1,20})", re.IGNORECASE)
COMPONENTS = ("EW", "NS", "UD")
OF_KIK = {  # value of Dir. → sensor
    **{str(k): f"{way}, borehole" for k, way in enumerate(("N-S", "E-W", "U-D"), start=1)},
    **{str(k): f"{way}, surface" for k, way in enumerate(("N-S", "E-W", "U-D"), start=4)},
}


def read_knet(path: Path, request: Request) -> Contents:
    """The column acc [gal], the fact dt [s], and the station and direction as its label.

    Raises FileError for a header without rate or scale factor, for text among the counts, and for
    fewer counts than the header's duration.
    """
    check_size(path, 16.0 * path.stat().st_size, path.stat().st_size)
    lines = path.read_text(encoding="latin-1").splitlines()
    said = _header(lines)
    rate = _number(path, said, "sampling freq(hz)", r"([0-9.]{1,12})\s*(?:Hz)?")
    scale = SCALE.search(said.get("scale factor", ""))
    if scale is None or float(scale[2]) == 0.0:
        raise FileError(
            f"{path.name}: the header says 'Scale Factor' {shorten(said.get('scale factor', ''))}; "
            "expected such as 3920(gal)/6182761; download it again"
        )
    words = " ".join(lines[HEADER:]).split()
    try:
        counts = np.array([int(word) for word in words], dtype=np.float64)
    except ValueError as error:
        raise FileError(
            f"{path.name}: below line {HEADER}: {shorten(error, 80, bare=True)}; expected whole "
            "counts; download it again"
        ) from None
    expected = rate * _number(path, said, "duration time(s)", r"([0-9.]{1,12})")
    if len(counts) < expected:
        raise FileError(
            f"{path.name} announces {expected:.0f} counts and {len(counts)} follow; the file was "
            "cut off: download it again"
        )
    direction = said.get("dir", "")
    place = f"station {said.get('station code', '?')}, {OF_KIK.get(direction, direction)}"
    choose(path, ["acc"], request.columns)
    acc = counts * (float(scale[1]) / float(scale[2]))
    notes = [f"counts times {scale[1]}/{scale[2]} gal, {place}; its offset is still in it"]
    return Contents({"acc": acc}, {"acc": "gal"}, {"dt": 1.0 / rate}, notes, labels={"acc": place})


def _header(lines: list[str]) -> dict[str, str]:
    """What the header says, by names in lower case; some files put a point behind a word."""
    names = (re.sub(r"[. ]+", " ", line[:NAME]).strip().lower() for line in lines[:HEADER])
    return dict(zip(names, (line[NAME:].strip() for line in lines), strict=False))


def _number(path: Path, said: dict[str, str], key: str, pattern: str) -> float:
    found = re.fullmatch(pattern, said.get(key, ""), re.IGNORECASE)
    number = float(found[1]) if found and re.fullmatch(r"\d+\.?\d*", found[1]) else 0.0
    if not number > 0.0:
        raise FileError(
            f"{path.name}: the header says {key!r} {shorten(said.get(key, ''))}; expected a number "
            "above 0; download it again"
        )
    return number


def content(head: bytes) -> str:
    """Name of content that begins as such a file does, "" for other content."""
    return "K-NET accelerogram" if head.startswith(b"Origin Time ") and b"Lat." in head else ""


KNET = Format(
    "K-NET",
    tuple(f".{way.lower()}{level}" for level in ("", "1", "2") for way in COMPONENTS),
    read_knet,
    content=content,
    layout=True,
)
