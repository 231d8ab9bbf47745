"""evaluate.py uncertainty=…: tables, figures and refusals of a planted, measured run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from report.uncertainty.command import evaluate_uncertainty
from runner.config.choices import plain, take_settings
from runner.config.compose import composed
from runner.config.settings import Conditions, Question
from tests.program.planted_runs import DT, forced, plant, training

SAMPLES = 600


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """One mass, a noisy record of 6 s."""
    folder = tmp_path_factory.mktemp("uncertain")
    model, sensors = forced(1)
    rng = np.random.default_rng(0)
    f = np.convolve(rng.standard_normal(SAMPLES), np.hanning(30), mode="same")
    f = torch.from_numpy(6.0 * f / f.std())[:, None]
    drive = training(model, sensors).drive()
    with torch.no_grad():
        a = model.free_run(type(drive)(DT, f, drive.x0, drive.v0)).a.numpy()
    a = a + 0.05 * a.std() * rng.standard_normal(a.shape)
    t = DT * np.arange(SAMPLES)[:, None]
    record = folder / "record.csv"
    np.savetxt(record, np.hstack([t, f, a]), delimiter=",", header="t,f1,a1", comments="")
    words = ("model=element_network", "system=measured", "data=measured", f"data.path={record}",
             "data.initial_state=rest")  # fmt: skip
    return plant(folder / "run", model, sensors, *words)


def evaluated(run: Path, *words: str) -> dict:
    asked = plain(composed("label=x", *words, config="evaluate"))
    return evaluate_uncertainty(
        run, take_settings(Question, asked), take_settings(Conditions, asked)
    )


def test_laplace_has_both_kinds_and_says_which_to_believe(run, capsys):
    evaluated(run, "uncertainty=laplace")
    said = " ".join(capsys.readouterr().out.split())
    assert "± model error" in said
    assert ": use ± noise" in said or "use ± model error" in said


def test_nothing_is_written_into_a_published_model(run, tmp_path, monkeypatch):
    """An entry of the zoo that holds more than was published is refused from then on."""
    here = "runner.folder.run_folder.to_absolute_path"
    monkeypatch.setattr(here, lambda path: str(tmp_path / path))
    monkeypatch.setattr("runner.folder.run_folder.zoo.published", lambda folder: "model/system.v1")
    evaluated(run, "uncertainty=laplace")
    place = tmp_path / "runs/zoo/model/system.v1/evaluation/uncertainty_laplace"
    assert (place / "uncertainty.json").is_file()


def test_a_profile_has_a_table_and_a_figure(run, capsys):
    found = evaluated(run, "uncertainty=profile", "parameter=r1.damping,x1.mass")
    assert [p["status"] for p in found["parameters"]] == ["determined"] * 2
    folder = run / "evaluation" / "uncertainty_profile"
    assert (folder / "profile.png").exists()
    assert json.loads((folder / "uncertainty.json").read_text()) == found
    assert "determined" in capsys.readouterr().out


def test_samples_have_evidence_and_a_figure_and_follow_the_seed(run, capsys):
    words = ("uncertainty=smc", "parameter=x1.mass,r1.damping", "particles=150", "threads=1")
    found, again = evaluated(run, *words), evaluated(run, *words)
    assert found["parameters"] == again["parameters"]
    by_name = {p["name"]: p for p in found["parameters"]}
    mass = by_name["x1.mass"]
    assert abs(mass["mean"] - mass["laplace"]) < 0.25 * mass["laplace_deviation"]
    assert "log evidence" in capsys.readouterr().out
    assert (run / "evaluation" / "uncertainty_smc" / "corner.png").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["uncertainty=profile", "parameter=r1.stifness"], "did you mean r1.stiffness"),
        (["uncertainty=smc", "priors.r1.stiffness=[.nan,0.1]"], "two finite numbers"),
        (["uncertainty=smc", "priors.r1.stiffness=[400,-1]"], "upwards"),
        (["uncertainty=smc", "data.duration=3"], "leave out scenario, seeds and data"),
        (["uncertainty=laplace", "parameter=x1.mass"], "profile and smc"),
    ],
)
def test_what_cannot_be_asked_is_refused_in_a_line(run, words, said):
    with pytest.raises(ValueError, match=said):
        evaluated(run, *words)
