"""The page of structures whose law nobody planted: page.md filled in, no number by hand."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Any

from benchmarks.unplanted.structures import CASES, HELD_BACK
from data.whole_file import write_text
from runner.scores.spread import percent, quantile

TEMPLATE = Path(__file__).with_name("page.md")
PARTS = {"train": "training", "unseen": "unseen", "farther": "1.5 times"}
Result = dict[str, Any]


def write_page(
    page: Path,
    results: Sequence[Result],
    wanted: Sequence[tuple[str, str, int]],
    pictures: Mapping[str, Path],
    limit: float,
) -> None:
    """Fill the template. wanted: structures, models and seeds; limit: seconds of a fit."""
    facts = {
        "seeds": ", ".join(map(str, sorted({seed for _, _, seed in wanted}))),
        "chosen": medians([r for r in results if r["structure"] in CASES]),
        "held_back": medians([r for r in results if r["structure"] in HELD_BACK]),
        "lost": lost(results),
        "late": late(results, limit),
        "fits": table(results, head=True),
        "missing": missing(results, wanted),
        "older": older(results),
        "choices": choices(results),
        "loops": "\n\n".join(
            f"{name}:\n\n![loops of {name}](figures/{picture.name})"
            for name, picture in pictures.items()
        )
        or "None were drawn.",
    }
    write_text(page, Template(TEMPLATE.read_text("utf-8")).substitute(facts))


def number(value: float | None) -> float:
    return math.inf if value is None else float(value)


def medians(results: Sequence[Result]) -> str:
    """Medians over the seeds, a row a structure and model."""
    lines = [row("structure", "model", *PARTS.values(), "parameters", "s a fit", "lost")]
    lines.append("| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    for name, model in dict.fromkeys((r["structure"], r["model"]) for r in results):
        mine = [r for r in results if (r["structure"], r["model"]) == (name, model)]
        middle = [percent(quantile([number(r[part]) for r in mine], 0.5)) for part in PARTS]
        seconds = quantile([r["seconds"] for r in mine], 0.5)
        gone = sum(any(r[part] is None for part in PARTS) for r in mine)
        count = max(r["parameters"] for r in mine)
        of = f"{gone} of {len(mine)}" if gone else "–"
        lines.append(row(name, f"`{model}`", *middle, count or "–", f"{seconds:.0f}", of))
    return "\n".join(lines) if len(lines) > 2 else "Not run for this page."


def table(results: Sequence[Result], head: bool) -> str:
    """Every fit, a row each."""
    lines = []
    if head:
        lines = [row("structure", "model", "seed", *PARTS.values(), "s"), ""]
        lines[1] = "| --- | --- | ---: | ---: | ---: | ---: | ---: |"
    for r in results:
        errors = [percent(number(r[part])) for part in PARTS]
        name = f"`{r['model']}`"
        lines.append(row(r["structure"], name, r["seed"], *errors, f"{r['seconds']:.0f}"))
    return "\n".join(lines)


def lost(results: Sequence[Result]) -> str:
    """Each fit without a number, and why."""
    gone = [r for r in results if any(r[part] is None for part in PARTS)]
    if not gone:
        return "Every fit ended and no free run diverged."
    return "\n".join(
        f"- {r['structure']}, `{r['model']}`, seed {r['seed']}: "
        + (r["remark"] or f"diverged {', '.join(PARTS[p] for p in PARTS if r[p] is None)}")
        for r in gone
    )


def late(results: Sequence[Result], limit: float) -> str:
    """Fits that took longer than the limit."""
    slow = [r for r in results if r["seconds"] > limit]
    if not slow:
        return f"No fit took longer than {limit:.0f} s."
    names = (
        f"{r['structure']}, `{r['model']}`, seed {r['seed']}: {r['seconds']:.0f} s" for r in slow
    )
    return f"Longer than {limit:.0f} s: {'; '.join(names)}."


def choices(results: Sequence[Result]) -> str:
    """What was chosen on motion held back, a row a fit."""
    mine = [r for r in results if r.get("chosen")]
    if not mine:
        return "Nothing was chosen."
    lines = [row("structure", "model", "seed", "memory of every law", "weight of the polish")]
    lines.append("| --- | --- | ---: | --- | ---: |")
    for r in mine:
        memory, _, weight = r["chosen"].partition("; ")
        lines.append(row(r["structure"], f"`{r['model']}`", r["seed"], memory, weight or "–"))
    return "\n".join(lines)


def missing(results: Sequence[Result], wanted: Sequence[tuple[str, str, int]]) -> str:
    """Fits that were not run."""
    done = {(r["structure"], r["model"], r["seed"]) for r in results}
    lacking: dict[tuple[str, int], list[str]] = {}
    for name, model, seed in wanted:
        if (name, model, seed) not in done:
            lacking.setdefault((model, seed), []).append(name)
    told = [
        f"- `{model}`, seed {seed}: {'; '.join(names)}" for (model, seed), names in lacking.items()
    ]
    return "\n**Not run for this page:**\n\n" + "\n".join(told) + "\n" if told else ""


def older(results: Sequence[Result]) -> str:
    """Fits of an earlier commit, whose numbers were read back from the page of that commit."""
    of: dict[tuple[str, str, int], list[str]] = {}
    for r in results:
        if "commit" in r:
            of.setdefault((r["commit"], r["model"], r["seed"]), []).append(r["structure"])
    told = [
        f"- `{model}`, seed {seed}, {commit}: {'; '.join(names)}"
        for (commit, model, seed), names in of.items()
    ]
    head = "\n**Read back from the page of an earlier commit**, to two decimals:\n\n"
    return head + "\n".join(told) + "\n" if told else ""


def row(*cells: object) -> str:
    return f"| {' | '.join(map(str, cells))} |"
