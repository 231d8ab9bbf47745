"""The page of public benchmarks: their own metric, per series, over seeds; what is absent."""

from __future__ import annotations

import json
import math

import pytest
from omegaconf import OmegaConf

from benchmarks.stand_ins.files import circuit
from data.public.datamodule import BenchmarkData
from data.public.measures import official_rmse
from data.simulation.scenario import FullState
from report.benchmarks.page import official_table, stand_ins_table, write_benchmarks_page
from report.benchmarks.rows import NOISE, Row, errors_of, rows_of, without_rows
from report.benchmarks.stored import store
from report.collection.runs import collect
from runner.folder.run import restore
from runner.job import identify
from tests.program.test_every_config import composed

pytestmark = [
    pytest.mark.filterwarnings("ignore:.*LeafSpec.*"),
    pytest.mark.filterwarnings("ignore:.*does not have many workers.*"),
    pytest.mark.filterwarnings("ignore:.*litlogger.*"),
]


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A cubic spring and a linear model on a stand-in, from a part of its multisine."""
    folder = tmp_path_factory.mktemp("benchmarks")
    noise = circuit(folder / "files")
    (folder / "files" / NOISE).write_text(json.dumps({"silverbox": noise.tolist()}))
    for name, more in (
        (
            "modal_network",
            ["model.modes=1", "model.elements=1", "model.laws=[cubic]", "model.draws=1"],
        ),
        ("linear_modes", ["model.modes=1", "model.iterations=5"]),
    ):
        cfg = composed(
            "data=benchmark", "data.name=silverbox", f"data.folder={folder / 'files'}",
            "data.samples=2000",
            f"model={name}", "baselines=none", "figures=false",
            "trainer.enable_progress_bar=false", *more,
        )  # fmt: skip
        identify(cfg, folder / "runs" / name)
    return folder, collect([folder / "runs"])


def test_the_error_of_a_row_is_the_benchmarks_own(runs):
    folder, results = runs
    data = BenchmarkData("silverbox", FullState(), folder=str(folder / "files"))
    (record,) = data.make_records()["test"]
    for run in results:
        cfg = OmegaConf.load(run.folder / "config.yaml")
        model = restore(cfg, run.folder)
        by_hand = float(official_rmse(model(record), record)[0])
        error = (model(record) - record.a)[50:, 0]  # the official window has 50 samples
        assert by_hand == pytest.approx(float(error.square().mean().sqrt()), rel=1e-12)
        assert errors_of(run)["multisine"][0] == pytest.approx(by_hand, rel=1e-9)


def test_rows_are_sorted_and_set_beside_the_noise_and_the_published(runs):
    _, results = runs
    best, other = rows_of(results)
    assert (best.model, other.model) == ("modal_network", "linear_modes")
    assert best.noise == pytest.approx(2e-4)
    assert f"{best.median / 2e-4:.2f}" in stand_ins_table(rows_of(results))
    table = official_table(rows_of(results), results)
    assert "0.0003 V" in table
    assert table.index("0.0003 V") < table.index("modal_network") < table.index("linear_modes")
    assert "| f16 |" in table
    assert "not run" in table


def test_a_diverged_run_is_infinite_and_a_missing_benchmark_says_why(runs):
    _, results = runs
    lost = next(run for run in results if run.model == "linear_modes")
    lost.metrics["free_run"] |= {"per_dof_rms": [None], "relative_rms_percent": None}
    assert math.isinf(errors_of(lost)["multisine"][0])
    absent = without_rows(rows_of(results), results)
    assert "silverbox" not in absent
    assert absent["f16"] == "not run"


def test_the_page_is_written(runs, tmp_path):
    folder, _ = runs
    write_benchmarks_page(tmp_path / "page.md", tmp_path / "none", folder / "runs")
    assert "modal_network" in (tmp_path / "page.md").read_text()
    with pytest.raises(ValueError, match="no runs in"):
        write_benchmarks_page(tmp_path / "other.md", tmp_path / "none", tmp_path / "neither")


def test_what_was_not_run_again_stays_on_the_page(runs, tmp_path):
    folder, _ = runs
    page = tmp_path / "page.md"
    kept = Row("f16", "FullMSine_Level2", "gru", [1e-4], [0.1], [60.0], [51.0], 1e-4)
    old = Row("silverbox", "multisine", "modal_network", [0.777], [9.0], [1.0], [1.0], 2e-4)
    store(page, {"official": [], "stand_ins": [kept, old]})
    write_benchmarks_page(page, tmp_path / "none", folder / "runs")
    text = page.read_text()
    assert "`gru`" in text
    assert "earlier runs and code: `gru` on f16 (stand-ins)" in text
    assert "0.777" not in text
    write_benchmarks_page(page, tmp_path / "none", tmp_path / "neither")
    again = page.read_text()
    assert again.count("`modal_network` |") == text.count("`modal_network` |") == 1
    page.with_suffix(".json").write_text('{"official": [{"x": 1}]}')
    with pytest.raises(ValueError, match=r"page\.json holds no rows of benchmarks"):
        write_benchmarks_page(page, tmp_path / "none", tmp_path / "neither")
