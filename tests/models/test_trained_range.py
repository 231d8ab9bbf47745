"""How far training moved a model, and where a new motion leaves that."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import pytest
import torch

from data.record import Record
from data.sample import Sensors
from models.element_network import ElementNetwork
from models.fit.trained_range import (
    outside,
    range_of,
    range_of_drive,
    warnings_of,
    worst_of,
)
from models.linear import EquivalentLinear
from models.stored.schema import METRICS_KIND, SPECTRUM, require


@pytest.fixture(scope="module")
def chain(linear_record) -> ElementNetwork:
    """An identified network of the linear chain: linear, so its motion scales with the force."""
    model = ElementNetwork(linear_record.dofs, linear_record.f.shape[-1], linear_record.dt, units=0)
    model.identify([linear_record])
    return model


def times(record: Record, factor: float) -> Record:
    return record.measured().map(lambda u: factor * u)


def test_twice_the_motion_is_outside_by_two_in_every_kind(chain, linear_record):
    trained = range_of(chain, [linear_record.measured()])
    found = outside(trained, range_of(chain, [times(linear_record, 2.0)]))
    kinds = ["excitation", "acceleration", "displacement", "velocity", "deformation", "rate"]
    kinds.append("spectrum")
    assert [one["kind"] for one in found] == kinds
    assert all(one["times"] == pytest.approx(2.0, rel=1e-6) for one in found)
    lines = warnings_of(found)
    assert len(lines) == len(kinds)
    assert all(line.startswith("outside the trained range: 2 × the largest ") for line in lines)
    assert "ground–x1" in str(trained["deformation"]["names"])
    assert worst_of(found).startswith("2 × the trained ")


@pytest.mark.parametrize(
    ("forced", "words"),
    [
        ("base", "ground acceleration (2 m/s², in training 1 m/s²)"),
        ([1], "excitation of f1 (2 N, in training 1 N)"),
        ([3], "excitation of f3 (2 N, in training 1 N)"),
    ],
)
def test_what_drives_is_named_with_its_unit(forced, words):
    one = torch.ones(50, 1, dtype=torch.float64)
    trained, new = (
        range_of(EquivalentLinear(1, 1, 0.01), [Record(0.01, one, f)], sensors)
        for f, sensors in ((one, Sensors(0.01, 1, 1, forced)), (2.0 * one, None))
    )
    assert warnings_of(outside(trained, new)) == [
        f"outside the trained range: 2 × the largest {words}"
    ]


def test_other_inputs_leave_their_range_at_either_end():
    """A temperature is no motion about zero: less of it is outside, too."""
    f = torch.ones(50, 1, dtype=torch.float64)
    degrees = torch.linspace(20.0, 30.0, 50, dtype=torch.float64)[:, None]
    trained, cold, warm, less = (
        range_of(EquivalentLinear(1, 2, 0.01), [Record(0.01, f, f, e=e)])
        for e in (degrees, degrees - 15.0, degrees + 5.0, 25.0 + 0.9 * (degrees - 25.0))
    )
    assert trained["excitation"]["names"] == ["f1"]
    assert trained["other input"]["names"] == ["u1"]
    assert outside(trained, less) == []
    (found,) = outside(trained, cold)
    assert (found["name"], found["largest"], found["trained"]) == ("u1", 5.0, 20.0)
    assert found["times"] == pytest.approx(4.0)
    assert warnings_of([found]) == ["outside the trained range: u1 reaches 5, in training 20"]
    assert worst_of([found]) == "4 × the trained other input"
    (found,) = outside(trained, warm)
    assert (found["largest"], found["times"]) == (35.0, pytest.approx(2.0))
    assert outside({"other input": trained["other input"] | {"largest": []}}, cold) == []


def test_a_free_run_is_compared_by_its_own_motion(chain, linear_record):
    trained = range_of(chain, [linear_record.measured()])
    drive = times(linear_record, 2.0).drive()
    (found,) = (
        one
        for one in outside(trained, range_of_drive(chain, drive, trained))
        if one["kind"] == SPECTRUM
    )
    assert found["times"] == pytest.approx(2.0, rel=1e-9)
    del trained[SPECTRUM]
    assert SPECTRUM not in range_of_drive(chain, drive, trained)


def test_a_run_that_diverges_has_no_range(chain, linear_record):
    gone = linear_record.measured().map(lambda u: 1e300 * u)
    assert "deformation" not in range_of(chain, [gone])


def shaken(
    *parts: tuple[float, float], dt: float = 0.01, sizes: Sequence[float] = (1.0,)
) -> Record:
    """40 s of harmonics, of so many Hz and m/s², on channels of these sizes; it moves as driven."""
    t = dt * torch.arange(round(40.0 / dt), dtype=torch.float64)[:, None]
    u = sum(size * torch.sin(2.0 * torch.pi * f * t) for f, size in parts)
    u = u * torch.tensor(sizes, dtype=torch.float64)
    return Record(dt, u[:, :1], u)


def spectral(trained: Record, new: Record) -> list[dict[str, Any]]:
    """Where the spectrum leaves that of training, read back from a file."""
    m = trained.f.shape[-1]
    sensors = Sensors(trained.dt, 1, m, "base") if m == 1 else None
    model = EquivalentLinear(1, m, trained.dt)
    known = json.loads(json.dumps(range_of(model, [trained], sensors)))
    needed = {"model": "linear", "system": "frame", "scenario": "noisy"}
    require({**needed, "trained_range": known}, METRICS_KIND)
    return [one for one in outside(known, range_of(model, [new])) if one["kind"] == SPECTRUM]


def test_another_frequency_content_is_outside_with_smaller_peaks():
    """The slower motion moves oscillators of its period more than training did."""
    (found,) = spectral(shaken((4.0, 1.0)), shaken((1.25, 0.9)))
    transient = 1.0 / (3.2 - 1.0)  # of training, in an oscillator 3.2 times as slow
    assert found["times"] == pytest.approx(0.9 * 10.0 / transient, rel=0.1)
    (line,) = warnings_of([found])
    assert line.startswith("outside the trained range: ")
    assert "× the largest spectral acceleration at 0.8" in line
    assert line.endswith(f"({found['largest']:.3g} m/s², in training {found['trained']:.3g} m/s²)")
    assert worst_of([found]).endswith(" × the trained spectrum")
    assert spectral(shaken((4.0, 1.0), (1.25, 1.0)), shaken((1.25, 0.9))) == []


def test_a_spectrum_is_compared_where_the_motion_has_its_power():
    """An excitation that the structure hardly answers, says nothing of its model."""
    trained, new = shaken((1.25, 1.0)), shaken((1.25, 0.98), (7.0, 0.02))
    still = Record(0.01, shaken((1.25, 0.98)).a, new.f)
    assert spectral(trained, still) == []
    assert spectral(trained, Record(0.01, shaken((7.0, 0.1)).a, new.f)) != []


@pytest.mark.parametrize("sizes", [(1.0, 0.01), (0.01, 1.0)])
def test_neither_units_nor_order_nor_sampling_change_a_spectral_ratio(sizes):
    (plain,) = spectral(shaken((4.0, 1.0)), shaken((1.25, 0.9)))
    channels = spectral(shaken((4.0, 1.0), sizes=sizes), shaken((1.25, 0.9), sizes=sizes))
    (fine,) = spectral(shaken((4.0, 1.0), dt=0.005), shaken((1.25, 0.9), dt=0.005))
    (mixed,) = spectral(shaken((4.0, 1.0)), shaken((1.25, 0.9), dt=0.005))
    assert channels[0]["times"] == pytest.approx(plain["times"], rel=1e-9)
    assert channels[0]["channels"] == 2
    assert "spectral value of f" in warnings_of(channels)[0]
    assert fine["times"] == pytest.approx(plain["times"], rel=0.01)
    assert mixed["times"] == pytest.approx(plain["times"], rel=0.01)


def test_a_motion_that_nothing_drives_has_no_spectrum():
    free = Record(0.01, shaken((1.0, 1.0)).a, torch.zeros(4000, 0))
    assert SPECTRUM not in range_of(EquivalentLinear(1, 0, 0.01), [free])


def test_a_run_without_a_spectrum_is_compared_as_before(chain, linear_record):
    trained = range_of(chain, [linear_record.measured()])
    new = range_of(chain, [times(linear_record, 2.0)])
    found = outside(trained, new)
    del trained[SPECTRUM]
    assert outside(trained, new) == [one for one in found if one["kind"] != SPECTRUM]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"periods": [1.0]}, "has 1 periods"),
        ({"largest": [[]] * 2}, "largest of other lengths than names"),
        ({"power": None}, "expected"),
    ],
)
def test_a_spectrum_that_does_not_fit_together_is_refused(change, words):
    own = {"unit": "", "names": ["f1"], "periods": [1.0, 1.1], "power": [0.5, 0.5]}
    own |= {"largest": [[1.0], [2.0]], **change}
    needed = {"model": "linear", "system": "frame", "scenario": "noisy"}
    with pytest.raises(ValueError, match=words):
        require({**needed, "trained_range": {SPECTRUM: own}}, METRICS_KIND)
