"""One element network and one element test: `laws` says of which kind, in configs and in Python."""

from __future__ import annotations

import copy
import pickle

import pytest
from omegaconf import OmegaConf

import models
from models import ElementNetwork, ElementTest, Estimator
from runner.config.choices import plain
from runner.config.compose import composed, placed
from runner.config.identity import config_digest
from tests.experiments import build, class_of

DIGESTS = {  # of 0.11: finished runs are found by them; of 0.12 where a setting was added since
    "element_network": "2626fe267d",  # mass_damping
    "element_network_branch": "ebbc9ed003",
    "element_network_named": "2a90992344",
    "hysteretic_element": "d3cca20bef",
    "branch_element": "403ea9668b",
    "named_element": "a97941bdad",
    "vwnn_first_order": "ed2bb82399",
    "gru": "37d09aaf47",
    "vwnn data=measured": "58b73ced3d",
}
NAMES = {  # of configs, by front and laws
    ("element_network", "units"): "element_network",
    ("element_network", "branch"): "element_network_branch",
    ("element_network", "named"): "element_network_named",
    ("element_test", "units"): "hysteretic_element",
    ("element_test", "branch"): "branch_element",
    ("element_test", "named"): "named_element",
}
FRONTS = {"element_network": ElementNetwork, "element_test": ElementTest}


@pytest.mark.parametrize(("chosen", "name"), NAMES.items())
def test_laws_and_the_earlier_name_are_one_config_of_the_class_of_these_laws(chosen, name):
    front, laws = chosen
    cfg = composed(f"model={front}", f"model.laws={laws}")
    assert plain(cfg) == plain(composed(f"model={name}"))
    assert cfg.model.name == name
    dofs = 2 if front == "element_network" else 1
    own = FRONTS[front](dofs, 2, 0.01, laws=laws)
    assert type(own) is class_of(cfg.model)
    assert isinstance(own, FRONTS[front])
    assert type(own) is getattr(models, models.KINDS[FRONTS[front].__name__][laws])
    more = {"other_inputs": 0} if "other_inputs" in cfg.model else {}
    assert type(build(cfg.model, Estimator, dofs=dofs, inputs=2, dt=0.01, **more)) is type(own)
    assert type(copy.deepcopy(own)) is type(pickle.loads(pickle.dumps(own))) is type(own)


@pytest.mark.parametrize(("name", "digest"), DIGESTS.items())
def test_finished_runs_of_earlier_code_are_found_by_their_digest(name, digest):
    assert config_digest(plain(composed(*f"model={name}".split()))) == digest


def test_a_list_of_names_chooses_named_laws_where_a_model_has_any():
    assert composed("model=element_test", "model.laws=[Linear]").model.seed == 0
    assert "model/laws=named" not in placed(["model=modal_network", "model.laws=[cubic]"])
    sweep = placed(["model=element_network,element_test", "model.laws=units,branch"])
    assert sweep[-1] == "model/laws=units,branch"


@pytest.mark.parametrize("laws", ["brunch", 3, True, {"a": 1}])
def test_laws_that_there_are_not_are_told(laws):
    node = OmegaConf.create({"_target_": "models.ElementTest", "laws": laws})
    with pytest.raises(ValueError, match=r"model\.laws=.*expected units, branch, named, or a list"):
        build(node, Estimator, dofs=1, inputs=2, dt=0.01)
    config_digest(plain(composed()) | {"model": {"name": "x", **node}})  # which is not the place
