"""The terminal. Text from files and folders is printed unchanged and commands nothing."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any

from rich.console import Console, ConsoleOptions
from rich.segment import Segment
from rich.text import Text

from data.arguments import plain

WIDTH = 80  # columns, where the output goes elsewhere than to a terminal
ROWS = 40  # of a table; files have all
LISTED = 6  # in a line; the rest is counted, or in files


class Terminal(Console):
    """A console without markup and without control characters from texts.

    Whatever is printed passes `render`, so that a name from a file cannot colour the terminal,
    move its cursor, turn the direction of writing or become a link. Colours of tables are styles,
    which stay.
    """

    def __init__(self, **options: Any) -> None:
        own = "file" not in options and sys.stdout is sys.__stdout__
        options.setdefault("force_terminal", None if own else False)  # despite FORCE_COLOR
        super().__init__(markup=False, emoji=False, force_jupyter=False, **options)
        self.headed = ""

    def heading(self, text: str) -> None:
        """Print a heading with what is printed next; none where another heading comes first."""
        self.headed = text

    def print(self, *objects: Any, **options: Any) -> None:
        """Print, below the heading that waits for it."""
        text, self.headed = self.headed, ""
        if text:
            super().print(Text(f"\n{text}", style="bold"))
        super().print(*objects, **options)

    def tell(self, text: str, style: str = "") -> None:
        """Print a text as one line, however long it is, in a style and no other colours."""
        self.print(Text(text, style=style), soft_wrap=True)

    def render(self, renderable: Any, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            text = segment.text
            if segment.control or text.isprintable() or text == "\n":
                yield segment
            else:
                text = "\n".join(plain(line) for line in text.split("\n"))
                yield Segment(text, segment.style)


def terminal(width: int = WIDTH) -> Terminal:
    """The terminal, or `width` columns where the output goes elsewhere."""
    return Terminal(width=None if Terminal().is_terminal else width)


class Line:
    """A line of messages that rewrites itself, in a terminal and in a notebook.

    Elsewhere a plain line follows now and then.
    """

    every, every_plain = 0.2, 30.0  # seconds between lines

    def __init__(self) -> None:
        notebook = type(sys.stderr).__module__ == "ipykernel.iostream"
        self.display = import_module("IPython.display").DisplayHandle() if notebook else None
        self.rewrites, self.shown = notebook or sys.stderr.isatty(), False
        self.told = time.monotonic()

    def tell(self, line: Callable[[], str]) -> None:
        """Show the line, unless the last one is too young."""
        now = time.monotonic()
        if now - self.told >= (self.every if self.rewrites else self.every_plain):
            self.told = now
            self._write(plain(line()))

    def clear(self) -> None:
        """Leave nothing of it."""
        if self.shown:
            self._write("")
            self.shown = False

    def _write(self, text: str) -> None:
        if self.display is not None:
            show = self.display.update if self.shown else self.display.display
            show({"text/plain": text}, raw=True)
        elif self.rewrites:
            sys.stderr.write(f"\r\x1b[K{text[: shutil.get_terminal_size().columns - 1]}")
        else:
            sys.stderr.write(f"{text}\n")
        self.shown = self.rewrites
        sys.stderr.flush()
