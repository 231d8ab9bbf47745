"""Names from files and configs in tables and pictures: text, whatever they look like."""

from __future__ import annotations

import csv
import io

import pyarrow as pa  # type: ignore[import-untyped]
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from report.collection.report import write_long
from report.output import Section, as_csv, latex, markdown, save_figure, spreadsheet

FORMULAS = ("=cmd|' /C calc'!A0", "+1+1", "-1+1", "@SUM(A1)", "\t=1", "\r=1", "＝1+1", "=", "-")
NUMBERS = ("-3.5", "+1", "-1e-5", "-.5", "1.", "-inf", "nan", "–", "-0.0")


@pytest.mark.parametrize("text", FORMULAS)
def test_no_formula_in_a_spreadsheet(text):
    cell = spreadsheet(text)
    assert cell[0] not in "=+-@\t\r＝" or len(cell) == 1


@pytest.mark.parametrize("text", NUMBERS)
def test_numbers_stay_numbers(text):
    assert spreadsheet(text) == text
    assert spreadsheet(-3.5) == -3.5


def test_both_kinds_of_csv(tmp_path):
    rows = list(csv.reader(io.StringIO(as_csv([{"=head": "=1+1", "number": -2.5}]))))
    assert rows == [["'=head", "number"], ["'=1+1", "-2.5"]]
    table = pa.table({"run": ["=1+1", None, "a"], "value": [-1.5, None, 2.0]})
    _, path = write_long(table, tmp_path)
    with path.open(newline="") as file:
        assert list(csv.reader(file))[1:] == [["'=1+1", "-1.5"], ["", ""], ["a", "2"]]


@settings(deadline=None, max_examples=60, derandomize=True)
@given(st.text(st.sampled_from("|<>&%\n\r`\\{}$_^~#[]a\x1b\u202e"), min_size=1))
def test_tables_keep_their_cells(name):
    page = markdown(("a", "b"), [(name, "1")])
    assert len(page.split("\n")) == 3
    assert page.isprintable() or page.replace("\n", "").isprintable()
    text = latex([Section(("a", "b"), [(name, "1")], title=name, notes=[name])], name)
    assert len(text.splitlines()) == 10
    assert text.replace("\n", "").isprintable()


@pytest.mark.parametrize("name", ["$x_{$", "$\\frac$ $", "\x1b[31m$", "😀", "a$b"])
def test_pictures_with_any_names(tmp_path, name):
    figure = Figure()
    figure.suptitle(name)
    axes = figure.add_subplot()
    axes.semilogy([1, 2], [1e-3, 2e3], label=name)
    axes.set_title(name)
    axes.set_xlabel(name)
    axes.legend()
    figure.legend()
    for path in save_figure(figure, tmp_path, "p"):
        assert path.stat().st_size > 1000
