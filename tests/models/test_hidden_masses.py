"""A structure that is no chain, one of whose masses has no sensor."""

from __future__ import annotations

from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import torch

from data.record import Drive, Record
from data.simulation.laws.bilinear import Bilinear
from data.simulation.laws.element import Element
from data.simulation.laws.polynomial import Polynomial
from data.simulation.motion import Motion, simulate
from data.simulation.structure import Structure
from export.steps.composite import step_of
from models import ElementNetwork
from models.fit.growing import grow
from models.stored.run import read_run
from tests.export.compiling import needs_gcc, run_in_c
from tests.program.test_train import finished_run

DT, SAMPLES, LONGER, MASSES = 0.02, 600, 900, (0.8, 2.0, 1.2)
PAIRS = tuple(combinations(("ground", "x1", "x2", "x3"), 2))


def structure(heavier: float = 1.0) -> Structure:
    """Three masses, all joined: springs that yield to the ground, cubic ones between them."""
    elements: dict[str, Element] = {}
    for i, pair in enumerate(PAIRS, start=1):
        k = heavier * (40.0 + 3.0 * i)
        if "ground" in pair:
            elements[f"r{i}"] = Bilinear(
                between=pair, stiffness=k, post_yield_stiffness=0.3 * k, yield_displacement=0.03,
                damping=0.01 * k, post_yield_damping=0.01 * k,
            )  # fmt: skip
        else:
            elements[f"r{i}"] = Polynomial(
                between=pair, stiffness=k, damping=0.01 * k, cubic_stiffness=100.0 * k
            )
    return Structure([heavier * m for m in MASSES], elements)


def shaken(
    seed: int, heavier: float = 1.0, stronger: float = 1.0, samples: int = SAMPLES
) -> tuple[Record, Motion]:
    """A record of the first and the third mass; the whole motion."""
    white = np.random.default_rng(seed).standard_normal((samples, 3))
    f = np.stack([np.convolve(u, np.hanning(16), mode="same") for u in white.T], axis=1)
    f *= 1.2 * stronger * heavier / f.std()
    motion = simulate(structure(heavier), f, DT)
    return Record(DT, torch.from_numpy(motion.a[:, [0, 2]].copy()), torch.from_numpy(f)), motion


def network(laws: str | list[str], heavier: float = 1.0) -> ElementNetwork:
    masses = [heavier * m for m in MASSES]
    return ElementNetwork(3, 3, DT, "all", masses=masses, laws=laws, sensors=[1, 3])  # type: ignore[arg-type]


@cache
def identified(heavier: float = 1.0) -> ElementNetwork:
    model, (record, _) = network("units", heavier), shaken(1, heavier)
    model.identify([record])
    grow(model, [record])
    return model.requires_grad_(False)


def errors(model: ElementNetwork, heavier: float = 1.0) -> np.ndarray:
    """Relative errors of the deformations (6,) in a motion that was not trained on."""
    record, motion = shaken(7, heavier)
    y = model.trace(record.drive()).deformations.numpy()
    return np.asarray(np.linalg.norm(y - motion.y, axis=0) / np.linalg.norm(motion.y, axis=0))


def test_units_tell_how_a_mass_without_a_sensor_moves() -> None:
    assert max(np.abs(shaken(1)[1].y).max(axis=0)[:3]) > 2.0 * 0.03
    assert errors(identified()).max() < 0.03
    assert not identified().begins_anew(shaken(1)[0])  # x and v of a hidden mass are not known


def test_units_of_mass_change_nothing() -> None:
    np.testing.assert_allclose(errors(identified(1024.0), 1024.0), errors(identified()), rtol=1e-3)


def test_named_laws_are_those_of_each_element() -> None:
    model = network(["Bilinear", "HardeningSpring"])
    record, _ = shaken(1)
    facts = model.identify([record])
    kinds = ["Bilinear" if "ground" in pair else "HardeningSpring" for pair in PAIRS]
    assert facts["laws"] == ", ".join(kinds)
    assert facts["sensors_do_not_determine"] == ""
    assert errors(model).max() < 1e-3


def test_a_strength_that_no_motion_reaches_is_not_determined() -> None:
    record, motion = shaken(1, stronger=0.1, samples=LONGER)
    assert np.abs(motion.y).max() < 0.3 * 0.03
    found = network(["Bilinear", "HardeningSpring"]).identify([record])
    told = "the strength of elements 1, 2, 3, which is hardly or never reached"
    assert found["sensors_do_not_determine"] == told


def test_small_motion_is_that_of_all_masses() -> None:
    K = structure().linearised()[2]
    found = identified().small_motion()
    assert found is not None
    true = np.linalg.solve(np.diag(MASSES), K)
    np.testing.assert_allclose(found[0].numpy(), true, rtol=0.05, atol=0.02 * np.abs(true).max())
    np.testing.assert_array_equal(found[2].numpy(), np.eye(3))


@needs_gcc
def test_c_has_the_motion_of_all_masses(tmp_path: Path) -> None:
    model, (record, _) = identified(), shaken(7)
    rest = torch.zeros(3, dtype=torch.float64)
    found = run_in_c(step_of(model), Drive(DT, record.excitation, rest, rest), tmp_path)
    right = model.trace(record.drive()).deformations.numpy()[:, :3]  # from the ground
    np.testing.assert_allclose(found["x"], right, rtol=0.0, atol=1e-12 * np.abs(right).max())


@torch.no_grad()
def test_a_record_may_begin_in_motion() -> None:
    """What yielded before leaves its offset unknown; how masses move about it is told."""
    first, counted = 300, 100

    def cut(seed: int) -> Record:
        whole, _ = shaken(seed, samples=LONGER)
        rest = whole.a[first:], whole.excitation[first:]
        return Record(DT, *rest, initial_state="unknown", warmup=counted)

    model = network("units")
    model.identify([cut(1)])
    grow(model, [cut(1)])
    y = model.element_loops(cut(7))[0].numpy()[counted:]
    true = shaken(7, samples=LONGER)[1].y[first + counted :]
    left = (y - true) - (y - true).mean(axis=0)
    assert (np.linalg.norm(left, axis=0) / np.linalg.norm(true, axis=0)).max() < 0.03


def test_a_run_has_intervals_of_all_deformations(tmp_path: Path) -> None:
    words = ["system=bilinear", "data.sensors=[1,3]", "model.masses=[0.8,2.0,1.2]"]
    short = ["data.duration=8", "baselines=none", "data.calibration_records=0"]
    short += ["objective.starts=1", "objective.finalists=1", "solver.iterations=15"]
    folder = finished_run(tmp_path / "run", "model=element_network", *words, *short)
    rows = read_run(folder).metrics["uncertainty"]["drifts"]
    assert [row["element"][:2] for row in rows[:6]] == [f"r{e}" for e in range(1, 7)]
    assert all(0.0 < row["peak_half"] < 0.1 * row["peak"] for row in rows[:6])


def test_a_building_on_a_base_is_a_chain_and_no_mass_is_loose() -> None:
    on_base = ElementNetwork(3, 1, DT, masses=MASSES, forced="base", sensors=[3])
    assert on_base.is_chain
    assert len(ElementNetwork(3, 3, DT, masses=MASSES, sensors=[1, 3]).elements) == 6
    loose = ElementNetwork(
        3, 3, DT, [["ground", "x1"], ["x1", "x3"]], masses=MASSES, sensors=[1, 3]
    )
    with pytest.raises(ValueError, match="no element joins x2"):
        loose.identify([shaken(1)[0]])
