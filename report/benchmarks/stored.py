"""Rows of the page, kept beside it: a benchmark that is run again replaces its own rows alone.

page.json has, for official files and for stand-ins, every row with the errors of its seeds.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from data.whole_file import write_text
from report.benchmarks.rows import Row, in_order


def stored(page: Path) -> dict[str, list[Row]]:
    """The rows beside a page, by the kind of their files; none where there are none.

    Raises ValueError for a file that has no such rows.
    """
    place = page.with_suffix(".json")
    if not place.is_file():
        return {}
    try:
        kinds = json.loads(place.read_text("utf-8"))
        return {kind: [Row(**row) for row in rows] for kind, rows in kinds.items()}
    except (ValueError, TypeError, AttributeError) as error:
        raise ValueError(
            f"{place} holds no rows of benchmarks ({error}); remove it, and only runs that are "
            "there are on the page"
        ) from None


def store(page: Path, kinds: Mapping[str, Sequence[Row]]) -> None:
    """Write the rows beside a page."""
    rows = {kind: [asdict(row) for row in rows] for kind, rows in kinds.items()}
    write_text(page.with_suffix(".json"), json.dumps(rows, indent=1, ensure_ascii=False) + "\n")


def with_stored(now: Sequence[Row], before: Sequence[Row]) -> list[Row]:
    """Rows of runs, and the stored ones of benchmarks and models that were not run again."""
    run = {(row.benchmark, row.model) for row in now}
    kept = [row for row in before if (row.benchmark, row.model) not in run]
    return in_order([*now, *kept])


def told(now: Mapping[str, Sequence[Row]], before: Mapping[str, Sequence[Row]]) -> str:
    """Which rows are not of runs that are there; "" where all are."""
    faults = []
    for kind, rows in before.items():
        run = {(row.benchmark, row.model) for row in now[kind]}
        kept = sorted({(row.benchmark, row.model) for row in rows} - run)
        names = ", ".join(f"`{model}` on {benchmark}" for benchmark, model in kept)
        faults += [f"{names} ({kind.replace('_', '-')})"] if kept else []
    return f"rows kept from earlier runs and code: {'; '.join(faults)}" if faults else ""
