"""Attack the project with generated inputs, and count what became of them.

    python -m benchmarks.attack --minutes 30             # all targets, two processes
    python -m benchmarks.attack --only records --inputs 200 --seed 3
    python -m benchmarks.attack --minutes 30 --page docs/trust.md

Every way in has its share of the time. Printed are the counts of each, then every bad outcome with
the number that repeats it (--only NAME --seed SEED --number N) and its last line. The time is that
of all seeds together. Exit status 1 where anything ended badly.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from string import Template

from benchmarks.attack.attempt import BAD, OUTCOMES, prepared
from benchmarks.attack.work import NAMES, Finding, attack, target_of, try_one
from data.arguments import Parser
from runner.config.command_line import command_errors

TEMPLATE = Path(__file__).with_name("page.md")


def table(counts: dict[str, Counter]) -> str:
    """Counts of the outcomes as Markdown, a row for each target."""
    rows: list[tuple[str, ...]] = [("target", "tried", *OUTCOMES), ("---", *["---:"] * 7)]
    for name, count in (*counts.items(), ("all", sum(counts.values(), Counter()))):
        cells = (count.total(), *(count[outcome] for outcome in OUTCOMES))
        rows.append((name.replace("_", " "), *(f"{cell:,}" for cell in cells)))
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def main() -> int:
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--inputs", type=int, help="of each target; default: as time allows")
    parser.add_argument("--seed", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--only", nargs="+", default=NAMES, choices=NAMES, metavar="TARGET")
    parser.add_argument("--number", type=int, help="this one attempt, with all that it printed")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--page", type=Path, help="written anew, with the counts")
    arguments = parser.parse_args()
    if arguments.number is not None:
        return repeat(arguments.only[0], arguments.seed[0], arguments.number)
    counts: dict[str, Counter] = {name: Counter() for name in arguments.only}
    worst = 0.0
    for seed in arguments.seed:
        for finding in attacked(arguments, seed):
            counts[finding[0]][finding[3].outcome] += 1
            worst = max(worst, finding[3].seconds)
            if finding[3].outcome in BAD:
                print(f"seed {seed}, ", end="")
                show(finding)
    print(table(counts))
    print(f"the longest took {worst:.0f} s")
    if arguments.page:
        seeds = ", ".join(map(str, arguments.seed))
        facts = {"table": table(counts), "seeds": seeds, "minutes": f"{arguments.minutes:g}"}
        words = Template(TEMPLATE.read_text("utf-8")).substitute(facts, longest=f"{worst:.0f}")
        arguments.page.write_text(words, "utf-8")
    tried = sum(counts.values(), Counter())
    return int(any(tried[outcome] for outcome in BAD) or not tried)


def attacked(arguments: argparse.Namespace, seed: int) -> Iterator[Finding]:
    """All findings of one seed, as they come."""
    context = multiprocessing.get_context("spawn")
    queue, parts = context.Queue(), arguments.processes
    seconds = 60.0 * arguments.minutes / len(arguments.seed)
    for part in range(parts):
        context.Process(
            target=attack,
            args=(arguments.only, seed, seconds, arguments.inputs, (part, parts), queue),
        ).start()
    while parts:
        finding = queue.get()
        if finding is None:
            parts -= 1
        else:
            yield finding


def repeat(name: str, seed: int, number: int) -> int:
    """Try one attempt again and print all about it."""
    with tempfile.TemporaryDirectory(prefix="attack-material") as material:
        target = target_of(name)
        prepared(target, Path(material))
        finding = try_one(name, target, seed, number, Path(material))
    print(finding[2], *(f"{key}: {value}" for key, value in vars(finding[3]).items()), sep="\n")
    return int(finding[3].outcome in BAD)


def show(finding: Finding) -> None:
    name, number, what, verdict = finding
    last = verdict.words.strip().splitlines()[-1:] or [""]
    print(f"{name} {number}: {verdict.outcome}: {what[:300]!r}: {last[0][:300]}", flush=True)


if __name__ == "__main__":
    with command_errors():
        sys.exit(main())
