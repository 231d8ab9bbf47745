"""The terminal. Text from files and folders is printed unchanged and commands nothing."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Iterable
from html import escape
from typing import Any

from rich.console import Console, ConsoleOptions
from rich.segment import Segment
from rich.text import Text

from data.arguments import plain

WIDTH = 80  # columns, where the output goes elsewhere than to a terminal


class Terminal(Console):
    """A console without markup and without control characters from texts.

    Whatever is printed passes `render`, so that a name from a file cannot colour the terminal,
    move its cursor, turn the direction of writing or become a link. Colours of tables are styles,
    which stay.
    """

    def __init__(self, **options: Any) -> None:
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
    return Terminal(width=None if Console(force_jupyter=False).is_terminal else width)


def as_html(text: str) -> str:
    """Text as a notebook shows it, every character of it for itself."""
    lines = "\n".join(plain(line) for line in text.split("\n"))
    return f'<pre style="line-height: 1.2">{escape(lines)}</pre>'


class Line:
    """One line on the stream of messages that rewrites itself, in a terminal and in a notebook.

    Elsewhere a plain line follows now and then.
    """

    every, every_plain = 0.2, 30.0  # seconds between lines

    def __init__(self) -> None:
        stream, self.length = sys.stderr, 0
        self.rewrites = stream.isatty() or type(stream).__module__ == "ipykernel.iostream"
        self.told = time.monotonic()

    def tell(self, line: Callable[[], str]) -> None:
        """Show the line, unless the last one is too young."""
        now = time.monotonic()
        if now - self.told < (self.every if self.rewrites else self.every_plain):
            return
        self.told, text = now, plain(line())
        if self.rewrites:
            text = text[: shutil.get_terminal_size().columns - 1]
            self._write(f"\r{text.ljust(self.length)}")
            self.length = len(text)
        else:
            self._write(f"{text}\n")

    def clear(self) -> None:
        """Leave nothing of it."""
        if self.length:
            self._write(f"\r{' ' * self.length}\r")
            self.length = 0

    @staticmethod
    def _write(text: str) -> None:
        sys.stderr.write(text)
        sys.stderr.flush()
