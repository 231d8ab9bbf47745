"""The page of structures whose law nobody planted: page.md filled in, no number by hand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from string import Template
from typing import Any

from benchmarks.unplanted.structures import CASES, HELD_BACK
from runner.folder.run_folder import write_text
from runner.scores.spread import percent, quantile

TEMPLATE = Path(__file__).with_name("page.md")
PARTS = {"train": "training", "unseen": "unseen", "farther": "1.5 times"}
Result = dict[str, Any]


def write_page(page: Path, results: Sequence[Result]) -> None:
    """Fill the template."""
    seeds = sorted({r["seed"] for r in results})
    facts = {
        "seeds": ", ".join(map(str, seeds)),
        "chosen": medians([r for r in results if r["structure"] in CASES]),
        "held_back": medians([r for r in results if r["structure"] in HELD_BACK]),
        "lost": lost(results),
        "fits": table(results, head=True),
        "missing": missing(results),
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


def missing(results: Sequence[Result]) -> str:
    """Structures that were not run, and models that were not run on all."""
    models = dict.fromkeys(r["model"] for r in results)
    lacking = [
        f"`{model}` on {name}"
        for name in (*CASES, *HELD_BACK)
        for model in models
        if not any((r["structure"], r["model"]) == (name, model) for r in results)
    ]
    return f"\n**Not run for this page:** {'; '.join(lacking)}.\n" if lacking else ""


def row(*cells: object) -> str:
    return f"| {' | '.join(map(str, cells))} |"
