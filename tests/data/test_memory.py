"""Memory that is asked for before it is taken."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from data.memory import available_memory, require_memory
from data.parallel import BLINK, in_threads, interruptible, take_threads

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


# Ctrl-C


@pytest.mark.parametrize("steps", [1, BLINK + 1])
def test_an_error_in_the_work_is_that_of_the_call(steps):
    with pytest.raises(ZeroDivisionError):
        interruptible(lambda: 1 / 0, steps)


@pytest.mark.parametrize("steps", [1, BLINK + 1])
@pytest.mark.parametrize("threads", [1, 3])
def test_results_are_in_the_order_of_the_items_and_errors_arrive(threads, steps):
    try:
        take_threads(threads)
        assert in_threads(lambda n: n * n, range(50), steps) == [n * n for n in range(50)]
        with pytest.raises(ZeroDivisionError):
            in_threads(lambda n: 1 / n, [2, 1, 0], steps)
    finally:
        take_threads(1)
