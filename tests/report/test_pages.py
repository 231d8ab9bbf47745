"""The list of generated pages and figures: nothing in docs/ is left out, what is stale says why."""

from __future__ import annotations

import json
import os
from collections import Counter

import pytest

from report import pages
from report.pages import CURRENT, DOCS, Product, make, products
from runner.config.identity import RESULTS
from tests.report.free_run_runs import add_run


def test_every_figure_of_the_docs_is_made_by_one_command():
    counts = Counter(path for product in products() for path in product.files)
    assert set(DOCS.rglob("*.png")) <= set(counts)
    assert set(counts.values()) == {1}
    for product in products():
        assert all(path.is_file() for path in product.files), product.command


@pytest.fixture
def page(tmp_path) -> Product:
    """A page of two runs of this code, made after them."""
    for seed in (0, 1):
        run = add_run(tmp_path / "runs", 5.0, seed=seed)
        metrics = json.loads((run / "metrics.json").read_text())
        metrics["identity"] = {"results": RESULTS}
        (run / "metrics.json").write_text(json.dumps(metrics))
    (tmp_path / "page.md").write_text("made")
    return Product((tmp_path / "page.md",), "python -c pass", {tmp_path / "runs": "python again"})


def test_a_page_is_stale_by_its_runs_their_code_and_its_age(page, tmp_path):
    assert page.state() == CURRENT
    os.utime(tmp_path / "page.md", (0, 0))
    assert "older than the runs" in page.state()
    add_run(tmp_path / "runs", 5.0, seed=2)
    assert "1 of 3 runs" in page.state()
    gone = Product(page.files, page.command, {tmp_path / "nothing": "python again"})
    assert gone.state() == f"{tmp_path / 'nothing'} is missing"


def test_what_has_no_runs_or_needs_a_person_is_not_made(page, tmp_path, capsys):
    nothing = Product(page.files, "python -c fail", {tmp_path / "nothing": ""})
    make([page, nothing, Product(page.files, "python -c fail", {}, by_hand=True)])
    assert capsys.readouterr().out == "python -c pass\n"
    with pytest.raises(ValueError, match="python -c fail failed"):
        make([Product(page.files, "python -c fail", {})])


def test_the_program_prints_every_file_and_what_is_missing(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["pages"])
    pages.main()
    out = capsys.readouterr().out
    assert "docs/figures/fig05_element_loops.png" in out
    assert "runs/study is made by python train.py -m experiment=paper" in out
