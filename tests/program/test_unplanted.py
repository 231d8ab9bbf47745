"""The suite of structures whose law nobody planted: a quick run, resumed, and its page."""

from __future__ import annotations

import json
import sys

import pytest

from benchmarks.unplanted import structures, suite
from benchmarks.unplanted.page import lost, medians, write_page
from benchmarks.unplanted.structures import CASES, HELD_BACK, records

FIT = {"train": 1.0, "unseen": 2.0, "farther": 3.0, "seconds": 4.0, "parameters": 5, "remark": ""}


def test_a_quick_run_is_resumed_and_writes_its_page(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(structures, "SAMPLES", structures.SAMPLES)
    words = ["suite", "--quick", "--models", "zero", "element_network_branch"]
    page = tmp_path / "page.md"
    monkeypatch.setattr(sys, "argv", [*words, "--output", str(tmp_path), "--page", str(page)])
    suite.main()
    files = sorted((tmp_path / "quick").glob("*.json"))
    assert len(files) == 2
    branch = json.loads(files[0].read_text("utf-8"))
    assert 0.0 < branch["train"] < 60.0
    assert "slack braces, 2 storeys" in page.read_text("utf-8")
    before = [file.stat().st_mtime_ns for file in files]
    suite.main()
    assert [file.stat().st_mtime_ns for file in files] == before
    assert "`zero`" in capsys.readouterr().out


def test_every_structure_stands_and_moves(monkeypatch):
    monkeypatch.setattr(structures, "SAMPLES", 300)
    for case in (*CASES.values(), *HELD_BACK.values()):
        motions = records(case)
        assert [len(those) for those in motions.values()] == [6, 4, 4]
        assert all(bool(r.a.isfinite().all()) for those in motions.values() for r in those)
        assert case.structure().natural_frequencies()[0] > 0.5


def test_a_fit_that_diverged_counts_as_the_worst(tmp_path):
    name = next(iter(CASES))
    fits = [
        {"structure": name, "model": "a", "seed": seed, **FIT, "farther": far}
        for seed, far in enumerate((3.0, None, None))
    ]
    assert "| 1.00 | 2.00 | diverged | 5 | 4 | 2 of 3 |" in medians(fits)
    assert f"- {name}, `a`, seed 1: diverged 1.5 times" in lost(fits)
    write_page(tmp_path / "page.md", fits)
    assert "**Not run for this page:**" in (tmp_path / "page.md").read_text("utf-8")


def test_an_unknown_structure_is_refused():
    with pytest.raises(ValueError, match="expected some of"):
        suite.arguments(["--cases", "castle"])
