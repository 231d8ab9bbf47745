"""Files that are written whole or not at all: under another name first, then renamed."""

from __future__ import annotations

import hashlib
import io
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Where to write what `path` is to hold, in its folder.

    The file takes its place at the end of the block. Where the block or the disk fails, `path`
    is unchanged and nothing else remains. Raises OSError where the file cannot take its place.
    """
    aside = path.with_name(f"{path.name}.part")
    try:
        yield aside
        os.replace(aside, path)
    except BaseException:
        aside.unlink(missing_ok=True)
        raise


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8, whole or not at all. Raises OSError."""
    with whole_file(path) as aside:
        aside.write_text(text, encoding="utf-8")


# Files that may come from anybody: only regular ones are read, and only of a sensible size.
#
# Opening a pipe waits for a writer, a device never ends, and a file with holes claims any size.


def open_regular(path: Path) -> io.BufferedReader:
    """A file, opened to be read.

    Raises OSError where it cannot be opened, ValueError for a folder, a pipe or a device.
    """
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    number = os.open(path, flags)
    if not stat.S_ISREG(os.fstat(number).st_mode):
        os.close(number)
        raise ValueError(f"{path} is no regular file, but a folder, a pipe or a device")
    return os.fdopen(number, "rb")


def read_regular(path: Path, limit: int) -> bytes:
    """Content of a file of at most `limit` bytes. Raises OSError or ValueError for any other."""
    with open_regular(path) as file:
        content = file.read(limit + 1)
    if len(content) > limit:
        raise ValueError(f"{path} is larger than {limit} bytes, more than such a file can have")
    return content


def digest_of(path: Path) -> str:
    """SHA-256 of a file. Raises OSError or ValueError for no file."""
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
