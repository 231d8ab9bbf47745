"""Tables of the study, and its page: page.md filled in, no number by hand."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import median
from string import Template
from typing import Any

from benchmarks.which_law.cases import SETS, laws
from benchmarks.which_law.elements import CLASSES
from data.whole_file import write_text
from report.candidates.table import OTHER, Candidate, recommended

TEMPLATE = Path(__file__).with_name("page.md")
NONE = "none"  # of the candidates is a model of the records
Result = dict[str, Any]
Pick = Callable[[Sequence[Candidate]], str]


def write_page(page: Path, results: Sequence[Result]) -> None:
    write_text(page, Template(TEMPLATE.read_text("utf-8")).substitute(facts_of(results)))


def tables_of(results: Sequence[Result]) -> str:
    return "\n\n".join(f"{name}\n{table}" for name, table in facts_of(results).items())


def facts_of(results: Sequence[Result]) -> dict[str, str]:
    facts = {}
    for which in SETS:
        own = [r for r in results if r["set"] == which]
        facts[which] = "\n".join(confusion(own, by_unseen))
        right = [sum(pick(candidates(r)) == r["kind"] for r in own) for pick in (by_unseen, by_bic)]
        facts[f"{which}_cases"] = str(len(own))
        facts[f"{which}_right"] = share(right[0], len(own))
        facts[f"{which}_by_bic"] = share(right[1], len(own))
    times = [c["seconds"] for r in results for c in r["candidates"].values()]
    facts["seconds"] = f"{median(times):.2f}" if times else "–"
    facts["minutes"] = f"{sum(times) / 60.0:.0f}"
    return facts


def candidates(result: Result) -> list[Candidate]:
    found = []
    for told in result["candidates"].values():
        own: Result = {k: math.inf if v is None else v for k, v in told.items() if k != "seconds"}
        found.append(Candidate(**own))
    return found


def by_unseen(found: Sequence[Candidate]) -> str:
    """What `experiment=which_law` recommends."""
    choice = recommended(found)
    return choice.kind if choice else NONE


def by_bic(found: Sequence[Candidate]) -> str:
    """The class of the least BIC."""
    return min((c for c in found if c.kind != OTHER), key=lambda c: c.bic).kind


def confusion(results: Sequence[Result], pick: Pick) -> Iterator[str]:
    """How often each class is taken for which; the last column is the share of the right ones."""
    answers = list(dict.fromkeys(kind for kind, _ in laws().values()))
    if any(pick(candidates(r)) == NONE for r in results):
        answers.append(NONE)
    yield f"| planted | {' | '.join(answers)} | right |".replace("_", " ")
    yield "| --- |" + " ---: |" * (len(answers) + 1)
    for kind in CLASSES:
        picked = [pick(candidates(r)) for r in results if r["kind"] == kind]
        if not picked:
            continue
        cells = [str(picked.count(answer) or "") for answer in answers]
        right = share(picked.count(kind), len(picked))
        yield f"| {kind.replace('_', ' ')} | {' | '.join(cells)} | {right} |"


def share(hits: int, of: int) -> str:
    return f"{100.0 * hits / of:.1f} %" if of else "–"
