"""Runs → the leaderboard of free runs, its figures, and the page docs/free_run.md. No training.

python -m report.free_run                            of the runs in runs/free_run
python -m report.free_run FOLDER … --output FOLDER   of some folders
python -m report.free_run --page docs/free_run.md    the whole page, and its rows in README.md
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from data.arguments import Parser
from data.terminal import terminal
from report.collection.runs import has_runs, read_runs, results_folder, run_folders
from report.usual import LEADERBOARD
from report.usual import QUESTIONS as ASKED
from runner.config.command_line import command_errors
from runner.scores.result import Result


def main(words: Sequence[str] | None = None) -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    add = parser.add_argument
    add(
        "folders",
        nargs="*",
        type=Path,
        default=[LEADERBOARD],
        help=f"of the runs; {LEADERBOARD} without any",
    )
    add("--questions", type=Path, default=ASKED, help="runs of experiment=free_run_questions")
    add("--output", type=Path, help="of tables and figures; results/ in the folder of the runs")
    add("--page", type=Path, help="to write, with its figures beside it: docs/free_run.md")
    with command_errors():
        options = parser.parse_args(words)
        run_folders(options.folders)
        report_free_run(options.folders, options.questions, options.output, options.page)


def report_free_run(
    folders: Sequence[Path],
    questions: Path,
    output: Path | None = None,
    page: Path | None = None,
) -> None:
    """Write and print the leaderboard, and what the questions' runs answer; and the page."""
    # PyTorch and Matplotlib take seconds to load: a mistyped folder is told before
    from report.collection.report import tell_ended
    from report.free_run.figures import draw_leaderboard
    from report.free_run.page import write_page
    from report.free_run.questions import QUESTION_COLUMNS, QUESTIONS, question_of, question_rows
    from report.free_run.rows import leaderboard
    from report.free_run.tables import CAPTION, sections, write_rows
    from report.output import printed

    output = output or results_folder(folders)
    runs = read_runs(folders)
    rows = leaderboard(runs)
    parts = sections(rows)
    paths = write_rows("leaderboard", rows, parts, output)
    asked: list[Result] = []
    if has_runs(questions):
        asked = [run for run in read_runs(questions) if run.grid in QUESTIONS]
    if asked:
        rows = question_rows(asked, runs)
        answered = sections(rows, QUESTION_COLUMNS, question_of)
        paths += write_rows("questions", rows, answered, output)
        parts += answered
    console = terminal(165)
    console.print(*map(printed, parts))
    console.print(CAPTION)
    for note in dict.fromkeys(note for part in parts for note in part.notes):
        console.print(note, soft_wrap=True, markup=False)
    paths += draw_leaderboard(runs, asked, output)
    console.print(f"{len(paths)} files in {output}", soft_wrap=True)
    tell_ended(console, [*runs, *asked])
    if page is not None:
        write_page(page, runs, asked, paths)
        console.print(f"page in {page}", soft_wrap=True)


if __name__ == "__main__":
    main()
