"""Parts of all small command lines: one-line errors, pairs such as a1=Acc_X, plain text."""

from __future__ import annotations

import argparse
import difflib
import io
import sys
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any, NoReturn


class _Paragraphs(argparse.HelpFormatter):
    """Paragraphs fill the width; those that are set in, such as commands, stay as they are."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        paragraphs = []
        for paragraph in text.strip("\n").split("\n\n"):
            as_it_is = paragraph.startswith(" ")
            filled = super()._fill_text
            paragraphs.append(paragraph if as_it_is else filled(paragraph, width, indent))
        return "\n\n".join(paragraphs)


class Parser(argparse.ArgumentParser):
    """Parser that raises ValueError where argparse would print its usage and exit.

    A module that was run as such is called so: `python -m benchmarks.sweeps`, not `sweeps.py`.
    """

    def __init__(self, prog: str | None = None, **settings: Any) -> None:
        settings = {"formatter_class": _Paragraphs} | settings
        super().__init__(prog or _command(), **settings)

    def error(self, message: str) -> NoReturn:
        raise ValueError(f"{message}; see --help")

    def print_help(self, file: Any = None) -> None:
        print_any_text()
        super().print_help(file)


def _command() -> str | None:
    """`python -m MODULE`; None where a file was run (Python does so itself from 3.14 on)."""
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    return spec and f"python -m {spec.name.removesuffix('.__main__')}"


def print_any_text() -> None:
    """Let a terminal of few characters (Windows' code page 1252) show ? for those it lacks."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


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


def key_values(words: Sequence[str], keys: Mapping[str, str]) -> dict[str, str]:
    """Words such as run=FOLDER by their keys. keys: what the value of each is.

    Raises ValueError for other words, for a key that is given twice, and for one without a value.
    """
    given: dict[str, str] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or key not in keys:
            known = " ".join(f"{name}={what}" for name, what in keys.items()) or "no settings"
            raise ValueError(f"{word}: expected {known}{suggestion(key, keys)}; see --help")
        if key in given:
            raise ValueError(f"{key}= is given twice; say it once")
        if not value:
            raise ValueError(f"{word} lacks a value: {key}={keys[key]}")
        given[key] = value
    return given


def suggestion(word: str, choices: Iterable[str], most: int = 1, cutoff: float = 0.6) -> str:
    """What a mistyped word may mean, for the end of an error: "; did you mean json?"; or ""."""
    near = difflib.get_close_matches(word, list(choices), n=most, cutoff=cutoff)
    return f"; did you mean {' or '.join(near)}?" if near else ""


def plain(text: str) -> str:
    """`text` without characters that would move the cursor or colour the terminal."""
    return "".join(c if c.isprintable() else "?" for c in text)


def as_html(text: str) -> str:
    """Text as a notebook shows it, every character of it for itself."""
    lines = "\n".join(plain(line) for line in text.split("\n"))
    return f'<pre style="font-family: monospace; line-height: 1.2">{escape(lines)}</pre>'


class Shown:
    """What a notebook shows as its text."""

    def _repr_html_(self) -> str:
        return as_html(str(self))


def count_of(number: int, noun: str) -> str:
    """So many of what the noun names: "1 overrun", "2,000 samples"."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def label(text: str, length: int = 60) -> str:
    """Plain text for a picture, where a $ is a $ and begins no formula."""
    shown = plain(text)
    shown = shown if len(shown) <= length else shown[: length - 1] + "…"
    return shown.replace("$", "\\$")


def reason(error: ValueError | OSError) -> str:
    """Message of an error, in one plain line."""
    line = str(error)
    if isinstance(error, OSError) and error.strerror:
        line = f"{error.strerror}{f': {error.filename}' if error.filename else ''}"
    return plain(" ".join(line.split()))
