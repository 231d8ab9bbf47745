"""Hostile senders behind a socket: chunks of any size, endless lines, ends in the middle."""

from __future__ import annotations

import random
import socket
import threading
from pathlib import Path

from benchmarks.attack.attempt import Attempt, WronglyAcceptedError
from data.stream.lines import LONGEST, SampleLines

DT, SEND = 0.01, 1 << 24  # bytes of a sender that does not end
HEAD = b"t,f1,a1,a2\n"
ROW = b"%.2f,0.5,0.1,-0.2\n"
JUNK: tuple[bytes, ...] = (
    b"\x00" * 50,
    b"\xff\xfe",
    b"\x1b]0;x\x07\n",
    b"\n" * 500,
    b"{}\n",
    b"[" * 2000 + b"\n",
)
JUNK += (b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", b"\x16\x03\x01\x02\x00\x01", b"1e999,1,1,1\n", b"\r")


class Target:
    name = "sockets"

    def prepare(self, folder: Path) -> None:
        pass

    def attempt(self, draw: random.Random, folder: Path) -> Attempt:
        head = draw.choice([HEAD, HEAD, HEAD, b"", b"\n" * 9 + HEAD, draw.choice(JUNK), b"a1,f1\n"])
        rows = [ROW % (k * DT) for k in range(draw.choice([0, 1, 50, 500]))]
        for _ in range(draw.choice([0, 1, 5])):
            rows.insert(draw.randrange(len(rows) + 1), draw.choice((*JUNK, draw.randbytes(300))))
        endless = draw.random() < 0.2
        data = head + b"".join(rows)
        data = data[: draw.randrange(len(data) + 1)] if draw.random() < 0.3 else data
        sizes = [draw.choice([1, 7, 1000, 65536]) for _ in range(50)]
        what = f"{head!r}, {len(rows)} rows, {len(data)} bytes, {endless=}, {sizes[:5]}"
        return Attempt(what, lambda: attacked(data, sizes, endless))


def attacked(data: bytes, sizes: list[int], endless: bool) -> None:
    """Read all that a sender sends; no line of it may be longer than is read, or give no number."""
    ours, theirs = socket.socketpair()
    threading.Thread(target=send, args=(theirs, data, sizes, endless), daemon=True).start()
    with ours, ours.makefile("rb") as file:
        lines = SampleLines(file, DT)
        count = sum(1 for _ in lines)
    if endless:
        raise WronglyAcceptedError(f"a line of more than {LONGEST} bytes was taken")
    if count + lines.bad > data.count(b"\n") + 1 or len(lines.faults) > 100:
        raise WronglyAcceptedError(f"{count} samples of {data.count(10)} lines")


def send(connection: socket.socket, data: bytes, sizes: list[int], endless: bool) -> None:
    """Send in pieces, then end in the middle of things, or never."""
    try:
        for size in sizes:
            connection.sendall(data[:size])
            data = data[size:]
        connection.sendall(data)
        if endless:
            connection.sendall(b"9" * SEND)
        connection.shutdown(socket.SHUT_RDWR)
    except OSError:
        pass  # the reader has ended
