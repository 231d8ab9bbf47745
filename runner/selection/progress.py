"""What identify.py prints: what each column is taken for, a line for each model, the verdict."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.live import Live
from rich.text import Text

from data.terminal import Line, Terminal
from runner.selection.fits import LOG
from runner.selection.identified import COLUMN, Identified, outcome_line
from runner.selection.search import Watch


class Progress(Watch):
    """Lines of the terminal while models are fitted; the running ones only where it is one."""

    def __init__(self, console: Terminal) -> None:
        self.console = console
        self.live = Live(console=console, transient=True, auto_refresh=False)
        self.ended_any = False

    def __enter__(self) -> Progress:
        if self.console.is_terminal:
            self.live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self.console.is_terminal:
            self.live.stop()

    def understood(self, about: Mapping[str, Any]) -> None:
        """Each file, its columns, its faults."""
        record = about["record"]
        for number, file in enumerate(record["files"]):
            length = "" if file["seconds"] is None else f", {file['seconds']:.4g} s"
            rate = "" if file["dt"] is None else f" at {1.0 / file['dt']:.6g} Hz"
            self.console.tell(f"{file['name']}: {file['samples']:,} samples{rate}{length}", "bold")
            for column in file["channels"] if number == 0 else ():
                unit = f" [{column['unit']}]" if column["unit"] else ""
                taken = f"is {column['channel']}" if column["channel"] else "is not used"
                why = f": {column['why']}" if column["channel"] and column["why"] else ""
                self.console.tell(f"  {column['column']}{unit} {taken}{why}")
            for fault in file["findings"] if not about["questions"] else ():
                where = f" in {fault['channel']}" if fault["channel"] else ""
                self.console.tell(f"  {fault['what']}{where}: {fault['text']}", "yellow")
        for text in record.get("left_out", []):
            self.console.tell(f"left out: {text}", "dim")
        for word in record.get("repairs", []):
            self.console.tell(f"repaired by {word}", "yellow")

    def running(self, seconds: Mapping[str, tuple[float, Path]], left: float) -> None:
        if not self.console.is_terminal:
            return
        lines = [
            f"  {name:<{COLUMN}} {taken:4.0f} s  {_last_line(folder / LOG)}"[:79]
            for name, (taken, folder) in seconds.items()
        ]
        self.live.update(
            Text("\n".join([*lines, f"at most {max(left, 0.0):.0f} s left"])), refresh=True
        )

    def ended(self, outcome: Mapping[str, Any]) -> None:
        if not self.ended_any:
            self.console.tell("errors on held-back motion:")
        self.ended_any = True
        self.console.tell(outcome_line(outcome), "dim" if outcome["status"] == "failed" else "")


class Following(Watch):
    """One line on the models that are being fitted, for those who call from Python."""

    def __enter__(self) -> Following:
        self.line = Line()
        return self

    def __exit__(self, *_: object) -> None:
        self.line.clear()

    def running(self, seconds: Mapping[str, tuple[float, Path]], left: float) -> None:
        listed = [f"{name} {taken:.0f} s" for name, (taken, _) in seconds.items()]
        if listed:
            self.line.tell(lambda: f"{', '.join(listed)}; at most {max(left, 0.0):.0f} s left")


def print_found(console: Terminal, found: Identified) -> None:
    """The verdict, the command that repeats the model, its run, and the page."""
    console.print()
    for number, line in enumerate(found.found["lines"]):
        console.tell(line, "bold" if number == 0 else "")
    if found.found["command"]:
        console.tell(f"again: {found.found['command']}", "dim")
    if found.chosen:
        console.tell(f"run: {found.folder / found.chosen['folder']}")
    console.tell(f"page: {found.page()}")


def _last_line(path: Path) -> str:
    """The last line of a log, at most 4 kB long; "" while there is none."""
    try:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - 4096))
            lines = file.read().decode("utf-8", "replace").strip().splitlines()
    except OSError:
        return ""
    return lines[-1] if lines else ""
