"""`python -m report.describe`: tables and modes of planted models."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch
from omegaconf import OmegaConf

from data.record import Drive
from data.sample import Sensors
from data.simulation.laws.candidate import Units
from export.__main__ import main as export
from export.modes import modes_of
from models import VWNN, ElementNetworkNamed, EquivalentLinear
from models.named_laws.candidates import CANDIDATES
from models.named_laws.fit import Fit
from report.about import about, models, prior_knowledge
from report.describe.__main__ import main
from report.paper.figures import SYSTEMS
from runner.config.choices import dotted, plain
from runner.config.compose import CONF, composed
from runner.config.identity import config_digest
from runner.loggers import swept
from tests.experiments import data_from, estimator_from
from tests.program.planted_runs import DT, K, carried, forced, plant, shaken


def exact_frequencies(dofs: int) -> np.ndarray:
    """Of a chain of unit masses on springs K [Hz]."""
    i = np.arange(1, dofs + 1)
    return np.sqrt(K) * np.sin((2 * i - 1) * np.pi / (2 * (2 * dofs + 1))) / np.pi


@pytest.mark.parametrize("dofs", [1, 30])
@pytest.mark.parametrize("made", [forced, shaken, carried])
def test_modes_of_a_chain_are_the_exact_ones(dofs, made):
    modes = modes_of(made(dofs)[0])
    np.testing.assert_allclose(modes.frequencies, exact_frequencies(dofs), rtol=1e-9)
    omega = 2.0 * np.pi * exact_frequencies(dofs)
    np.testing.assert_allclose(modes.damping, 0.5 * (1.5 / K) * omega, rtol=1e-9)
    first = np.sin(np.arange(1, dofs + 1) * np.pi / (2 * dofs + 1))
    np.testing.assert_allclose(modes.shapes[:, 0].real, first / first.max(), atol=1e-9)
    assert not modes.unstable.any()


def test_modes_of_a_linear_model_are_its_poles():
    model = EquivalentLinear(1, 1, DT)
    model.weights.data = torch.tensor([[0.4], [-100.0], [1.0]]).double()
    modes = modes_of(model)
    assert modes.frequencies == pytest.approx([10.0 / (2.0 * np.pi)])
    assert modes.damping == pytest.approx([-0.02])
    assert modes.unstable.all()
    model.weights.data = torch.tensor([[-40.0], [-100.0], [1.0]]).double()
    assert not len(modes_of(model).frequencies)  # it creeps back


def test_a_run_is_described_within_eighty_columns(tmp_path, capsys):
    folder = plant(tmp_path / "run", *forced(3))
    main([f"run={folder}"])
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines()[:-2])) <= 80
    assert "masses [kg]: x1 1, x2 1, x3 1" in printed
    assert "r2 x1–x2" in printed
    assert (folder / "description" / "modes.png").is_file()


def test_the_json_of_a_run_has_its_parameters_and_modes(tmp_path):
    folder = plant(tmp_path / "run", *forced(3))
    export([f"run={folder}", "to=json", f"output={tmp_path / 'out'}"])
    (path,) = (tmp_path / "out").glob("*.json")
    content = json.loads(path.read_text())
    values = {p["name"]: (p["value"], p["unit"]) for p in content["parameters"]}
    assert values["r3.stiffness"] == (pytest.approx(K), "N/m")
    assert values["r3.yield_force"] == (pytest.approx(4.0), "N")
    assert values["x2.mass"] == (pytest.approx(1.0), "kg")
    assert [m["frequency_hz"] for m in content["modes"]] == pytest.approx(exact_frequencies(3))
    assert content["common_factor_is_open"] is False


def test_a_black_box_is_called_one(tmp_path, capsys):
    sensors = Sensors(DT, 3, 3, [1, 2, 3])
    model = estimator_from(composed("model=vwnn").model, sensors)
    assert isinstance(model, VWNN)
    model.weights.data.fill_(0.0)
    folder = plant(tmp_path / "run", model, sensors, "model=vwnn")
    main([f"run={folder}"])
    printed = capsys.readouterr().out
    assert "a black box" in printed
    assert "has no physical parameters" in printed


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "give run=FOLDER"),
        (["rn=a"], "did you mean run?"),
        (["run=nowhere"], "is not a finished run"),
    ],
)
def test_mistakes_end_in_one_line(words, told, capsys):
    with pytest.raises(SystemExit):
        main(words)
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line


def test_elements_of_a_named_network_balance_its_motion():
    """M ẍ + Bᵀ r = f with the forces that are told beside the motion, in the same run."""
    model = ElementNetworkNamed(2, 2, DT, elements="chain", forced=[1, 2])
    model.mass.start(torch.tensor([1.0, 2.0]).double())
    model.identified.fill_(1.0)
    for e, name in enumerate(("SelfCentering", "SlackBrace")):
        q = np.zeros(len(CANDIDATES[name].parameters))
        model.named.take(e, Fit(CANDIDATES[name], Units(0.02, 0.1, 4.0, 400.0), q))
    t = DT * torch.arange(400, dtype=torch.float64)[:, None]
    f = 3.0 * torch.sin(5.0 * t) * torch.tensor([1.0, 0.7], dtype=torch.float64)
    rest = torch.zeros(2, dtype=torch.float64)
    with torch.no_grad():
        trace = model.trace(Drive(DT, f, rest, rest))
        y, r = model.element_loops(Drive(DT, f, rest, rest))
    inertia = f - trace.response.a * model.mass().detach()
    torch.testing.assert_close(r @ model.B, inertia, rtol=1e-6, atol=1e-6)
    torch.testing.assert_close(y, trace.response.x @ model.B.T, rtol=1e-9, atol=1e-12)
    assert float(r.abs().max()) > 1.0


# What conf/model says about its models: well-formed, seen by tables and pictures alone


KEYS = {"told", "contains", "may_contain", "colour", "own_residual_colour"}


def test_every_model_of_the_leaderboard_says_what_it_is_told():
    experiment = OmegaConf.load(CONF / "experiment" / "free_run" / "free_run.yaml")
    grids = experiment.hydra.sweeper.grids.values()
    assert all(prior_knowledge(name) for grid in grids for name in grid["model"].split(","))
    assert prior_knowledge("unheard_of") == ""


@pytest.mark.parametrize("model", models())
def test_the_words_of_a_model_are_those_that_are_read(model):
    assert set(about(model)) <= KEYS
    assert {*about(model).get("contains", ()), *about(model).get("may_contain", ())} <= {*SYSTEMS}


def test_what_a_model_says_of_itself_changes_neither_model_nor_run():
    cfg = composed("model=online_vwnn")
    other = composed("model=online_vwnn", "+model.about.told=nothing", "model.estimator.about=null")
    assert config_digest(plain(cfg)) == config_digest(plain(other))
    for content in (plain(cfg), plain(other)):
        assert not [name for name in (*dotted(content), *swept(content)) if "about" in name]
    assert estimator_from(other.model, data_from(other)).estimator is not None
