"""Long compiled work hears Ctrl-C, and its errors arrive."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path
from threading import Timer

import pytest

from data.interruptible import BLINK, interruptible
from data.parallel import in_threads, take_threads

ROOT = Path(__file__).parents[2]
LONG = """
import signal
import numba
from data.interruptible import BLINK, interruptible
from data.parallel import in_threads, take_threads

@numba.njit(nogil=True)
def spin(n):
    total = 0.0
    for k in range(n):
        total += 1.0 / (k + 1.0)
    return total

spin(1)
signal.signal(signal.SIGINT, signal.default_int_handler)  # where tests run in the background
print("ready", flush=True)
try:
    interruptible(lambda: spin(10**12), BLINK + 1)
except KeyboardInterrupt:
    print("heard", flush=True)
take_threads(2)
in_threads(spin, [10**12] * 3)
"""


def test_long_compiled_calls_hear_ctrl_c_and_their_process_ends():
    """What was begun goes on until the process ends, and does not hold up its end."""
    words = [sys.executable, "-c", LONG]
    process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    deaf = Timer(30.0, process.kill)
    deaf.start()
    try:
        for stage in (b"ready\n", b"heard\n"):
            assert process.stdout.readline() == stage
            time.sleep(0.3)
            process.send_signal(signal.SIGINT)
        _, error = process.communicate()
    finally:
        deaf.cancel()
        process.kill()
    assert process.returncode not in (0, -signal.SIGKILL)
    assert b"KeyboardInterrupt" in error


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
