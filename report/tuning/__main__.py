"""Finished searches → what careful tuning gives on fresh seeds, and the page docs/tuning.md.

python -m report.tuning                                     of the searches in runs/tune_…
python -m report.tuning FOLDER FOLDER --page docs/tuning.md
"""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console

from report.tuning.cases import USUAL, read_cases
from report.tuning.page import write_tuning_page
from report.tuning.tables import as_printed
from runner.command_line import one_line_errors


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", nargs="*", type=Path, default=USUAL)
    parser.add_argument("--page", type=Path, help="write the page, with its figure beside it")
    options = parser.parse_args()
    with one_line_errors("train"):
        cases = read_cases(options.folders)
        console = Console(width=None if Console().is_terminal else 150)
        console.print(as_printed(cases))
        if options.page is not None:
            write_tuning_page(options.page, cases)
            console.print(f"page in {options.page}", soft_wrap=True)


if __name__ == "__main__":
    main()
