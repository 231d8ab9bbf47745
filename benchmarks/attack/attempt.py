"""One hostile input, tried in a process of its own, and what became of it.

The process is a fork, in an empty folder, with limits of time and memory. A command that an input
makes the program run is seen by the file that the command leaves (`touch executed`), a connection
by Python's audit events, an environment that was read by its value in what is printed or written.
"""

from __future__ import annotations

import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

EXECUTED = "executed"  # file that a hostile input tries to make: `touch executed`
SECRET, SECRET_NAME = "the-value-of-a-secret", "ATTACK_SECRET"  # ${oc.env:ATTACK_SECRET}
SECONDS, BYTES = 60.0, 12 * 2**30  # limits of one input
ONE_LINE, ACCEPTED, WRONG = "one line", "accepted", "accepted wrong"
TRACEBACK, HANG, RAN = "traceback", "hang", "executed"
OUTCOMES = (ONE_LINE, ACCEPTED, TRACEBACK, HANG, RAN, WRONG)
BAD = (TRACEBACK, HANG, RAN, WRONG)


class WronglyAcceptedError(Exception):
    """Raised by an attempt whose input was taken and gave something that it must not give."""


@dataclass(frozen=True)
class Attempt:
    """One input: `what` tells a person how to repeat it, `act` tries it.

    `act` is called in an empty folder. What it raises is judged: SystemExit is the exit status of
    a program, whose error must be one line on stderr; ValueError and OSError of one line are the
    refusal of a library call; anything else is a traceback. To end is to accept.
    """

    what: str
    act: Callable[[], object]


class Target(Protocol):
    """One way in. Made in a process of its own, so that `prepare` may start threads."""

    name: str

    def prepare(self, folder: Path) -> None:
        """Write what all attempts start from, such as a finished run, into an empty folder."""

    def attempt(self, draw: random.Random, folder: Path) -> Attempt:
        """A random input; `folder` is as `prepare` left it and is not to be written to."""


@dataclass(frozen=True)
class Verdict:
    """What became of an attempt: one of OUTCOMES, and what was printed about it."""

    outcome: str
    words: str
    seconds: float


def judged(attempt: Attempt, seconds: float = SECONDS) -> Verdict:
    """Try an input in a process of its own."""
    folder = Path(tempfile.mkdtemp(prefix="attack"))
    began = time.monotonic()
    try:
        child = os.fork()
        if child == 0:
            _try(attempt, folder)
        status = _status(child, seconds)
        return Verdict(*_judgement(folder, status), time.monotonic() - began)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def prepared(target: Target, folder: Path) -> None:
    """Let a target prepare, in a process of its own. Raises RuntimeError where it fails."""
    child = os.fork()
    if child == 0:
        try:
            target.prepare(folder)
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        sys.stdout.flush()
        os._exit(0)
    if os.waitpid(child, 0)[1]:
        raise RuntimeError(f"{target.name} could not be prepared")


def _try(attempt: Attempt, folder: Path) -> None:
    """The child: never returns."""
    status = 70
    try:
        os.setsid()
        work = folder / "work"
        work.mkdir()
        os.chdir(work)
        os.environ[SECRET_NAME] = SECRET
        for number, name in ((1, "stdout"), (2, "stderr")):
            file = os.open(folder / name, os.O_WRONLY | os.O_CREAT, 0o600)
            os.dup2(file, number)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        sys.stdin = os.fdopen(0, "r", encoding="utf-8")
        sys.stdout, sys.stderr = (os.fdopen(n, "w", encoding="utf-8") for n in (1, 2))
        warnings.simplefilter("ignore")
        resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        sys.addaudithook(lambda event, args: _audit(folder, event, args))
        status = _status_of(attempt)
    except BaseException:
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(status)


def _status_of(attempt: Attempt) -> int:
    try:
        attempt.act()
    except SystemExit as error:
        if isinstance(error.code, str):
            print(error.code, file=sys.stderr)
            return 1
        return int(error.code or 0)
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except WronglyAcceptedError as error:
        print(error, file=sys.stderr)
        return 71
    return 0


def _audit(folder: Path, event: str, args: tuple[Any, ...]) -> None:
    """Note what no loaded file may lead to."""
    if event in ("os.system", "os.exec", "os.posix_spawn", "socket.getaddrinfo"):
        _note(folder, f"{event} {args}")
    if event == "socket.connect" and not isinstance(args[1], str):  # a Unix socket is local
        _note(folder, f"{event} {args[1]}")


def _note(folder: Path, line: str) -> None:
    file = os.open(folder / "seen", os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    os.write(file, f"{line}\n".encode())
    os.close(file)


def _status(child: int, seconds: float) -> int | None:
    """Exit status of a child, negative for a signal; None where it had to be stopped."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.005)
    try:
        os.killpg(child, signal.SIGKILL)
    except ProcessLookupError:
        os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


def _judgement(folder: Path, status: int | None) -> tuple[str, str]:
    printed, error = (
        (folder / name).read_text("utf-8", "replace") if (folder / name).exists() else ""
        for name in ("stdout", "stderr")
    )
    seen = (folder / "seen").read_text("utf-8", "replace") if (folder / "seen").exists() else ""
    if seen or list(folder.rglob(EXECUTED)):
        return RAN, seen or "a command ran"
    if _told(folder, printed + error):
        return RAN, f"the environment was read: {SECRET_NAME}"
    if status is None:
        return HANG, error[-500:]
    if status == 71:
        return WRONG, error.strip()
    if raw := [c for c in printed + error if not c.isprintable() and c not in "\n\r\t"]:
        return WRONG, f"printed the control character {raw[0]!r}"
    if status == 0:
        return (TRACEBACK, error[-2000:]) if "Traceback" in error else (ACCEPTED, "")
    lines = [line for line in error.splitlines() if line.strip()]
    if len(lines) == 1 and lines[0].startswith("error: ") and len(lines[0]) > len("error: "):
        return ONE_LINE, lines[0]
    return TRACEBACK, f"status {status}: {error[-2000:]}"


def _told(folder: Path, printed: str) -> bool:
    """Whether the secret stands in what was printed or written."""
    places = (folder / "work").rglob("*")
    files = (path for path in places if path.is_file() and not path.is_symlink())
    secret = SECRET.encode()
    return SECRET in printed or any(
        secret in path.read_bytes() for path in files if path.stat().st_size < 2**20
    )
