"""Small command lines: what they are called, and what their help looks like."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import pytest

from data.arguments import Parser

DESCRIPTION = """What it does, in a sentence that is longer than a narrow terminal of 60 columns.

    python -m some.module --with words        what these words do, in one line of its own

More of it, in lines that
are short.
"""


@pytest.mark.parametrize(
    ("module", "called"),
    [("some.module", "python -m some.module"), ("some.front.__main__", "python -m some.front")],
)
def test_a_module_that_was_run_is_called_as_it_was_typed(monkeypatch, module, called):
    run = SimpleNamespace(__spec__=SimpleNamespace(name=module))
    monkeypatch.setitem(sys.modules, "__main__", run)
    assert Parser().prog == called


def test_paragraphs_of_a_description_fill_the_terminal_and_commands_stay(monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    lines = Parser(description=DESCRIPTION).format_help().splitlines()
    assert DESCRIPTION.splitlines()[2] in lines
    assert "More of it, in lines that are short." in lines
    assert all(len(line) < 60 for line in lines if "python -m some" not in line)


def test_a_word_that_is_not_known_is_told_in_one_line():
    with pytest.raises(ValueError, match=r"^unrecognized arguments: --qick; see --help$"):
        Parser().parse_args(["--qick"])
