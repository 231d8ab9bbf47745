"""The tables of errors at the end of a run, and the verdict on its model."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from data.record import dof_numbers
from data.terminal import WIDTH
from models.fit.metrics import FREE_RUNS
from models.fit.trained_range import warnings_of
from runner.scores.grade import ONE_STEP, SIMULATES

SPLITS = tuple(FREE_RUNS)
STYLES = {SIMULATES: "green", ONE_STEP: "yellow"}  # of grades
BORDERS = 3  # of a column
CAPTION = (
    "relative RMS error of the {quantity} in % (Eq. 21). “Free run”: simulated from the "
    "excitation and the initial state alone. All other rows: one step ahead, from the measured "
    "motion"
)


def print_errors(
    console: Console,
    title: str | Text,
    rows: Iterable[tuple[str, Mapping[str, Any]]],
    dofs: int,
    quantity: str | None,
    splits: Sequence[str] = SPLITS,
    numbers: Sequence[int] = (),
) -> None:
    """Print `error_table` below its title; what the errors are, unless `quantity` is None."""
    if title:
        console.print(title)
    console.print(error_table(rows, dofs, console.width, splits, numbers))
    if quantity is not None:
        console.print(CAPTION.format(quantity=quantity))


def error_table(
    rows: Iterable[tuple[str, Mapping[str, Any]]],
    dofs: int,
    width: int = WIDTH,
    splits: Sequence[str] = SPLITS,
    numbers: Sequence[int] = (),
) -> Table:
    """Relative RMS error in percent: one row per method, the splits in total and per DOF.

    A single DOF has no columns; numbers: of the DOFs, 1 … n unless given. Where `width` columns of
    the terminal do not hold errors per DOF, the training motion's are omitted, then the test
    motion's; `metrics.json` has them all.

    A row is a name and {split: scores}, or {"failed": reason}. Where the sensors erred, a second
    row gives the error against the true signals. Raises ValueError for scores of other DOFs.
    """
    table = Table()
    lines = list(_lines(rows, dofs, splits))
    columns = ["total", *(f"x{i}" for i in dof_numbers(numbers, dofs) if dofs > 1)]
    heads = {split: [f"{split}\n{column}" for column in columns] for split in splits}
    shown = _shown(heads, lines, width)
    table.add_column("", overflow="fold")
    for split in splits:
        for head in heads[split][: shown[split]]:
            table.add_column(head, justify="right", overflow="fold")
    for name, cells in lines:
        table.add_row(name, *(c for s in splits for c in cells[s][: shown[s]]))
    return table


Cells = Mapping[str, Sequence[str]]  # by split: in total, then per DOF


def _lines(
    rows: Iterable[tuple[str, Mapping[str, Any]]], dofs: int, splits: Sequence[str]
) -> Iterator[tuple[str, Cells]]:
    """Names and texts of the lines of a table."""
    for name, scores in rows:
        if "failed" in scores:
            yield name, {split: ["failed", *["–"] * dofs] for split in splits}
            continue
        yield name, {split: _cells(scores.get(split, {}), dofs) for split in splits}
        if _differs_from_truth(scores):
            indent = " " * (len(name) - len(name.lstrip()))
            true = {split: _cells(_true(scores.get(split, {})), dofs) for split in splits}
            yield f"{indent}  against true", true


def _shown(heads: Cells, lines: Sequence[tuple[str, Cells]], width: int) -> dict[str, int]:
    """For each split how many columns are shown: all, or the total alone where all get too wide."""
    shown = {split: len(of_split) for split, of_split in heads.items()}
    first = max((len(name) for name, _ in lines), default=0) + BORDERS + 1
    for split in heads:
        texts = [
            [of_line[s][i] for _, of_line in [("", heads), *lines]]
            for s in heads
            for i in range(shown[s])
        ]
        if first + sum(map(_width, texts)) > width:
            shown[split] = 1
    return shown


def _width(texts: Iterable[str]) -> int:
    """Of a column with these texts."""
    return BORDERS + max(len(line) for text in texts for line in text.split("\n"))


def titled(metrics: Mapping[str, Any], title: str) -> Text:
    """The title of a run's table; in red where its model is no result."""
    return Text(title, style="bold red" if no_result(metrics) else "table.title")


def no_result(metrics: Mapping[str, Any]) -> str:
    """Why a run's model is none; "" where it is one, and in runs that nobody judged."""
    verdict = metrics.get("verdict", {})
    reason = verdict.get("reason", "") if verdict.get("identified") is False else ""
    return reason or verdict.get("test_diverges", "") or verdict.get("not_better", "")


def print_verdict(console: Console, metrics: Mapping[str, Any]) -> None:
    """The grade of a run's model and its reason, what would help; of older runs why it is none."""
    verdict = metrics.get("verdict", {})
    grade, lost = verdict.get("grade"), no_result(metrics)
    if grade is not None:
        style = "red" if lost else STYLES.get(grade["grade"], "red")
        console.print(Text(f"{grade['grade']}: {grade['reason']}", style=style))
        if grade["advice"]:
            console.print(Text(f"would help: {'; '.join(grade['advice'])}"))
    elif lost:
        console.print(Text(f"no result: {lost}", style="red"))
    elif verdict.get("identified") is None and verdict.get("reason"):
        console.print(f"not judged: {verdict['reason']}")


def print_again(
    console: Console, metrics: Mapping[str, Any], rows: Iterable[tuple[str, Mapping[str, Any]]]
) -> None:
    """Print errors of a run that was scored before, what it was identified on, and its grade."""
    title = f"{metrics['model']} identified on {metrics['system']}, {metrics['scenario']}"
    dofs = len(metrics["test"]["per_dof_percent"])
    quantity = metrics.get("quantity", "acceleration")
    numbers = metrics.get("numbers", ())
    print_errors(console, titled(metrics, title), rows, dofs, quantity, numbers=numbers)
    print_verdict(console, metrics)
    print_left_open(console, metrics)


def print_left_open(console: Console, metrics: Mapping[str, Any]) -> None:
    """What the motions and the sensors of training leave open of the model."""
    if left_open := metrics.get("identification", {}).get("sensors_do_not_determine"):
        console.print(Text(f"the sensors do not determine: {left_open}", style="yellow"))


def print_outside(console: Console, start: str, found: Iterable[Mapping[str, Any]]) -> None:
    """Lines in yellow for what leaves the range that a model was trained in."""
    for line in warnings_of(found):
        console.print(Text(f"{start}{line}", style="yellow"))


def record_rows(metrics: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    """Rows of the test records by themselves; none where there is only one."""
    rows: list[tuple[str, Mapping[str, Any]]] = []
    for name, scores in metrics.get("per_record", {}).items():
        free = scores.get(FREE_RUNS["test"], {})
        rows.append((name, {"test": scores["test"]}))
        if "no_free_run" not in free:
            rows.append(("  free run", {"test": free}))
    return rows


def rows_of(name: str, scores: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    """Rows of a method: its estimate, its estimates in other ways, its free run."""
    one_step = {split: scores[split] for split in SPLITS if split in scores}
    if not one_step:
        return [(name, scores)]
    first: Mapping[str, Any] = next(iter(one_step.values()))
    rows: list[tuple[str, Mapping[str, Any]]] = [(name, one_step)]
    for way in sorted(key for key, value in first.items() if isinstance(value, dict)):
        found = {split: of_split.get(way) for split, of_split in one_step.items()}
        others = {split: value for split, value in found.items() if isinstance(value, dict)}
        rows.append((f"  {way.replace('_', ' ')}", others))
    free = {split: scores[key] for split, key in FREE_RUNS.items() if key in scores}
    if any("no_free_run" not in of_split for of_split in free.values()):
        rows.append(("  free run", free))
    return rows


def merged_rows(name: str, scores: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    """`rows_of`; a single row where every estimate is a free run."""
    rows = rows_of(name, scores)
    same = ("relative_rms_percent", "per_dof_percent")
    if len(rows) == 2 and all(
        of_split.get(key) == rows[0][1].get(split, {}).get(key)
        for split, of_split in rows[1][1].items()
        for key in same
    ):
        return [(f"{name}, free run", rows[1][1])]
    return rows


def why_no_free_run(methods: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Reasons for no free run, a line each, with the methods that lack it."""
    named: dict[str, list[str]] = {}
    for name, scores in methods.items():
        reasons = {scores.get(key, {}).get("no_free_run") for key in FREE_RUNS.values()}
        for reason in sorted(reasons - {None}):
            named.setdefault(reason, []).append(name)
    return [f"no free run of {', '.join(names)}: {reason}" for reason, names in named.items()]


def _cells(scores: Mapping[str, Any], dofs: int) -> list[str]:
    left = scores.get("diverged_after_s")
    if left:
        several = f"{len(left)} diverge\nfrom" if len(left) > 1 else "diverges\nat"
        return [f"{several} {min(left):.1f} s", *["–"] * dofs]
    per_dof = scores.get("per_dof_percent", [None] * dofs)
    if len(per_dof) != dofs:
        raise ValueError(
            f"metrics.json has errors of {len(per_dof)} DOFs where {dofs} are expected; repeat the "
            "run"
        )
    values = [scores.get("relative_rms_percent"), *per_dof]
    return ["–" if value is None else f"{value:.2f}" for value in values]


def _true(scores: Mapping[str, Any]) -> dict[str, Any]:
    return {key.removesuffix("_true"): v for key, v in scores.items() if key.endswith("_true")}


def _differs_from_truth(scores: Mapping[str, Any]) -> bool:
    return any(
        s.get("relative_rms_percent_true", s.get("relative_rms_percent"))
        != s.get("relative_rms_percent")
        for s in scores.values()
    )
