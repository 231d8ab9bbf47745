"""Every model with trainer=gpu: trained, scored and in free run as on the processor."""

from __future__ import annotations

import math
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from data.parallel import threads
from models.composition.many_runs import WARP
from models.uncertainty.laplace import laplace
from models.uncertainty.parameters import free_vector
from models.uncertainty.posterior import Likelihood
from report.run.summary import draw_run
from runner.config.compose import CONF, EARLIER, composed
from runner.folder.run import load_run
from runner.job import identify
from runner.launch.batched import begin_fit, score, train_together
from tests.experiments import data_from, experiment_of
from tests.models.runs_on_gpu import compared
from tests.models.test_sampling import yielding

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no GPU")

SIMULATED = ["system=bilinear", "data.duration=16", "data.calibration_records=0"]
QUICK = ["figures=false", "baselines=none", "trainer.enable_progress_bar=false"]
SMALLER = {  # what a model has of settings that cost time
    "iterations": 2, "refinements": 1, "law_starts": 1, "starts": 1,
}  # fmt: skip
ELEMENTS = {
    "branch_element", "hysteretic_element", "named_element", "prandtl_ishlinskii",
    "restoring_force_surface",
}  # fmt: skip
RUNS_AWAY = 500.0  # percent
MODELS = sorted(
    path.stem for folder in (CONF, EARLIER) for path in (folder / "model").glob("*.yaml")
)


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> Path:
    """A record of an element."""
    folder, t = tmp_path_factory.mktemp("records"), 0.01 * np.arange(900.0)
    u, rate = np.sin(3.0 * t) * (1.0 + 0.3 * t), np.gradient(np.sin(3.0 * t) * (1.0 + 0.3 * t), t)
    signals = {"s1": 0.01 * u, "s_dot1": 0.01 * rate, "r1": 100.0 * np.tanh(u)}
    columns = np.stack([t, *signals.values()], axis=1)
    header = ",".join(["time", *signals])
    np.savetxt(folder / "element.csv", columns, delimiter=",", header=header, comments="")
    return folder


def words(model: str, files: Path) -> list[str]:
    if model in ELEMENTS:
        return ["data=measured", f"data.path={files}/element.csv", "data.quantity=force"]
    return SIMULATED


def small(cfg: Any) -> list[str]:
    found = [f"model.{key}={value}" for key, value in SMALLER.items() if key in cfg.model]
    if cfg.model.name in ("named_element", "element_network_named"):
        found.append("model.laws=[Linear]")
    if "horizons" in cfg.objective:
        found += ["objective.horizons=[20,null]", "objective.finalists=1"]
    return [*found, "solver.iterations=3"] if "iterations" in cfg.solver else found


def run(model: str, trainer: str, files: Path, folder: Path) -> dict[str, Any]:
    chosen = [f"model={model}", f"trainer={trainer}", *words(model, files), *QUICK]
    cfg = composed(*chosen, *small(composed(*chosen)))
    return identify(cfg, folder / trainer)


def errors(metrics: dict[str, Any]) -> dict[str, float]:
    """All relative errors of a run; none of a motion that runs away, in which rounding grows."""
    found = {}
    for split, scores in metrics.items():
        if isinstance(scores, dict) and "relative_rms_percent" in scores:
            value = scores["relative_rms_percent"]
            found[split] = math.nan if value is None or value > RUNS_AWAY else value
    return found


@pytest.mark.parametrize("model", MODELS)
def test_a_run_on_the_gpu_has_the_errors_of_one_on_the_processor(model, files, tmp_path):
    here, there = (errors(run(model, trainer, files, tmp_path)) for trainer in ("cpu", "gpu"))
    assert here
    assert there == pytest.approx(here, rel=1e-4, nan_ok=True)


@pytest.mark.parametrize("solver", ["lbfgs", "levenberg_marquardt"])
def test_networks_trained_together_on_the_gpu_are_as_on_the_processor(solver):
    words = ["model=global_mlp", f"solver={solver}", "solver.iterations=20", *SIMULATED]
    found = {}
    for device in ("cpu", "cuda"):
        fits = []
        for seed in range(3):
            cfg = composed(*words, f"seed={seed}")
            data = data_from(cfg)
            data.setup()
            fits.append((experiment_of(cfg).make_identification(data), data))
            begin_fit(*fits[-1], device)
        train_together(fits, device)
        for module, data in fits:
            module.on_fit_end()
            score(module.cpu(), data)
        found[device] = [errors(module.results()) for module, _ in fits]
    for one, other in zip(found["cpu"], found["cuda"], strict=True):
        assert other == pytest.approx(one, rel=1e-4, nan_ok=True)


@pytest.fixture
def kernels() -> None:
    if not import_module("models.composition.gpu").is_there():
        pytest.skip("needs numba-cuda: pip install -c constraints.txt -e '.[gpu]'")


def test_free_runs_on_the_gpu_are_those_on_the_processor(kernels):
    found = compared(samples=30, runs=256, device="cuda")
    assert found["a run that diverges"][1] > 0
    assert max(apart for apart, _ in found.values()) < 1e-10


def test_a_likelihood_on_the_gpu_is_that_on_the_processor(kernels, monkeypatch):
    model, record = yielding(units=1)
    likelihood = Likelihood(model, [record], laplace(model, [record]))
    assert likelihood.compile()
    theta = free_vector(model).repeat(WARP * threads(), 1)
    theta += 0.01 * torch.randn(theta.shape, generator=torch.Generator().manual_seed(0)).double()
    there = likelihood.many(theta.numpy())
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert there == pytest.approx(likelihood.many(theta.numpy()), rel=1e-10)


@pytest.mark.parametrize("model", ["gru", "online_vwnn"])
def test_what_was_trained_on_the_gpu_is_drawn_and_loaded_without_one(model, tmp_path):
    words = [f"model={model}", "trainer=gpu", *SIMULATED, "baselines=none"]
    cfg = composed(*words, *small(composed(*words)))
    identify(cfg, tmp_path / "run", draw_run)
    assert max(file.stat().st_size for file in (tmp_path / "run").rglob("events*")) > 50_000
    estimator = load_run(tmp_path / "run")
    assert {p.device.type for p in estimator.parameters()} == {"cpu"}
