"""Sources of live samples: a record at the pace of its sensors, a pipe, a socket."""

from __future__ import annotations

import math
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import BinaryIO

from data.record import Record
from data.sample import Sample, samples_of

LOOPBACK = "127.0.0.1"


def paced(record: Record, speed: float = 1.0) -> Iterator[tuple[float, Sample]]:
    """The samples of one record (T, ·), each with the moment at which it was due.

    speed: 1 is the pace of the sensors, inf does not wait. Moments [s] are of
    `time.perf_counter`. Raises ValueError for a speed that is not positive.
    """
    if not speed > 0.0:
        raise ValueError(f"--speed {speed:g} must be positive; inf does not wait")
    start = time.perf_counter()
    for k, sample in enumerate(samples_of(record)):
        now = time.perf_counter()
        due = now if math.isinf(speed) else start + k * record.dt / speed
        if due > now:
            time.sleep(due - now)
        yield due, sample


def standard_input() -> BinaryIO:
    """Standard input, as bytes."""
    return sys.stdin.buffer


@contextmanager
def one_client(port: int) -> Iterator[BinaryIO]:
    """Lines that the first client of a port of this computer sends; no other client is let in.

    Waits for the client. Port 0 takes a free port; its number is printed to standard error.
    Raises ValueError for a number that is no port, OSError for a port in use.
    """
    if not 0 <= port < 1 << 16:
        raise ValueError(f"--listen {port}: expected a port from 0 to 65535")
    with socket.create_server((LOOPBACK, port), backlog=1) as server:
        address, number = server.getsockname()
        print(f"waiting for a client on {address}:{number}", file=sys.stderr, flush=True)
        connection, _ = server.accept()
    with connection, connection.makefile("rb") as lines:
        yield lines
