"""The same program run here and in another process: do they compute the same bits?"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent


def same_bits_elsewhere(program: str) -> bool:
    """`program` sets `result` to an array; it runs with the project on its path."""
    text = (
        f"import sys; sys.path.insert(0, {str(ROOT)!r})\n{program}\n"
        "import hashlib, numpy\n"
        "assert numpy.size(result) > 0\n"
        "digest = hashlib.sha256(numpy.ascontiguousarray(result).tobytes()).hexdigest()\n"
    )
    here: dict = {}
    exec(text, here)
    command = [sys.executable, "-c", text + "print(digest)"]
    elsewhere = subprocess.run(command, capture_output=True, text=True, check=True)
    return elsewhere.stdout.strip() == here["digest"]
