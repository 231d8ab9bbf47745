"""Pull and release: nothing drives the motion, and its first state is measured or unknown."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.linalg import expm

from data.measured.datamodule import MeasuredData
from models.element_network import ElementNetwork
from models.element_network_named import ElementNetworkNamed
from tests.data.odd_files import table
from tests.experiments import measured

DT = 0.01
K, C = np.array([[900.0, -400.0], [-400.0, 400.0]]), 0.002  # per kg; C of K


def ring_down(pulled: tuple[float, float]) -> np.ndarray:
    """x, v, a (T, 6) of two storeys that are let go at these displacements [m]."""
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-K, -C * K]])
    step, states = expm(DT * A), [np.array([*pulled, 0.0, 0.0])]
    for _ in range(599):
        states.append(step @ states[-1])
    z = np.array(states)
    return np.concatenate([z, (z @ A.T)[:, 2:]], axis=1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two ring-downs in mm, mm/s and g, with 0.5 % of noise; the second was held for 0.4 s."""
    place, rng = tmp_path_factory.mktemp("free"), np.random.default_rng(0)
    names = ["time [ms]", "x1 [mm]", "x2 [mm]", "v1 [mm/s]", "v2 [mm/s]", "a1 [g]", "a2 [g]"]
    factor = np.repeat([1e3, 1e3, 1.0 / 9.80665], 2)
    for number, pulled in enumerate([(0.02, 0.03), (0.025, 0.02)], start=1):
        rows = ring_down(pulled)
        rows += 0.005 * rows.std(axis=0) * rng.standard_normal(rows.shape)
        if number == 2:
            held = np.concatenate([np.repeat([pulled], 40, axis=0), np.zeros((40, 4))], axis=1)
            rows = np.concatenate([held, rows])
        columns = [1e3 * DT * np.arange(len(rows)), *(rows * factor).T]
        signals = dict(zip(names, columns, strict=True))
        table(place / f"free{number}.csv", signals, "%.17g")
    return place


def heard(folder, *signals: str) -> MeasuredData:
    columns = {f"{s}{i}": f"{s}{i}" for s in signals for i in (1, 2)}
    units = {"time": "ms", "x": "mm", "v": "mm/s", "a": "g"}
    return measured(folder, channels={"time": "time", **columns}, units=units)


@pytest.mark.parametrize("signals", ["xva", "a"])
def test_a_ring_down_needs_no_excitation_and_no_first_state(folder, signals):
    data = heard(folder, *signals)
    assert (data.inputs, data.forced) == (0, [])
    (test,) = data.records["test"]
    assert test.samples == 600  # from where it was let go
    assert test.initial_state == ("given" if signals == "xva" else "unknown")
    network = ElementNetwork(2, 0, data.dt, forced=[], from_accelerations=signals == "a")
    network.identify(data.loader("train"))
    stiffness = network.small_motion()[0].detach()
    found = np.sqrt(np.sort(np.linalg.eigvals(stiffness.numpy()).real))
    assert found == pytest.approx(np.sqrt(np.linalg.eigvalsh(K)), rel=0.01)
    with torch.no_grad():
        errors = (network.run_of(test).a - test.a)[test.warmup :]
    assert float(errors.norm() / test.a[test.warmup :].norm()) < 0.1


def test_what_nothing_drives_and_does_not_ring_down_is_refused_with_a_remedy(tmp_path):
    motion = np.random.default_rng(1).standard_normal(500)
    path = table(tmp_path / "wind.csv", {"time": DT * np.arange(500), "a1": motion})
    with pytest.raises(ValueError, match=r"does not ring down.*data\.initial_state=unknown"):
        measured(path)
    data = measured(path, initial_state="unknown")
    assert data.records["train"][0].initial_state == "unknown"
    assert data.inputs == 0


def test_named_laws_begin_at_rest_and_say_what_does_not():
    with pytest.raises(ValueError, match=r"model\.laws=units"):
        ElementNetworkNamed(1, 0, DT)
