"""From the file of a sensor to a model, and a verdict on it, on one page.

    python identify.py record.csv                        which model fits, and how well
    python identify.py event_1.csv event_2.csv event_3.csv    the last fifth is tested on
    python identify.py record.csv data.units.a=g data.channels.s_ddot1=Base budget=10min
    python identify.py record.csv --config configs/data/record.yaml

Says what it takes each column for; asks for what is missing by the option that says it; fits the
models that such a record allows, the cheap ones first, all cores at once; chooses one by motion
that was held back, tests it on other motion, and writes report.html. Everything lies in ordinary
run folders below the one it prints.
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from psutil import Process

from data.arguments import Parser
from data.terminal import terminal
from runner.config.command_line import command_errors
from runner.config.compose import prepare_hydra
from runner.config.settings import seconds_of
from runner.selection.fits import Fits

SETTING = re.compile(r"[+~]*[A-Za-z_][\w./]*=")


def main(words: Sequence[str] | None = None) -> int:
    """The exit status: 0 for a model that is good for something, 3 for none, 1 for questions."""
    line = Parser("python identify.py", description=__doc__)
    line.add_argument("words", nargs="+", metavar="RECORD or key=value")
    line.add_argument("--config", type=Path, help="a config of data of your own, in a folder data/")
    args = line.parse_args(words)
    settings = [w for w in args.words if SETTING.match(w) and not Path(w).exists()]
    records = [w for w in args.words if w not in settings]
    if not records:
        raise ValueError("name the record: python identify.py record.csv; see --help")
    own = {key: [w.partition("=")[2] for w in settings if w.startswith(f"{key}=")]
           for key in ("budget", "hydra.run.dir")}  # fmt: skip
    settings = [w for w in settings if w.partition("=")[0] not in own]
    budget = seconds_of((own["budget"] or [None])[-1])
    if own["budget"] and not budget:
        raise ValueError(f"budget={own['budget'][-1]}: expected a time, such as 60s or 10min")
    folder = own["hydra.run.dir"][-1] if own["hydra.run.dir"] else None
    fits = Fits()  # its processes load what they need while this one does
    from runner.scores.grade import NOTHING
    from runner.selection.progress import Progress, print_found
    from runner.selection.search import BUDGET, identify_records

    console, spent = terminal(), time.time() - Process().create_time()
    left = max((budget or BUDGET) - spent, 0.0)
    with Progress(console) as watch:
        found = identify_records(
            records, folder, left, settings, config=args.config, watch=watch, fits=fits
        )
    print_found(console, found)
    return 1 if found.found["questions"] else 3 if found.verdict["grade"] == NOTHING else 0


if __name__ == "__main__":
    prepare_hydra()
    with command_errors():
        sys.exit(main())
