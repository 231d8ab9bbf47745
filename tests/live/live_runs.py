"""A finished run to stream to."""

from __future__ import annotations

from pathlib import Path

from runner.config.choices import plain
from runner.config.compose import composed
from runner.folder.run import Run
from tests.experiments import data_from, estimator_from

ROOT = Path(__file__).parents[2]
DT = 0.01


def finished(folder: Path, *words: str) -> Path:
    """A finished run, identified on its 10 s of training motion."""
    cfg = composed("data.duration=10", "baselines=none", *words)
    data = data_from(cfg)
    data.setup()
    estimator = estimator_from(cfg.model, data)
    run = Run.begin(folder, plain(cfg), data.sensors)
    estimator.identify(data.loader("train"))
    run.save(estimator)
    names = ("model", "system", "scenario")
    run.finish({name: cfg[name].name for name in names})
    return folder
