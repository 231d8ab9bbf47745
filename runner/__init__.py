"""Everything around a run and a sweep.

config/  a command line → choices and settings, their types, the identity of a run
folder/  what lies in a run's folder, in which order it is written, who may write
scores/  what came of runs: numbers, a verdict on the model, medians over many
launch/  who does the runs of a sweep

Here: one run (job.py), and the runs of a sweep, proposed, side by side and watched.
"""

from importlib import import_module
from typing import Any

FRONT = ("train", "identify", "evaluate", "predict", "FinishedRun", "CommandError")


def __getattr__(name: str) -> Any:
    """`from runner import train`: a command from Python, loaded when it is asked for."""
    if name not in FRONT:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("report.front"), name)  # a room above this one


def __dir__() -> list[str]:
    return [*globals(), *FRONT]
