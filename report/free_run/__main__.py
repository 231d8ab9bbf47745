"""Runs → the leaderboard of free runs, printed and as CSV, Markdown and LaTeX. No training.

python -m report.free_run                            of the runs in runs/free_run
python -m report.free_run FOLDER … --output FOLDER   of some folders
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from data.arguments import Parser
from data.terminal import terminal
from report.collection.runs import read_runs, results_folder, run_folders
from runner.config.command_line import command_errors

LEADERBOARD = Path("runs/free_run")


def main(words: Sequence[str] | None = None) -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    about = f"of the runs; {LEADERBOARD} without any"
    parser.add_argument("folders", nargs="*", type=Path, default=[LEADERBOARD], help=about)
    parser.add_argument("--output", type=Path, help="of tables; results/ in the folder of the runs")
    with command_errors():
        options = parser.parse_args(words)
        run_folders(options.folders)
        report_free_run(options.folders, options.output)


def report_free_run(folders: Sequence[Path], output: Path | None = None) -> None:
    """Write and print the leaderboard of the runs in some folders."""
    # PyTorch takes seconds to load: a mistyped folder is refused before
    from report.collection.report import tell_ended
    from report.free_run.rows import leaderboard
    from report.free_run.tables import CAPTION, sections, write_rows
    from report.output import printed

    output = output or results_folder(folders)
    runs = read_runs(folders)
    rows = leaderboard(runs)
    parts = sections(rows)
    paths = write_rows("leaderboard", rows, parts, output)
    console = terminal(165)
    console.print(*map(printed, parts))
    console.print(CAPTION)
    for note in dict.fromkeys(note for part in parts for note in part.notes):
        console.print(note, soft_wrap=True, markup=False)
    console.print(f"{len(paths)} files in {output}", soft_wrap=True)
    tell_ended(console, runs)


if __name__ == "__main__":
    main()
