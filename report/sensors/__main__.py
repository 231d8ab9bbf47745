"""Where to put sensors: which floors determine the peak drifts of all storeys best.

python -m report.sensors run=FOLDER count=3                 of a finished run of named laws
python -m report.sensors run=FOLDER count=3 noise=0.05      a share of what each sensor has
python -m report.sensors system=steel_frame count=2 data.duration=20   of a known structure

The ground has a sensor, count= others are on floors. Noise is that of the run's residual unless
noise= says it; of a structure it is 0.05. The picture goes into the run's folder, or output=.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from data.arguments import key_values
from runner.config.command_line import command_errors
from runner.folder.run_folder import require_finished, run_folder
from runner.loading import loading

KEYS = {"run": "FOLDER", "system": "NAME", "count": "3", "noise": "0.05", "output": "FOLDER"}
NOISE = 0.05  # share of what a sensor has, of a structure


def read_words(words: Sequence[str]) -> tuple[dict[str, str], list[str]]:
    """{key: value} of the command line, and words for the config of a structure.

    Raises ValueError for other words.
    """
    of_system = any(word.startswith("system=") for word in words)
    own = [word for word in words if not of_system or word.partition("=")[0] in KEYS]
    found = key_values(own, KEYS)
    if ("run" in found) == ("system" in found):
        raise ValueError("sensors of what? give run=FOLDER, or system=NAME of conf/system")
    if not re.fullmatch("[0-9]+", found.get("count", "")) or int(found["count"]) < 1:
        raise ValueError(f"count={found.get('count', '')}: how many floors get a sensor? count=3")
    return found, [word for word in words if word not in own]


def share(word: str) -> float:
    """Raises ValueError for no positive number."""
    try:
        noise = float(word)
    except ValueError:
        noise = 0.0
    if not 0.0 < noise < float("inf"):
        raise ValueError(f"noise={word}: expected a positive share, such as 0.05")
    return noise


def folder_of(word: str) -> Path:
    """The folder of output=, made where it is not. Raises ValueError where none can be written."""
    with suppress(OSError):
        Path(word).mkdir(parents=True, exist_ok=True)
    if not (Path(word).is_dir() and os.access(word, os.W_OK)):
        raise ValueError(f"output={word}: no folder that can be written to; choose another")
    return Path(word)


def main(words: Sequence[str] | None = None) -> None:
    """Bad input ends in one line and exit status 1."""
    words = sys.argv[1:] if words is None else words
    if {"-h", "--help"} & set(words):
        print(__doc__)
        return
    with command_errors():
        asked, more = read_words(words)
        noise = share(asked["noise"]) if "noise" in asked else None
        count = int(asked["count"])
        output = folder_of(asked["output"]) if "output" in asked else None
        if "run" in asked:
            require_finished(run_folder(asked["run"]))
        with loading():  # takes seconds: a mistyped word is reported first
            from report.sensors.placement import of_run, of_system, place

        if "run" in asked:
            case = of_run(run_folder(asked["run"]), noise, count)
        else:
            case = of_system(asked["system"], more, noise or NOISE, count)
        place(case, count, output)


if __name__ == "__main__":
    main()
