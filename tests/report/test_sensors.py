"""What sensors tell of a chain, what they leave open, and where they are placed best."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console
from scipy.signal import lsim

from data.record import Record
from data.simulation.laws.bilinear import Bilinear
from data.simulation.laws.candidate import Units
from data.simulation.laws.friction_pendulum import FrictionPendulum
from data.simulation.laws.menegotto_pinto import MenegottoPinto
from data.simulation.laws.polynomial import Polynomial
from data.simulation.motion import simulate
from models import ElementNetwork
from models.element_network_named import ElementNetworkNamed
from models.named_laws.alike import Search
from models.named_laws.candidates import CANDIDATES
from models.named_laws.fit import Fit
from models.named_laws.free_run import FreeRuns, Laws
from models.named_laws.information import Information, Plan, drifts, prior, slopes, undetermined
from report.sensors.__main__ import main
from report.sensors.placement import law_of, require_chain
from report.uncertainty.storeys import print_drifts
from tests.models.test_hidden_floors import MASSES, PAIRS, STIFFNESS, YIELDS

DT, SAMPLES = 0.02, 600


def ground(peak: float) -> np.ndarray:
    """−s̈ (T, 1) [m/s²]."""
    white = np.random.default_rng(1).standard_normal(SAMPLES)
    smooth = np.convolve(white, np.hanning(8), mode="same")
    return (peak * smooth / np.abs(smooth).max() * np.linspace(0.0, 1.0, SAMPLES) ** 0.5)[:, None]


def bilinear(k: float, y: float) -> Fit:
    """5 % of hardening, and a damper."""
    units = Units(y, 10.0 * y, k * y, k)
    q = [0.0, 0.0, math.log(0.05 / 0.95), math.log(0.003 * k / units.damping)]
    return Fit(CANDIDATES["Bilinear"], units, np.array(q))


def spring(k: float) -> Fit:
    units = Units(1.0, 10.0, k, k)
    return Fit(CANDIDATES["Linear"], units, np.array([0.0, math.log(0.004 * k / units.damping)]))


def motion(fits, masses, floors, peak=3.0, noise=0.0, seed=2) -> tuple[Laws, FreeRuns]:
    """A chain on a shaken base, and records of some of its floors; noise [m/s²]."""
    n, f = len(fits), ground(peak)
    hidden = {"sensors": floors} if len(floors) < n else {}
    model = ElementNetwork(
        n, 1, DT, "chain", masses=list(masses), forced="base", laws="named", **hidden
    )
    assert isinstance(model, ElementNetworkNamed)
    laws = Laws(fits, np.array(masses), model.elements, False, 0.05, "ground")
    a = simulate(laws.structure(), f * np.array(masses), DT).a[:, [i - 1 for i in floors]]
    drawn = noise * np.random.default_rng(seed).standard_normal(a.shape)
    seen = Record(DT, torch.from_numpy(a + drawn), torch.from_numpy(f))
    return laws, model.runs_beside([seen])


def information(laws: Laws, runs: FreeRuns, floors) -> Information:
    return Search(runs, laws, floors, 0).information(laws)


def left_open(fits, masses, floors, peak=3.0, noise=0.02) -> list[str]:
    laws, runs = motion(fits, masses, floors, peak, noise)
    return undetermined(information(laws, runs, floors), runs)


FRAME = [bilinear(k, y) for k, y in zip(STIFFNESS, YIELDS, strict=True)]


@cache
def plan(heavier: float = 1.0, longer: float = 1.0) -> Plan:
    fits = [bilinear(heavier * k, longer * y) for k, y in zip(STIFFNESS, YIELDS, strict=True)]
    masses = [heavier * m for m in MASSES]
    laws, runs = motion(fits, masses, [1, 2, 3], 3.0 * longer)
    return Plan(runs, laws, lambda a: 0.05 * a.std(axis=0))


def linear_sensitivities(k, c, alpha, masses) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations' slopes (T, n, P) and peak drifts' over the peaks (n, P), by ln of k, c, α.

    [x, ẋ] and their slopes are the state of one larger linear system.
    """
    n, m, f = len(masses), np.array(masses), ground(3.0)[:, 0]
    B = np.eye(n) - np.eye(n, k=-1)

    def system(k, c, alpha):
        K, C = (B.T * k) @ B / m[:, None], (B.T * c) @ B / m[:, None]
        return np.block([[np.zeros((n, n)), np.eye(n)], [-K, -C - alpha * np.eye(n)]])

    A, numbers = system(k, c, alpha), np.array([*k, *c, alpha])
    parts = [np.eye(2 * n + 1)[i] * numbers for i in range(2 * n + 1)]
    slopes_of_A = [
        system(p[:n], p[n : 2 * n], p[-1]) - system(0 * p[:n], 0 * p[:n], 0.0) for p in parts
    ]
    J, g = [], []
    for S in slopes_of_A:
        whole = np.block([[A, np.zeros_like(A)], [S, A]])
        push = np.concatenate([np.zeros(n), np.ones(n), np.zeros(2 * n)])[:, None]
        _, _, state = lsim((whole, push, np.eye(4 * n), 0 * push), f, DT * np.arange(SAMPLES))
        rates = state @ whole.T
        J.append(rates[:, 3 * n :])
        y, s = state[:, :n] @ B.T, state[:, 2 * n : 3 * n] @ B.T
        at = np.abs(y).argmax(axis=0)
        g.append(s[at, range(n)] / y[at, range(n)])
    return np.stack(J, axis=-1), np.stack(g, axis=-1)


@pytest.mark.parametrize("n", [2, 3])
def test_variance_of_a_linear_chain_is_the_analytic_one(n: int) -> None:
    k, masses, noise = np.array(STIFFNESS[:n]), MASSES[:n], 0.3
    laws, runs = motion([spring(one) for one in k], masses, [*range(1, n + 1)])
    found = Plan(runs, laws, lambda a: np.full(n, noise))
    J, g = linear_sensitivities(k, 0.004 * k, 0.05, masses)
    to_physical = np.zeros((2 * n + 1, 4 * n + 1))  # ln k, ln c, ln α by z
    for e in range(n):
        to_physical[[e, n + e], e] = 1.0
        to_physical[e, 2 * n + 2 * e] = to_physical[n + e, 2 * n + 2 * e + 1] = 1.0
    to_physical[-1, -1] = 1.0
    held = np.linalg.inv(to_physical @ prior(laws) @ to_physical.T)
    for floors in ([1], [n], [*range(1, n + 1)]):
        own = J[:, [i - 1 for i in floors]].reshape(-1, 2 * n + 1) / noise
        variance = np.diag(g @ np.linalg.inv(own.T @ own + held) @ g.T)
        expected = found.expected(floors).halves[0]
        np.testing.assert_allclose(expected, 1.96 * np.sqrt(variance), rtol=1e-3)


def test_expected_widths_are_those_of_fits() -> None:
    laws, runs = motion(FRAME, MASSES, [1, 2, 3])
    noise = 0.1
    expected = Plan(runs, laws, lambda a: np.full(3, noise))
    true, ratios = expected.peaks[0], []
    for floors in ([3], [1, 2]):
        for seed in range(4):
            laws, one = motion(FRAME, MASSES, floors, noise=noise, seed=seed)
            fitted = one.followed(laws, 1.0, 5, 1e-9)
            own = np.abs(drifts(laws.pairs, one.run(fitted, one.shakings[0]), one.shakings[0])).max(
                axis=0
            )
            ratios.append((own / true - 1.0) / (expected.expected(floors).halves[0] / 1.96))
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.5


def test_without_information_nothing_but_the_prior_counts() -> None:
    deaf = copy.copy(plan())
    deaf.information = [0.0 * A for A in deaf.information]
    expected = np.sqrt(np.einsum("rp,pq,rq->r", deaf.g, deaf.W, deaf.g)) / deaf.peaks[0]
    found = deaf.expected([1, 2])
    np.testing.assert_allclose(found.halves[0], 1.96 * expected, rtol=1e-9)
    assert found.bits == pytest.approx(0.0, abs=1e-9)


def test_more_sensors_never_tell_less() -> None:
    for floors in ([1], [2], [3], [1, 2], [1, 3], [2, 3]):
        some = plan().expected(floors)
        for more in {1, 2, 3} - set(floors):
            wider = plan().expected(sorted([*floors, more]))
            assert (wider.halves < some.halves).all()
            assert wider.bits > some.bits


def test_other_units_change_no_expectation() -> None:
    other = plan(heavier=1e-3, longer=1e3)
    for floors in ([3], [1, 2]):
        one, two = plan().expected(floors), other.expected(floors)
        np.testing.assert_allclose(one.halves, two.halves, rtol=1e-3)
        assert one.bits == pytest.approx(two.bits, abs=0.01)


def test_half_the_noise_halves_the_width_where_the_prior_is_weak() -> None:
    quiet = copy.copy(plan())
    quiet.information = [4.0 * A for A in quiet.information]
    ratio = quiet.expected([2, 3]).halves / plan().expected([2, 3]).halves
    np.testing.assert_allclose(ratio, 0.5, atol=0.05)


def test_noise_is_a_share_of_what_an_accelerometer_has_on_the_moving_floor() -> None:
    laws, f = Laws(FRAME, np.array(MASSES), [*PAIRS], False, 0.05, "ground"), ground(3.0)
    absolute = simulate(laws.structure(), f * np.array(MASSES), DT).a - f
    np.testing.assert_allclose(plan().noise, 0.05 * absolute.std(axis=0), rtol=1e-4)


def test_sets_are_ranked_and_many_are_built_floor_by_floor() -> None:
    found, whole = plan().sets(2)
    assert whole
    assert sorted(one.floors for one in found) == [(1, 2), (1, 3), (2, 3)]
    assert [one.size for one in found] == sorted(one.size for one in found)
    first = plan().sets(1)[0][0].floors
    many = copy.copy(plan())
    many.samples = 0
    greedy, whole = many.sets(2)
    assert not whole
    assert len(greedy) == 2
    assert all(set(first) < set(one.floors) for one in greedy)


def test_sensors_on_all_floors_of_a_yielding_frame_leave_nothing_open() -> None:
    assert left_open(FRAME, MASSES, [1, 2, 3]) == []
    assert left_open(FRAME, MASSES, [3]) == []


def test_strengths_that_no_motion_reaches_are_named_and_stiffness_is_determined() -> None:
    for floors in ([3], [1, 2, 3]):
        words = left_open(FRAME, MASSES, floors, peak=0.3, noise=0.002)
        assert words == ["the strength of storeys 1, 2, 3, which is hardly or never reached"]
    laws, runs = motion([spring(k) for k in STIFFNESS], MASSES, [3], noise=0.02)
    found = undetermined(information(laws, runs, [3]), runs)
    assert found == ["the strength of storeys 1, 2, 3, which is hardly or never reached"]


def test_storeys_above_the_highest_sensor_that_it_does_not_feel_are_named() -> None:
    fits = [*FRAME[:2], bilinear(4e7, 0.004), bilinear(4e7, 0.004)]
    assert left_open(fits, [2e4, 1.8e4, 50.0, 50.0], [2], noise=0.05) == [
        "the stiffness of storeys 3, 4",
        "the strength of storeys 3, 4, which is hardly or never reached",
    ]
    assert left_open([*FRAME, FRAME[2]], [*MASSES, MASSES[2]], [2]) == []  # these it feels


def test_storeys_without_a_mass_between_are_one_spring() -> None:
    fits = [bilinear(1.6e7, 0.006), bilinear(1.4e7, 0.004), bilinear(1.4e7, 0.004)]
    words = left_open(fits, [2e4, 20.0, 1.5e4], [3], noise=0.05)
    assert words[0] == "the stiffness of storeys 2, 3 other than as a sum"


def test_any_two_elements_of_another_structure_may_be_one_spring() -> None:
    """Two springs in series, elements 1 and 3, with next to no mass between them."""
    pairs = [["ground", "x2"], ["ground", "x1"], ["x2", "x3"]]
    masses = np.array([1.5e4, 20.0, 2e4])
    laws = Laws([bilinear(1.6e7, 0.006)] * 3, masses, pairs, False, 0.05, "ground")
    model = ElementNetwork(
        3, 1, DT, pairs, masses=masses.tolist(), forced="base", laws="named", sensors=[1, 3]
    )
    assert isinstance(model, ElementNetworkNamed)
    f = ground(3.0)
    a = simulate(laws.structure(), f * masses, DT).a[:, [0, 2]]
    drawn = 0.05 * np.random.default_rng(0).standard_normal(a.shape)
    runs = model.runs_beside([Record(DT, torch.from_numpy(a + drawn), torch.from_numpy(f))])
    words = undetermined(information(laws, runs, [1, 3]), runs, "element")
    assert words[0] == "the stiffness of elements 1, 3 other than as a sum"


def test_sensors_that_tell_of_no_storey_are_refused() -> None:
    with pytest.raises(ValueError, match="do not determine the stiffness of storeys 1, 2, 3 in"):
        left_open(FRAME, MASSES, [1], noise=1e4)


def test_storeys_of_one_law_share_what_is_known_of_it() -> None:
    mixed = [FRAME[0], spring(1e7), FRAME[2]]
    laws = Laws(mixed, np.array(MASSES), [], False, 0.05, "ground")
    W = prior(laws)
    assert len(W) == 6 + 4 + 2 + 4 + 1
    assert W[6, 12] == pytest.approx(math.log(12.0) ** 2)  # the yield points of both
    assert not W[6, 10:12].any()
    assert (np.linalg.eigvalsh(W) > 0.0).all()


def test_slopes_are_those_of_a_function_that_is_known() -> None:
    laws = Laws(FRAME, np.array(MASSES), [], False, 0.05, "ground")
    J = slopes(lambda laws: np.array([np.log(fit.units.slope) for fit in laws.fits]), laws)
    np.testing.assert_allclose(J[:, :3], np.eye(3), atol=1e-9)
    assert not J[:, 3:].any()


def test_storeys_of_a_structure_are_read_as_named_laws() -> None:
    own = {"between": ["x1", "x2"], "stiffness": 1e8, "hardening_ratio": 0.02}
    steel = MenegottoPinto(**own, yield_displacement=0.015, sharpness=18.0, a1=0.04, a3=0.04)
    damper = Polynomial(between=["x1", "x2"], stiffness=0.0, damping=3e5)
    found = law_of([damper, steel], Units(0.03, 0.1, 2e6, 1e8), "storey 2")
    (made,) = found.candidate.elements(found.q, found.units, own["between"])
    expected = replace(steel, damping=3e5)
    np.testing.assert_allclose(made.parameters, expected.parameters, rtol=1e-3)
    odd = FrictionPendulum(
        between=["x1", "x2"], weight=1.0, radius=2.0, friction_fast=0.07, friction_slow=0.03,
        rate=30.0, yield_displacement=1e-4,
    )  # fmt: skip
    with pytest.raises(ValueError, match="storey 1, of Bilinear and FrictionPendulum, is not"):
        law_of([odd, Bilinear(**_bilinear())], Units(0.03, 0.1, 2e6, 1e8), "storey 1")


def _bilinear() -> dict[str, object]:
    return {
        "between": ["x1", "x2"],
        "stiffness": 1e7,
        "yield_displacement": 0.01,
        "post_yield_stiffness": 1e6,
    }


def test_floors_of_a_structure_are_ranked_and_drawn(tmp_path: Path, capsys) -> None:
    words = ["data.duration=5", "data.train_records=1", "data.sensors=[3]"]
    main(["system=steel_frame", "count=2", *words, f"output={tmp_path}"])
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines()[:-1])) <= 80
    assert "noise 5 % of each floor's" in printed
    rows = [line for line in printed.splitlines() if line.startswith("│")]
    assert len(rows) == 5  # three pairs, the present one, all
    assert "present" in rows[3]
    assert "1–3" in rows[4]
    assert "all" in rows[4]
    assert (tmp_path / "sensors.png").is_file()


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("count=2", "run=FOLDER, or system=NAME"),
        ("system=steel_frame", "count=: how many floors"),
        ("system=steel_frame count=0", "count=0: how many"),
        ("system=steel_frame count=1 noise=-1", "noise=-1: expected a positive share"),
        ("system=steel_frame count=4 data.duration=2", "count=4: system=steel_frame has 3 floors"),
        ("system=bilinear count=1", "r3 joins x1 and x3"),
        ("run=nowhere count=1", "nowhere"),
    ],
)
def test_what_cannot_be_placed_is_refused_in_a_line(words: str, reason: str, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words.split())
    assert ended.value.code == 1
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1


def test_where_the_picture_goes_is_asked_before_the_work(
    tmp_path: Path, capsys, monkeypatch
) -> None:
    monkeypatch.setattr("report.sensors.placement.Plan", None)  # calling it would be another error
    (tmp_path / "file").write_text("")
    for words in (f"count=2 output={tmp_path / 'file'}", "count=4"):
        with pytest.raises(SystemExit):
            main(["system=steel_frame", "data.duration=2", *words.split()])
        error = capsys.readouterr().err
        assert "file: no folder that can be written to" in error or "has 3 floors" in error


def test_other_models_have_no_floors_to_choose() -> None:
    for laws, elements in (("units", "chain"), ("named", "all")):
        model = ElementNetwork(2, 2, DT, elements, laws=laws)
        with pytest.raises(ValueError, match="run=here: sensors are placed on a chain of named"):
            require_chain(model, "run=here", 1)


def test_a_drift_whose_interval_is_as_wide_as_itself_has_no_number() -> None:
    row = {"record": "quake", "residual": 0.0, "residual_half": 1e-3}
    drawn = [
        {**row, "element": "r1 ground–x1", "peak": 0.02, "peak_half": 0.001},
        {**row, "element": "r2 x1–x2", "peak": 0.02, "peak_half": 0.02},
    ]
    console = Console(width=80, record=True)
    print_drifts(console, {"drifts": drawn})
    first, second = (line for line in console.export_text().splitlines() if "quake" in line)
    assert "20.0 ± 1" in first
    assert "not determined" in second
    assert "20.0" not in second
