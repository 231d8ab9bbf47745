"""A sweep as a person sees it: live progress, then what was done, what failed and why."""

from __future__ import annotations

import math
import os
import re
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from data.arguments import plain
from data.terminal import Terminal, terminal
from runner.config.choices import varying
from runner.config.identity import RESULTS, is_current
from runner.folder.run_folder import EARLIER, FAILED, METRICS, read_failure, read_metrics
from runner.scores.result import Result, read_result, spread_of
from runner.scores.spread import DIVERGED, NOT_IDENTIFIED, percent

OWN = ("model", "system", "scenario", "seed", "grid")  # have columns of their own, or need none
WIDE = 130  # columns of a terminal
LONGEST = 20  # of a line in the first column of a narrow table


def is_finished(folder: Path) -> bool:
    """Whether a run is complete and of this results version. The folder's name tells its config."""
    try:
        return is_current(read_metrics(folder))
    except (ValueError, OSError):  # damaged, or not there
        return False


def would_fail_again(folder: Path) -> bool:
    """Whether a run failed by its own fault, not a disk's or a machine's, in this version."""
    try:
        failure = read_failure(folder)
        return failure["own"] and failure["results"] == RESULTS
    except (ValueError, OSError):  # damaged, or not there
        return False


class Watch:
    """Progress over the folders of a sweep, whoever works on them."""

    def __init__(
        self,
        folders: Sequence[Path],
        total: int,
        hopeless: int = 0,
        varied: Mapping[Path, str] | None = None,
    ) -> None:
        """`folders`: what is to be run, of `total` runs; `hopeless`: failed before, left alone.

        `varied`: settings that tell the runs apart, besides those of their names.
        Numbers of another results version are put aside; broken off, a sweep gives them back to
        runs that it has not begun.
        """
        for folder in folders:
            (folder / FAILED).unlink(missing_ok=True)
            with suppress(FileNotFoundError):
                os.replace(folder / METRICS, folder / EARLIER)
        self.varied = varied or {}
        self.left, self.total, self.done = set(folders), total, total - len(folders)
        self.before, self.failed = total - len(folders) - hopeless, hopeless
        self.ends = {f: [f"{f}/{METRICS}", f"{f}/{FAILED}"] for f in folders}  # looked for often
        self.results: dict[Path, Result] = {}  # of runs that ended under it
        self.console = terminal(130)
        self.progress = Progress(
            BarColumn(),
            TextColumn("{task.fields[done]} done, {task.fields[failed]} failed"),
            TextColumn("{task.fields[left]} left", style="default"),
            TimeRemainingColumn(),
            console=self.console,
        )
        self.ended = threading.Event()

    def __enter__(self) -> Watch:
        if self.before:
            self.console.print(f"{self.before} of {self.total} runs were finished before")
        self.task = self.progress.add_task("", total=self.total, **self._counts())
        if self.console.is_terminal:
            self.progress.start()
        self.thread = threading.Thread(target=self._watch, daemon=True)
        self.thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.ended.set()
        self.thread.join()
        self.progress.stop()
        for folder in self.left if kind else ():
            with suppress(FileNotFoundError):
                os.replace(folder / EARLIER, folder / METRICS)

    def _counts(self) -> dict[str, Any]:
        """What the one line of a terminal shows; `completed` moves its bar."""
        counts = {"done": self.done - self.failed, "failed": self.failed}
        return {"completed": self.done, **counts, "left": self.total - self.done}

    def _watch(self) -> None:
        last_pass = False
        while not last_pass:
            last_pass = self.ended.wait(0.5)
            self._report_ended()

    def _report_ended(self) -> None:
        new = [f for f in self.left if any(map(os.path.exists, self.ends[f]))]
        for folder in sorted(new, key=lambda f: f.stat().st_mtime):
            self.left.discard(folder)
            self.done += 1
            failed = not (folder / METRICS).exists()
            self.failed += failed
            count = f"[{self.done:>{len(str(self.total))}}/{self.total}]"
            self.results[folder] = run = read_result(folder)
            line = f"{count} {_line(run, failed, self.varied.get(folder, ''))}"
            if not self.console.is_terminal:  # which shows one line, and the table at the end
                self.console.tell(line)
            self.progress.update(self.task, **self._counts())


def _line(run: Result, failed: bool, varied: str) -> str:
    if failed:
        return f"{f'{run.folder.name} {varied}'.rstrip()}: failed: {run.reason}"
    train, test = (_padded(run.error(split)) for split in ("train", "test"))
    name = f"{run.folder.name.rpartition('-')[0]} {varied}".rstrip()  # without the hash
    free = run.free_run
    simulated = "" if free is None else f" free run {_padded(free)}"
    lost = f" {NOT_IDENTIFIED}" if run.identified is False else ""
    return f"{name:<50} train {train} test {test}{simulated}{lost}"


def _padded(error: float | None) -> str:
    lost = error is None or math.isinf(error)
    return f"{DIVERGED:>8}  " if lost else f"{percent(error):>8} %"


def print_summary(
    jobs: Mapping[Path, Sequence[str]],
    skipped: int,
    hopeless: int = 0,
    known: Mapping[Path, Result] | None = None,
) -> bool:
    """Errors over the seeds, the failures and their reasons; whether all runs are done.

    `jobs` maps the folder of each run to what was typed for it; `skipped` of them were done before,
    `hopeless` had failed before and were not run again; `known` are results read already.
    """
    folders = list(jobs)
    console = terminal(160)
    runs = [(known or {}).get(folder) or read_result(folder) for folder in folders]
    done = [run for run in runs if run.finished]
    failed = [run for run in runs if run.has_ended and not run.finished]
    if done:
        told = varied_settings(jobs)
        ended = [(told[run.folder], run) for run in runs if run.has_ended and run.model]
        for table in sweep_tables(ended, console.width):
            console.print(table)
        console.print("median (min – max) over the runs of a row")
    for line in reasons({run.folder.name: run.reason for run in failed}):
        console.tell(line)
    print_not_identified(console, runs)
    before = f" ({skipped} of them before)" if skipped else ""
    judged = sum(run.identified is False for run in done)
    no_result = f", {judged} of them {NOT_IDENTIFIED}" if judged else ""
    lost = len(folders) - len(done) - len(failed)
    unknown = f", {lost} without any result" if lost else ""
    again = "not tried again; hydra.sweeper.retry_failed=true does"
    left = f" ({hopeless} of them before, {again})" if hopeless else ""
    place = f"in {folders[0].parent}" if folders else ""
    console.print(
        f"{len(done)} done{before}{no_result}, {len(failed)} failed{left}{unknown}, {place}",
        soft_wrap=True,
    )
    return len(done) == len(folders)


def print_not_identified(console: Terminal, runs: Sequence[Result]) -> None:
    """Say, in red, which model on which system is no result in how many runs, and one reason."""
    cases: dict[str, list[Result]] = {}
    for run in runs:
        if run.identified is False:
            cases.setdefault(f"{run.model} on {run.system}, {run.scenario}", []).append(run)
    for case, of_case in cases.items():
        first = of_case[0]
        several = f" in {len(of_case)} runs" if len(of_case) > 1 else ""
        line = f"{NOT_IDENTIFIED}: {case}{several}: {first.why} ({first.folder.name})"
        console.tell(line, "red")


def reasons(failed: dict[str, str]) -> list[str]:
    """Why runs failed, a line for each reason: how many runs, and the first of them."""
    by_reason: dict[str, list[str]] = {}
    for name, reason in failed.items():
        by_reason.setdefault(plain(reason), []).append(plain(name))
    return [
        f"failed: {reason} ({len(names)} runs, such as {names[0]})"
        if len(names) > 1
        else f"failed: {names[0]}: {reason}"
        for reason, names in by_reason.items()
    ]


def print_damaged(runs: Mapping[str, str]) -> None:
    """Print which folders {name: reason} cannot be read, and are omitted."""
    for line in reasons(dict(runs)):
        print(line.replace("failed", "damaged", 1), file=sys.stderr)


def varied_settings(jobs: Mapping[Path, Sequence[str]]) -> dict[Path, str]:
    """For each run the settings that vary in the sweep and have no column."""
    words = [dict(word.partition("=")[::2] for word in job) for job in jobs.values()]
    names = sorted(name for name in varying(words) if name not in OWN)
    return {
        folder: " ".join(f"{name}={of_run[name]}" for name in names if name in of_run)
        for folder, of_run in zip(jobs, words, strict=True)
    }


def sweep_tables(runs: Sequence[tuple[str, Result]], width: int) -> Iterator[Table]:
    """Median (min – max) over the seeds of each case: (varied settings, run) of every run.

    A table for each system and scenario. In less than `WIDE` columns ranges are below medians,
    and what was varied or lost below the model.
    """
    cases: dict[tuple[str, str], dict[tuple[str, str], list[Result]]] = {}
    for settings, run in runs:
        of_place = cases.setdefault((str(run.system), str(run.scenario)), {})
        of_place.setdefault((settings, str(run.model)), []).append(run)
    for place, groups in sorted(cases.items()):
        title = f"{', '.join(place)}: relative RMS error in %"
        table = Table(title=title, title_justify="left", collapse_padding=True)
        varied = any(settings for settings, _ in groups)
        for name in ("model", *(["varied"] if varied and width >= WIDE else [])):
            table.add_column(name, overflow="fold")
        for name in ("runs", "train", "test", "free run"):
            table.add_column(name, justify="right")
        for (settings, model), group in sorted(groups.items()):
            train = spread_of(group, lambda run: run.error("train"))
            test = spread_of(group, lambda run: run.error("test"))
            free = spread_of(group, lambda run: run.free_run)
            cells = [model, *([settings] if varied else []), test.counts()]
            errors = [spread.text() for spread in (train, test, free)]
            if width < WIDE:
                count, *lost = test.counts().split(", ")
                below = (_in_lines(text, "  ") for text in (*settings.split(), *lost))
                cells = ["\n".join((_in_lines(model), *below)), count]
                errors = [text.replace(" (", "\n(") for text in errors]
            style = "red" if test.unidentified else None
            table.add_row(*map(Text, cells), *errors, style=style)
        yield table


def _in_lines(name: str, indent: str = "") -> str:
    """A name or setting in lines that a narrow column holds, which end at _ or =."""
    lines = [indent]
    for word in re.findall(r"[^_=]*[_=]?", name):
        if lines[-1].strip() and len(lines[-1] + word) > LONGEST:
            lines.append(indent)
        lines[-1] += word
    return "\n".join(lines)
