"""How far training moved a model, and where a new motion leaves that."""

from __future__ import annotations

import pytest
import torch

from data.record import Record
from data.sample import Sensors
from models.element_network import ElementNetwork
from models.fit.trained_range import outside, range_of, warnings_of, worst_of
from models.linear import EquivalentLinear


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


def test_a_run_that_diverges_has_no_range(chain, linear_record):
    gone = linear_record.measured().map(lambda u: 1e300 * u)
    assert "deformation" not in range_of(chain, [gone])
