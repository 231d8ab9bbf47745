"""Comparisons of before and after: what changed is found and placed, and nothing else is."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import pytest
import torch

from benchmarks.changed import SIZE, model_of, record_of, structure
from data.record import Record
from models import ElementNetwork, NeuralStateSpace
from models.estimator import Parameter
from models.uncertainty.change import Change, by_holm, compare, refit
from models.uncertainty.change import _differences as differences
from models.uncertainty.change import _Fit as Fit

NOISE = 0.05
SOUND, LOST = np.ones(2), np.array([1.0, 0.75])


@pytest.fixture(scope="module", params=[(True, False), (False, True)], ids=["base", "forces"])
def earlier(request):
    """A model of two storeys, fitted to a record; that record; how to make others of the kind."""
    base, known = request.param
    rng = np.random.default_rng(11)

    def record(factors, size=SIZE):
        return record_of(structure("bilinear", factors), base, size, NOISE, rng)

    first, model = record(SOUND), model_of("bilinear", 2, base, known, rng)
    refit(model, [first], float(NOISE**2 * first.a.var()), masses=True)
    return model, first, record


def test_a_loss_is_found_placed_and_sized_and_a_sound_pair_is_not_called_changed(earlier):
    model, before, record = earlier
    kept = {name: value.clone() for name, value in model.state_dict().items()}
    for factors, places in ((SOUND, []), (LOST, [2])):
        found = compare(model, [before], [record(factors)])
        assert found.places == places
        if places:
            (one,) = [c for c in found.changes if c.name == "r2.stiffness"]
            assert one.low < 0.75 < one.high
            assert one.high - one.low < 0.1
    for name, value in model.state_dict().items():
        assert torch.equal(value, kept[name])
    assert torch.equal(found.after.mass(), model.mass())


def test_intervals_are_as_wide_as_blocks_of_a_record_disagree():
    """A wrong law asks for other parameters in each: ten times as far apart, ten times as wide."""
    drawn = 0.1 * np.random.default_rng(0).standard_normal((12, 1))

    def width(apart: float) -> float:
        one, none = np.ones((1, 1)), np.zeros((1, 1))
        fit = Fit(np.zeros(1), one, 1e-4 * one, none, none, apart * drawn, np.zeros(1), 2)
        known = {"r1.stiffness": Parameter("r1.stiffness", 1.0, "N/m", "")}
        (change,) = differences(known, list(known), fit, fit)
        return float(np.log(change.high / change.low))

    assert width(10.0) == pytest.approx(10.0 * width(1.0))
    assert width(1e-3) == width(1e-6) > 0.0  # noise is there in any case


def test_what_motions_do_not_reach_is_not_told(earlier):
    model, before, record = earlier
    found = compare(model, [before], [record(LOST, 0.1 * SIZE)])
    assert {"r1.yield_force", "r2.yield_force"} <= set(found.undetermined)
    assert found.places == [2]


@torch.no_grad()
def test_records_with_states_are_compared_too(earlier):
    model, before, _ = earlier
    lost = deepcopy(model)
    lost.laws.stiffness.theta[1] += np.log(0.75)
    lost.laws.unit_stiffness.theta[1] *= 0.75
    records, rng = [], np.random.default_rng(1)
    for one in (model, lost):
        run = one.free_run(before.drive())
        noise = 0.02 * run.a.std() * torch.from_numpy(rng.standard_normal(run.a.shape))
        records.append(Record(before.dt, run.a + noise, before.f, run.x, run.v))
    assert compare(model, records[:1], records[1:]).places == [2]


def test_holm_rejects_in_order_and_never_less_certain_ones_first():
    def of(name: str, chance: float) -> Change:
        return Change(name, "N/m", "", 1.0, 1.0, 0.9, 1.1, chance)

    first, *rest = of("r1.stiffness", 0.02), of("r2.stiffness", 0.01), of("r3.damping", 0.9)
    judged = by_holm([first, *rest])
    assert [one.name for one in judged] == ["r2.stiffness", "r1.stiffness", "r3.damping"]
    assert [one.chance for one in judged] == pytest.approx([0.03, 0.04, 0.9])
    assert [one.changed for one in judged] == [True, True, False]
    judged = by_holm([of("r1.damping", 0.02), of("r2.damping", 0.021), of("r3.damping", 0.02)])
    assert not any(one.changed for one in judged)


def test_what_cannot_be_compared_is_refused(earlier):
    model, before, _ = earlier
    m, dt = before.f.shape[-1], before.dt
    branch = ElementNetwork(2, 2, dt, elements="chain", laws="branch")
    held = deepcopy(model).requires_grad_(False)  # as that of a finished run is
    for other in (NeuralStateSpace(2, m, dt), branch, held):
        with pytest.raises(ValueError, match=r" has no springs.*model=element_network.*restore"):
            compare(other, [before], [before])
    three = record_of(structure("bilinear", np.ones(3)), True, SIZE, 0.0, np.random.default_rng(0))
    with pytest.raises(ValueError, match="3 DOFs"):
        compare(model, [before], [three])
