"""Grids of an experiment, by name: the requested runs, saved with the runs that keep the name."""

from __future__ import annotations

from functools import cache
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig, OmegaConf

from runner.config.choices import typed
from runner.config.compose import CONF
from runner.scores.result import Result

CASE = ("model", "system", "scenario", "seed")  # they have columns of their own


@cache
def grids_of(experiment: str) -> dict[str, dict[str, Any]]:
    """{grid: {setting: values as they are typed}} of an experiment in conf/experiment."""
    (path,) = (CONF / "experiment").rglob(f"{experiment}.yaml")
    cfg = OmegaConf.load(path)
    assert isinstance(cfg, DictConfig)
    return {str(name): dict(grid) for name, grid in cfg.hydra.sweeper.grids.items()}


def seeds_of(experiment: str) -> dict[str, int]:
    """{grid: how many seeds it asks for} of an experiment in conf/experiment."""
    (path,) = (CONF / "experiment").rglob(f"{experiment}.yaml")
    usual = OmegaConf.select(OmegaConf.load(path), "hydra.sweeper.params.seed")
    parser = OverridesParser.create()
    words = {name: grid.get("seed", usual) for name, grid in grids_of(experiment).items()}
    return {
        name: len(list(parser.parse_override(f"seed={word}").sweep_string_iterator()))
        for name, word in words.items()
    }


def asked(run: Result, experiment: str) -> str:
    """Settings that the run's grid chose, as they would be typed; the grid itself where unknown."""
    grid = grids_of(experiment).get(run.grid)
    if grid is None:
        return run.grid or "no grid"
    settings = (f"{key}={typed(run.choices.get(key))}" for key in grid if key not in CASE)
    return " ".join(settings) or "the seeds alone"
