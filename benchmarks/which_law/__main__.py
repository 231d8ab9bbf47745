"""Does the choice among laws find the true class of an element? Counted over planted cases.

    python -m benchmarks.which_law --page docs/which_law.md    # 20 cases a class and set
    python -m benchmarks.which_law --quick                     # 2 of each class, no page
    python -m benchmarks.which_law --stored                    # of what there is

A case is a test of an element drawn at random (elements.py, cases.py). Its result lies in
--output, a file each; a case with a file is not repeated, so the command goes on where it stopped.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from joblib import Parallel, delayed

from benchmarks.which_law.cases import SETS, run_case
from benchmarks.which_law.page import tables_of, write_page
from data.arguments import Parser
from runner.config.command_line import command_errors
from runner.config.compose import prepare_hydra
from runner.folder.run_folder import write_json

QUICK = 2  # cases of a class


def one(which: str, kind: str, number: int, output: Path) -> dict[str, Any]:
    """The result of a case, from its file if there is one."""
    path = output / f"{which}_{kind}_{number}.json"
    if path.is_file():
        return dict(json.loads(path.read_text("utf-8")))
    torch.set_num_threads(1)
    prepare_hydra()
    result = run_case(which, kind, number)
    write_json(path, result)
    return result


def asked(cases: int, sets: list[str]) -> Iterator[tuple[str, str, int]]:
    for which in sets:
        for number in range(cases):
            for kind in SETS[which][1]:
                yield which, kind, number


def stored(output: Path) -> list[dict[str, Any]]:
    """All results that there are."""
    return [json.loads(path.read_text("utf-8")) for path in sorted(output.glob("*_*_*.json"))]


def main(given: list[str] | None = None) -> None:
    parser = Parser(description=__doc__)
    parser.add_argument("--cases", type=int, default=20, help="of every class and set")
    sets, known = list(SETS), ", ".join(SETS)
    parser.add_argument("--sets", nargs="+", metavar="SET", choices=sets, default=sets, help=known)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} cases of a class")
    parser.add_argument("--output", type=Path, default=Path("runs/which_law_cases"))
    parser.add_argument("--page", type=Path, help="file that is written")
    parser.add_argument("--stored", action="store_true", help="fit nothing")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    options = parser.parse_args(given)
    with command_errors():
        options.output.mkdir(parents=True, exist_ok=True)
        if not options.stored:
            todo = list(asked(QUICK if options.quick else options.cases, options.sets))
            work = (delayed(one)(*case, options.output) for case in todo)
            done = Parallel(n_jobs=options.jobs, return_as="generator_unordered")(work)
            for count, result in enumerate(done, start=1):
                words = f"{result['set']} {result['kind']} {result['number']}"
                print(f"{count} of {len(todo)}: {words}", flush=True)
        results = stored(options.output)
        print(tables_of(results))
        if options.page is not None:
            write_page(options.page, results)


if __name__ == "__main__":
    main()
