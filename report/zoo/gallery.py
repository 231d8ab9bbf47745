"""docs/zoo.md: a gallery of what is published, from zoo/index.json alone."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from string import Template
from typing import Any

from data.whole_file import write_text
from models.zoo.index import ROOT, Entry, entries
from report.zoo.publish import total_bytes

TEMPLATE = Path(__file__).parent / "page.md"
PAGE = ROOT.parent / "docs" / "zoo.md"


def write_page(page: Path = PAGE, root: Path = ROOT) -> Path:
    """Write the page; returns where it is."""
    write_text(page, page_of(root))
    return page


def page_of(root: Path = ROOT) -> str:
    """The page's text."""
    found = entries(root)
    text = TEMPLATE.read_text("utf-8")
    facts = {
        "count": str(len(found)),
        "kilobytes": f"{total_bytes(root) / 1000.0:.0f}",
        "gallery": "\n\n".join(_of_system(found)),
        "told": "\n".join(_prior_table(found)),
    }
    return Template(text).substitute(facts)


def _of_system(found: list[Entry]) -> Iterator[str]:
    """A table for each structure, the least free-run error first."""
    for system in dict.fromkeys(entry.system for entry in found):
        of_system = sorted((e for e in found if e.system == system), key=_rank)
        head = "| model | free run [%] | one step [%] | parameters | kB | licence | motion |"
        lines = [head, "| --- | ---: | ---: | ---: | ---: | --- | --- |"]
        lines += [_row(entry) for entry in of_system]
        yield f"### {system}\n\n" + "\n".join(lines)


def _rank(entry: Entry) -> tuple[bool, float]:
    free = entry.facts["free_run_percent"]
    return isinstance(free, str), entry.facts["one_step_percent"] if isinstance(free, str) else free


def _row(entry: Entry) -> str:
    facts, place = entry.facts, f"../zoo/{entry.name}"
    cells = (
        f"[{entry.name}]({place}/card.md)",
        _number(facts["free_run_percent"]),
        _number(facts["one_step_percent"]),
        facts["parameters"],
        f"{entry.bytes / 1000.0:.1f}",
        facts["licence"],
        f'<img src="{place}/picture.svg" width="240" alt="">',
    )
    return "| " + " | ".join(map(str, cells)) + " |"


def _number(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _prior_table(found: list[Entry]) -> Iterator[str]:
    """Prior knowledge of the structure, by kind of model."""
    yield "| model | told beforehand |"
    yield "| --- | --- |"
    for model in dict.fromkeys(entry.model for entry in found):
        told = next(entry.told for entry in found if entry.model == model)
        yield f"| `{model}` | {' '.join(told.split()) or '–'} |"
