"""Files that may come from anybody: only regular ones are read, and only of a sensible size.

Opening a pipe waits for a writer, a device never ends, and a file with holes claims any size.
"""

from __future__ import annotations

import hashlib
import io
import os
import stat
from pathlib import Path


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
