"""The terminal. Text from files and folders is printed unchanged and commands nothing."""

from __future__ import annotations

from collections.abc import Iterable
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
        super().__init__(markup=False, emoji=False, **options)
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
    return Terminal(width=None if Console().is_terminal else width)
