"""Parts of all small command lines: one-line errors, pairs such as a1=Acc_X, plain text."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn


class Parser(argparse.ArgumentParser):
    """Parser that raises ValueError where argparse would print its usage and exit."""

    def error(self, message: str) -> NoReturn:
        raise ValueError(f"{message}; see --help")


class Pairs(argparse.Action):
    """Pairs of the command line: a1=Acc_X f1=Force → {"a1": "Acc_X", "f1": "Force"}."""

    def __call__(self, parser: Any, args: Any, values: Any, option: str | None = None) -> None:
        pairs = dict(getattr(args, self.dest))
        for word in values:
            key, equals, value = word.partition("=")
            if not (key and equals and value):
                parser.error(f"{option} {word}: expected name=value, such as a1=Acc_X")
            pairs[key] = value
        setattr(args, self.dest, pairs)


def plain(text: str) -> str:
    """`text` without characters that would move the cursor or colour the terminal."""
    return "".join(c if c.isprintable() else "?" for c in text)


def reason(error: ValueError | OSError) -> str:
    """Message of an error, in one plain line."""
    line = str(error)
    if isinstance(error, OSError) and error.strerror:
        line = f"{error.strerror}{f': {error.filename}' if error.filename else ''}"
    return plain(" ".join(line.split()))
