"""A zip archive of record files, unpacked into a folder that vanishes afterwards.

Names are made plain file names: nothing is written outside the folder.  Sizes are checked before
and while unpacking, archives within the archive stay packed.
"""

from __future__ import annotations

import re
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from data.measured.files.columns import FileError, check_size, reason_of, shorten

MOST_MEMBERS = 1000
PIECE, SUSPECT = 2**20, 2**26  # bytes
FOLD = 200  # times its size that an archive of records may unpack to: measured rows hold noise


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """A folder with the files of an archive, while it is needed.

    Files of subfolders are named folder_file. Raises FileError for bombs, passwords and damage.
    """
    with tempfile.TemporaryDirectory(prefix="record_") as name:
        folder = Path(name)
        try:
            with zipfile.ZipFile(path) as archive:
                _unpack(path, archive, folder)
        except FileError:
            raise
        except MemoryError:
            raise FileError(f"{path.name} does not fit into memory; unpack it yourself") from None
        except Exception as error:  # each kind of compression has errors of its own
            if isinstance(error, OSError) and error.strerror:
                raise FileError(f"{path.name} cannot be unpacked: {error.strerror}") from None
            raise FileError(
                f"{path.name} is damaged: {reason_of(error)}; copy or download it again"
            ) from None
        yield folder


def _unpack(path: Path, archive: zipfile.ZipFile, folder: Path) -> None:
    members = [m for m in archive.infolist() if not m.is_dir() and _is_data(m.filename)]
    if len(members) > MOST_MEMBERS:
        raise FileError(
            f"{path.name} holds {len(members)} files; expected at most {MOST_MEMBERS}; unpack it "
            "and name those that you need"
        )
    check_size(path, sum(m.file_size for m in members), path.stat().st_size, FOLD, SUSPECT)
    names = _plain_names(path, [m.filename for m in members])
    for member, name in zip(members, names, strict=True):
        if member.flag_bits & 1:
            raise FileError(f"{path.name}: {shorten(name)} wants a password; unpack it yourself")
        with archive.open(member) as packed, (folder / name).open("wb") as file:
            left = member.file_size
            while piece := packed.read(PIECE):
                left -= len(piece)
                if left < 0:
                    raise FileError(
                        f"{path.name}: {shorten(name)} unpacks to more than the archive says; "
                        "download it again"
                    )
                file.write(piece)


def _is_data(name: str) -> bool:
    """Whether a member may hold a record: no archive, nothing hidden."""
    parts = re.split(r"[/\\]", name)
    hidden = any(
        part.startswith((".", "__MACOSX")) for part in parts if part not in ("", ".", "..")
    )
    return not hidden and not name.lower().endswith((".zip", ".gz", ".7z", ".tar", ".tgz"))


def _plain_names(path: Path, members: list[str]) -> list[str]:
    """File names without folders; with folders where two would be the same."""
    parts = [
        [_plain(p) for p in re.split(r"[/\\]", m) if p not in ("", ".", "..")] for m in members
    ]
    last = [p[-1] if p else "" for p in parts]
    names = last if len(set(last)) == len(last) else ["_".join(p) for p in parts]
    if len({n.lower() for n in names}) < len(names) or "" in names:
        raise FileError(f"{path.name} holds two files of one name; unpack it yourself")
    return names


def _plain(part: str) -> str:
    return re.sub(r"[^\w.+ ()-]", "_", part)[-150:]
