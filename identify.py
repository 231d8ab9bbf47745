"""From the file of a sensor to a model, and a verdict on it, on one page.

    python identify.py record.csv                        which model fits, and how well
    python identify.py event_1.csv event_2.csv event_3.csv    the last fifth is tested on
    python identify.py record.csv data.units.a=g data.channels.s_ddot1=Base budget=10min
    python identify.py record.csv hydra.run.dir=FOLDER   where all that it writes shall lie
    python identify.py record.csv --config configs/data/record.yaml

Says what it takes each column for; asks for what is missing by the option that says it; fits the
models that such a record allows, the cheap ones first, all cores at once; chooses one by motion
that was held back, tests it on other motion, and writes report.html. Everything lies in ordinary
run folders below the one it prints.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

from psutil import Process

from data.arguments import Parser
from data.terminal import terminal
from runner.config.command_line import command_errors
from runner.config.compose import prepare_hydra
from runner.loading import loading
from runner.selection.fits import Fits
from runner.selection.words import read_words


def main(words: Sequence[str] | None = None) -> int:
    """The exit status: 0 for a model that is good for something, 3 for none, 1 for questions."""
    line = Parser("python identify.py", description=__doc__)
    line.add_argument("words", nargs="+", metavar="RECORD or key=value")
    line.add_argument("--config", type=Path, help="a config of data of your own, in a folder data/")
    args = line.parse_args(words)
    asked = read_words(args.words)
    fits = Fits()  # its processes load what they need while this one does
    with loading():
        from runner.scores.grade import NOTHING
        from runner.selection.progress import Progress, print_found
        from runner.selection.search import BUDGET, identify_records

    console, spent = terminal(), time.time() - Process().create_time()
    left = max((asked.budget or BUDGET) - spent, 0.0)
    with Progress(console) as watch:
        found = identify_records(
            asked.records, asked.folder, left, asked.settings, config=args.config, watch=watch,
            fits=fits,
        )  # fmt: skip
    print_found(console, found)
    return 1 if found.found["questions"] else 3 if found.verdict["grade"] == NOTHING else 0


if __name__ == "__main__":
    prepare_hydra()
    with command_errors():
        sys.exit(main())
