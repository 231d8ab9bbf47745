"""Runs side by side: the numbers and files of runs alone; what is amiss is done alone."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

import train
from data import parallel
from data.record import Record
from models.layers.least_squares import LeastSquares, RankDeficientError
from runner.config.compose import composed
from runner.launch import batched as batch
from runner.launch.batched import can_be_batched, replicate_weights
from runner.seeds import SeedsOf
from tests.program.test_train import run

QUICK = ["data.duration=8", "trainer.enable_progress_bar=false", "figures=false"]


def numbers(value, name: str = ""):
    """Leaves of nested results, by name; without times, the digest of every bit, and one error.

    The simulation's own error is that of the first run.
    """
    if isinstance(value, dict):
        for key, inner in value.items():
            if key not in ("fit_seconds", "checkpoint", "simulation_error"):
                yield from numbers(inner, f"{name}/{key}")
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            yield from numbers(inner, f"{name}/{i}")
    else:
        yield name, value


def metrics_by_run(folder: Path) -> dict[str, dict]:
    return {
        path.parent.name: dict(numbers(json.loads(path.read_text())))
        for path in folder.glob("*/metrics.json")
    }


@pytest.mark.parametrize(
    "words",
    [
        ["model=vwnn", "scenario=noisy", "scenario.signals=[a,f]", "baselines=none"],
        ["model=linear", "scenario=noisy_integrated", "data.warmup=20", "data.train_records=2"],
    ],
)
def test_side_by_side_is_as_alone(words, tmp_path, monkeypatch):
    seeds = [*QUICK, *words, "seed=0,1,2"]
    monkeypatch.setattr(batch, "AT_ONCE", 2)
    for launcher in ("basic", "batched"):
        place = f"hydra.sweep.dir={tmp_path / launcher}"
        assert run(train, monkeypatch, "-m", *seeds, f"hydra/launcher={launcher}", place) == 0
    alone, together = (metrics_by_run(tmp_path / name) for name in ("basic", "batched"))
    assert len(alone) == 3
    assert alone.keys() == together.keys()
    for name, ours in together.items():
        assert ours.keys() == alone[name].keys()
        for key, value in ours.items():
            # a displacement is twice the integral of what errs by rounding
            exact = 1e-6 if "displacement" in key else 1e-9
            expected = alone[name][key]
            near = isinstance(value, float) and isinstance(expected, float)
            assert value == (pytest.approx(expected, rel=exact) if near else expected), key
        one, other = (tmp_path / place / name for place in ("basic", "batched"))
        assert (one / "config.yaml").read_text() == (other / "config.yaml").read_text()
        weights = (load_file(place / "model.safetensors")["weights"] for place in (one, other))
        assert torch.allclose(*weights, rtol=1e-7, atol=1e-10)
    own, shared = (errors_by_seed(tmp_path / launcher) for launcher in ("basic", "batched"))
    assert shared == dict.fromkeys(range(3), pytest.approx(own[0], rel=1e-6))


def errors_by_seed(folder: Path) -> dict[int, float]:
    """The simulation's own error that each run of a sweep tells."""
    every = [json.loads(path.read_text()) for path in folder.glob("*/metrics.json")]
    return {metrics["seed"]: metrics["simulation_error"] for metrics in every}


def test_what_fails_fails_alone_and_says_why(tmp_path, monkeypatch, capsys):
    """A seed that is none, and a polynomial motion that escapes."""
    words = ["-m", "model=linear", "baselines=none", "trainer.enable_progress_bar=false"]
    words += ["system=polynomial", "system.excitation.std=15", "data.duration=30", "figures=false"]
    words += ["seed=-1,0,3"]
    for launcher in ("basic", "batched"):
        place = f"hydra.sweep.dir={tmp_path / launcher}"
        assert run(train, monkeypatch, *words, f"hydra/launcher={launcher}", place) == 1
    reasons = [
        {
            path.parent.name: json.loads(path.read_text())["reason"]
            for path in (tmp_path / launcher).glob("*/failed.json")
        }
        for launcher in ("basic", "batched")
    ]
    assert len(reasons[0]) == 2
    assert any("escaped" in reason for reason in reasons[0].values())
    assert reasons[0] == reasons[1]
    assert metrics_by_run(tmp_path / "basic").keys() == metrics_by_run(tmp_path / "batched").keys()


def test_what_cannot_go_side_by_side_is_told_apart():
    assert can_be_batched(SeedsOf(composed("model=vwnn")))
    assert can_be_batched(SeedsOf(composed("model=linear", "scenario=noisy")))
    for words in (
        ["model=global_mlp", "baselines=none"],
        ["model=residual_mlp", "baselines=none"],
        ["model=power_series_residual", "baselines=none"],
        ["model=vwnn", "data.validation=0.2"],
        ["model=vwnn", "data.window=50"],
        ["model=vwnn", "scenario.level=${seed}", "scenario=noisy"],
    ):
        assert not can_be_batched(SeedsOf(composed(*words))), words


def test_runs_side_by_side_have_one_thread_each(tmp_path, monkeypatch):
    seen, before = [], torch.get_num_threads()
    monkeypatch.setattr(parallel, "_limit", None)
    monkeypatch.setattr(batch, "_run_side_by_side", lambda *_: seen.append(torch.get_num_threads()))
    torch.set_num_threads(2)
    assert (
        batch.run_batch(SeedsOf(composed("model=vwnn")), [0, 1], [tmp_path / "0", tmp_path / "1"])
        == []
    )
    torch.set_num_threads(before)
    assert seen == [1]


def test_least_squares_side_by_side_are_those_alone():
    random = torch.Generator().manual_seed(0)
    phi, y = (torch.randn(5, 40, c, generator=random).double() for c in (6, 2))
    together = LeastSquares(stacked=True)
    for start in (0, 15):
        span = slice(start, start + 15 if start == 0 else None)
        together.add(phi[:, span], y[:, span])
    solution = together.solve()
    for place in range(5):
        alone = LeastSquares()
        alone.add(phi[place], y[place])
        assert torch.allclose(solution.weights[place], alone.solve().weights, rtol=1e-11)
        assert solution.facts()["rank"][place] == 6
        assert solution.facts()["condition"][place] == pytest.approx(alone.solve().condition)
    phi[3, :, 2] = phi[3, :, 4]
    deficient = LeastSquares(stacked=True)
    deficient.add(phi, y)
    with pytest.raises(RankDeficientError, match="5 of 6"):
        deficient.solve()


def test_the_weights_of_each_run_meet_its_own_records():
    """Estimates of S runs with S sets of weights, against each alone; one step and free run."""
    from models.linear import EquivalentLinear
    from models.vwnn import VWNN

    random = torch.Generator().manual_seed(2)
    a, f, x, v = (torch.randn(3, 2, 60, 2, generator=random).double() for _ in range(4))
    records = Record(0.01, a, f, x, v)
    for build in (EquivalentLinear, VWNN):
        together = build(2, 2, 0.01)
        replicate_weights(together, 3)
        together.identify([records])
        one_step, free = together(records), together.free_run(records.drive())
        for place in range(3):
            own = records.map(lambda signal, place=place: signal[place])
            alone = build(2, 2, 0.01)
            alone.identify([own])
            assert torch.allclose(one_step[place], alone(own), rtol=1e-9)
            assert torch.allclose(free.a[place], alone.free_run(own.drive()).a, rtol=1e-8)
