"""Runs of the study → the paper's tables and figures. No training.

python -m report.paper                            of the runs in runs/study
python -m report.paper FOLDER … --output FOLDER   as far as the runs of some folders allow
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from data.arguments import Parser
from data.terminal import terminal
from report.collection.runs import read_runs, results_folder, run_folders
from runner.config.command_line import command_errors

STUDY = Path("runs/study")


def main(words: Sequence[str] | None = None) -> None:
    """Bad input ends in one line and exit status 1."""
    with command_errors():
        parser = Parser(description=(__doc__ or "").splitlines()[0])
        about = f"of the runs; {STUDY} without any"
        parser.add_argument("folders", nargs="*", type=Path, default=[STUDY], help=about)
        parser.add_argument("--output", type=Path, help="folder; results/ in that of the runs")
        options = parser.parse_args(words)
        run_folders(options.folders)
        report_paper(options.folders, options.output)


def report_paper(folders: Sequence[Path], output: Path | None = None) -> None:
    """Write and print tables and figures, as far as the runs allow.

    Raises ValueError where no run belongs to a table of the paper.
    """
    # PyTorch and Matplotlib take seconds to load: a mistyped folder is reported first
    from report.collection.report import tell_ended
    from report.output import printed
    from report.paper.figures import draw_study
    from report.paper.tables import hits, printed_sections, study_cells, write_tables

    output = output or results_folder(folders)
    runs = read_runs(folders)
    cells = study_cells(runs)
    if not cells:
        where = ", ".join(map(str, folders))
        raise ValueError(f"no run in {where} belongs to a table of the paper; see --help")
    console = terminal(145)
    console.print(*map(printed, printed_sections(cells)))
    console.print("the paper's values inside our ranges over the seeds:", hits(cells), sep="\n")
    paths = write_tables(cells, output) + draw_study(runs, output)
    console.print(f"{len(paths)} files in {output}", soft_wrap=True)
    tell_ended(console, runs)


if __name__ == "__main__":
    main()
