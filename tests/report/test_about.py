"""What conf/model says about its models: well-formed, seen by tables and pictures alone."""

from __future__ import annotations

import pytest
from omegaconf import OmegaConf

from report.about import about, models, prior_knowledge
from report.free_run import SYSTEMS
from runner.config.choices import dotted, plain
from runner.config.compose import CONF, composed
from runner.config.identity import config_digest
from runner.loggers import swept
from tests.experiments import data_from, estimator_from

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
