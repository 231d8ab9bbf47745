"""Do 95 % intervals and bands hold the truth, are braces found that a model lacks?

    python -m benchmarks.coverage --page docs/coverage.md        # 200 cases a kind, the page
    python -m benchmarks.coverage --cases 20                     # in small
    python -m benchmarks.coverage --stored --page docs/coverage.md    # of what there is

A case is a structure drawn at random with noisy records (cases.py). Its result lies in --output, a
file each; a case with a file is not repeated, so the command goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from joblib import Parallel, delayed

from benchmarks.coverage.cases import KINDS, run_case
from benchmarks.coverage.page import table_of, write_page
from data.arguments import Parser
from runner.config.command_line import command_errors
from runner.config.compose import prepare_hydra
from runner.folder.run_folder import write_json


def one(kind: str, number: int, output: Path) -> dict[str, Any]:
    """The result of a case, from its file if there is one."""
    path = output / f"{kind}_{number}.json"
    if path.is_file():
        return dict(json.loads(path.read_text("utf-8")))
    torch.set_num_threads(1)
    prepare_hydra()
    try:
        result = run_case(kind, number)
        json.dumps(result, allow_nan=False)
    except ValueError as error:  # no fit, or an interval that is not finite
        result = {"kind": kind, "number": number, "failed": str(error)}
    write_json(path, result)
    return result


def asked(options: argparse.Namespace) -> Iterator[tuple[str, int]]:
    for number in range(options.cases):
        for kind in KINDS:
            yield kind, number


def stored(output: Path) -> list[dict[str, Any]]:
    """All results that there are, by kind and number."""
    found = [json.loads(path.read_text("utf-8")) for path in output.glob("*_*.json")]
    return sorted(found, key=lambda r: (list(KINDS).index(r["kind"]), r["number"]))


def main(given: list[str] | None = None) -> None:
    parser = Parser(description=__doc__)
    parser.add_argument("--cases", type=int, default=200, help="of every kind")
    parser.add_argument("--output", type=Path, default=Path("runs/coverage"))
    parser.add_argument("--page", type=Path, help="file that is written")
    parser.add_argument("--stored", action="store_true", help="fit nothing")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    options = parser.parse_args(given)
    with command_errors():
        options.output.mkdir(parents=True, exist_ok=True)
        if not options.stored:
            work = (delayed(one)(kind, number, options.output) for kind, number in asked(options))
            done = Parallel(n_jobs=options.jobs, return_as="generator_unordered")(work)
            total = options.cases * len(KINDS)
            for count, result in enumerate(done, start=1):
                print(f"{count} of {total}: {result['kind']} {result['number']}", flush=True)
        results = stored(options.output)
        print(table_of(results))
        if options.page is not None:
            write_page(options.page, results)


if __name__ == "__main__":
    main()
