"""The page of public benchmarks: report/benchmarks/page.md with tables of finished runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from string import Template

from data.public.benchmarks import BENCHMARKS
from report.benchmarks.published import PUBLISHED
from report.benchmarks.rows import Row, rows_of, without_rows
from report.benchmarks.stored import store, stored, told, with_stored
from report.collection.runs import has_runs, other_version, read_runs, stated
from report.output import markdown
from report.usual import BENCHMARKED, STAND_INS
from runner.folder.run_folder import write_text
from runner.scores.result import Result
from runner.scores.spread import quantile

TEMPLATE = Path(__file__).with_name("page.md")
NEEDS = {  # of the page: what makes it
    BENCHMARKED: "python train.py -m experiment=benchmarks data.folder=FOLDER",
    STAND_INS: f"python train.py -m experiment=benchmarks data.folder=STAND_INS "
    f"hydra.sweep.dir={STAND_INS}",
}
HEAD = ("benchmark", "test series", "model", "RMS error", "least – largest", "% of output")
COST = ("fit [s]", "parameters", "seeds")


def write_benchmarks_page(page: Path, official: Path, stand_ins: Path) -> None:
    """Fill the template from the runs in two folders, either of which may be absent, not both.

    Rows that were stored beside the page stay where nothing was run again.
    """
    runs = {path: read_runs(path) if has_runs(path) else [] for path in (official, stand_ins)}
    before = stored(page)
    if not (any(runs.values()) or any(before.values())):
        raise ValueError(f"no runs in {official} and {stand_ins}; {NEEDS[BENCHMARKED]} makes them")
    now = {"official": rows_of(runs[official]), "stand_ins": rows_of(runs[stand_ins])}
    rows = {kind: with_stored(now[kind], before.get(kind, [])) for kind in now}
    faults = [other_version([*runs[official], *runs[stand_ins]]), told(now, before)]
    texts = {
        "official": official_table(rows["official"], runs[official]),
        "stand_ins": stand_ins_table(rows["stand_ins"]),
        "earlier": stated("; ".join(fault for fault in faults if fault)),
    }
    write_text(page, Template(TEMPLATE.read_text("utf-8")).substitute(texts))
    store(page, rows)


def official_table(rows: Sequence[Row], runs: Sequence[Result]) -> str:
    """All benchmarks: those without files say so."""
    lines, known_of = [], set[tuple[str, str]]()
    for row in rows:
        known = PUBLISHED.get((row.benchmark, row.series))
        if known is not None and (row.benchmark, row.series) not in known_of:
            known_of.add((row.benchmark, row.series))
            value = f"{known.value:g} %" if known.percent else _with_unit(row, known.value)
            lines.append([row.benchmark, row.series, f"published: {known.source}", value, *"–––––"])
        lines.append([*_first(row), *_cost(row)])
    for name, why in without_rows(rows, runs).items():
        missing = "its files are not here" if "not in" in why or "missing" in why else why
        values = [
            f"{series} {known.value:g} {'%' if known.percent else BENCHMARKS[name].unit}"
            for (benchmark, series), known in PUBLISHED.items()
            if benchmark == name
        ]
        note = f"published: {'; '.join(values)}" if values else "published: as with its data"
        lines.append([name, "–", note, missing, *"–––––"])
    return markdown([*HEAD, *COST], lines, (0, 1, 2))


def stand_ins_table(rows: Sequence[Row]) -> str:
    """Errors of stand-ins in units of the noise in their outputs."""
    lines = []
    for row in rows:
        over = "–" if row.noise is None else f"{row.median / row.noise:.2f}"
        lines.append([*_first(row), over, *_cost(row)])
    return markdown([*HEAD, "error over noise", *COST], lines, (0, 1, 2))


def _first(row: Row) -> list[str]:
    ends = f"{min(row.errors):.3g} – {max(row.errors):.3g}"
    percent = quantile(row.percents, 0.5) or 0.0
    name = f"`{row.model}`"
    return [row.benchmark, row.series, name, _with_unit(row, row.median), ends, f"{percent:.3g}"]


def _cost(row: Row) -> list[str]:
    seconds, count = quantile(row.seconds, 0.5) or 0.0, quantile(row.parameters, 0.5) or 0.0
    return [f"{seconds:.0f}", f"{count:.0f}", str(len(row.errors))]


def _with_unit(row: Row, value: float) -> str:
    return f"{value:.3g} {BENCHMARKS[row.benchmark].unit}"
