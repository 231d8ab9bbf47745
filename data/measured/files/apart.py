"""Files whose library may crash or never end on damage are first read in a separate process.

SciPy's MAT reader and HDF5 are compiled code that trusts what a file says of itself: a few flipped
bytes end the whole program without a word, keep it busy for ever, or make it ask for all memory.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from data.measured.files.columns import Contents, FileError, Request
from data.measured.files.format import Package
from data.memory import limit_memory

ROOT = Path(__file__).parents[3]  # holds `data`; a folder of data files may hold a hostile json.py
RATE = 5e6  # bytes a second of a large file
CRASHES = 2**31  # statuses from here on are those of crashes, on Windows
TOO_MUCH = 12  # status of a reader that asked for more memory than there is


def require_package(path: Path, package: Package) -> None:
    """Raise FileError where the package is missing that reads a file."""
    if importlib.util.find_spec(package.name) is None:
        raise FileError(
            f"{path.name}: such files need the package {package.project}: "
            f"pip install -c constraints.txt -e '.[{package.extra}]'{package.instead}"
        )


def require_survival(
    path: Path, request: Request, read: Callable[[Path, Request], Contents], seconds: float = 20.0
) -> None:
    """Raise FileError where a reader crashes on a file, or does not end.

    seconds: that it may take for any file; large ones have a second for 5 MB, too.
    """
    limit = seconds + path.stat().st_size / RATE
    try:
        status = subprocess.run(
            [sys.executable, "-m", __name__, read.__module__, read.__name__, str(path.absolute())],
            cwd=ROOT,
            input=json.dumps(asdict(request)).encode(),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=limit,
            check=False,
        ).returncode
    except subprocess.TimeoutExpired:
        raise FileError(
            f"{path.name} is damaged: it kept the library that reads it busy for {limit:.0f} s; "
            "copy or export it again"
        ) from None
    if status == TOO_MUCH:
        raise FileError(
            f"{path.name} is damaged, or too large: to read it takes more memory than is free here"
        )
    if status < 0 or status >= CRASHES:
        raise FileError(
            f"{path.name} is damaged: the library that reads it crashed; copy or export it again"
        )


def _main() -> None:
    module, name, path = sys.argv[1:]
    request = json.load(sys.stdin)
    columns = request.pop("columns")
    wanted = None if columns is None else tuple(columns)
    limit_memory()
    try:
        read = getattr(importlib.import_module(module), name)
        read(Path(path), Request(**request, columns=wanted))
    except (FileError, OSError):  # whoever asked meets it, too
        pass
    except MemoryError:
        sys.exit(TOO_MUCH)


if __name__ == "__main__":
    _main()
