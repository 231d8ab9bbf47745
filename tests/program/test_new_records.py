"""`evaluate.py run=… data.path=…` and the verdict, as a person meets them."""

from __future__ import annotations

import csv
import json
import shutil
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
import torch

import evaluate
import train
from data.record import Drive
from runner import job
from tests.data.odd_files import table
from tests.program.planted_runs import plant, shaken
from tests.program.test_train import finished_run, run

DT = 0.01
QUIET = ["trainer.enable_progress_bar=false", "figures=false"]
NETWORK = [  # a small one, and little training
    "model=element_network", "model/reads=accelerations",
    "model.units=1", "model.hinges=0", "model.cubic=false",
    "objective.starts=1", "objective.finalists=1", "objective.horizons=[null]",
    "solver.iterations=3",
]  # fmt: skip


def moved(seed: int, size: float = 1.0, samples: int = 900) -> dict[str, np.ndarray]:
    """A damped mass under a random force: m = 2 kg, 2 Hz, 5 % of critical."""
    rng = np.random.default_rng(seed)
    force = size * np.convolve(rng.standard_normal(samples), np.ones(8) / 8, "same")
    force *= np.hanning(samples)
    omega, x, v = 4.0 * np.pi, 0.0, 0.0
    a = np.empty(samples)
    for k in range(samples):
        a[k] = force[k] / 2.0 - 0.1 * omega * v - omega**2 * x
        v += DT * a[k]
        x += DT * v
    return {"time": DT * np.arange(samples), "f1": force, "a1": a}


def write(path: Path, columns: dict[str, np.ndarray]) -> Path:
    return table(path, columns, "%.17g")


@pytest.fixture(scope="module")
def records(tmp_path_factory) -> Path:
    """Three records of one mass, a.csv, b.csv and c.csv."""
    folder = tmp_path_factory.mktemp("records")
    for seed, name in enumerate("abc"):
        write(folder / f"{name}.csv", moved(seed))
    return folder


@pytest.fixture(scope="module")
def network(records, tmp_path_factory) -> Path:
    """A network that was trained on a and tested on b and c."""
    words = ["data=measured", f"data.path={records}", "data.test=[b,c]", *NETWORK, *QUIET]
    return finished_run(tmp_path_factory.mktemp("runs") / "network", *words)


def numbers(folder: Path) -> dict:
    return json.loads((folder / "metrics.json").read_text())


def scores(run_folder: Path, label: str) -> dict:
    return json.loads((run_folder / "evaluation" / label / "scores.json").read_text())


def test_a_run_says_what_it_was_judged_by_and_tells_its_records_apart(network):
    metrics = numbers(network)
    assert metrics["verdict"]["identified"] is True
    assert metrics["verdict"]["by"] == "free run"
    assert metrics["verdict"]["error_percent"] == metrics["free_run_train"]["relative_rms_percent"]
    assert metrics["baselines"].keys() == {
        *("zero", "two_point", "linear", "fir", "linear_state_space")
    }
    plain = metrics["verdict"]["opponents"]["test"]
    assert plain["fir"] == pytest.approx(
        metrics["baselines"]["fir"]["free_run"]["relative_rms_percent"]
    )
    each = [of["free_run"]["relative_rms_percent"] for of in metrics["per_record"].values()]
    assert list(metrics["per_record"]) == ["b", "c"]
    assert min(each) < metrics["free_run"]["relative_rms_percent"] < max(each)
    assert metrics["trained_range"]["deformation"]["names"] == ["ground–x1"]


def test_the_same_record_in_another_file_has_the_same_errors(
    network, records, tmp_path, monkeypatch, capsys
):
    other = shutil.copy(records / "c.csv", tmp_path / "other.csv")
    assert run(evaluate, monkeypatch, f"run={network}", f"data.path={other}") == 0
    found, own = scores(network, "other")["records"]["other"], numbers(network)["per_record"]["c"]
    for way in ("test", "free_run"):
        for key, value in own[way].items():
            assert found[way][key] == pytest.approx(value, rel=1e-12), (way, key)
    printed = capsys.readouterr().out
    assert f"{own['free_run']['relative_rms_percent']:.2f}" in printed
    assert "linear, free run" in printed
    with (network / "evaluation/other/scores.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["dof"] for row in rows] == ["all", "1"] * 2
    assert float(rows[2]["relative_rms_percent"]) == own["free_run"]["relative_rms_percent"]
    for name in ("free_run_acceleration", "element_loops", "error_over_time"):
        assert (network / f"evaluation/other/{name}.png").is_file()


@pytest.mark.parametrize(("size", "warned"), [(0.9, False), (2.0, True)])
def test_a_warning_at_twice_the_stroke_and_none_below_it(
    size, warned, network, tmp_path, monkeypatch, capsys
):
    path = write(tmp_path / f"scaled{size:g}.csv", moved(0, size))
    assert (
        run(
            evaluate,
            monkeypatch,
            f"run={network}",
            f"data.path={path}",
            "label=scaled",
            "figures=false",
        )
        == 0
    )
    printed = " ".join(capsys.readouterr().out.split())
    assert ("outside the trained range: 2 × the largest deformation" in printed) == warned
    (found,) = scores(network, "scaled")["outside_trained_range"].values()
    assert {one["kind"] for one in found} == (
        {"excitation", "acceleration", "deformation", "rate", "spectrum"} if warned else set()
    )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["data.path=none.csv"], "no such file"),
        (["data.path={b}", "data.duration=20"], "data.duration is of simulated motions"),
        (["data.path={b}", "seeds=[1]"], "leave one out"),
        (["data.path={b}", "data.channels={time: t, f1: Load}"], "no column"),
        (
            ["data.path={b}", "data.channels={time: time, s_ddot1: f1, a1: a1}"],
            "the run was driven by",
        ),
        (
            ["data.path={b}", "data.channels={time: time, f2: f1, a1: a1}"],
            "the run was driven by f1, the records by f2",
        ),
        (["data.path={b}", "data.channels={time: time, f1: f1, x1: a1}"], "estimates acceleration"),
    ],
)
def test_records_that_do_not_fit_are_one_line(words, said, network, records, monkeypatch, capsys):
    typed = [word.replace("{b}", str(records / "b.csv")) for word in words]
    assert run(evaluate, monkeypatch, f"run={network}", *typed) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_a_network_that_diverges_is_no_result_and_says_so(records, tmp_path, monkeypatch, capsys):
    fit = job.Trainer.fit

    def spoilt(self, module, **more: object) -> None:
        fit(self, module, **more)
        with torch.no_grad():
            laws = module.estimator.laws
            laws.stiffness.theta.fill_(12.0)  # far too stiff for the time step

    monkeypatch.setattr(job.Trainer, "fit", spoilt)
    words = ["data=measured", f"data.path={records}", "data.test=[b,c]", *NETWORK, *QUIET]
    folder = tmp_path / "run"
    assert run(train, monkeypatch, *words, f"hydra.run.dir={folder}") == 3
    told = capsys.readouterr()
    (line,) = told.err.splitlines()
    assert line.startswith("error: element_network is not identified: its free run ")
    assert "\nnot identified: its free run diverges on test motions: b " in told.out
    verdict = numbers(folder)["verdict"]
    assert verdict["identified"] is False
    assert (folder / "model.safetensors").is_file()  # to look at


def test_a_change_is_told_placed_and_saved_and_so_is_none(tmp_path, monkeypatch, capsys):
    """A planted chain on a shaken base, before and after its second storey lost a quarter."""
    model, sensors = shaken(2)
    lost = deepcopy(model)
    with torch.no_grad():
        lost.laws.stiffness.theta[1] += np.log(0.75)
        lost.laws.unit_stiffness.theta[1] *= 0.75
    rng, t = np.random.default_rng(0), DT * np.arange(1000)
    for name, own in (("before", model), ("same", model), ("after", lost)):
        w, phases = rng.uniform(5.0, 30.0, 6), rng.uniform(0.0, 6.0, 6)
        ground = np.minimum(t, 1.0) * np.sin(np.outer(t, w) + phases).sum(axis=1)
        still = torch.zeros(2, dtype=torch.float64)
        with torch.no_grad():
            a = own.free_run(Drive(DT, torch.from_numpy(-ground[:, None]), still, still)).a.numpy()
        a = a + ground[:, None] + 0.02 * rng.standard_normal(a.shape)
        columns = {"time": t, "s_ddot1": ground, "a1": a[:, 0], "a2": a[:, 1]}
        write(tmp_path / f"{name}.csv", columns)
    words = ["model=element_network", "data=measured", f"data.path={tmp_path}/before.csv"]
    folder = plant(tmp_path / "run", model, sensors, *words, "data.split=0.9")
    for name, places in (("after", ["r2 x1–x2, storey 2"]), ("same", [])):
        path = f"data.path={tmp_path}/{name}.csv"
        assert run(evaluate, monkeypatch, f"run={folder}", path, "change=true") == 0
        printed = capsys.readouterr().out
        saved = json.loads((folder / f"evaluation/change_{name}/change.json").read_text())
        assert saved["places"] == places
        assert "r1.stiffness" in [one["name"] for one in saved["quantities"]]
        told = f"changed: {places[0]}: " if places else "no change beyond what these records tell"
        assert told in " ".join(printed.split())
        assert "frequencies of small motions [Hz]" in printed
        assert f"largest drifts under {name}" in printed
    words = f"run={folder}", "change=true"
    assert run(evaluate, monkeypatch, *words) == 1
    assert "data.path=after.csv" in capsys.readouterr().err
    assert run(evaluate, monkeypatch, *words, "uncertainty=laplace") == 1
    assert "leave one out" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "word"),
    [
        (["system=measured", "data=measured", "data.path=r.csv"], "data.stop=20"),
        (["system=bilinear", "excitation=given", "excitation.force.path=f.csv"], "data.duration=9"),
    ],
)
def test_what_was_trained_on_is_not_cut_into_test_motion(
    words, word, tmp_path, monkeypatch, capsys
):
    folder = plant(
        tmp_path, *shaken(3), "model=element_network", *words, test={"per_dof_percent": [1.0] * 3}
    )
    assert run(evaluate, monkeypatch, f"run={folder}", word) == 1
    assert f"error: {word.partition('=')[0]} cuts the histories" in capsys.readouterr().err
