"""Named laws of a chain some of whose floors have no sensor."""

from __future__ import annotations

import copy
import csv
import math
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from rich.console import Console
from torch import Tensor

import evaluate
import predict
from data.inspect.command import model_for
from data.record import Drive, Record
from data.sample import Sensors
from data.simulation.laws.bilinear import Bilinear
from data.simulation.motion import simulate
from data.simulation.structure import Structure
from export.modes import modes_of
from export.names import motion_of
from export.opensees import _ends
from live.__main__ import main as live
from models import ElementNetwork, element_network_named
from models.checkpoint import load_estimator, save_estimator
from models.element_network_named import ElementNetworkNamed
from models.experiment import Model
from models.fit.ensemble import Ensemble
from models.fit.progress import limited
from models.named_laws import alike
from models.named_laws.alike import SIZES, Search
from models.named_laws.candidates import CANDIDATES
from models.named_laws.differences import Differences
from models.named_laws.free_run import FreeRuns, Laws, blend
from models.named_laws.information import (
    SCATTER,
    Information,
    drifts,
    prior,
    require_modes,
    sizes,
)
from models.named_laws.likely import laws_about, step_without, steps_by_noise
from models.stored.run import read_run
from models.uncertainty.drifts import storeys_of
from report.page import write_page
from report.prediction.interface import BASE, Interface
from report.prediction.motions import Motion
from report.prediction.predict import draw_one
from report.prediction.runs import Runner
from report.run.summary import label_of
from report.run.table import print_again
from report.sensors.__main__ import main as place_sensors
from runner.selection.candidates import candidates
from tests.program.test_train import finished_run, run

DT, SAMPLES = 0.02, 400
MASSES, STIFFNESS, YIELDS = (2e4, 1.8e4, 1.5e4), (1.6e7, 1.4e7, 9e6), (0.006, 0.003, 0.004)
PAIRS = (("ground", "x1"), ("x1", "x2"), ("x2", "x3"))


def structure(heavier: float = 1.0, longer: float = 1.0) -> Structure:
    """Three storeys; in other units of mass and length, times stay as they are."""
    parts = zip(PAIRS, STIFFNESS, YIELDS, strict=True)
    elements = {
        f"r{i}": Bilinear(
            between=pair, stiffness=heavier * k, yield_displacement=longer * y,
            post_yield_stiffness=0.05 * heavier * k, damping=0.003 * heavier * k,
            post_yield_damping=0.003 * heavier * k,
        )
        for i, (pair, k, y) in enumerate(parts, start=1)
    }  # fmt: skip
    return Structure([heavier * m for m in MASSES], elements)


def shaken(of: Structure, seed: int, longer: float = 1.0) -> tuple[Tensor, Tensor, np.ndarray]:
    """f = −s̈ (T, 1), accelerations against the ground (T, 3), drifts of the storeys (T, 3)."""
    white = np.random.default_rng(seed).standard_normal(SAMPLES)
    smooth = np.convolve(white, np.hanning(8), mode="same")
    f = 3.0 * longer * smooth / np.abs(smooth).max() * np.linspace(0.0, 1.0, SAMPLES) ** 0.5
    motion = simulate(of, f[:, None] * np.array(of.masses), DT)
    return torch.from_numpy(f[:, None]), torch.from_numpy(motion.a), motion.y


def record(floors: list[int], seed: int = 1, noise: float = 0.0, longer: float = 1.0) -> Record:
    f, a, _ = shaken(structure(longer=longer), seed, longer)
    drawn = torch.randn(SAMPLES, 4, generator=torch.Generator().manual_seed(seed)).double()
    ground = noise * f.std() * drawn[:, :1]
    seen = a[:, [i - 1 for i in floors]]
    return Record(DT, seen + noise * seen.std() * drawn[:, floors] + ground, f + ground)


def network(floors: list[int], *laws: str, heavier: float = 1.0) -> ElementNetworkNamed:
    masses = [heavier * m for m in MASSES]
    built = ElementNetwork(
        3, 1, DT, elements="chain", masses=masses, forced="base", laws=list(laws), sensors=floors
    )
    assert isinstance(built, ElementNetworkNamed)
    return built


@cache
def identified(noise: float = 0.02) -> ElementNetworkNamed:
    """By the ground and the roof alone."""
    model = network([3], "Bilinear", "HardeningSpring")
    facts = model.identify([record([3], noise=noise)])
    assert facts["laws"] == "Bilinear, Bilinear, Bilinear"
    assert facts["sensors_do_not_determine"] == ""
    return model


def drive(f: Tensor, channels: int = 1) -> Drive:
    rest = torch.zeros(channels, dtype=torch.float64)
    return Drive(DT, f, rest, rest)


def peaks(model: ElementNetworkNamed, f: Tensor) -> np.ndarray:
    return model.trace(drive(f)).deformations.abs().amax(dim=0).numpy()


def test_roof_alone_tells_the_drift_of_every_storey_and_how_sure_it_is() -> None:
    f, _, y = shaken(structure(), seed=9)
    true = np.abs(y).max(axis=0)
    assert (true > 1.2 * np.array(YIELDS)).all()
    np.testing.assert_allclose(peaks(identified(), f), true, rtol=0.04)
    rows = storeys_of(identified(), drive(f))
    assert [row["element"] for row in rows] == ["r1 ground–x1", "r2 x1–x2", "r3 x2–x3"]
    peak, half = np.array([[r["peak"], r["peak_half"]] for r in rows], dtype=float).T
    assert (np.abs(peak - true) < 2.0 * half).all()  # of three, all within four deviations
    assert (half < 0.2 * true).all()


def test_masses_that_are_uncertain_widen_the_intervals_until_they_hold() -> None:
    f, _, y = shaken(structure(), seed=9)
    true, said, off = np.abs(y).max(axis=0), [0.0, 0.1], []
    for within in said:
        model = ElementNetwork(
            3, 1, DT, "chain", [1.1 * MASSES[0], 0.9 * MASSES[1], 1.1 * MASSES[2]], "base",
            laws=["Bilinear"], sensors=[3], masses_within=within,
        )  # fmt: skip
        assert isinstance(model, ElementNetworkNamed)
        model.identify([record([3], noise=0.005)])
        rows = storeys_of(model, drive(f))
        peak, half = np.array([[r["peak"], r["peak_half"]] for r in rows], dtype=float).T
        off.append((np.abs(peak - true) / half).max())
        found = model.mass().numpy() / model.known_masses.numpy()
        assert (np.abs(np.log(found)) <= 2.0 * within).all()
        drawn = np.log([laws.masses for laws in model.likely()])
        spread = drawn.std(axis=0)
        assert (spread < 1.5 * within + 1e-12).all()
        assert (spread > 0.3 * within).all() or not within
    assert off[1] < 1.5 < 2.0 < off[0]


def test_masses_are_pulled_by_what_is_known_of_them_and_fitted_at_last() -> None:
    search, found = search_of(identified(), record([3], noise=0.02))
    pull = search._pull(found, 0.1)
    np.testing.assert_allclose(pull[-4:-1] / pull[0], (SCATTER / found.within) ** 2)
    np.testing.assert_allclose(pull[-1], pull[0])  # of the masses' damping
    linear = search.linear()
    assert found.learned
    assert not linear.learned
    np.testing.assert_array_equal(linear.masses, found.masses)


def test_a_base_pulls_at_the_masses_of_the_structure_that_runs() -> None:
    f = shaken(structure(), seed=8)[0]
    heavy = Structure([1.3 * MASSES[0], 0.8 * MASSES[1], MASSES[2]], structure().elements)
    (run,) = identified().motions_of(heavy, drive(f))
    np.testing.assert_allclose(run.y, simulate(heavy, f.numpy() * heavy.masses, DT).y)


def test_intervals_grow_with_the_noise_of_the_ground() -> None:
    f = shaken(structure(), seed=8)[0]
    quiet, loud = copy.deepcopy(identified()), copy.deepcopy(identified())
    quiet.noise_of_ground.zero_()
    loud.noise_of_ground.fill_(0.3)
    of_both = [storeys_of(model, drive(f)) for model in (quiet, loud)]
    for less, more in zip(*of_both, strict=True):
        assert more["peak_half"] > 1.5 * less["peak_half"]
    found = [float(row["peak"]) for row in of_both[0]]
    np.testing.assert_allclose(found, peaks(quiet, f), rtol=1e-12)


def test_a_jackknife_is_the_fit_without_the_block() -> None:
    rng = np.random.default_rng(0)
    J, y = rng.standard_normal((60, 4)), rng.standard_normal(60)
    whole, rest = (np.linalg.lstsq(J[k:], y[k:])[0] for k in (0, 20))
    step = step_without(J[:20], (J @ whole - y)[:20], np.linalg.inv(J.T @ J))
    np.testing.assert_allclose(step, rest - whole, rtol=1e-9)


def search_of(model: ElementNetworkNamed, seen: Record) -> tuple[Search, Laws]:
    runs = FreeRuns(model._shakings([seen]), model._output)
    found = model.found_laws()
    return Search(runs, found, [3], 0), found


def weak(scale: float) -> Record:
    """Of the roof, under a ground motion that is so many times as large."""
    f = scale * shaken(structure(), seed=1)[0]
    roof = simulate(structure(), f.numpy() * np.array(MASSES), DT).a[:, 2:]
    noisy = roof + 0.02 * roof.std() * np.random.default_rng(0).standard_normal(roof.shape)
    return Record(DT, torch.from_numpy(noisy), f)


@cache
def hardly_yielding() -> tuple[Search, Laws, dict[str, Any]]:
    """The search, the laws and the facts of a motion in which the second storey alone yields."""
    model, seen = network([3], "Bilinear"), weak(0.36)
    facts = model.identify([seen])
    return *search_of(model, seen), facts


def test_draws_of_strengths_that_are_hardly_reached_stay_likely() -> None:
    search, found, _ = hardly_yielding()
    found = search.judge(found)
    far = [search.judge(laws).error for laws in search.likely(search.information(found), 32)]
    assert np.median(far) < 1.1 * found.error
    assert max(far) < 10.0 * found.error  # 40 times as far where none is halved


def test_a_strength_that_is_open_narrows_no_stiffness() -> None:
    search, found, _ = hardly_yielding()
    known = search.information(found)
    k = [[sizes(fit)[0] for fit in laws.fits] for laws in [found, *search.likely(known, 32)]]
    spread = np.sqrt(np.mean(np.log(np.array(k[1:]) / k[0]) ** 2, axis=0))
    expected = np.sqrt(
        np.einsum("ep,pq,eq->e", known.of_sizes[0], known.covariance, known.of_sizes[0])
    )
    np.testing.assert_allclose(spread / expected, 1.0, atol=0.5)


def test_a_number_that_may_not_grow_narrows_no_other() -> None:
    """Of draws in whose one half the misfit is far larger than the slopes say."""
    rng, laws = np.random.default_rng(0), Laws([], np.ones(2), [], True, 1.0, "")
    J, left = 1e-2 * np.eye(8, 3), 1e-2 * np.eye(8)[7]

    class Bent(FreeRuns):
        def residuals(self, laws: Laws, share: float = 1.0) -> np.ndarray:
            z = laws.numbers
            return left + J @ z + 10.0 * max(float(z[0]), 0.0) * np.eye(8)[6]

    known = Information(laws, left, 1e-6, J, 1e-12 * np.eye(3))
    steps = rng.standard_normal((200, 3))
    drawn = np.array([one.numbers for one in laws_about(known, Bent([], np.array), steps, 0)])
    assert (drawn[:, 0] < 0.1).all()
    np.testing.assert_allclose(drawn[:, 1:].std(axis=0), 1.0, atol=0.2)


def test_noise_of_the_ground_is_as_large_as_the_residual_says() -> None:
    rng, J = np.random.default_rng(0), np.zeros((4000, 2))
    J[:, 0], J[:, 1] = np.sin(np.arange(4000) / 9.0), np.cos(np.arange(4000) / 9.0)
    drawn = rng.standard_normal((65, 4030))
    smooth = np.array([np.convolve(row, np.ones(31) / 31.0, "valid") for row in drawn])
    white = 0.1 * rng.standard_normal((65, 4000))
    left = white[0] + 3.0 * smooth[0]
    known = Information(
        Laws([], np.ones(1), [], False, 0.0, ""), left, left.var(), J, 1e6 * np.eye(2)
    )
    steps = steps_by_noise(known, 1, white[1:], smooth[1:])
    np.testing.assert_allclose(
        steps, (white[1:] + 3.0 * smooth[1:]) @ J @ np.linalg.inv(J.T @ J), rtol=0.2, atol=1e-3
    )


def test_draws_are_about_as_likely_and_numbers_of_storeys_differ_less_than_they_vary() -> None:
    search, found = search_of(identified(), record([3], noise=0.02))
    found = search.judge(found)
    n = found.numbers.size + 6
    far = [search.judge(laws).error for laws in search.likely(search.information(found), 32)]
    assert np.median(far) < 1.1 * found.error
    assert max(far) < 1.5 * found.error
    W, law = prior(found), found.fits[0].candidate
    several = len(law.parameters)
    for i, span in enumerate(law.at([1.0] * several) - law.at([0.0] * several)):
        one, two = 6 + i, 6 + several + i
        assert W[one, two] == pytest.approx(span**2)
        assert W[one, one] - W[one, two] == pytest.approx(SCATTER**2)
    assert W.shape == (n, n)


def test_directions_have_the_covariance_of_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """And change the drifts independently of each other, the first of them most."""
    monkeypatch.setattr(alike, "TIMES", 8)
    search, found = search_of(identified(), record([3], noise=0.02))
    known = search.information(found)
    ways = search.directions(known, 32)
    rng = np.random.default_rng(1)
    steps = np.vstack([search._steps(known, 64, rng) for _ in range(4)])
    prior_part = known.covariance @ np.linalg.inv(known.W) @ known.covariance
    expected = known.of_sizes @ (steps.T @ steps / len(steps) + prior_part)
    expected = np.einsum("sep,sep->se", expected, known.of_sizes)
    k = np.log([[sizes(fit) for fit in laws.fits] for laws in [found, *ways]])
    spread = np.square(k[1:] - k[0]).sum(axis=0).T
    np.testing.assert_allclose(spread[0], expected[0], rtol=0.4)
    for way in ways:
        both = [way, blend(found, [way], np.array([-1.0]))]
        likelier, other = (np.linalg.norm(search.runs.residuals(one)) for one in both)
        assert likelier <= other * (1.0 + 1e-9)
    motion = search.runs.shakings[0]
    y = [drifts(PAIRS, search.runs.run(laws, motion), motion).ravel() for laws in [found, *ways]]
    moved = np.array(y[1:]) - y[0]
    lengths = np.linalg.norm(moved, axis=1)
    assert (lengths[:4] > 0.7 * lengths[1:5]).all()
    assert lengths[0] > 10.0 * lengths[-1]
    cosines = (moved @ moved.T / np.outer(lengths, lengths))[:4, :4] - np.eye(4)
    assert np.abs(cosines).max() < 0.3


def test_chains_start_stronger_below() -> None:
    search, _ = search_of(identified(), record([3]))
    linear = search.linear()
    search.units = search.units_of(linear)
    first, second = (
        search.starts(linear, CANDIDATES["Takeda"], 8, seed).members for seed in (0, 1)
    )
    for start in first:
        assert (np.diff([fit.units.slope for fit in start.fits]) <= 0.0).all()
    assert not any(np.allclose(one.numbers, other.numbers) for one in first for other in second)


def test_laws_race_on_the_motion_that_a_linear_structure_follows_worst() -> None:
    """Which need not be the one with the largest acceleration."""
    model = identified()
    search, _ = search_of(model, record([3], noise=0.02))
    spike = replace(record([3]), f=20.0 * record([3]).f, a=20.0 * record([3]).a)
    laws = search.linear()
    linear = FreeRuns(model._shakings([spike]), model._output)
    own = linear.run(laws, linear.shakings[0])
    followed = replace(linear.shakings[0], target=model._output(own))
    search.runs = FreeRuns([followed, *search.runs.shakings], model._output)
    assert np.abs(followed.target).max() > 5.0 * np.abs(search.runs.shakings[1].target).max()
    assert search.runs.hardest(laws).shakings == [search.runs.shakings[1]]


def test_a_linear_chain_has_the_frequency_of_small_motions() -> None:
    """By a motion whose last nine tenths of the energy come from a softer structure."""
    search, _ = search_of(identified(), weak(4.0))
    found = search.linear().structure().natural_frequencies()
    assert found[0] == pytest.approx(structure().natural_frequencies()[0], rel=0.03)


@pytest.mark.parametrize("law", ["BoucWen", "SlackBrace", "Maxwell"])
def test_every_law_starts_as_stiff_as_small_motions_are(law: str) -> None:
    """A brace that is slack, and a dashpot, leave all of the stiffness to the spring beside."""
    search, _ = search_of(identified(), record([3], noise=0.02))
    linear = search.linear()
    search.units = search.units_of(linear)
    for chain in search.starts(linear, CANDIDATES[law], 2, 0).members:
        fit = chain.fits[0]
        elements = fit.candidate.elements(fit.q, fit.units)
        stiffness = sum(element.tangent()[0] for element in elements)
        assert 0.69 < stiffness / search.units.slope < 1.41


def test_a_law_has_a_second_ensemble(monkeypatch: pytest.MonkeyPatch) -> None:
    search, _ = search_of(identified(), record([3], noise=0.02))
    linear = search.linear()
    search.units = search.units_of(linear)
    first, *_ = search.starts(linear, CANDIDATES["Bilinear"], 8, 0).members
    fits = [replace(fit, units=fit.units.scaled(1.0, 20.0)) for fit in first.fits]
    far_off = Ensemble([replace(first, fits=fits)])  # slopes do not tell at what it would yield
    left = search.best_chain(far_off, linear).error
    monkeypatch.setattr(alike, "ENSEMBLES", 2)
    assert search.best_chain(far_off, linear).error < 0.05 < 0.5 * left


def test_the_nearest_law_is_taken_where_none_leaves_noise() -> None:
    facts = network([3], "HardeningSpring", "Linear").identify([record([3], noise=0.02)])
    errors = [pair.rpartition(" ") for pair in facts["error_percent"].split(", ")]
    of_law = {law: float(error) for law, _, error in errors}
    assert len(of_law) == 2
    assert of_law[facts["laws"].split(", ")[0]] == min(of_law.values())


def harder_below() -> Structure:
    harder = structure()
    first = replace(harder.elements["r1"], post_yield_stiffness=0.3 * STIFFNESS[0])
    return Structure(list(MASSES), {**harder.elements, "r1": first})


def ratios_of(model: ElementNetworkNamed) -> list[float]:
    storeys = [vars(model.named_elements(e)[0]) for e in range(3)]
    return [values["post_yield_stiffness"] / values["stiffness"] for values in storeys]


@cache
def harder_below_identified() -> ElementNetworkNamed:
    """A law of many parameters is tried where no other is."""
    f, a, _ = shaken(harder_below(), seed=1)
    model = network([1, 3], "Bilinear")
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(element_network_named, "SIZES", (1, 2))
        model.identify([Record(DT, a[:, [0, 2]], f)])
    return model


def test_storeys_differ_where_the_motion_says_so() -> None:
    model, f = harder_below_identified(), shaken(harder_below(), seed=1)[0]
    assert ratios_of(model) == pytest.approx([0.3, 0.05, 0.05], rel=0.1)
    simulated = simulate(harder_below(), f.numpy() * np.array(MASSES), DT).a[:, [0, 2]]
    np.testing.assert_allclose(model.free_run(drive(f, 2)).a, simulated, atol=0.05)


@pytest.mark.parametrize("white", [False, True])
def test_the_last_fit_draws_about_its_end_whether_or_not_what_is_left_is_white(
    monkeypatch: pytest.MonkeyPatch, white: bool
) -> None:
    drawn = []
    monkeypatch.setattr(Differences, "jump", lambda _, draws, rng: drawn.append(draws))
    monkeypatch.setattr(FreeRuns, "leave_noise", lambda *_: white)
    search, found = search_of(identified(), record([3], noise=0.02))
    search.fit(search.judge(found), math.inf)
    numbers = 3 * len(CANDIDATES["Bilinear"].parameters) + 3 + 1  # masses, and their damping
    assert drawn == [alike.MORE_DRAWS * numbers]  # noise hides wrong valleys


def test_storeys_are_alike_where_the_prior_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    model, ratios = harder_below_identified(), {}
    f, a, _ = shaken(harder_below(), seed=1)
    search, found = search_of(model, Record(DT, a[:, [0, 2]], f))
    first = found.fits[0].q
    even = replace(found, fits=[replace(fit, q=first) for fit in found.fits])
    even = search.judge(replace(even, alike=SIZES))
    for scatter in (alike.SCATTER, 1e-6):
        monkeypatch.setattr(alike, "SCATTER", scatter)
        fits = search.fit(even, math.inf).fits
        values = [fit.candidate.values(fit.q, fit.units)["hardening_ratio"] for fit in fits]
        ratios[scatter] = np.ptp(values)
    assert ratios[1e-6] < 1e-3 < 0.1 < ratios[SCATTER]


def test_commands_tell_what_all_storeys_suffer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    f, a, y = shaken(structure(), seed=1)
    strain = 1e6 * (0.35 * y[:, 1] - 0.1 * y[:, 2])
    columns = np.column_stack([DT * np.arange(SAMPLES), -f, a[:, 2:] - f, strain])
    for name in ("one", "two"):
        head = "time [s],s_ddot1 [m/s^2],a3 [m/s^2],strain1 [microstrain]"
        np.savetxt(tmp_path / f"{name}.csv", columns, delimiter=",", header=head, comments="")
    words = ["data=measured", f"data.path={tmp_path}", "data.train=[one]", "data.test=[two]"]
    words += ["figures=false", "baselines=none"]
    words += ["model=element_network", "model.laws=[Bilinear]", f"model.masses={list(MASSES)}"]
    words.append("model.rows.strain1={drift2: 0.35, drift3: -0.1}")
    folder = finished_run(tmp_path / "run", *words, "model.heights=3.5")
    metrics, printed = read_run(folder).metrics, [capsys.readouterr().out]
    assert metrics["identification"]["sensors_do_not_determine"] == ""
    assert metrics["identification"]["error_of_other_channels_percent"] < "strain1 1"
    rows = metrics["uncertainty"]["drifts"]
    assert [row["element"] for row in rows] == 3 * ["r1 ground–x1", "r2 x1–x2", "r3 x2–x3"]
    records = list(dict.fromkeys(row["record"] for row in rows))
    assert records == ["one", "two", "two, by its sensors"]  # of training, its sensors were used
    for free, near, true in zip(rows[3:6], rows[6:], np.abs(y).max(axis=0), strict=True):
        assert near["peak_half"] < 0.5 * free["peak_half"] + 1e-3 * true
        assert near["peak"] == pytest.approx(true, abs=near["peak_half"] + 2e-3 * true)
    assert {row["height"] for row in rows} == {3.5}
    again, other = tmp_path / "again", [f"data.path={tmp_path / 'two.csv'}"]
    motion = ["figures=false", f"excitation.path={tmp_path / 'one.csv'}", f"output={again}"]
    with pytest.MonkeyPatch.context() as monkeypatch:
        for command, more in ((evaluate, other), (predict, motion)):
            assert run(command, monkeypatch, f"run={folder}", *more) == 0
            printed.append(capsys.readouterr().out)
    for text in printed:
        assert "storeys ± 95 %, " in text
        assert str(100.0 * rows[0]["peak"] / 3.5)[:4] in text
        assert "of the storey's height" in text
        assert max(len(line) for line in text.splitlines() if "┃" in line) <= 80
    files = [*folder.rglob("storeys.csv"), again / "storeys.csv"]
    assert len(files) == 3
    tables = [list(csv.DictReader(file.read_text("utf-8").splitlines())) for file in files]
    for table in tables:
        assert float(table[2]["peak [mm]"]) == pytest.approx(1e3 * rows[2]["peak"], rel=1e-3)
    assert len(list(folder.rglob("storeys.png"))) == 1  # of the evaluation
    page = write_page(folder).read_text("utf-8")
    assert "storeys ± 95 %, one" in page
    assert "peak drifts; the table has their numbers" in page
    capsys.readouterr()
    place_sensors([f"run={folder}", "count=1"])
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("│")]
    assert sum("present" in line for line in lines) == 1
    assert len(lines) == 4  # three floors, all
    assert (folder / "sensors" / "sensors.png").is_file()
    estimates, replay = tmp_path / "made.csv", ["--replay", str(tmp_path / "two.csv")]
    with pytest.raises(SystemExit) as ended:
        live([*replay, "--speed", "inf", "--run", str(folder), "--output", str(estimates)])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert re.search(r"largest so far \[mm\]: \S+ ± \S+, \S+ ± \S+, \S+ ± \S+\n", text)
    assert re.search(r", by noise alone \d\.\d %, ", text)
    assert "outside the trained range" not in text
    other = tmp_path / "other.csv"
    other.write_text((tmp_path / "two.csv").read_text("utf-8").replace("a3", "a2"), "utf-8")
    with pytest.raises(SystemExit) as ended:
        live(["--replay", str(other), "--speed", "inf", "--run", str(folder)])
    assert ended.value.code == 1
    assert "identified on the DOFs [3], the records are of [2]" in capsys.readouterr().err
    columns[:, 1:] *= 1.5
    np.savetxt(other, columns, delimiter=",", header=head, comments="")
    with pytest.raises(SystemExit):
        live(["--replay", str(other), "--speed", "inf", "--run", str(folder)])
    text = capsys.readouterr().out
    assert "outside the trained range: 1.5 × the largest ground acceleration (2.7 m/s²" in text
    assert "× the largest deformation of " in text
    three = ",".join(str(tmp_path / f"{name}.csv") for name in ("one", "two", "other"))
    likely = ["samples=4", "limits.drift=[0.1 %,0.035 m]", f"excitation.path=[{three}]"]
    with pytest.MonkeyPatch.context() as monkeypatch:
        assert run(predict, monkeypatch, f"run={folder}", *likely, *motion[::2]) == 0
    text = capsys.readouterr().out
    assert "draws: 4 laws that are as likely, of 4 asked for" in text
    assert all(words in text for words in ("drift > 0.1 %", "3 motions and 4 draws"))
    table = np.genfromtxt(estimates, delimiter=",", names=True)
    for e in range(3):
        assert np.abs(table[f"drift{e + 1}"]).max() == pytest.approx(rows[e]["peak"], rel=0.02)


def test_the_picture_of_a_motion_has_the_drifts_of_all_storeys() -> None:
    f, model = shaken(structure(), seed=7)[0], identified()
    motion = Motion("quake", DT, {"s_ddot1": -f[:, 0].numpy()})
    predicted = Runner(model, Interface(BASE), "acceleration", {}, storeys=True)(motion, 1.0)
    drawn = draw_one(predicted, model, "")["history"].axes
    (drifts,) = (axes for axes in drawn if axes.get_ylabel() == "drift\n[m]")
    sizes = [np.abs(np.asarray(line.get_ydata())).max() for line in drifts.lines]
    np.testing.assert_allclose(sizes, peaks(model, f))


def test_what_a_fit_leaves_open_is_said() -> None:
    *_, facts = hardly_yielding()
    words = "the strength of storeys 1, 3, which is hardly or never reached"
    assert facts["sensors_do_not_determine"] == words
    console = Console(width=200, record=True)
    scores = {"total_percent": 1.0, "per_dof_percent": [1.0]}
    names = dict.fromkeys(("model", "system", "scenario"), "some")
    metrics = {**names, "test": scores, "identification": facts}
    print_again(console, metrics, [])
    assert f"the sensors do not determine: {words}" in console.export_text()
    assert label_of("sensors_do_not_determine") == "the sensors do not determine"


def test_other_units_change_nothing() -> None:
    longer, heavier, f = 1000.0, 1e-3, shaken(structure(), seed=7)[0]
    model = network([3], "Bilinear", "HardeningSpring", heavier=heavier)
    model.identify([record([3], noise=0.02, longer=longer)])
    found = peaks(model, longer * f) / longer
    np.testing.assert_allclose(found, peaks(identified(), f), rtol=1e-3)


def test_without_masses_they_count_as_equal() -> None:
    model = ElementNetwork(
        3, 1, DT, elements="chain", forced="base", laws=["Bilinear"], sensors=[3]
    )
    with limited(0.0):
        facts = model.identify([record([3])])
    assert facts["masses"] == "taken as equal"
    assert model.scale_is_open
    assert model.masses() is None


def test_noise_of_the_ground_is_no_misfit() -> None:
    noisy, model = record([3], noise=0.1), network([3], "Bilinear")
    model.identify([noisy])
    search, found = search_of(model, noisy)
    assert search.judge(found).leaves_noise
    assert not search.runs.leave_noise(found)  # a structure answers noise of the ground smoothly
    weaker = [replace(fit, units=fit.units.scaled(1.0, 0.7)) for fit in found.fits]
    assert not search.judge(replace(found, fits=weaker)).leaves_noise


def test_draws_are_stored(tmp_path: Path) -> None:
    save_estimator(identified(), tmp_path / "model.safetensors", "named")
    model = network([3], "Bilinear", "HardeningSpring")
    load_estimator(model, tmp_path / "model.safetensors", "named")
    assert len(list(model.likely())) == 32
    assert torch.equal(model.drawn, identified().drawn)
    assert not list(network([1, 2, 3], "Bilinear").likely())


def test_outputs_are_those_with_a_sensor_and_modes_of_all_floors() -> None:
    model = identified()
    modes = modes_of(model)
    assert modes is not None
    shapes = modes.shapes.real
    assert (np.diff(shapes[:, 0]) > 0.0).all()  # of the first mode, upwards
    M, _, K = model.structure().linearised()
    left = K @ shapes - M @ shapes * (2.0 * np.pi * modes.frequencies) ** 2
    assert np.abs(left).max() < 1e-2 * np.abs(K @ shapes).max()
    f = shaken(structure(), seed=7)[0]
    assert model.free_run(drive(f)).a.shape == (SAMPLES, 1)


def test_exports_have_all_floors() -> None:
    assert next(names for _, names, _ in motion_of(identified())) == ["x1", "x2", "x3"]
    assert [_ends(identified(), e) for e in range(3)] == list(PAIRS)


@pytest.mark.parametrize("floors", [[], [2, 1], [1, 1], [0, 3], [4]])
def test_numbers_that_are_no_floors_are_refused(floors: list[int]) -> None:
    with pytest.raises(ValueError, match="ascending numbers"):
        network(floors, "Bilinear")


def test_what_cannot_be_identified_is_refused() -> None:
    seen, rest = record([3]), {"dofs": 3, "inputs": 1, "dt": DT, "sensors": [3]}
    with pytest.raises(
        ValueError, match=r"DOFs 1, 2 of 3 have no sensor: choose model\.laws=named or units"
    ):
        ElementNetwork(**rest, elements="chain", forced="base", laws="branch")
    with pytest.raises(ValueError, match="give 3 masses"):
        ElementNetwork(**rest, elements="chain", forced=[3], laws="named").identify([seen])
    still = replace(seen, f=0.0 * seen.f)
    with pytest.raises(ValueError, match="zero throughout"):
        network([3], "Bilinear").identify([still])
    with pytest.raises(ValueError, match="x3 do not move against the ground"):
        network([3], "Bilinear").identify([replace(seen, a=0.0 * seen.a)])


def test_more_storeys_than_modes_tell_are_refused_at_once() -> None:
    """400 samples with ten cycles of the first mode: no mode has more than thirty times as many."""
    chain = ElementNetwork(
        200, 1, DT, elements="chain", forced="base", laws="named", sensors=[3, 200]
    )
    seen = record([2, 3])
    with pytest.raises(
        ValueError, match=r"model\.dofs=200: 400 samples every 0\.02 s show 10 modes"
    ):
        chain.identify([seen])
    for floors, sensors in ((5, 1), (12, 1), (50, 4)):
        require_modes(floors, sensors, DT, SAMPLES)


def built(dofs: int | None, laws: str, *channels: str) -> ElementNetwork:
    values = {"name": "network", "_target_": "models.ElementNetwork", "laws": laws, "dofs": dofs}
    sensors = Sensors(DT, len(channels) - 1, 1, "base", channels=channels)
    model = Model("model", {**values, "forced": None}).estimator(sensors)
    assert isinstance(model, ElementNetwork)
    return model


def test_channels_say_which_floors_have_a_sensor() -> None:
    assert built(None, "named", "s_ddot1", "a2", "a5").hidden == [1, 3, 4]
    assert built(6, "named", "s_ddot1", "a2", "a5").hidden == [1, 3, 4, 6]
    assert built(None, "named", "s_ddot1", "a1", "a2").hidden == []
    with pytest.raises(ValueError, match=r"model\.dofs=4: there is a sensor on DOF 5 \(a5\)"):
        built(4, "named", "s_ddot1", "a2", "a5")
    with pytest.raises(ValueError, match=r"DOFs 1, 3, 4 of 5 have no sensor"):
        built(None, "branch", "s_ddot1", "a2", "a5")


def test_commands_take_the_model_that_can_do_without_a_sensor() -> None:
    channels = ("s_ddot1", "a2", "a5")
    tried = {one.name for one in candidates(channels, DT)}
    assert "element_network, named" in tried
    assert not tried & {"element_network, units", "element_network, branch"}
    words = ["model=element_network", "model.laws=named"]
    assert model_for({c: c for c in channels}) == words
