"""Runs → the leaderboard of free runs, printed and as CSV, Markdown and LaTeX. No training.

python -m report.free_run                            of the runs in runs/free_run
python -m report.free_run FOLDER … --output FOLDER   of some folders
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from data.terminal import terminal
from report.collection.runs import folders_and_output, read_runs, results_folder
from runner.config.command_line import command_errors

LEADERBOARD = Path("runs/free_run")


def main(words: Sequence[str] | None = None) -> None:
    """Bad input ends in one line and exit status 1."""
    with command_errors():
        report_free_run(*folders_and_output(__doc__, LEADERBOARD, words))


def report_free_run(folders: Sequence[Path], output: Path | None = None) -> None:
    """Write and print the leaderboard of the runs in some folders."""
    # PyTorch takes seconds to load: a mistyped folder is refused before
    from report.collection.report import tell_ended
    from report.free_run.leaderboard import CAPTION, leaderboard, sections, write_rows
    from report.output import printed

    output = output or results_folder(folders)
    runs = read_runs(folders)
    rows = leaderboard(runs)
    parts = sections(rows)
    paths = write_rows(rows, parts, output)
    console = terminal(165)
    console.print(*map(printed, parts))
    console.print(CAPTION)
    for note in dict.fromkeys(note for part in parts for note in part.notes):
        console.print(note, soft_wrap=True, markup=False)
    console.print(f"{len(paths)} files in {output}", soft_wrap=True)
    tell_ended(console, runs)


if __name__ == "__main__":
    main()
