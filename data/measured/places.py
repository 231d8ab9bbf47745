"""Files and folders that are records, read and named; a record that lacks a channel is omitted."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from glob import glob
from pathlib import Path
from typing import Any

from data.measured.files.columns import NoColumnError, shorten
from data.measured.raw_record import RawRecord
from data.measured.reading import files_in, read_records

PROSE = 100_000  # bytes of a text that are looked at
ROW = re.compile(r"[-+.\d][-+.,;:\d\seEdDnNaAiIfF|/]*")  # a line of numbers, clocks and gaps


def record_places(path: str | Sequence[str], channels: Mapping[str, str] | None) -> list[Path]:
    """Files and folders that are one record each, or zip archives of such.

    Of a folder these are its files, or its event folders' files; where channels name files
    (file.csv:column), the folders that hold them. Raises ValueError for a path without a file.
    """
    patterns = [path] if isinstance(path, str) else list(path)
    named = {where.rpartition(":")[0] for where in (channels or {}).values()} - {""}
    places: list[Path] = []
    for pattern in patterns:
        hits = [pattern] if _exists(pattern) else sorted(glob(pattern))
        if not hits:
            raise ValueError(
                f"data.path={shorten(pattern, 300, bare=True)}: there is no such file or folder "
                f"(seen from {Path.cwd()})"
            )
        for place in map(Path, hits):
            if not place.is_dir():
                places.append(place)
            elif not any(place.iterdir()):
                raise ValueError(f"data.path={place} is an empty folder; expected files of records")
            elif named:
                places += _events(place, named)
            else:
                files = files_in(place)
                places += [file for file in files if not _is_prose(file)] or files
    return places


def _is_prose(path: Path) -> bool:
    """Whether a text has no line of numbers in its beginning, as a README has none."""
    if path.suffix.lower() != ".txt":
        return False
    with path.open("rb") as file:
        text = file.read(PROSE).decode("utf-8", errors="replace")
    return not any(ROW.fullmatch(line.strip()) for line in text.splitlines())


def _events(place: Path, named: set[str]) -> list[Path]:
    """The folder itself if it holds one of the named files, else its folders and archives."""
    if any(_holds(place, file) for file in named):
        return [place]
    folders = [p for p in place.iterdir() if p.is_dir() and any(_holds(p, f) for f in named)]
    archives = [*place.glob("*.zip"), *place.glob("*/*.zip")]
    return sorted(folders or archives) or [place]


def _holds(folder: Path, file: str) -> bool:
    """Whether a folder has a file, in whose name a * stands for any text."""
    if "*" in file:
        return any(folder.glob(file)) if not Path(file).is_absolute() else False
    return (folder / file).exists()


def _exists(path: str) -> bool:
    """Whether there is such a file or folder; a loop of links or a name too long is none."""
    try:
        return Path(path).exists()
    except (OSError, ValueError, RuntimeError):
        return False


def named_records(
    path: str | Sequence[str],
    channels: Mapping[str, str] | None = None,
    units: Mapping[str, str | None] | None = None,
    align: str | None = None,
    **reader: Any,
) -> tuple[dict[str, RawRecord], dict[str, str]]:
    """All records by names of their own, and {name: reason} of those that lack a channel.

    Records of one name in several folders are called folder_name, and by their paths where that
    does not tell them apart. Arguments as in `data.measured.reading.read_records`. Raises
    ValueError for files that cannot be read, and where every record lacks a channel.
    """
    found: list[tuple[Path, str, RawRecord | NoColumnError]] = []
    for place in record_places(path, channels):
        try:
            records = read_records(place, channels, units, align, **reader)
            found += [(place, name, raw) for name, raw in records.items()]
        except NoColumnError as error:
            found.append((place, place.name if place.is_dir() else place.stem, error))
    if not found:
        raise ValueError("data.path is an empty list; give a file, a folder or a pattern")
    lacking = [error for _, _, error in found if isinstance(error, NoColumnError)]
    if len(lacking) == len(found):
        raise lacking[0]
    names = [name for _, name, _ in found]
    for longer in ("{0.parent.name}_{1}", "{0}", "{0}_{1}"):
        often = Counter(names)
        names = [
            longer.format(place, name) if often[called] > 1 else called
            for called, (place, name, _) in zip(names, found, strict=True)
        ]
    by_name = {called: record for called, (_, _, record) in zip(names, found, strict=True)}
    kept = {name: raw for name, raw in by_name.items() if isinstance(raw, RawRecord)}
    return kept, {name: str(by_name[name]) for name in by_name if name not in kept}


def require_read(
    left_out: Mapping[str, str], named: Mapping[str, str | Sequence[str] | None]
) -> None:
    """Raise ValueError for a record asked for by name, {split: names}, that was left out."""
    for split, wanted in named.items():
        for name in [wanted] if isinstance(wanted, str) else wanted or ():
            if name in left_out:
                raise ValueError(
                    f"data.{split} names {name}, which lacks a channel: {left_out[name]}"
                )
