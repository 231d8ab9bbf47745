"""Memory that is asked for before it is taken."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from data.memory import available_memory, require_memory

ROOT = Path(__file__).parents[2]
LIMITED = """
import resource, psutil
from data.memory import require_memory
most = psutil.Process().memory_info().vms + 2 * 10**8
resource.setrlimit(resource.RLIMIT_AS, (most, most))
require_memory(1e8, "data.duration=1", "shorten it")
try:
    require_memory(4e8, "data.duration=9", "shorten it")
except ValueError as error:
    print(error)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="has no such limits")
def test_what_a_process_may_take_is_what_its_own_limit_leaves():
    command = [sys.executable, "-c", LIMITED]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("data.duration=9 would take some 400 MB of memory, ")
    assert done.stdout.endswith("are there; shorten it\n")


@pytest.mark.parametrize("need", [float("nan"), float("inf")])
def test_sizes_that_are_no_numbers_do_not_fit(need):
    with pytest.raises(ValueError, match="shorten it"):
        require_memory(need, "data.duration=1e400", "shorten it")
    require_memory(0.01 * available_memory(), "data.duration=1", "shorten it")
