"""A chain or all pairs: what held-back motion prefers, and when nobody asks."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from omegaconf import OmegaConf

from runner.rival import preferred, with_other_topology

OPEN = OmegaConf.create({"model": {"elements": None, "masses": None}})


def fit(error: float | None):
    loss = None if error is None else error**2
    objective = SimpleNamespace(held_back_loss=loss)
    return SimpleNamespace(objective=objective, solution={}, fit_seconds=2.0), f"by {error}"


def shaken(topology: str | None):
    """Three masses on a base that moves."""
    return SimpleNamespace(
        topology=topology, measured=True, forced="base", quantity="acceleration", dofs=3
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
    fits = {guess: fit(first), {"chain": "all", "all": "chain"}[guess]: fit(rival)}
    data = shaken({"chain": "all", "all": "chain"}[guess])  # as the rival left it
    module, trainer = preferred(data, *fits.values())
    assert data.topology == kept
    assert (module, trainer) == fits[kept]
    assert module.fit_seconds == 4.0
    told = module.solution["held_out_error_by_topology_percent"]
    assert told.startswith("chain" if guess == "chain" else "all pairs")


@pytest.mark.parametrize(
    ("cfg", "topology", "error"),
    [
        (OPEN, None, 0.2),  # given, or masses are known
        (OPEN, "chain", None),  # nothing was held back
        (OPEN, "chain", 0.02),  # a chain explains nearly all
        (OmegaConf.create({"model": {"elements": "chain", "masses": None}}), "chain", 0.2),
    ],
)
def test_a_rival_is_fitted_only_where_the_topology_is_open(cfg, topology, error):
    data = shaken(topology)
    assert with_other_topology(cfg, data, fit(error)[0]) is None
    assert data.topology == topology
