"""Cyclic tests of elements: no clock is asked for, and cycles are held back in one memory."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from data.measured.cycles import end_of_a_cycle, valleys
from data.measured.datamodule import MeasuredData
from models.hysteretic_element import HystereticElement
from tests.data.odd_files import table
from tests.experiments import measured

PER_CYCLE = 60


def cycles(amplitudes, offset: float = 0.0) -> np.ndarray:
    phase = np.linspace(0.0, 2.0 * np.pi, PER_CYCLE, endpoint=False)
    return np.concatenate([a * (np.sin(phase) + offset) for a in amplitudes])


def elastoplastic(y: np.ndarray, k: float = 4e7, yields: float = 9e4) -> np.ndarray:
    z = np.zeros_like(y)
    for j in range(1, len(y)):
        z[j] = np.clip(z[j - 1] + k * (y[j] - y[j - 1]), -yields, yields)
    return z + 0.05 * k * y


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Two cycles of each amplitude in inches and kip, without a clock, slips back and repeats."""
    y = 1e-3 * cycles([1, 1, 2, 2, 4, 4, 8, 8])
    y = y + 1e-5 * np.random.default_rng(0).standard_normal(len(y))
    y[100:104] = y[100]
    place = tmp_path_factory.mktemp("cyclic") / "cyclic.csv"
    columns = {"Stroke (in)": y / 0.0254, "Load (kip)": elastoplastic(y) / 4448.2216}
    return table(place, columns, "%.17g")


def cyclic(path, **choices) -> MeasuredData:
    channels = {"s1": "Stroke", "r1": "Load"}
    return measured(path, **{"channels": channels, **choices})


def slow(path, said: bool | None) -> MeasuredData:
    return cyclic(path, channels=None, units={"time": "s"}, quasi_static=said)


@pytest.mark.parametrize("state", [None, "rest"])
def test_a_test_without_a_clock_is_cut_at_the_end_of_a_cycle(path, state):
    data = cyclic(path, initial_state=state)
    (train,), (test,) = data.records["train"], data.records["test"]
    assert float(train.s_dot.abs().max()) == 0.0
    assert abs(train.samples - 6.75 * PER_CYCLE) <= 2  # the largest cycle is seen once
    assert float(test.s[train.samples :].abs().max()) <= 1.02 * float(train.s.abs().max())
    assert (test.samples, test.warmup) == (8 * PER_CYCLE, train.samples)  # in one memory
    notes = " ".join(" ".join([k, *v]) for k, v in data.notes.items())
    assert "quasi-static" in notes
    assert "s_dot1" not in notes  # no sensor that is to be checked: no file holds it


def test_what_has_no_rates_has_no_damper_and_the_rest_goes_on_in_mid_loop(path):
    data = cyclic(path)
    (test,) = data.records["test"]
    element = HystereticElement(1, 2, data.dt, hinges=0, units=1, cubic=False)
    element.identify(data.loader("train"))
    assert "r1.damping" not in [p.name for p in element.physical_parameters()]
    laws = element.laws
    laws.start(*(torch.tensor([v], dtype=torch.float64) for v in (4.2e7, 0.0, 8e-3)), (0.5, 0.5))
    for c, value in ((laws.unit_stiffness, 4e7), (laws.unit_limit, 2.25e-3)):
        c.unit.fill_(value)  # of both parts: k, and what is lost of it
    laws.unit_stiffness.theta.data.fill_(1.0)
    missed = (element.run_of(test).a - test.a)[test.warmup :]
    assert float(missed.norm() / test.a[test.warmup :].norm()) < 0.01


def test_a_clock_is_not_listened_to_where_the_test_is_said_to_be_quasi_static(tmp_path):
    y = 1e-3 * cycles([1, 2, 2])
    columns = {"time": 5.0 * np.arange(len(y)), "s1": y, "r1": elastoplastic(y)}
    path = table(tmp_path / "slow.csv", columns, "%.17g")
    rates = [slow(path, said).records["train"][0].s_dot.abs().max() for said in (None, True)]
    assert float(rates[0]) > 0.0
    assert float(rates[1]) == 0.0


@pytest.mark.parametrize(
    ("amplitudes", "offset", "end"),
    [
        ([1, 2, 3, 4], 0.0, 2.75),  # nothing covers the last: all others train
        ([1, 1, 4, 4], 0.0, 2.75),
        ([4, 3, 2, 2, 1, 1], 0.0, 2.75),  # near the middle, where all would do
        ([1, 1, 4, 4], 1.0, 2.75),  # one way only
    ],
)
def test_the_cut_is_a_valley_behind_the_largest_motion(amplitudes, offset, end):
    y = cycles(amplitudes, offset) + 1e-3 * np.random.default_rng(1).standard_normal(
        PER_CYCLE * len(amplitudes)
    )
    assert abs(end_of_a_cycle(y, 0.5) - end * PER_CYCLE) <= 3
    assert len(valleys(y)) == len(amplitudes)


def test_what_has_no_cycles_is_cut_by_time():
    assert end_of_a_cycle(np.linspace(0.0, 1.0, 100), 0.5) is None
