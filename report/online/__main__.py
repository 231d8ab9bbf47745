"""Finished runs of on-line models → the tables and the page docs/online.md. No training.

python -m report.online learnt runs/online            one pass beside the batch fit
python -m report.online settled runs/online           how soon, and the errors of frozen weights
python -m report.online stable runs/online_stability  which gains lose the motion
python -m report.online --page docs/online.md         the page, of the runs in both folders
"""

from __future__ import annotations

from pathlib import Path

from data.arguments import Parser
from report.online.cases import read_online
from report.online.page import ONLINE, STABILITY, write_online_page
from report.online.tables import TABLES
from runner.config.command_line import command_errors


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("table", nargs="?", choices=TABLES)
    parser.add_argument("folder", nargs="?", type=Path, help="of finished runs")
    parser.add_argument("--estimator", help="of the table, such as vwnn; all without it")
    parser.add_argument("--page", type=Path, help="write the page")
    with command_errors():
        options = parser.parse_args()
        if options.page is None and options.table is None:
            parser.error("say which table, or --page docs/online.md")
        if options.table is not None:
            usual = STABILITY if options.table == "stable" else ONLINE
            runs = read_online(options.folder or usual, options.estimator)
            print("\n".join(TABLES[options.table](runs)))
        if options.page is not None:
            write_online_page(options.page, ONLINE, STABILITY)
            print(f"page in {options.page}")


if __name__ == "__main__":
    main()
