"""The page of results: every placeholder is filled from runs, and says so where it cannot be."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from report.collection.runs import read_runs
from report.paper import page as page_module
from report.paper.cells import METHODS, SETTINGS, study_cells
from report.paper.page import CLAIMS, write_page
from runner.config.choices import plain
from runner.folder.run_folder import settings_of
from runner.scores.result import Result
from tests.program.test_every_config import composed
from tests.report.test_paper_cells import add_run

TRAINING = {"training": {"iterations": 40}, "fit_seconds": 1.5}
FEEDTHROUGH = {
    system: {f"{k} {s}": [3.0] for k in ("causal", "leaky") for s in ("train", "test")}
    for system in ("bilinear", "polynomial", "bouc_wen")
}


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Path:
    """Runs of every method on every setting, two seeds; errors that tell them apart."""
    folder = tmp_path_factory.mktemp("paper") / "study"
    folder.mkdir()
    models = [m for m in METHODS if m != "residual_mlp_own_residual"]
    for system, scenario in SETTINGS.values():
        settings = settings_of(plain(composed(f"scenario={scenario}").scenario))
        for i, model in enumerate(models):
            for seed in (0, 1):
                case = {"model": model, "system": system, "scenario": scenario, "seed": seed}
                error = 1.0 + i + 0.1 * seed
                add_run(folder, error, scenario_settings=settings, extra=TRAINING, **case)
    (folder.parent / "feedthrough.json").write_text(json.dumps(FEEDTHROUGH))
    return folder


@pytest.fixture(scope="module")
def runs(study) -> list[Result]:
    return read_runs(study)


@pytest.fixture(autouse=True)
def _no_free_runs(monkeypatch) -> None:
    monkeypatch.setattr(page_module, "rows_of", lambda runs: [])


def test_the_page_has_no_placeholder_left_and_its_figures_beside_it(study, runs, tmp_path):
    (tmp_path / "drawn").mkdir()
    (tmp_path / "drawn" / "fig.png").write_bytes(b"picture")
    page = tmp_path / "docs" / "results.md"
    of_filters = study.parent / "feedthrough.json"
    write_page(page, runs, study_cells(runs), tmp_path / "drawn", study, study, of_filters)
    text = page.read_text("utf-8")
    assert "$" not in text
    assert "| `vwnn` | 9.34 | 1.05 |" in text
    assert "2 of 2" in text
    assert (tmp_path / "docs" / "figures" / "fig.png").read_bytes() == b"picture"


def test_a_study_of_one_table_makes_no_page_and_says_what_is_missing(study, runs, tmp_path):
    runs = [run for run in runs if run.system == "bilinear"]
    with pytest.raises(ValueError, match=r"make them: python train\.py -m experiment=paper"):
        write_page(tmp_path / "results.md", runs, study_cells(runs), tmp_path, study, study)
    assert not (tmp_path / "results.md").exists()


def test_a_page_without_the_study_of_the_filters_says_how_to_make_it(study, runs, tmp_path):
    places = (tmp_path / "drawn", study, study, tmp_path / "nothing.json")
    with pytest.raises(ValueError, match=r"make it: python -m studies\.feedthrough"):
        write_page(tmp_path / "results.md", runs, study_cells(runs), *places)


def test_claims_are_judged_on_the_errors_of_a_seed():
    errors = dict.fromkeys(METHODS, 10.0) | {"vwnn": 5.0, "two_point": 2.0, "residual_mlp": 4.0}
    judged = {name: holds(errors) for name, holds in CLAIMS.items()}
    assert judged == {
        "vwnn_best_own": True,
        "vwnn_best_measured": False,
        "two_point_beats_vwnn": True,
        "first_beats_second": False,
        "linear_beats_polynomial": False,
        "all_above_100": False,
    }
