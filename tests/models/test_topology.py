"""A chain, or all pairs: told by the motion of the masses, whatever its units."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from models.element_network import ElementNetwork
from models.starts.topology import topology_of
from models.training.assemble import data_from
from runner.config.compose import composed
from tests.models.test_starts import DT, MASSES, STIFFNESS, motion, planted


def bridge(abutment: float) -> ElementNetwork:
    """A chain of three whose last mass, the deck's, also moves against the ground."""
    joined = [["ground", "x1"], ["x1", "x2"], ["x2", "x3"], ["x3", "ground"]]
    model = ElementNetwork(3, 1, DT, joined, forced="base", hinges=0, units=1)
    k = torch.tensor([*STIFFNESS, abutment]).double()
    model.mass.start(torch.tensor(MASSES).double())
    model.laws.start(k, 0.002 * k, torch.full_like(k, 0.1), (0.5, 0.5))
    model.laws.unit_stiffness.theta.data.fill_(0.3)
    model.identified.fill_(1.0)
    return model


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("yielding", [0.0, 0.7])
def test_a_building_is_a_chain(yielding, seed):
    record = motion(planted(True, yielding), 2000, noise=0.03, seed=seed)
    assert topology_of([record]) == "chain"


@pytest.mark.parametrize("seed", range(4))
def test_a_deck_that_moves_against_the_ground_is_none(seed):
    records = [motion(bridge(1000.0), 2000, noise=0.03, seed=seed + 10 * i) for i in range(2)]
    assert topology_of(records) == "all"


def test_units_do_not_matter():
    record = motion(bridge(1000.0), 2000, noise=0.03)
    for size in (1e-6, 1e6):
        scaled = replace(record, a=size * record.a, f=size * record.f)
        assert topology_of([scaled]) == "all"
        slow = replace(scaled, dt=size * record.dt)
        assert topology_of([slow]) == "all"


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(
    ("system", "told"),
    [("steel_frame", "chain"), ("self_centering_frame", "chain"), ("slack_braced_frame", "chain"),
     ("timber_house", "chain"), ("isolated_building", "chain"), ("bridge_piers", "all")],
)  # fmt: skip
def test_on_one_support_displacements_tell_it_and_without_them_it_is_a_chain(system, told, seed):
    words = [f"system={system}", "data.duration=20", "data.calibration_records=0", f"seed={seed}"]
    data = data_from(composed(*words, "model=element_network_named"))
    data.setup()
    (record,) = data.records["train"]
    assert topology_of([record]) == told
    assert topology_of([replace(record, x=None, v=None)]) == "chain"
