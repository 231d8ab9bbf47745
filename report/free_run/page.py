"""The page of free runs: report/free_run/page.md filled in from the leaderboard's tables.

A placeholder of the template is `$name`; each is made here of the rows that the tables have, so no
error is written by hand. What no run answers is said to be so, with the command that makes them.
Rows of its first table that a README.md beside the page's folder has are written there too.
"""

from __future__ import annotations

import math
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from string import Template

from models.training.metrics import FREE_RUNS
from report.about import about, contains, told
from report.collection.grids import grids_of, seeds_of
from report.collection.runs import other_version, stated
from report.free_run.beyond import AS_TRAINED, FILE, LARGER, STD, STEPS, beyond_rows, chosen
from report.free_run.beyond import BEYOND_COLUMNS as BEYOND
from report.free_run.questions import (
    ASK,
    QUESTION_COLUMNS,
    QUESTIONS,
    question_of,
    question_rows,
)
from report.free_run.rows import SYSTEMS, Row, leaderboard, row_of, rows_apart
from report.free_run.tables import COLUMNS, Columns, Title, case, records_of, sections
from report.output import code, markdown, sections_markdown
from report.usual import LEADERBOARD
from report.usual import QUESTIONS as ASKED
from runner.folder.run_folder import write_text
from runner.scores.result import Result, against_true
from runner.scores.spread import DIVERGED, ESCAPED, FAILED, percent, quantile

TEMPLATE = Path(__file__).with_name("page.md")
FULL_STATE = "full_state"
PRINTED = {"bouc_wen": "Bouc–Wen"}
NEEDS = {LEADERBOARD: "python train.py -m experiment=free_run", ASKED: ASK}  # of the page
CAUGHT = 10.0  # times the median of the other seeds
MARKS = {"yes": " †", "possible": " ‡"}
NOTES = (
    "Median (smallest – largest) over the seeds, in percent.",
    "† the model's laws contain the structure's: parametric identification.",
    "‡ the model's laws could contain them, in directions that it was not told.",
)


def write_page(
    page: Path, runs: Sequence[Result], asked: Sequence[Result], drawn: Sequence[Path]
) -> None:
    """Fill the template; the figures `drawn` go beside it, rows of the first table into the README.

    runs: the leaderboard's; asked: those of the questions, may be empty.
    """
    rows = leaderboard(runs)
    pictures = [path for path in drawn if path.suffix == ".png"]
    facts = dict(_of_leaderboard(rows)) | dict(_of_costs(rows, runs, asked))
    seeds = {run.seed for run in runs}
    facts |= {
        "missing": _missing(rows, runs),
        "caught": _caught(runs),
        "seeds": f"{min(seeds)} … {max(seeds)}",
    }
    facts |= dict(_of_questions(question_rows(asked, runs), _beyond(runs)))
    facts |= dict(_of_figures([path.stem for path in pictures]))
    text = Template(TEMPLATE.read_text("utf-8")).substitute(facts)
    figures = page.parent / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    for path in pictures:
        shutil.copyfile(path, figures / path.name)
    write_text(page, text)
    _refresh(page.absolute().parent.parent / "README.md", facts["overview"])


def _missing(rows: Sequence[Row], runs: Sequence[Result]) -> str:
    """What the experiment names and these runs lack, and whether they are of this code."""
    lines = []
    systems = [PRINTED.get(s, s) for s in SYSTEMS if s not in {row.system for row in rows}]
    if systems:
        lines.append(f"no runs of {', '.join(systems)} yet")
    grids = grids_of("free_run").values()
    planned = [model for grid in grids for model in str(grid["model"]).split(",")]
    lacking = [m for m in dict.fromkeys(planned) if m not in {row.model for row in rows}]
    if lacking:
        names = ", ".join(f"`{model}`" for model in lacking)
        lines.append(f"the experiment names {names} too, which were not run yet")
    lines += _fewer_seeds(runs)
    if earlier := other_version(runs):
        lines.append(earlier)
    return stated("; ".join(lines))


def _fewer_seeds(runs: Sequence[Result]) -> Iterator[str]:
    """Models that have fewer seeds than their grid asks for, on some system."""
    counts = Counter((run.grid, run.model, run.system) for run in runs)
    wanted = seeds_of("free_run")
    short: dict[tuple[str, str], list[int]] = {}
    for (grid, model, _), count in counts.items():
        if count < wanted.get(grid or "", 0):
            short.setdefault((str(grid), str(model)), []).append(count)
    names = (
        f"`{model}` ({grid.replace('_', ' ')}) {min(numbers)} of {wanted[grid]}"
        for (grid, model), numbers in short.items()
    )
    if text := ", ".join(names):
        yield f"some systems have fewer seeds than asked for: {text}"


def _refresh(readme: Path, table: str) -> None:
    """Rows of the README's table as the page has them now; the README says which."""
    if not readme.is_file():
        return
    rows = {line.split(" |")[0]: line for line in table.splitlines() if line.startswith("| `")}
    lines = readme.read_text("utf-8").split("\n")
    write_text(readme, "\n".join(rows.get(line.split(" |")[0], line) for line in lines))


def _of_leaderboard(rows: Sequence[Row]) -> Iterator[tuple[str, str]]:
    """Counts, the overview, the rows setting by setting, and what the models know."""
    for count in ("runs", DIVERGED, FAILED, ESCAPED):
        yield count, str(sum(getattr(row.errors, count) for row in rows))
    simulated = [row for row in rows if not row.no_free_run]
    yield "overview", "\n\n".join([matrix(simulated, _spread), " ".join(NOTES)])
    usual, first = next(iter(settings(simulated).items()))
    yield "usual", usual
    yield "one_step", matrix(first, _one_step_and_free)
    blocks = []
    for title, same in settings(rows).items():
        columns = {"model": COLUMNS["model"], "truth inside": _inside, **COLUMNS}
        blocks += [f"### {title}", _tables(same, columns, case)]
    yield "leaderboard", "\n\n".join(blocks)
    models = dict.fromkeys(row.model for same in settings(rows).values() for row in same)
    known = [(code(model), told(model)) for model in models]
    yield "known", markdown(("model", "what it is told"), known, left=None)
    yield "lost", _lost(rows)


def settings(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Rows by records and scenario: without noise first, then most records first."""
    found: dict[str, list[Row]] = {}
    for row in sorted(rows, key=lambda r: (r.scenario != FULL_STATE, -(r.train_records or 0))):
        found.setdefault(f"{records_of(row.train_records)}{_seen(row)}", []).append(row)
    return found


def _seen(row: Row) -> str:
    return "full state, no noise" if row.scenario == FULL_STATE else f"`scenario={row.scenario}`"


def matrix(rows: Sequence[Row], cell: Callable[[Row], str]) -> str:
    """A line for each model and setting, a column for each system; the best of a setting first."""
    found = {row.system for row in rows}
    systems = [*(s for s in SYSTEMS if s in found), *sorted(found - set(SYSTEMS))]
    head = ["model", *(PRINTED.get(system, system) for system in systems)]
    lines: list[list[str]] = []
    for number, same in enumerate(settings(rows).values()):
        named: dict[str, dict[str, Row]] = {}
        for row in same:
            label = f"`{row.model}`" + (f" {row.varied}" if row.varied else "")
            label += f", {_setting(row)}" if number else ""
            named.setdefault(label, {})[row.system] = row
        for label, of in sorted(named.items(), key=lambda item: _middle(item[1].values())):
            lines.append([label, *(cell(of[s]) if s in of else "" for s in systems)])
    return markdown(head, lines)


def _setting(row: Row) -> str:
    """Of a line that is not in the first setting."""
    records = records_of(row.train_records).removesuffix(", ").replace("training ", "")
    return records if row.scenario == FULL_STATE else f"{records}, {row.scenario}"


def _middle(rows: Iterable[Row]) -> float:
    """Median over the systems of the medians over the seeds."""
    medians = [row.errors.median for row in rows if row.errors.median is not None]
    return quantile(medians, 0.5) or 0.0


def _spread(row: Row) -> str:
    return row.errors.text() + MARKS.get(_inside(row), "")


def _inside(row: Row) -> str:
    """Whether the model contains the structure's law; "" for what nobody has stated."""
    stated = row.system in SYSTEMS and about(row.model)
    return contains(row.model, row.system) if stated else ""


def _one_step_and_free(row: Row) -> str:
    """Both medians; an estimate one step ahead is never said to have diverged."""
    return f"{percent(row.one_step_percent)} → {row.errors.words(row.errors.median)}"


def _tables(rows: Sequence[Row], columns: Columns, title: Title) -> str:
    """Of each title a table, as in the leaderboard's own files but without their caption."""
    return sections_markdown(sections(rows, columns, title)).rstrip()


def _lost(rows: Sequence[Row]) -> str:
    """Rows with lost runs, and how many there are of each kind."""
    escaped = [ESCAPED] if any(row.errors.escaped for row in rows) else []
    names = ("runs", DIVERGED, FAILED, *escaped)
    lines = []
    for row in rows:
        counts = [getattr(row.errors, name) for name in names]
        if any(counts[1:]):
            where = f"{records_of(row.train_records)}{row.scenario} {row.varied}".strip()
            lines.append([code(row.model), row.system, where, *map(str, counts)])
    if not lines:
        return "No run diverged and none failed."
    return markdown(("model", "system", "setting", *names), lines, left=None)


def _caught(runs: Sequence[Result]) -> str:
    """Runs whose error is CAUGHT times the median of their row, and their training error."""
    lines = []
    for varied, same in rows_apart(runs):
        row = row_of(same, varied)
        middle = row.errors.median
        limit = CAUGHT * (math.inf if middle is None else middle)
        for run in same:
            if limit < (run.free_run or 0.0) < math.inf:
                training = against_true(run.metrics.get(FREE_RUNS["train"], {}))
                errors = (row.errors.words(u) for u in (middle, run.free_run, training))
                place = (code(row.model), row.system, _setting(row), str(run.seed))
                lines.append([*place, *errors])
    head = ("model", "system", "setting", "seed", "median", "its error", "in training")
    return markdown(head, lines, left=None) if lines else "There is none among these."


def _of_costs(
    rows: Sequence[Row], runs: Sequence[Result], asked: Sequence[Result]
) -> Iterator[tuple[str, str]]:
    """Seconds of every fit, and hours of all of them together."""
    yield "costs", matrix(rows, lambda row: percent(row.fit_seconds))
    yield "hours", _hours(runs)
    yield "hours_questions", _hours(asked) if asked else "not measured here, about as much"


def _hours(runs: Sequence[Result]) -> str:
    seconds = sum(run.metrics.get("fit_seconds", 0.0) for run in runs)
    return f"{seconds / 3600.0:.1f} hours"


def _beyond(runs: Sequence[Result]) -> list[Row]:
    """Rows of report/free_run/beyond.py, of the runs that it has scored."""
    return beyond_rows([run for run in chosen(runs) if (run.folder / FILE).is_file()])


def _of_questions(answered: Sequence[Row], beyond: Sequence[Row]) -> Iterator[tuple[str, str]]:
    for name, varied in QUESTIONS.items():
        mine = [row for row in answered if row.varied == varied]
        yield name, _answer(mine, QUESTION_COLUMNS, question_of, ASK)
    changes = {"larger": [f"{STD}*{LARGER}"], "other_dt": [f"data.dt={dt}" for dt in STEPS]}
    for name, wanted in changes.items():
        mine = [row for row in beyond if row.varied in (AS_TRAINED, *wanted)]
        yield name, _answer(mine, BEYOND, case, "python -m report.free_run.beyond")


def _answer(rows: Sequence[Row], columns: Columns, title: Title, command: str) -> str:
    if not rows:
        return f"Not measured among these runs; `{command}` does it."
    return _tables(rows, columns, title)


def _of_figures(names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Markdown of those that were drawn."""
    kinds: dict[str, Callable[[str], bool]] = {
        "figures_errors": lambda name: name.startswith("free_run_errors_"),
        "figures_questions": lambda name: name.startswith("free_run_error_against_"),
        "figures_loops": lambda name: name.startswith("loops_"),
        "figures_motions": lambda name: name.startswith("free_run_"),
    }
    left = list(names)
    for kind, belongs in kinds.items():
        mine = [name for name in left if belongs(name)]
        left = [name for name in left if name not in mine]
        lines = [f"![{name.replace('_', ' ')}](figures/{name}.png)" for name in mine]
        yield kind, "\n\n".join(lines) or "Nothing to draw among these runs."
