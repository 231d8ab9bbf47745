"""Long compiled work hears Ctrl-C, and its errors arrive."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from data.interruptible import BLINK, interruptible

ROOT = Path(__file__).parents[2]
LONG = """
import signal
import numba
from data.interruptible import BLINK, interruptible

@numba.njit(nogil=True)
def spin(n):
    total = 0.0
    for k in range(n):
        total += 1.0 / (k + 1.0)
    return total

spin(1)
signal.signal(signal.SIGINT, signal.default_int_handler)  # where tests run in the background
print("ready", flush=True)
interruptible(lambda: spin(10**12), BLINK + 1)
"""


def test_a_long_compiled_call_ends_at_ctrl_c():
    words = [sys.executable, "-c", LONG]
    process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=20)
    assert process.returncode != 0
    assert b"KeyboardInterrupt" in error


@pytest.mark.parametrize("steps", [1, BLINK + 1])
def test_an_error_in_the_work_is_that_of_the_call(steps):
    with pytest.raises(ZeroDivisionError):
        interruptible(lambda: 1 / 0, steps)
