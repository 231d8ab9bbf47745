"""The identity of a run's code: what it does counts, neither where it stands nor how it is told."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from runner.config import identity, statements
from runner.config.identity import ROOT, code_version, front_name, targets_of, written_code_version

TARGETS = frozenset({"models.VWNN", "data.Structure"})


@pytest.fixture
def tree(tmp_path) -> Path:
    """A copy of the code that makes numbers."""
    for room in ("data", "models", "runner"):
        shutil.copytree(ROOT / room, tmp_path / room, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def change(path: Path, before: str, after: str) -> None:
    text = path.read_text("utf-8")
    assert before in text
    path.write_text(text.replace(before, after), "utf-8")


@pytest.fixture(autouse=True)
def afresh():
    """Files that change while the program runs are read again."""
    yield
    afresh_now()


def afresh_now() -> None:
    identity._read.cache_clear()
    identity._code_of.cache_clear()
    statements._kept.cache_clear()


def of(tree: Path) -> str:
    afresh_now()
    return code_version(TARGETS, tree)


def test_a_copy_elsewhere_is_the_same_code(tree):
    assert of(tree) == code_version(TARGETS, ROOT)


def test_words_do_not_count(tree):
    before = of(tree)
    path = tree / "models" / "vwnn.py"
    text = path.read_text("utf-8")
    path.write_text('"""Another sentence."""\n# and a comment\n' + text.partition('"""\n\n')[2])
    change(tree / "models" / "estimator.py", "must be positive", "has to be positive")
    assert of(tree) == before


def test_a_moved_file_is_the_same_code(tree):
    before = of(tree)
    (tree / "models" / "layers" / "filters.py").rename(tree / "models" / "low_pass.py")
    change(tree / "models" / "vwnn.py", "models.layers.filters", "models.low_pass")
    for path in (tree / "models").rglob("*.py"):
        path.write_text(path.read_text("utf-8").replace("models.layers.filters", "models.low_pass"))
    assert of(tree) == before


def test_a_changed_equation_is_other_code(tree):
    before = of(tree)
    change(tree / "models" / "layers" / "filters.py", "math.exp(-", "math.exp(-2.0 * ")
    assert of(tree) != before


def test_what_a_package_gathers_counts(tree):
    """`from data.simulation.elements import Takeda` leads to the file of the law."""
    named = frozenset({"models.NamedElement"})
    before = code_version(named, tree)
    change(tree / "data" / "simulation" / "elements" / "takeda.py", "slope = max(", "slope = min(")
    afresh_now()
    assert code_version(named, tree) != before


def test_what_a_run_does_not_use_does_not_count(tree):
    before = of(tree)
    path = tree / "models" / "recurrent.py"
    path.write_text(path.read_text("utf-8") + "\nOTHER = 1\n")
    assert of(tree) == before
    assert code_version(frozenset({"models.Recurrent"}), tree) != code_version(
        frozenset({"models.Recurrent"}), ROOT
    )


def test_a_config_names_its_code_in_any_layout(tmp_path):
    content = {"model": {"_target_": "models.VWNN"}, "system": [{"_target_": "data.Structure"}]}
    assert targets_of(content) == TARGETS
    path = tmp_path / "config.yaml"
    path.write_text("a:\n  _target_: models.vwnn.VWNN\nb:\n  _target_: data.structure.Structure\n")
    assert written_code_version(path) == code_version(TARGETS)
    assert written_code_version(tmp_path / "none.yaml") == ""
    assert front_name("os.path.Here") == "os.path.Here"


def test_what_was_parsed_is_kept_on_disk_by_its_text(tree, tmp_path, monkeypatch):
    file = tmp_path / "kept.json"
    monkeypatch.setattr(statements, "_file", lambda: file)
    monkeypatch.setattr(statements, "ROOT", tree)
    before = of(tree)
    with monkeypatch.context() as patched:
        patched.delattr(statements, "_parsed")
        assert of(tree) == before  # nothing is parsed
    change(tree / "models" / "layers" / "filters.py", "math.exp(-", "math.exp(-2.0 * ")
    changed = of(tree)
    assert changed != before
    file.write_text("damaged")
    assert of(tree) == changed


@pytest.mark.parametrize("text", ["", "null", "[1]", '{"a": 3}', '{"a": [1]}'])
def test_a_file_of_something_else_is_parsed_again(text, tmp_path, monkeypatch):
    file = tmp_path / "kept.json"
    file.write_text(text)
    monkeypatch.setattr(statements, "_file", lambda: file)
    assert statements._on_disk() == {}
