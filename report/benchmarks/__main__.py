"""Finished runs on public benchmarks and on their stand-ins → tables and a page. No training.

python -m report.benchmarks                            both tables, of the usual folders
python -m report.benchmarks --page docs/benchmarks.md  the page
"""

from __future__ import annotations

from pathlib import Path

from data.arguments import Parser
from report.benchmarks.page import official_table, stand_ins_table, write_benchmarks_page
from report.benchmarks.rows import rows_of
from report.collection.runs import has_runs, read_runs
from report.usual import BENCHMARKED, STAND_INS
from runner.config.command_line import command_errors


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--official", type=Path, default=BENCHMARKED, help="runs on official files")
    parser.add_argument("--stand-ins", type=Path, default=STAND_INS, help="runs on simulated files")
    parser.add_argument("--page", type=Path, help="write the page")
    with command_errors():
        options = parser.parse_args()
        if options.page is not None:
            write_benchmarks_page(options.page, options.official, options.stand_ins)
            print(f"page in {options.page}")
            return
        official, stand_ins = (
            read_runs(folder) if has_runs(folder) else []
            for folder in (options.official, options.stand_ins)
        )
        print(official_table(rows_of(official), official), end="\n\n")
        print(stand_ins_table(rows_of(stand_ins)), end="\n\n")


if __name__ == "__main__":
    main()
