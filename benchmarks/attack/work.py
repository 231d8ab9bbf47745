"""The work of one process of an attack: its share of the numbers of every target."""

from __future__ import annotations

import importlib
import multiprocessing
import pkgutil
import random
import tempfile
import time
from multiprocessing.queues import Queue
from pathlib import Path

from benchmarks.attack import targets
from benchmarks.attack.attempt import Target, Verdict, judged, prepared

NAMES = sorted(module.name for module in pkgutil.iter_modules(targets.__path__))
Finding = tuple[str, int, str, Verdict]  # target, number, what, verdict
Share = tuple[int, int]  # this process of so many


def target_of(name: str) -> Target:
    target: Target = importlib.import_module(f"{targets.__name__}.{name}").Target()
    return target


def try_one(name: str, target: Target, seed: int, number: int, folder: Path) -> Finding:
    """The attempt of this number, the same in every run."""
    attempt = target.attempt(random.Random(f"{seed} {name} {number}"), folder)
    return name, number, attempt.what, judged(attempt)


def attack(
    names: list[str], seed: int, seconds: float, inputs: int | None, share: Share, queue: Queue
) -> None:
    """One process: its share of the numbers of each target, in turns of equal time.

    Puts every Finding into the queue, then None, also where it breaks off.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="attack-material") as material:
            _attack(names, seed, seconds, inputs, share, queue, Path(material))
    finally:
        queue.put(None)


def _attack(
    names: list[str],
    seed: int,
    seconds: float,
    inputs: int | None,
    share: Share,
    queue: Queue,
    material: Path,
) -> None:
    part, parts = share
    ready = {name: target_of(name) for name in names}
    for name, target in ready.items():
        (material / name).mkdir()
        prepared(target, material / name)
    end = time.monotonic() + seconds
    spent, number = dict.fromkeys(names, 0.0), dict.fromkeys(names, part)
    while time.monotonic() < end and spent and _wanted():
        name = min(spent, key=spent.__getitem__)
        if inputs is not None and number[name] >= inputs:
            del spent[name]
            continue
        began = time.monotonic()
        queue.put(try_one(name, ready[name], seed, number[name], material / name))
        spent[name] += time.monotonic() - began
        number[name] += parts


def _wanted() -> bool:
    """Whether the command that asked for this work still runs."""
    parent = multiprocessing.parent_process()
    return parent is None or parent.is_alive()
