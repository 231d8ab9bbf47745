"""Topologies of unknown elements: what held-back motion prefers, and when a rival is fitted."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from models import ElementNetwork
from models.experiment import Experiment, select_fit

OTHER = {"chain": "all", "all": "chain"}
OPEN = {"elements": None, "masses": None}


def fit(error: float | None) -> Any:
    own = {"held_back_error": error, "fit_seconds": 2.0, "solution": {}}
    return SimpleNamespace(estimator=ElementNetwork, **own)


def shaken(topology: str | None) -> Any:
    """Three masses on a base that moves."""
    return SimpleNamespace(
        inputs=1, topology=topology, measured=True, forced="base", quantity="acceleration", dofs=3
    )


@pytest.mark.parametrize(
    ("guess", "first", "rival", "kept"),
    [
        ("chain", 0.19, 0.14, "all"),
        ("chain", 0.19, 0.18, "chain"),  # not clearly better: fewer elements
        ("all", 0.14, 0.15, "chain"),
        ("all", 0.14, 0.30, "all"),
        ("chain", 0.14, float("inf"), "chain"),
        ("chain", float("inf"), 0.5, "all"),
    ],
)
def test_held_back_motion_chooses_and_all_pairs_have_to_be_clearly_better(
    guess, first, rival, kept
):
    fits = {guess: fit(first), OTHER[guess]: fit(rival)}
    data = shaken(OTHER[guess])  # as the rival left it
    module = select_fit(data, *fits.values())
    assert data.topology == kept
    assert module is fits[kept]
    assert module.fit_seconds == 4.0
    told = module.solution["held_out_error_by_topology_percent"]
    assert told.startswith("chain" if guess == "chain" else "all pairs")


@pytest.mark.parametrize(
    ("topology", "error", "rival"),
    [
        (None, 0.2, None),  # given, or masses are known
        ("chain", None, None),  # nothing was held back
        ("chain", 0.02, None),  # a chain explains nearly all
        ("chain", 0.2, "all"),
        ("all", 0.02, "chain"),
    ],
)
def test_a_rival_is_fitted_only_where_the_topology_is_open(topology, error, rival):
    data = shaken(topology)
    experiment = SimpleNamespace(make_identification=lambda data: data.topology)
    assert Experiment.make_rival(experiment, data, fit(error)) == rival
    assert data.topology == (rival or topology)


@pytest.mark.parametrize(
    "settings", [OPEN | {"elements": "chain"}, OPEN | {"masses": [1.0] * 3}, {"masses": None}]
)
def test_no_topology_is_sought_where_elements_or_masses_are_given(settings):
    assert ElementNetwork.topology_from(settings, shaken(None)) is None
