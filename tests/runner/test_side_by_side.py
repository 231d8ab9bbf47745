"""Runs side by side: the numbers and files of runs alone; what is amiss is done alone."""

from __future__ import annotations

import csv
import json
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from omegaconf import OmegaConf
from safetensors.torch import load_file
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

import train
from models.fit.identification import Identification
from models.fit.perceptrons import JointEvaluation, Perceptrons
from models.fit.problem import Problem
from models.layers.perceptron import ACTIVATIONS
from models.mlp import GlobalMLP
from models.uncertainty.parameters import free_vector, set_free_vector
from runner import loggers
from runner.config.compose import composed
from runner.config.identity import run_name
from runner.launch import batched, launcher
from runner.launch.batched import (
    Kind,
    begin_fit,
    number_together,
    score,
    train_side_by_side,
    train_together,
)
from runner.scores.verdict import estimates_of
from runner.seeds import SeedsOf
from tests.experiments import data_from, experiment_of
from tests.program.test_train import run

OF_THE_MACHINE = ("run/fit_seconds", "run/simulation_error")
QUICK = ["data.duration=4", "trainer.enable_progress_bar=false", "figures=false"]


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


@pytest.fixture(autouse=True)
def _in_this_process(monkeypatch):
    """Batches are done here: test_launchers.py has them in processes, one of which is lost."""

    def done_here(worker, jobs, processes):
        return {name: why for batch in jobs for name, why in worker.do(batch).items()}

    as_it_is = SimpleNamespace(dumps=lambda task: task, loads=lambda task: task)
    monkeypatch.setattr(batched, "run_side_by_side", done_here)
    monkeypatch.setattr(launcher, "cloudpickle", as_it_is)
    monkeypatch.setattr(launcher, "pickle", as_it_is)
    monkeypatch.setattr(launcher.Singleton, "set_state", lambda state: None)  # Hydra's, it is there


@pytest.mark.parametrize(
    "words",
    [
        ["model=linear,vwnn", "scenario=noisy", "data.warmup=20", "data.train_records=2"],
        ["model=residual_mlp,power_series_restoring_force", "solver=levenberg_marquardt"],
    ],
)
def test_a_batch_has_the_numbers_and_files_of_runs_alone(words, tmp_path, monkeypatch):
    if "solver" in words[-1]:
        words = [*words, "solver.iterations=20", "baselines=none", "data.calibration_records=0"]
        words = [*words, "logger=csv"]
    seeds = [*QUICK, *words, "seed=0,1"]
    for kind in ("basic", "batched"):
        place = [f"hydra/launcher={kind}", f"hydra.sweep.dir={tmp_path / kind}"]
        assert run(train, monkeypatch, "-m", *seeds, *place) == 0
    alone, together = (metrics_by_run(tmp_path / name) for name in ("basic", "batched"))
    assert len(alone) >= 2
    assert alone.keys() == together.keys()
    for name, ours in together.items():
        assert ours.keys() == alone[name].keys()
        for key, value in ours.items():
            assert value == alone[name][key], key
        one, other = (tmp_path / place / name for place in ("basic", "batched"))
        assert (one / "config.yaml").read_text() == (other / "config.yaml").read_text()
        assert (one / "sensors.json").read_text() == (other / "sensors.json").read_text()
        weights = [load_file(place / "model.safetensors") for place in (one, other)]
        for key, value in weights[0].items():
            assert torch.equal(value, weights[1][key]), key
        told = logged_in_csv if "logger=csv" in words else logged
        assert told(one) == told(other)
    own, shared = (errors_by_seed(tmp_path / kind) for kind in ("basic", "batched"))
    assert set(shared.values()) == {own[0]}


def logged(folder: Path) -> dict[str, list[tuple[int, float]]]:
    """What TensorBoard shows of a run, without its seconds: step and value of each number."""
    events = EventAccumulator(str(folder)).Reload()
    found = {tag: [(e.step, e.value) for e in events.Scalars(tag)] for tag in events.scalars.Keys()}
    assert "test/relative_rms_percent_over_time" in found
    return {tag: values for tag, values in found.items() if tag not in OF_THE_MACHINE}


def logged_in_csv(folder: Path) -> list[dict[str, str]]:
    """The same in a file, with the loss of each iteration."""
    with (folder / "csv" / "metrics.csv").open() as file:
        rows = [
            {key: value for key, value in row.items() if value and key not in OF_THE_MACHINE}
            for row in csv.DictReader(file)
        ]
    assert any("fit/loss" in row for row in rows) == ("mlp" in folder.name)
    return sorted(rows, key=repr)


def errors_by_seed(folder: Path) -> dict[int, float]:
    """The simulation's own error that each run of a sweep tells."""
    every = [json.loads(path.read_text()) for path in folder.glob("*/metrics.json")]
    return {metrics["seed"]: metrics["simulation_error"] for metrics in every}


def test_what_fails_fails_alone_and_says_why(tmp_path, monkeypatch, capsys):
    """A seed that is none, and a polynomial motion that escapes."""
    words = ["-m", "model=linear", "baselines=none", "trainer.enable_progress_bar=false"]
    words += ["system=polynomial", "system.excitation.std=15", "data.duration=30", "figures=false"]
    words += ["seed=-1,0,3"]
    for kind in ("basic", "batched"):
        place = f"hydra.sweep.dir={tmp_path / kind}"
        assert run(train, monkeypatch, *words, f"hydra/launcher={kind}", place) == 1
    reasons = [
        {
            path.parent.name: json.loads(path.read_text())["reason"]
            for path in (tmp_path / kind).glob("*/failed.json")
        }
        for kind in ("basic", "batched")
    ]
    assert len(reasons[0]) == 2
    assert any("escaped" in reason for reason in reasons[0].values())
    assert reasons[0] == reasons[1]
    assert metrics_by_run(tmp_path / "basic").keys() == metrics_by_run(tmp_path / "batched").keys()


def test_estimates_of_the_test_are_those_that_are_graded():
    """What scoring has made is not computed again, and is the same."""
    cfg = composed("model=linear", "scenario=noisy", *SHORT)
    data = data_from(cfg)
    data.setup()
    module = experiment_of(cfg).make_identification(data)
    begin_fit(module, data)
    score(module, data)
    made = module.estimates_made()
    assert {split for split, _ in made} == {"train", "test"}
    for (split, way), known in made.items():
        records = list(data.loader(split))
        (again,) = estimates_of(module.estimator, records, way)
        (reused,) = estimates_of(module.estimator, records, way, known)
        assert torch.equal(again, known)
        assert torch.equal(reused, known)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_value_that_is_wrong_costs_its_own_run_alone(tmp_path, monkeypatch, capsys):
    words = ["-m", *QUICK, "model=two_point", "baselines=none", "trainer.accelerator=gpu,cpu"]
    place = ["seed=0", "hydra/launcher=batched", f"hydra.sweep.dir={tmp_path}"]
    assert run(train, monkeypatch, *words, *place) == 1
    assert len(metrics_by_run(tmp_path)) == 1
    assert "PyTorch finds no GPU" in capsys.readouterr().out


def test_folders_are_named_after_all_that_follows_from_the_seed(tmp_path, monkeypatch):
    words = ["-m", *QUICK, "model=two_point", "baselines=none", "seed=7,8"]
    place = ["hydra/launcher=batched", f"hydra.sweep.dir={tmp_path}"]
    assert run(train, monkeypatch, *words, "data.duration=${seed}", *place) == 0
    folders = [path.parent for path in tmp_path.glob("*/metrics.json")]
    configs = [OmegaConf.load(folder / "config.yaml") for folder in folders]
    assert sorted(cfg.data.duration for cfg in configs) == [7, 8]
    assert [folder.name for folder in folders] == [run_name(cfg) for cfg in configs]


def test_what_cannot_be_batched_is_told_apart():
    def can(*words: str) -> bool:
        return Kind(SeedsOf(composed(*words)), Path()).can_be_batched

    for model in ("vwnn", "linear", "global_mlp", "residual_mlp", "chebyshev_restoring_force"):
        assert can(f"model={model}", "scenario=noisy"), model
    for words in (
        ["model=gru"],
        ["model=element_network"],
        ["model=global_mlp", "objective=free_run"],
        ["model=vwnn", "data.validation=0.2"],
        ["model=vwnn", "data.window=50", "data.batch=4"],
        ["model=linear", "budget=10s"],
    ):
        assert not can(*words), words


SHORT = ["system=bilinear", "data.duration=4", "data.calibration_records=0"]


@pytest.mark.parametrize("solver", ["lbfgs", "levenberg_marquardt"])
@pytest.mark.parametrize("model", ["global_mlp", "residual_mlp"])
def test_networks_trained_together_end_as_each_alone(model, solver):
    """Every network has its own steps and its own stop; one that cannot go on leaves the others."""

    def modules() -> list[Identification]:
        made = []
        for seed, count in ((0, 25), (1, 9), (2, 25)):
            words = [f"model={model}", f"solver={solver}", f"solver.iterations={count}"]
            cfg = composed(*SHORT, *words, f"seed={seed}")
            data = data_from(cfg)
            data.setup()
            module = experiment_of(cfg).make_identification(data)
            begin_fit(module, data)
            if seed == 2:
                next(iter(module.free_parameters().values())).data.fill_(torch.nan)
            made.append((module, next(iter(data.train_dataloader()))))
        return made

    alone, together = modules(), modules()
    for one in alone:
        train_side_by_side([one])
    train_side_by_side(together)
    for (one, _), (other, _) in zip(alone[:2], together, strict=False):
        assert other.losses == pytest.approx(one.losses, rel=1e-7)
        assert len(one.losses) > 5
        assert other.solver.why == one.solver.why
        assert torch.allclose(free_vector(one), free_vector(other), rtol=1e-4, atol=1e-6)
    assert together[2][0].losses == alone[2][0].losses == []
    assert "not finite" in together[2][0].solver.why


def test_a_run_is_finished_once_it_is_logged(tmp_path, monkeypatch, capsys):
    """A server that is gone costs the log alone; no run leaves a thread."""
    kind = Kind(SeedsOf(composed("model=two_point", "baselines=none", *SHORT)), tmp_path)
    room = batched.Batches(None, {})

    def fails(*_):
        raise RuntimeError("the server is gone")

    monkeypatch.setattr(loggers.TensorBoard, "log_choices", fails)
    room.run_together([(kind, 3)], "cpu")
    assert not (kind.folder(3) / "metrics.json").exists()
    monkeypatch.setattr(loggers, "MLflow", loggers.TensorBoard)  # whose server may be gone
    room.run_together([(kind, 3)], "cpu")
    assert "logging failed (the server is gone)" in capsys.readouterr().err
    assert (kind.folder(3) / "metrics.json").is_file()
    monkeypatch.undo()
    threads = threading.active_count()
    room.run_together([(kind, 4)], "cpu")
    assert (kind.folder(4) / "metrics.json").is_file()
    assert threading.active_count() == threads


def test_training_that_is_broken_off_leaves_no_result(tmp_path, monkeypatch):
    """As by the memory of a GPU: the run is done again, alone, and has its own numbers."""
    words = ["model=global_mlp", "solver.iterations=3", "baselines=none", *SHORT]
    kind = Kind(SeedsOf(composed(*words)), tmp_path)
    monkeypatch.setattr(batched, "train_together", lambda *_: 1 / 0)
    room = batched.Batches(None, {})
    room.run_together([(kind, 3)], "cpu")
    assert not kind.folder(3).exists()
    monkeypatch.undo()
    room.run_together([(kind, 3)], "cpu")
    assert (kind.folder(3) / "metrics.json").is_file()


def test_an_answer_that_fails_fails_for_all_who_wait():
    network = GlobalMLP(1, 1, 0.01, (3,)).network
    one = Perceptrons(network, torch.rand(9, 3).double(), torch.rand(9, 1).double(), 1.0)
    joint, theta = JointEvaluation(Perceptrons.joined([one, one])), free_vector(network)[None]
    with ThreadPoolExecutor(2) as pool:
        asked = [pool.submit(joint.ask, place, theta, "nonsense") for place in range(2)]
        for one_of_them in asked:
            with pytest.raises(AttributeError, match="nonsense"):
                one_of_them.result(timeout=20.0)


def test_motions_are_shared_where_all_that_they_follow_from_is_the_same():
    def motions(*words: str) -> str:
        return Kind(SeedsOf(composed("baselines=none", *words)), Path()).motions

    assert motions("model=vwnn") == motions("model=linear", "solver=lbfgs")
    for words in (["system=polynomial"], ["scenario=noisy"], ["data.duration=9"],
                  ["+model@baselines.x=fir"], ["damage=sudden"]):  # fmt: skip
        assert motions(*words) != motions(), words


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("hidden", [(5,), (4, 3, 6)])
def test_closed_forms_are_those_of_automatic_differentiation(activation, hidden, monkeypatch):
    monkeypatch.setattr("models.fit.perceptrons.BLOCK_ELEMENTS", 200)  # several blocks
    random = torch.Generator().manual_seed(0)
    draw = lambda *shape: torch.randn(*shape, generator=random, dtype=torch.float64)
    model = GlobalMLP(2, 1, 0.01, hidden, activation)
    network, u, y, weight = model.network, draw(61, 5), draw(61, 2), 0.7
    network.input_scale.fit([u])
    network.output_scale.fit([y])
    closed = Perceptrons(network, u, y, weight)
    theta = free_vector(network) + 0.1 * draw(free_vector(network).numel())

    def errors(theta: torch.Tensor) -> torch.Tensor:
        parts = theta.split([p.numel() for p in network.parameters()])
        named = {
            name: part.view(p.shape)
            for (name, p), part in zip(network.named_parameters(), parts, strict=True)
        }
        return weight * (torch.func.functional_call(network, named, (u,)) - y)

    J = torch.func.jacrev(errors)(theta)
    every = J[::7].flatten(0, 1)
    slope = torch.func.grad(lambda theta: errors(theta).square().mean())(theta)
    loss, slopes = closed.slopes(theta[None])
    assert loss.item() == pytest.approx(errors(theta).square().mean().item(), rel=1e-13)
    assert closed.losses(theta[None]).item() == pytest.approx(loss.item(), rel=1e-15)
    assert torch.allclose(slopes[0], slope, rtol=1e-10, atol=1e-13)
    squares = closed.squares(theta[None], 7)[0]
    assert torch.allclose(squares, 61 / 9 * every.T @ every, rtol=1e-10, atol=1e-12)


def test_a_problem_takes_the_closed_form_where_all_weights_are_free():
    cfg = composed("model=global_mlp", *SHORT)
    data = data_from(cfg)
    data.setup()
    module = experiment_of(cfg).make_identification(data)
    begin_fit(module, data)
    record = next(iter(data.train_dataloader()))
    closed = Problem(module.trainable, record)
    set_free_vector(closed.module, 0.3 * free_vector(closed.module))
    matrix, vector = closed.normal_equations(3)
    loss = float(closed.slopes()[0])
    next(closed.module.parameters()).requires_grad_(False)
    fewer = Problem(module.trainable, record)
    assert fewer.closed is None
    count = vector.numel() - next(closed.module.parameters()).numel()
    assert torch.allclose(fewer.normal_equations(3)[0], matrix[-count:, -count:], rtol=1e-9)
    assert torch.allclose(fewer.normal_equations(3)[1], vector[-count:], rtol=1e-9)
    assert float(fewer.loss().detach()) == pytest.approx(loss, rel=1e-13)


def test_as_many_networks_are_trained_together_as_memory_holds(monkeypatch):
    import runner.launch.batched as room

    cfg = composed("model=global_mlp", "solver=levenberg_marquardt", *SHORT)
    fits, seen = [], []
    for seed in range(5):
        data = data_from(cfg).of_seed(seed)
        data.setup()
        module = experiment_of(cfg).make_identification(data)
        begin_fit(module, data)
        fits.append((module, data))
    record = next(iter(fits[0][1].train_dataloader()))
    one = number_together(fits[0][0], record, 0.0)
    enough = next(n for n in range(1, 99) if number_together(fits[0][0], record, n * 2.0**20) >= 2)
    assert one == 1
    monkeypatch.setattr(torch.cuda, "mem_get_info", lambda: (enough * 2.0**20, 0.0))
    monkeypatch.setattr(torch.Tensor, "to", lambda self, *_, **__: self)
    monkeypatch.setattr(room, "train_side_by_side", lambda part: seen.append(len(part)))
    train_together(fits, "cuda")
    assert seen == [2, 2, 1]
