"""Many runs → all their numbers as one table, or a comparison by a choice that varies."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from data.terminal import terminal
from report.collection.compare import as_table, compare, in_common
from report.collection.figure import draw_comparison
from report.collection.long_table import counted, long_table, write_long
from report.collection.runs import collect, results_folder
from report.output import save_figure
from report.style import titled
from runner.config.identity import RESULTS
from runner.progress import is_finished, print_not_identified, reasons
from runner.scores.result import Result

WIDTH = 145


def report_collection(folders: Sequence[Path], output: Path | None) -> None:
    """All numbers of the runs in some folders as one table. Raises ValueError for no runs."""
    runs = collect(folders)
    paths = write_long(long_table(runs), output or results_folder(folders))
    console = terminal(WIDTH)
    console.print(f"{counted(runs)}; every number in {paths[0]} and .csv", soft_wrap=True)
    tell_ended(console, runs)


def report_by(
    folders: Sequence[Path], by: Sequence[str], metric: str, split: str, output: Path | None
) -> None:
    """Runs compared by choices that vary: a table printed, a picture drawn."""
    runs = collect(folders)
    comparison = compare(runs, by, metric, split)
    console = terminal(WIDTH)
    console.print(as_table(comparison))
    console.print(counted(runs), *comparison.notes, sep="\n", soft_wrap=True, markup=False)
    print_not_identified(console, runs)
    name = f"{comparison.number} by {' '.join(comparison.by)}"
    figure = titled(draw_comparison(comparison), in_common(runs))
    folder = output or results_folder(folders)
    path = save_figure(figure, folder, re.sub(r"[ /]+", "_", name))[0]
    console.print(f"picture in {path}", soft_wrap=True)


def tell_ended(console: Console, runs: Sequence[Result]) -> None:
    """Whether runs are of another version, why some have no numbers, and others no model."""
    if any(run.finished and not is_finished(run.folder) for run in runs):
        console.print(f"some of these runs are not of results version {RESULTS}; repeat the sweep")
    for line in reasons({run.folder.name: run.reason for run in runs if not run.finished}):
        console.print(line, soft_wrap=True, markup=False, highlight=False)
    print_not_identified(console, runs)
