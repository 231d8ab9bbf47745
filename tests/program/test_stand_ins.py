"""Stand-ins of the public benchmarks: official layouts, and recovered to their noise."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.stand_ins.files import STAND_INS, aircraft
from benchmarks.stand_ins.systems import Structure, multisine, respond
from data.public.benchmarks import BENCHMARKS
from data.public.datamodule import BenchmarkData
from data.public.measures import official_rmse
from data.simulation.scenario import FullState
from models import ModalNetwork

LEVELS = "FullMSine_*"


@pytest.fixture(scope="module")
def joint(tmp_path_factory) -> tuple[BenchmarkData, np.ndarray]:
    """Four modes, two accelerations, a hysteretic joint, and the noise."""
    folder = tmp_path_factory.mktemp("f16")
    noise = aircraft(folder, modes=4, outputs=2, samples=2048)
    data = BenchmarkData("f16", FullState(), folder=str(folder), train=LEVELS, test=LEVELS)
    return data, noise


def test_stand_ins_are_of_benchmarks_and_in_their_layout(joint):
    assert set(STAND_INS) == set(BENCHMARKS) - {"bouc_wen"}  # whose official files are simulated
    data, noise = joint
    assert (data.dofs, data.inputs, data.dt) == (2, 1, 1.0 / 400.0)
    assert data.names["train"] == [f"FullMSine_Level{n}" for n in (1, 3, 5, 7)]
    (first, *_) = data.make_records()["train"]
    assert (first.samples, first.initial_state, first.warmup) == (3 * 2048, "unknown", 50)
    periods = first.a.reshape(3, 2048, 2)
    difference = (periods[2] - periods[1]).std(dim=0).numpy() / np.sqrt(2.0)
    np.testing.assert_allclose(difference, noise, rtol=0.3)  # and what is left of a transient


def test_a_linear_structure_of_the_stand_ins_answers_as_its_frequency_response_says():
    one, dt = np.ones(1), 1e-2
    system = Structure(2.0 * one, 0.1 * one, 3.0 * one, one[None], 0.0 * one)
    u, fine = multisine(1000, dt, (0.5, 4.0), np.random.default_rng(0))
    q, a = respond(system, np.r_[np.tile(fine[:-1], 6), fine[0]], dt)
    w, omega = 2.0 * np.pi * 2.0, 2.0 * np.pi * np.fft.rfftfreq(1000, dt)
    H = 3.0 / (w * w - omega**2 + 0.2j * w * omega)
    expected = np.fft.irfft(H * np.fft.rfft(u), 1000)
    np.testing.assert_allclose(q[-1000:, 0], expected, atol=1e-6 * np.abs(expected).max())
    expected = np.fft.irfft(-(omega**2) * H * np.fft.rfft(u), 1000)
    np.testing.assert_allclose(a[-1000:, 0], expected, atol=1e-6 * np.abs(expected).max())


def test_a_hysteretic_joint_behind_hidden_modes_is_recovered_to_the_noise(joint):
    data, noise = joint
    model = ModalNetwork(2, 1, data.dt, elements=1, laws=["hysteretic"], directions=6, draws=1)
    facts = model.identify(data.make_records()["train"])
    assert facts["elements"] == "hysteretic"
    for record in data.make_records()["test"]:
        with torch.no_grad():
            error = official_rmse(model(record), record)
        assert (error < 1.5 * noise).all()


def test_the_command_writes_files(tmp_path, monkeypatch, capsys):
    from benchmarks.stand_ins import __main__ as program

    monkeypatch.setitem(program.STAND_INS, "f16", lambda folder, seed: np.array([seed + 0.5]))
    monkeypatch.setattr("sys.argv", ["stand_ins", "f16", str(Path(tmp_path)), "--seed", "2"])
    program.main()
    assert "2.5" in capsys.readouterr().out
    assert json.loads((tmp_path / "noise.json").read_text()) == {"f16": [2.5]}
