"""Finished searches → what careful tuning gives on fresh seeds, and the page docs/tuning.md.

python -m report.tuning                                     of the searches in runs/tune_…
python -m report.tuning FOLDER FOLDER --page docs/tuning.md
"""

from __future__ import annotations

from pathlib import Path

from data.arguments import Parser
from data.terminal import terminal
from report.tuning.cases import read_cases
from report.usual import SEARCHES
from runner.config.command_line import command_errors


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", nargs="*", type=Path, default=SEARCHES)
    parser.add_argument("--page", type=Path, help="write the page, with its figure beside it")
    with command_errors():
        options = parser.parse_args()
        cases = read_cases(options.folders)
        # SciPy and Matplotlib take seconds to load: a mistyped folder is told before
        from report.tuning.page import write_tuning_page
        from report.tuning.tables import as_printed

        console = terminal(150)
        console.print(as_printed(cases))
        if options.page is not None:
            write_tuning_page(options.page, cases)
            console.print(f"page in {options.page}", soft_wrap=True)


if __name__ == "__main__":
    main()
