"""Files that are written whole or not at all: under another name first, then renamed."""

from __future__ import annotations

import os
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
