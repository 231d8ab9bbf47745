"""The page of free runs: filled from the leaderboard's rows, and it says what no run answers."""

from __future__ import annotations

import json
import math
import re

import pytest

from report.collection.runs import read_runs
from report.free_run.beyond import CHANGES, FILE
from report.free_run.page import matrix, settings, write_page
from report.free_run.rows import leaderboard
from tests.report.free_run_runs import LOST, add_run

NOISY = {"level": 0.05, "signals": ["a", "f"]}


@pytest.fixture
def runs(tmp_path):
    """Some models on two systems; one diverged; one record; noise."""
    folder = tmp_path / "free_run"
    for system in ("bilinear", "bouc_wen"):
        for seed in (0, 1):
            case = {"system": system, "seed": seed}
            add_run(folder, 0.25 + seed, model="element_network", **case)
            add_run(folder, 33.0, model="linear", **case)
            lost = LOST if (system, seed) == ("bouc_wen", 1) else 12.5
            add_run(folder, lost, model="vwnn_forward", **case)
            add_run(folder, 1.75, model="element_network", train_records=1, **case)
            noisy = {"model": "element_network_accelerations", "scenario": "noisy"}
            add_run(folder, 0.5, settings=NOISY, **noisy, **case)
    return folder


def write(tmp_path, runs, asked=None, drawn=()):
    page = tmp_path / "docs" / "free_run.md"
    write_page(page, read_runs(runs), read_runs(asked) if asked else [], drawn)
    return page.read_text("utf-8")


def test_all_is_filled_in_and_the_figures_are_beside_it(runs, tmp_path):
    drawn = [tmp_path / f"loops_element_network_bilinear.{kind}" for kind in ("png", "pdf")]
    for path in drawn:
        path.write_bytes(b"picture")
    text = write(tmp_path, runs, drawn=drawn)
    assert "$" not in text
    assert "of the 20 runs 1 diverged and 0\nfailed" in text
    assert "| `element_network` | 0.75 (0.25 – 1.25) † | 0.75 (0.25 – 1.25) † |" in text
    assert "| `vwnn_forward` | 12.50 | diverged (12.50 – diverged) |" in text
    assert "**Incomplete:** no runs of polynomial yet; the experiment names `element" in text
    counts = re.findall(
        r"(\d+) of `", text.partition("runs of another results version: ")[2].split("\n")[0]
    )
    assert sum(map(int, counts)) == 20
    assert "There is none among these." in text
    assert "| `linear` | 3.00 → 33.00 | 3.00 → 33.00 |" in text
    assert "| `element_network`, 1 record | 1.75 † |" in text
    assert "### 8 training records, `scenario=noisy level=0.05 signals=[a,f]`" in text
    assert "| `vwnn_forward` | bouc_wen | 8 training records, full_state | 2 | 1 | 0 |" in text
    assert "(figures/loops_element_network_bilinear.png)" in text
    assert (tmp_path / "docs" / "figures" / "loops_element_network_bilinear.png").is_file()
    assert not (tmp_path / "docs" / "figures" / "loops_element_network_bilinear.pdf").exists()


def test_what_no_run_answers_names_the_command(runs, tmp_path):
    text = write(tmp_path, runs)
    assert text.count("`python train.py -m experiment=free_run_questions` does it") == 3
    assert text.count("`python -m report.free_run.beyond` does it") == 2


def test_questions_and_motions_beyond_are_rows(runs, tmp_path):
    asked = tmp_path / "questions"
    add_run(asked, 0.9, model="element_network", train_records=2, grid="less_data")
    score = {"relative_rms_percent_true": 4.5, "diverged": 0, "left_after_s": []}
    for entry in read_runs(runs):
        scores = dict.fromkeys(CHANGES[1:], score)
        (entry.folder / FILE).write_text(json.dumps({"scores": scores}))
    text = write(tmp_path, runs, asked)
    assert "**bilinear: data.train_records**" in text
    assert "| `element_network` | 2 | 1 | 0 | 0 | 0.90 |" in text
    assert "| `element_network` | excitation.force.std*1.5 | 2 | 0 | 4.50 |" in text
    assert "| `element_network` | data.dt=0.02 | 2 | 0 | 4.50 |" in text
    assert "report.free_run.beyond` does it" not in text


def test_a_fit_that_was_caught_is_named_with_its_seed(runs, tmp_path):
    for seed, error in ((2, 0.25), (3, 0.25), (4, 26.0)):
        add_run(runs, error, model="element_network", system="bilinear", seed=seed)
    text = write(tmp_path, runs)
    assert "| `element_network` | bilinear | 8 records | 4 | 0.25 | 26.00 | failed |" in text


def test_rows_that_the_readme_shows_are_those_of_the_page(runs, tmp_path):
    readme = tmp_path / "README.md"
    readme.write_text("before\n| `vwnn_forward` | of | yesterday |\n| `nobody` | 1 | 2 |\nafter")
    for _ in range(2):  # again is the same
        text = write(tmp_path, runs)
    (row,) = (
        s for s in text.split("\n## What a free")[0].splitlines() if "| `vwnn_forward` |" in s
    )
    assert readme.read_text("utf-8") == f"before\n{row}\n| `nobody` | 1 | 2 |\nafter"


def test_settings_without_noise_and_with_most_records_come_first_the_best_model_on_top(runs):
    rows = leaderboard(read_runs(runs))
    firsts = [same[0] for same in settings(rows).values()]
    found = [(row.scenario.split()[0], row.train_records) for row in firsts]
    assert found == [("full_state", 8), ("full_state", 1), ("noisy", 8)]
    lines = matrix(rows, lambda row: "").splitlines()[2:]
    models = [line.split("`")[1] for line in lines]
    assert models[:3] == ["element_network", "linear", "vwnn_forward"]  # half diverged is diverged
    assert max(row.errors.median or 0.0 for row in rows) == math.inf
