"""A chain, or all pairs: told by the motion of the masses, whatever its units, and by a rival."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from data import MenegottoPinto, Polynomial, SelfCentering, Takeda
from data.record import Record
from data.simulation.laws.element import Element
from data.simulation.motion import Motion, simulate
from data.simulation.structure import Structure
from models.composition.topology import is_open, topology_of
from models.element_network import ElementNetwork
from models.experiment import Experiment, select_fit
from runner.config.compose import composed
from tests.experiments import data_from
from tests.models.planted import planted
from tests.models.test_starts import MASSES, STIFFNESS, motion


def bridge(abutment: float) -> ElementNetwork:
    """A chain of three whose last mass, the deck's, also moves against the ground."""
    joined = [["ground", "x1"], ["x1", "x2"], ["x2", "x3"], ["x3", "ground"]]
    springs, driven = [*STIFFNESS, abutment], {"inputs": 1, "forced": "base"}
    return planted(MASSES, springs, joined, yielding=0.3, damper=0.002, **driven)


def test_units_do_not_matter():
    record = motion(bridge(1000.0), 2000, noise=0.03)
    for size in (1e-6, 1e6):
        scaled = replace(record, a=size * record.a, f=size * record.f)
        assert topology_of([scaled], "base") == "all"
        slow = replace(scaled, dt=size * record.dt)
        assert topology_of([slow], "base") == "all"


@pytest.mark.parametrize(
    ("system", "told"),
    [("steel_frame", "chain"), ("self_centering_frame", "chain"), ("slack_braced_frame", "chain"),
     ("timber_house", "chain"), ("isolated_building", "chain"), ("bridge_piers", "all")],
)  # fmt: skip
def test_on_one_support_displacements_tell_it_and_without_them_it_is_a_chain(system, told):
    words = [f"system={system}", "data.duration=20", "data.calibration_records=0", "seed=0"]
    data = data_from(composed(*words, "model=element_network_named"))
    data.setup()
    (record,) = data.records["train"]
    assert topology_of([record], []) == told
    assert topology_of([replace(record, x=None, v=None)], []) == "chain"


def drawn(seed: int, joined: bool) -> list[tuple[Record, Sequence[int] | str]]:
    """Two to four masses whose storeys yield, of drawn size, unit and law, on a moving support.

    joined: a spring of 0.3 to 2 storeys joins the last mass to the support. Also the same motion as
    accelerations against the base, with 3 % noise, and as that under forces on all masses, with
    and without x and v. With each, what `topology_of` knows of the forces.
    """
    rng, dt, T = np.random.default_rng(seed), 0.01, 2500
    n, unit, t = int(rng.integers(2, 5)), 10.0 ** rng.uniform(-3.0, 3.0), dt * np.arange(T)
    m = 10.0 ** rng.uniform(0.0, 6.0) * rng.uniform(0.6, 1.4, n)
    k = m.mean() * (4.0 / rng.uniform(0.1, 0.3)) ** 2 * rng.uniform(0.6, 1.4, n)
    w, phase = 2.0 * np.pi * rng.uniform(0.3, 5.0, 40), rng.uniform(0.0, 6.28, 40)
    rise = np.minimum(t / 4.0, 1.0) ** 2
    s = rise * (np.sin(np.outer(t, w) + phase) / w**1.5).sum(axis=1)
    speed = np.gradient(s, dt, edge_order=2)
    laws, abutment = rng.integers(0, 3, n), rng.uniform(0.3, 2.0) * k.mean()

    def moved(yields_at: float) -> Motion:
        nodes = ["s1", *(f"x{i + 1}" for i in range(n))]
        elements: dict[str, Element] = {}
        for i in range(n):
            own = {"stiffness": k[i], "damping": 0.03 * (k[i] * m[i]) ** 0.5}
            law, where = LAWS[laws[i]]
            elements[f"r{i}"] = law(between=(nodes[i], nodes[i + 1]), **{where: yields_at}, **own)
        if joined:
            elements["z"] = Polynomial(between=("s1", nodes[-1]), stiffness=abutment)
        structure = Structure(m.tolist(), elements)
        return simulate(structure, np.zeros((T, n)), dt, s[:, None].copy(), speed[:, None].copy())

    elastic = float(np.abs(moved(1e9).y[:, :n]).max())
    run = moved(elastic / rng.uniform(1.2, 5.0))
    x, v, a = (torch.from_numpy(unit * u) for u in (run.x, run.v, run.a))
    support, rate = (torch.from_numpy(unit * u)[:, None] for u in (s, speed))
    pushed = torch.from_numpy(unit * np.gradient(speed, dt))[:, None]
    noise = torch.randn(a.shape, generator=torch.Generator().manual_seed(seed)).double()
    heard = a - pushed + 0.03 * (a - pushed).std(dim=0) * noise
    forces = -pushed * torch.from_numpy(m)
    numbers = list(range(1, n + 1))
    return [
        (Record(dt, a, a.new_zeros(T, 0), x, v, support, rate), []),
        (Record(dt, heard, -pushed), "base"),
        (Record(dt, heard, forces, x - support, v - rate), numbers),
        (Record(dt, heard, forces), numbers),
    ]


@pytest.mark.parametrize(
    ("forced", "inputs", "is_told"),
    [("base", 1, True), ([1, 2], 2, True), ([2], 1, True), ([3], 1, False), ([1], 5, False),
     ([], 4, False), ([], 2, True)],
)  # fmt: skip
def test_records_tell_of_forces_alone_a_base_or_one_support(forced, inputs, is_told):
    data = SimpleNamespace(
        dofs=2, quantity="acceleration", measured=True, forced=forced, inputs=inputs
    )
    assert is_open({"elements": None, "masses": None}, data) == is_told
    assert not is_open({"elements": None, "masses": [1.0, None]}, data)


LAWS = [
    (partial(MenegottoPinto, hardening_ratio=0.03), "yield_displacement"),
    (partial(SelfCentering, hardening_ratio=0.05, flag=0.8), "activation_displacement"),
    (partial(Takeda, hardening_ratio=0.05), "yield_displacement"),
]


def test_drawn_chains_are_chains_and_abutments_are_seen():
    """Sizes, laws and units that nobody chose; a few abutments beside stiff storeys are missed."""
    chains = [drawn(seed, False) for seed in range(12)]
    bridges = [drawn(seed, True) for seed in range(12)]
    for way in range(4):
        seen = [[few[way] for few in kind] for kind in (chains, bridges)]
        counts = [sum(topology_of([r], forced) == "all" for r, forced in some) for some in seen]
        assert counts[0] <= 1, way
        assert counts[1] >= 9, way


@pytest.mark.parametrize("seed", range(4))
def test_a_deck_that_moves_against_the_ground_is_none(seed):
    records = [motion(bridge(1000.0), 2000, noise=0.03, seed=seed + 10 * i) for i in range(2)]
    assert topology_of(records, "base") == "all"


# --- what held-back motion prefers, and when a rival is fitted

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
