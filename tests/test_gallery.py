"""The gallery: each example is short, says what it is, and draws figures with titles and units.

The build of the site executes all of them; here one is run, the others are read.
"""

from __future__ import annotations

import ast
import re
import runpy
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "gallery").glob("*.py"))
FEWEST, MOST = 20, 60  # lines of code, without imports
UNIT = re.compile(r"\[[^\]]+\]")


def code_lines(text: str) -> int:
    """Lines of code, without comments, blank lines, imports and the text at the top."""
    first, *body = ast.parse(text).body
    code = [n for n in body if not isinstance(n, ast.Import | ast.ImportFrom)]
    assert isinstance(first, ast.Expr)
    lines = text.splitlines()
    within = [line for n in code for line in lines[n.lineno - 1 : n.end_lineno]]
    return sum(bool(line.strip()) and not line.strip().startswith("#") for line in within)


def labels(text: str) -> list[str]:
    """What axes are labelled with."""
    calls = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)]
    said = [k.value for call in calls for k in call.keywords if k.arg in ("xlabel", "ylabel")]
    for call in calls:
        if isinstance(call.func, ast.Attribute) and call.func.attr in ("set_xlabel", "set_ylabel"):
            said.append(call.args[0])
    return [word.value for word in said if isinstance(word, ast.Constant)]


def test_there_are_twelve_examples_in_order():
    assert [path.name[:2] for path in EXAMPLES] == [f"{i:02}" for i in range(1, 13)]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_its_figures_say_what_they_show(path):
    text = path.read_text("utf-8")
    title, rule, _, *said = (ast.get_docstring(ast.parse(text)) or "").splitlines()
    assert rule == "=" * len(title)
    assert len(" ".join(said).split()) > 20
    assert FEWEST <= code_lines(text) <= MOST
    figures = text.count("plt.subplots(")
    assert 2 <= figures <= 3
    assert text.count("title=") + text.count("title(") >= figures
    assert len(labels(text)) >= 2 * figures - 1
    assert all(UNIT.search(label) for label in labels(text))
    assert "print(" in text
    for block in text.split("# %%\n")[1:]:
        last = ast.unparse(ast.Module(ast.parse(block).body[-1:], []))  # a notebook shows its value
        assert ("plt.subplots(" in block) == (last == "plt.show()")


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_pages_that_an_example_names_exist(path):
    pages = re.findall(r":doc:`/(\w+)`", path.read_text("utf-8"))
    assert pages
    assert all((ROOT / "docs" / f"{page}.md").is_file() for page in pages)


def test_an_example_runs_in_an_empty_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(plt, "show", lambda: plt.close("all"))
    plt.switch_backend("agg")
    runpy.run_path(str(ROOT / "gallery" / "05_own_structure.py"), run_name="__main__")
    assert "natural frequencies: 2.23 Hz 4.87 Hz" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())
