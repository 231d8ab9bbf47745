"""Everything around a run and a sweep.

config/  a command line → choices and settings, their types, the identity of a run
folder/  what lies in a run's folder, in which order it is written, who may write
scores/  what came of runs: numbers, a verdict on the model, medians over many
launch/  who does the runs of a sweep

Here: one run (job.py), and the runs of a sweep, proposed, side by side and watched.
"""

from typing import Any


def __getattr__(name: str) -> Any:
    """`from runner import identify`: records → the model that fits them best, and a verdict."""
    if name != "identify":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from runner.selection.search import identify_records  # loads PyTorch, as few of us need

    return identify_records
