"""Displacements and storey drifts beside accelerations, of a chain with hidden floors."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from data import WholeRecords
from data.inspect.command import model_for
from data.measured.channels import beside
from data.measured.mend import Mending
from data.record import Record
from data.sample import Sensors, samples_of
from data.simulation.scenario import FullState
from data.stream import SampleLines
from live.source import lines_of
from models import ElementNetwork
from models.baselines import TwoPoint
from models.element_network_named import ElementNetworkNamed
from models.named_laws.free_run import FreeRuns, Laws, Shaking, blend
from models.online import drift_stream
from models.online.drift_stream import DriftStream, smoothed
from models.uncertainty.drifts import storeys_by_sensors
from tests.models.test_hidden_floors import (
    DT,
    MASSES,
    SAMPLES,
    built,
    peaks,
    record,
    shaken,
    structure,
)

NOISE, ZERO, WIRE = 0.02, 0.08, 4e-4  # of accelerations; of a drift [m]
WIRES = {"drift3": {"drift2": 1.0, "drift3": 1.0}}


def sensed(channels: list[str], seed: int = 1, longer: float = 1.0, wire: float = WIRE) -> Record:
    """The roof, with displacements and drifts that have a zero of their own [m]."""
    y = shaken(structure(longer=longer), seed, longer)[2]
    rng, x, columns = np.random.default_rng(seed), np.cumsum(y, axis=1), []
    for name in channels:
        own = x if name[0] == "x" else y
        noise = wire * rng.standard_normal(SAMPLES) + ZERO
        long = name in WIRES  # it spans two storeys
        columns.append(y @ [0.0, 1.0, 1.0] if long else own[:, int(name[-1]) - 1])
        columns[-1] = columns[-1] + longer * noise
    o = torch.from_numpy(np.stack(columns, axis=1))
    return replace(record([3], seed, NOISE, longer), o=o, others=tuple(channels))


def network(
    channels: list[str], sensors: Sequence[int] = (3,), rows: Mapping[str, Any] | None = None
) -> ElementNetworkNamed:
    model = ElementNetwork(
        3, 1, DT, elements="chain", masses=list(MASSES), forced="base", laws=["Bilinear"],
        sensors=sensors, others=channels, rows=rows,
    )  # fmt: skip
    assert isinstance(model, ElementNetworkNamed)
    return model


@cache
def wired() -> tuple[ElementNetworkNamed, dict[str, str]]:
    model = network(["drift2"])
    return model, model.identify([sensed(["drift2"])])


def test_a_drift_tells_its_zero_its_noise_and_how_well_it_is_simulated() -> None:
    model, facts = wired()
    f, _, y = shaken(structure(), seed=7)
    np.testing.assert_allclose(peaks(model, f), np.abs(y).max(axis=0), rtol=0.04)
    name, zero, unit = facts["zeros_of_sensors"].split()
    assert (name, unit) == ("drift2", "mm")
    assert float(zero) == pytest.approx(1e3 * ZERO, abs=0.3)
    assert float(model.noise_of_sensors[1]) == pytest.approx(WIRE, rel=0.1)
    assert model.noise_of_sensors[0] == pytest.approx(model.noise_of_ground)
    seen = sensed(["drift2"]).o
    share = 100.0 * WIRE / float(seen.std())
    assert float(facts["error_of_other_channels_percent"].split()[1]) == pytest.approx(
        share, rel=0.2
    )


def test_other_units_change_nothing() -> None:
    longer, f = 1000.0, shaken(structure(), seed=7)[0]
    model = network(["drift2"])
    heavier = torch.tensor(MASSES, dtype=torch.float64) / longer
    model.known_masses = heavier  # forces stay as they are
    model.identify([sensed(["drift2"], longer=longer)])
    np.testing.assert_allclose(peaks(model, longer * f) / longer, peaks(wired()[0], f), rtol=2e-3)


def test_a_wire_over_two_storeys_and_all_floors_join_a_fit() -> None:
    f, a, y = shaken(structure(), seed=1)
    x = torch.from_numpy(np.cumsum(y, axis=1))
    v = torch.from_numpy(np.gradient(x.numpy(), DT, axis=0))
    far = replace(sensed(["drift3"]), a=a, x=x, v=v)
    model = network(["drift3"], sensors=[1, 2, 3], rows=WIRES)
    facts = model.identify([far])
    share = 100.0 * WIRE / float(far.o.std())
    told = facts["error_of_other_channels_percent"].split()
    assert told[0] == "drift3"
    assert float(told[1]) == pytest.approx(share, rel=0.2)
    assert model.noise_of_sensors[3] == pytest.approx(WIRE, rel=0.1)
    assert len(list(model.likely())) == 32
    np.testing.assert_allclose(peaks(model, f), np.abs(y).max(axis=0), rtol=0.01)


class Planted(FreeRuns):
    """Runs that are known."""

    def _run(self, *_: object) -> np.ndarray:
        return np.asarray(self.output(None))  # type: ignore[arg-type]


@pytest.mark.parametrize("unit", [1.0, 1e3])
def test_sensors_count_by_their_noise_whatever_their_unit(unit: float) -> None:
    rng = np.random.default_rng(0)
    slow, other = rng.standard_normal((2, 20000))
    slow, other = (np.convolve(u, np.hanning(50), mode="same")[:, None] for u in (slow, other))
    size, noise = np.array([1.0, 1.0, unit, unit]), np.array([0.1, 0.1, 0.3 * unit, 0.3 * unit])
    drawn = noise * rng.standard_normal((20000, 4))
    runs = Planted([planted(slow * size + drawn)], lambda _: slow * size)
    kinds, some = ["", "", "x", "x"], Laws([], np.ones(1), [], False, 0.0, "ground")
    np.testing.assert_allclose(runs.weighed(kinds).scale, size, rtol=0.05)
    weighed = runs.weighed(kinds, some)
    np.testing.assert_allclose(weighed.scale, [1.0, 1.0, 3.0 * unit, 3.0 * unit], rtol=0.1)
    weighed = Planted(weighed.shakings, weighed.output)  # all in the unit of the first kind
    np.testing.assert_allclose(weighed.left(some).std(axis=0), 0.1, rtol=0.1)
    drawn[:, 2:] = noise[2:] * other / other.std()  # as large, and as slow as what was measured
    slower = Planted([planted(slow * size + drawn)], lambda _: slow * size)
    assert (slower.weighed(kinds, some).scale[2:] > 2.0 * 3.0 * unit).all()


def planted(target: np.ndarray) -> Shaking:
    return Shaking(DT, *[target[:, :1]] * 4, target=target, v=target, loose=2)


def test_a_noisy_displacement_does_no_harm_and_its_zero_within_the_noise_is_not_told() -> None:
    f, _, y = shaken(structure(), seed=7)
    model = network(["x3"])
    assert model.identify([sensed(["x3"], wire=0.1)])["zeros_of_sensors"] == ""
    np.testing.assert_allclose(peaks(model, f), np.abs(y).max(axis=0), rtol=0.04)


def test_displacements_alone_tell_drifts() -> None:
    noisy = sensed(["x3", "drift1"])
    alone = replace(
        noisy, a=noisy.o[:, :1], o=noisy.o[:, 1:], others=("drift1",), quantity="displacement"
    )
    model = network(["drift1"])
    model.identify([alone])
    f, _, y = shaken(structure(), seed=7)
    np.testing.assert_allclose(peaks(model, f), np.abs(y).max(axis=0), rtol=0.04)
    assert float(model.noise_of_ground) < 0.05 * float(f.std())
    with pytest.raises(ValueError, match="give it accelerometers"):
        model.stream()


def followed(seen: Record, model: ElementNetworkNamed) -> tuple[np.ndarray, DriftStream]:
    stream, rows = model.stream(), []
    for sample in samples_of(seen):
        stream.step(sample)
        rows.append(stream.drifts[:2])
    return np.array(rows), stream


def test_drifts_on_line_are_nearer_with_a_wire_and_without_one_as_before() -> None:
    model, y = copy.deepcopy(wired()[0]), shaken(structure(), seed=8)[2]
    fine = 0.02 * WIRE
    model.noise_of_sensors[1] = fine
    seen = sensed(["drift2"], seed=8, wire=fine)
    (near, stream), (far, _) = (
        followed(one, model) for one in (seen, replace(seen, o=None, others=()))
    )
    errors = [np.linalg.norm(rows[:, 0, 1] - y[:, 1]) for rows in (near, far)]
    assert errors[0] < 0.5 * errors[1]
    assert near[-200:, 1, 1].mean() < 0.5 * far[-200:, 1, 1].mean()
    assert float(stream.filter.s[len(stream.filter.A) + 1]) == pytest.approx(ZERO, abs=3.0 * fine)
    gone = replace(seen, o=torch.where(torch.arange(SAMPLES)[:, None] < 100, seen.o, torch.nan))
    rows, stream = followed(gone, model)
    assert np.isfinite(rows).all()
    assert not stream.filter.diverged


def test_what_does_not_fit_is_refused() -> None:
    for wrong in (["a2"], ["x4"], ["drift0"], ["drift"], ["strain1"]):
        with pytest.raises(ValueError, match=r"expected displacements x1 … x3 and drifts"):
            network(wrong)
    for rows, why in (
        ({"strain2": {"drift1": 1.0}}, r"model\.rows\.strain2: there is no such channel"),
        ({"strain1": {}}, r"expected weights of drifts"),
        ({"strain1": {"drift1": np.inf}}, r"expected weights of drifts"),
        ({"strain1": {"drift4": 1.0}}, r"drift4: expected displacements x1 … x3 and drifts"),
    ):
        with pytest.raises(ValueError, match=why):
            network(["strain1"], rows=rows)
    with pytest.raises(ValueError, match="built with others="):
        network(["drift1"]).identify([sensed(["drift2"])])
    still = sensed(["drift2"])
    with pytest.raises(ValueError, match="drift2 does not change"):
        network(["drift2"]).identify([replace(still, o=0.0 * still.o)])
    with pytest.raises(ValueError, match="one name for each"):
        replace(still, others=())
    base = {"dofs": 3, "inputs": 2, "dt": DT, "elements": "chain", "forced": [], "laws": "named"}
    with pytest.raises(ValueError, match="against a support that moves"):
        ElementNetwork(**base, sensors=[3], others=["drift1"])
    source = Sensors(DT, 1, 1, "base", channels=["a3"])
    with pytest.raises(ValueError, match="identified with drift2 beside accelerations"):
        source.check(wired()[0])


def test_channels_beside_accelerations_say_floors() -> None:
    assert built(None, "named", "s_ddot1", "a2", "drift4").floors == 4
    assert Sensors(DT, 1, 1, "base", channels=["a2", "x5", "drift6"]).highest == 6
    channels = ["s_ddot1", "a2", "x5", "drift1"]
    assert beside(channels, "acceleration") == ["x5", "drift1"]
    assert beside(["a1", "x1"], "acceleration") == []
    assert beside(["a2", "x2"], "acceleration") == ["x2"]
    assert beside(["x2", "drift2"], "displacement") == ["drift2"]
    words = ["model=element_network", "model.laws=named"]
    assert model_for({c: c for c in ("s_ddot1", "a1", "x3")}) == words
    assert model_for({c: c for c in ("s_ddot1", "x3", "drift1")}) == words


def test_what_is_not_read_is_said(tmp_path: Path) -> None:
    sensors = Sensors(DT, 2, 1, "base", channels=["a1", "a2", "v2", "x2", "drift2"])
    assert sensors.unread(network(["x2", "drift2"])).keys() == {"not read: v2"}
    (left,) = sensors.unread(TwoPoint(2, 1, DT)).items()
    assert left[0] == "not read: v2, x2, drift2"
    assert "model.laws=named" in left[1][0]
    assert Sensors(DT, 2, 1, channels=["a1", "a2", "x1", "x2"]).unread(TwoPoint(2, 1, DT)) == {}
    assert isinstance(built(None, "units", "s_ddot1", "a1", "a2", "drift2"), ElementNetwork)
    named = built(None, "named", "s_ddot1", "a1", "a2", "drift2")
    assert (named.others, named.hidden) == (["drift2"], [])
    with pytest.raises(ValueError, match=r"model\.dofs=5: .* DOF 9 \(drift9\)"):
        built(5, "named", "s_ddot1", "a2", "drift9")
    path = tmp_path / "one.csv"
    path.write_text("time,s_ddot1,a3,drift0\n0,1,2,3\n1,2,3,4\n", "utf-8")
    with pytest.raises(ValueError, match="drift0 is no channel"):
        WholeRecords(str(path), FullState(), Mending())
    with (
        path.open("rb") as file,
        pytest.raises(ValueError, match="drift0 is no channel"),
    ):
        SampleLines(file, DT)


def test_files_and_lines_hold_them(tmp_path: Path) -> None:
    t = DT * np.arange(200)
    rows = np.column_stack([t, np.sin(t), np.cos(t), 50.0 + np.sin(t), np.cos(3.0 * t)])
    head = "time [s],s_ddot1 [g],a3 [m/s^2],drift2 [mm],x5 [cm]"
    path = tmp_path / "one.csv"
    np.savetxt(path, rows, delimiter=",", header=head, comments="")
    data = WholeRecords(str(path), FullState(), Mending())
    (seen,) = data.records["train"]
    assert seen.others == ("x5", "drift2")
    assert data.sensors.others == ["x5", "drift2"]
    np.testing.assert_allclose(seen.o.numpy(), rows[:, [4, 3]] * [1e-2, 1e-3])
    with path.open("rb") as file:
        lines = SampleLines(file, DT)
        assert lines.sensors.others == ["x5", "drift2"]
        samples = [sample for _, sample in lines]
    assert torch.equal(torch.stack([sample.o for sample in samples]), seen.o)
    (first, second, *_) = lines_of(seen, base=True, speed=np.inf)
    assert first == "t,s_ddot1,a3,x5,drift2"
    assert float(second.split(",")[4]) == pytest.approx(0.05)


def test_displacements_alone_begin_at_zero_behind_a_quiet_start(tmp_path: Path) -> None:
    t = DT * np.arange(1000)
    moved = np.where(t > 10.0, np.sin(5.0 * (t - 10.0)), 0.0)
    noise = 1e-4 * np.random.default_rng(0).standard_normal((2, 1000))
    path = tmp_path / "one.csv"
    rows = np.column_stack([t, moved + noise[0], 0.3 + 0.01 * (moved + noise[1])])
    np.savetxt(path, rows, delimiter=",", header="time,s_ddot1,x3", comments="")
    (seen,) = WholeRecords(str(path), FullState(), Mending()).records["train"]
    assert float(seen.a[:20].abs().max()) < 1e-5


def test_a_floor_may_stand_for_a_ground_that_was_not_recorded() -> None:
    """Of the storeys above it, whatever shook those below."""

    def above(seed: int) -> tuple[Record, np.ndarray]:
        f, a, y = shaken(structure(), seed)
        noisy = a - f
        drawn = torch.randn(SAMPLES, 3, generator=torch.Generator().manual_seed(seed)).double()
        noisy = noisy + NOISE * noisy.std(dim=0) * drawn
        base = noisy[:, :1]
        return Record(DT, noisy[:, 2:] - base, -base), np.abs(y[:, 1:]).max(axis=0)

    model = ElementNetwork(
        2, 1, DT, elements="chain", masses=list(MASSES[1:]), forced="base", laws=["Bilinear"],
        sensors=[2],
    )  # fmt: skip
    model.identify([above(1)[0]])
    seen, true = above(7)
    found = model.trace(seen.drive()).deformations.abs().amax(dim=0).numpy()
    np.testing.assert_allclose(found, true, rtol=0.05)


def test_laws_blend_from_the_fit_to_those_that_are_as_likely() -> None:
    model = wired()[0]
    fit, (one, *others) = model.found_laws(), list(model.likely())
    ends = np.eye(32)[0]
    for shares, expected in ((0.0 * ends, fit), (ends, one)):
        found = blend(fit, [one, *others], shares)
        np.testing.assert_allclose(found.numbers, expected.numbers)
        for own, known in zip(found.fits, expected.fits, strict=True):
            assert own.units.slope == pytest.approx(known.units.slope)
    half = blend(fit, [one, *others], 0.5 * ends).fits[0].units.slope
    assert half**2 == pytest.approx(fit.fits[0].units.slope * one.fits[0].units.slope)


def test_an_event_is_smoothed_again_about_the_laws_that_it_shows(monkeypatch) -> None:
    model, streams = wired()[0], []

    class Seen(DriftStream):
        def __init__(self, *args, **settings):
            super().__init__(*args, **settings)
            streams.append(self)

    monkeypatch.setattr(drift_stream, "DriftStream", Seen)
    smoothed(model, sensed(["drift2"], seed=8))
    first, second = streams
    assert not first.about.any()
    assert np.array_equal(second.about, first.filter.c)
    second._rest()  # as surely about the fit as before
    assert np.array_equal(second.filter.s[-len(second.about) :], -second.about)


def test_a_recorded_event_is_smoothed_with_its_wire() -> None:
    model = copy.deepcopy(wired()[0])
    squares, held = [], []  # of several events: the errors of one scatter
    for seed in (9, 8):
        y, seen = shaken(structure(), seed=seed)[2], sensed(["drift2"], seed=seed)
        free = model.trace(seen.drive()).deformations.numpy()
        smooth, half = smoothed(model, seen)
        squares.append([np.sum((found - y) ** 2) for found in (smooth, free)])
        held.append((np.abs(smooth - y) <= half).mean())
    after, before = np.sum(squares, axis=0)
    assert after < 0.6**2 * before
    assert min(held) > 0.8
    without = storeys_by_sensors(model, record([3], 8, NOISE))
    rows = storeys_by_sensors(model, seen)
    assert [row["peak"] for row in rows] == pytest.approx(np.abs(smooth).max(axis=0).tolist())
    assert rows[1]["residual_half"] < without[1]["residual_half"]
    assert {row["floor_acceleration"] for row in rows} == {None}
    short = replace(seen, a=seen.a[:200], f=seen.f[:200], o=seen.o[:200])
    more = replace(short, o=torch.cat([-short.o, short.o], -1), others=("drift3", "drift2"))
    assert storeys_by_sensors(model, more) == storeys_by_sensors(model, short) != []
    assert storeys_by_sensors(model, replace(short, a=3.0 * short.a)) == []
    model.noise_of_sensors.zero_()
    assert storeys_by_sensors(model, short) == []
