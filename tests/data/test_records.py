"""Seeds, splits and escapes of simulated records."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import torch

from data import Polynomial
from data.record import Escape, stack
from data.simulation.excitation import BandLimitedGaussian, Excitation, Given
from data.simulation.motion import EscapedMotionError, simulate
from data.simulation.records import SPLITS, Simulation, stream
from data.simulation.scenario import FullState, Noisy
from data.simulation.structure import Structure

FORCE = BandLimitedGaussian(1.7, (0.0, 4.5))


@pytest.fixture
def simulation(bilinear_structure):
    return Simulation(bilinear_structure, Excitation(force=FORCE), FullState(), 0.01, 3.0)


@pytest.fixture
def escaping():
    """A softening oscillator of which some motions escape."""
    spring = Polynomial(between=("s1", "x1"), stiffness=30.0, damping=0.6, cubic_stiffness=-10.0)
    force = BandLimitedGaussian(9.0, (0.0, 2.0))
    structure, excitation = Structure([1.0], {"r": spring}), Excitation(force=force)
    return Simulation(structure, excitation, FullState(), 0.01, 10.0, "softening")


def correlation(one: torch.Tensor, other: torch.Tensor) -> float:
    rows = torch.stack([one.flatten(), other.flatten()])
    return abs(float(torch.corrcoef(rows)[0, 1]))


def test_a_record_holds_the_motion_under_its_own_force(simulation):
    (record,), escapes = simulation.records("train", 1, seed=0)
    motion = simulate(simulation.structure, record.f.numpy(), 0.01)
    assert escapes == []
    assert (record.samples, record.dt, record.s) == (300, 0.01, None)
    for name in "xva":
        assert np.array_equal(getattr(record, name), getattr(motion, name))
    for name in "xvayr":
        assert np.array_equal(getattr(record.truth, name), getattr(motion, name))


def test_training_testing_records_and_seeds_are_independent(simulation):
    train, test = (simulation.records(split, 2, seed=0)[0] for split in ("train", "test"))
    other = simulation.records("train", 1, seed=1)[0]
    forces = [record.f for record in (*train, *test, *other)]
    for i, one in enumerate(forces):
        assert all(correlation(one, another) < 0.5 for another in forces[:i])


def test_asking_for_more_records_leaves_the_first_ones_as_they_were(simulation):
    noisy = replace(simulation, scenario=Noisy())
    few, many = (noisy.records("test", count, seed=3)[0] for count in (2, 5))
    for one, same in zip(few, many, strict=False):
        assert torch.equal(one.a, same.a)
        assert torch.equal(one.f, same.f)


def test_every_seed_split_record_and_purpose_has_its_own_stream():
    keys = [(s, split, i, p) for s in (0, 1) for split in SPLITS for i in (0, 1) for p in (0, 1)]
    assert len({stream(*key).random() for key in keys}) == len(keys) == 24


PROGRAM = """
import hashlib
from data import Bilinear
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.records import Simulation
from data.simulation.scenario import Noisy
from data.simulation.structure import Structure
element = Bilinear(between=("s1", "x1"), yield_displacement=0.02, stiffness=40.0,
                   post_yield_stiffness=20.0)
structure, force = Structure([0.8], {"r": element}), BandLimitedGaussian(1.7, (0.0, 4.5))
simulation = Simulation(structure, Excitation(force=force), Noisy(), 0.01, 2.0)
record = simulation.records("test", 1, seed=8)[0][0]
digest = hashlib.sha256((record.a.numpy() + record.x.numpy()).tobytes()).hexdigest()
"""


def test_another_process_generates_the_same_bits():
    here: dict = {}
    exec(PROGRAM, here)
    command = [sys.executable, "-c", PROGRAM + "print(digest)"]
    root = Path(__file__).parents[2]
    elsewhere = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True)
    assert elsewhere.stdout.strip() == here["digest"]


def test_testing_takes_the_rows_of_a_given_history_that_training_left(simulation):
    history = np.random.default_rng(0).standard_normal((900, 3))
    given = replace(simulation, excitation=Excitation(force=Given(history)))
    train, _ = given.records("train", 2, seed=0)
    test, _ = given.records("test", 1, seed=0, first=2)
    rows = np.concatenate([record.f for record in (*train, *test)])
    assert np.array_equal(rows, history)


def test_escapes_are_counted_and_the_other_records_kept(escaping):
    records, escapes = escaping.records("train", 12, seed=0)
    assert escapes
    assert len(records) + len(escapes) == 12
    assert all(isinstance(e, Escape) and e.split == "train" for e in escapes)
    assert all(0.0 < e.time < 10.0 for e in escapes)
    assert all(torch.isfinite(record.a).all() for record in records)
    kept = [i for i in range(12) if i not in {e.record for e in escapes}]
    drawn = [draw(escaping, i) for i in kept]
    for record, force in zip(records, drawn, strict=True):
        assert np.array_equal(record.f, force)


def draw(simulation, record: int) -> np.ndarray:
    generator = stream(0, "train", record, 0)
    return simulation.excitation.draw(simulation.structure, 1000, 0.01, record, generator)[0]


def test_a_single_escaped_motion_is_reported_with_seed_and_time(escaping):
    wild = replace(escaping, excitation=Excitation(force=BandLimitedGaussian(90.0, (0.0, 2.0))))
    with pytest.raises(EscapedMotionError, match=r"softening, seed 4: the test .*t = \d+\.\d\d s;"):
        wild.records("test", 1, seed=4)
    with pytest.raises(EscapedMotionError, match="and so did all 3") as caught:
        wild.records("test", 3, seed=4)
    assert 0.0 < caught.value.time < 10.0


def test_a_motion_that_escapes_is_drawn_anew_where_asked_for(escaping):
    left, out = escaping.records("train", 8, seed=0)
    asked = replace(escaping, escape="redraw")
    records, escapes = asked.records("train", 8, seed=0)
    assert len(records) == 8 > len(left)
    assert [one.record for one in escapes] == [one.record for one in out]
    assert all(one.redrawn > 0 for one in escapes)
    kept = [r for i, r in enumerate(records) if i not in {one.record for one in escapes}]
    assert all(torch.equal(mine.a, theirs.a) for mine, theirs in zip(kept, left, strict=True))
    again, _ = asked.records("train", 8, seed=0)
    assert all(torch.equal(one.a, other.a) for one, other in zip(records, again, strict=True))
    tests, _ = asked.records("test", 8, seed=0)
    drawn = [r.f for r in (*records, *tests)]
    assert all(abs(correlation(a, b)) < 0.8 for a, b in combinations(drawn, 2))


def test_the_error_of_the_simulation_falls_with_its_tolerance(simulation):
    coarse, fine = (
        replace(simulation, dt=0.1, tolerance=tolerance).error("train", seed=0)
        for tolerance in (1e-5, 1e-9)
    )
    assert fine < 0.01 * coarse
    assert 1e-7 < coarse < 1e-3
    loose, tight = (
        replace(simulation, dt=0.1, tolerance=tolerance).records("train", 1, 0)[0][0]
        for tolerance in (1e-5, 1e-7)
    )
    assert ((loose.a - tight.a).norm() / tight.a.norm()).item() == pytest.approx(coarse, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dt": 0.0}, r"dt=0\.0 must be a number above 0"),
        ({"dt": float("nan")}, "dt=nan is not finite"),
        ({"duration": 0.01}, r"data\.duration=0\.01 s holds 1 samples"),
        ({"duration": -1.0}, r"duration=-1\.0 must"),
    ],
)
def test_a_record_without_samples_is_refused(simulation, change, message):
    with pytest.raises(ValueError, match=message):
        replace(simulation, **change)


# Not all DOFs have a sensor


def test_sensors_on_some_dofs_have_the_channels_of_a_record_of_all(simulation):
    whole = replace(simulation, scenario=Noisy())
    some = replace(whole, sensors=[3, 1])
    (record,), (of_all,) = (s.records("test", 1, seed=3)[0] for s in (some, whole))
    assert (record.dofs, record.numbers, of_all.numbers) == (2, (1, 3), ())
    for one, other in ((record, of_all), (record.truth, of_all.truth)):
        for name in "xva":
            assert torch.equal(getattr(one, name), getattr(other, name)[:, [0, 2]])
    assert torch.equal(record.f, of_all.f)
    assert torch.equal(record.truth.r, of_all.truth.r)


@pytest.mark.parametrize("sensors", [[], [4], [0, 1], [1, 1]])
def test_sensors_that_the_structure_has_no_place_for_are_named(simulation, sensors):
    with pytest.raises(ValueError, match=r"from 1 to 3, each once.* or null") as error:
        replace(simulation, sensors=sensors)
    assert f"data.sensors={sensors}" in str(error.value)


def test_numbers_of_dofs_stay_with_a_record(simulation):
    (record,), _ = replace(simulation, sensors=[1, 3]).records("train", 1, seed=0)
    parts = [record.window(100 * k, 100) for k in range(2)]
    for one in (*parts, stack(parts), parts[1].behind(parts[0]), record.measured().to("cpu")):
        assert one.dof_numbers == [1, 3]
    assert replace(record, numbers=(1, 2)).numbers == ()
    with pytest.raises(ValueError, match="records differ in"):
        stack([parts[0], replace(parts[1], numbers=(2, 3))])
    for odd in ((1,), (3, 1), (0, 2), (1, 1)):
        with pytest.raises(ValueError, match="positive and ascending"):
            replace(record, numbers=odd)
