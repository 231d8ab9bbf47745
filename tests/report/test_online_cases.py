"""Running errors, settling times and learning curves: planted errors, and a run from end to end."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

import evaluate
import train
from data.record import Record
from models.linear import EquivalentLinear
from models.online.adaptive import Online
from models.online.scores import LEVELS, learning_curve, running_error, settling_time
from report.online.cases import read_online
from report.online.page import write_online_page
from report.online.tables import learning_table, settling_tables, stability_table
from report.run.online_figures import feature_sizes, online_figures
from tests.program.test_train import QUICK, pytestmark, run

__all__ = ["pytestmark"]
DT = 0.01


@pytest.fixture(scope="module")
def wave() -> Record:
    """Ten seconds of a sine that pauses from 4 s to 8 s."""
    t = DT * torch.arange(1000, dtype=torch.float64)[:, None]
    a = torch.sin(2.0 * math.pi * 5.0 * t)
    a[400:800] = 0.0
    return Record(DT, a, torch.zeros(1000, 1, dtype=torch.float64))


def test_the_running_error_is_that_of_the_last_two_seconds(wave):
    error = running_error(1.1 * wave.a, wave)
    assert torch.allclose(error[1:400], torch.full((399,), 10.0, dtype=torch.float64), rtol=1e-6)
    late = torch.where(torch.arange(1000)[:, None] < 200, 3.0, 1.0) * wave.a
    error = running_error(late, wave)
    assert float(error[199]) == pytest.approx(200.0, rel=1e-6)
    assert float(error[299]) == pytest.approx(200.0 * math.sqrt(0.5), rel=1e-3)
    assert float(error[399]) == pytest.approx(0.0, abs=1e-5)


def test_a_pause_of_the_motion_is_not_an_error_of_the_model(wave):
    """The same small error all along: in the pause it is ten times as large, not infinite."""
    error = running_error(wave.a + 0.01, wave)
    size = float(wave.a.square().mean().sqrt())
    assert float(error[700]) == pytest.approx(100.0 * 0.01 / (0.1 * size), rel=1e-6)


def test_records_of_a_batch_count_together(wave):
    pair = wave.map(lambda u: torch.stack([u, u]))
    estimate = torch.stack([wave.a, 1.2 * wave.a])
    expected = 20.0 / math.sqrt(2.0)
    assert float(running_error(estimate, pair)[300]) == pytest.approx(expected, rel=1e-6)


def test_settled_means_for_good():
    error = torch.tensor([90.0, 40.0, 10.0, 30.0, 10.0, 5.0])
    assert settling_time(error, 50.0, 0.5) == 0.5
    assert settling_time(error, 20.0, 0.5) == 2.0
    assert settling_time(error, 100.0, 0.5) == 0.0
    assert settling_time(error, 5.0, 0.5) is None
    assert settling_time(torch.tensor([1.0, math.nan]), 5.0, 0.5) is None


def test_a_linear_structure_is_learnt_once_there_are_samples_enough(linear_record):
    model = Online(3, 3, DT, EquivalentLinear(3, 3, DT))
    curve = learning_curve(model, linear_record, linear_record)
    assert list(curve) == [1.0, 2.0, 5.0, 10.0]
    assert curve[10.0] < 0.1
    silent = replace(linear_record, warmup=150)
    assert learning_curve(model, silent, linear_record)[1.0] == pytest.approx(100.0)


def test_the_learning_curve_ends_at_the_frozen_error(bilinear_records):
    train_record, test_record = bilinear_records[:2]
    model = Online(3, 3, DT)
    model.identify([train_record])
    frozen = model.estimates(test_record)["frozen"] - test_record.a
    expected = 100.0 * float(frozen.norm() / test_record.a.norm())
    assert learning_curve(model, train_record, test_record)[10.0] == pytest.approx(expected)


def test_the_sizes_of_features_are_their_rms(bilinear_record):
    model = Online(3, 3, DT, EquivalentLinear(3, 3, DT))
    (sizes,) = feature_sizes(model, bilinear_record)
    assert torch.allclose(sizes[:3], bilinear_record.v.square().mean(dim=0).sqrt())


def test_other_models_have_no_such_figures(bilinear_record):
    assert online_figures(EquivalentLinear(3, 3, DT), bilinear_record) == {}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run of an on-line model and one of its batch fit, in one folder."""
    folder, same = tmp_path_factory.mktemp("online"), ["baselines=none", *QUICK, "data.duration=20"]
    with pytest.MonkeyPatch.context() as patch:
        words = ["model=online_linear", "adaptation.forgetting=0.999", *same]
        assert run(train, patch, *words, f"hydra.run.dir={folder / 'online'}") == 0
        words = ["model=linear", "figures=false", *same]
        assert run(train, patch, *words, f"hydra.run.dir={folder / 'batch'}") == 0
    return folder


def test_a_run_tells_when_it_settled_and_what_it_learnt(finished):
    metrics = json.loads((finished / "online" / "metrics.json").read_text())
    online = metrics["online"]
    assert set(online["ways"]) == {"adapting", "frozen", "from_nothing"}
    assert set(online["ways"]["frozen"]["settle_s"]) == {f"{level:g}" for level in LEVELS}
    assert set(online["learnt_percent"]) == {"1", "2", "5", "10", "20"}
    frozen = metrics["test"]["frozen"]["relative_rms_percent"]
    assert online["learnt_percent"]["20"] == pytest.approx(frozen, rel=1e-6)
    assert json.loads((finished / "batch" / "metrics.json").read_text())["online"] == {}
    tags = EventAccumulator(str(finished / "online")).Reload().Tags()
    assert {"running_error", "weights_over_time"} <= set(tags["images"])


def test_an_on_line_run_is_evaluated_to_the_last_digit(finished, monkeypatch, capsys):
    assert run(evaluate, monkeypatch, f"run={finished / 'online'}") == 0
    assert "equal to metrics.json to the last digit" in capsys.readouterr().out
    drawn = {path.name for path in (finished / "online" / "evaluation").rglob("*.png")}
    assert {"running_error.png", "weights_over_time.png"} <= drawn


def test_the_tables_tell_the_ratio_to_the_batch_fit(finished):
    runs = read_online(finished)
    errors = {
        name: json.loads((finished / name / "metrics.json").read_text())["test"]
        for name in ("online", "batch")
    }
    ratio = errors["online"]["frozen"]["relative_rms_percent"]
    ratio /= errors["batch"]["relative_rms_percent"]
    (line,) = learning_table(runs)[2:]
    assert "least squares, λ = 0.999" in line
    assert f"| {ratio:.2f} | 1 of 1 |" in line
    assert len(settling_tables(runs)) == 7
    lost = next(line for line in stability_table(runs) if "0.999" in line)
    assert lost.split(" | ")[2:5] == ["1", "0", "0"]


def test_the_page_is_its_template_with_these_tables(finished, tmp_path):
    page, runs = tmp_path / "online.md", read_online(finished)
    write_online_page(page, finished, finished, settling="linear")
    text = page.read_text("utf-8")
    assert "$" not in text
    for lines in (learning_table(runs), settling_tables(runs), stability_table(runs)):
        assert "\n".join(lines) in text


def test_no_runs_are_one_clear_line(tmp_path):
    with pytest.raises(ValueError, match="no finished runs in"):
        read_online(tmp_path)
