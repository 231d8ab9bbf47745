"""Change detectors: run lengths, planted changes, thresholds, causality, streams, localisation."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.signal import lfilter
from scipy.stats import chi2

from benchmarks.changed import SIZE, model_of, record_of, structure
from data import Polynomial
from data.record import Record
from data.sample import Sample, samples_of
from data.simulation.damage import StiffnessLoss
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.records import Simulation
from data.simulation.scenario import FullState
from data.simulation.structure import Structure
from models import ElementNetwork, NeuralStateSpace
from models.detection import (
    Alarm,
    CumulativeSum,
    Detector,
    HighPass,
    Monitor,
    ResidualLevel,
    WeightDistance,
    WeightDrift,
    conformal_threshold,
    first_alarm,
    residual_blocks,
    siegmund,
    weight_blocks,
)
from models.estimator import Parameter
from models.linear import EquivalentLinear
from models.online.adaptive import Online
from models.online.laws.recursive_least_squares import RecursiveLeastSquares
from models.uncertainty.change import Change, by_holm, compare, refit
from models.uncertainty.change import _differences as differences
from models.uncertainty.change import _Fit as Fit

EVERY = 50


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(shape, generator=generator, dtype=torch.float64)


def test_the_mean_run_length_of_the_cusum_is_siegmunds():
    """In steps of a CUSUM of independent normal z, from zero to the first alarm."""
    detector, runs = CumulativeSum(0.5), 2000
    memory, length, alive = None, torch.zeros(runs), torch.ones(runs, dtype=torch.bool)
    generator = torch.Generator().manual_seed(1)
    while alive.any():
        z = torch.randn(runs, 1, generator=generator, dtype=torch.float64)
        memory, _ = detector.add(memory, z)
        length += alive
        alive &= memory[0, :, 0] <= 3.0
    expected = siegmund(0.5, 3.0)
    assert float(length.mean()) == pytest.approx(expected, rel=0.08)
    assert float(length.mean()) > 50.0


def test_siegmunds_formula_at_published_values():
    """Montgomery, Introduction to Statistical Quality Control, Sect. 9.1: κ = 1/2, both sides."""
    assert siegmund(0.5, 5.0) == pytest.approx(938.2, rel=1e-4)  # his own example of the formula
    assert siegmund(0.5, 4.0) / 2 == pytest.approx(168.0, rel=0.01)  # table of exact lengths
    assert siegmund(0.5, 5.0) / 2 == pytest.approx(465.0, rel=0.01)


def test_a_change_of_energy_is_found_after_the_number_of_looks_it_takes():
    """A lasting rise of z by δ passes a level h after about h/(δ − κ) blocks."""
    sound = noise(40, 200, EVERY, 2)
    detector = CumulativeSum(slack=0.5)
    detector.learn(sound)
    changed = noise(1, 200, EVERY, 2, seed=5)
    factor = float(torch.exp(0.5 * 2.0 * detector.sigma[0]))  # of DOF 1: z rises by 2
    changed[0, 100:, :, 0] *= factor
    statistic = detector.statistics(changed)[0]
    beyond = torch.nonzero(statistic[100:, 0] > 12.0)
    assert int(beyond[0]) + 1 == pytest.approx(12.0 / 1.5, abs=3)
    assert float(statistic[:100].max()) < 12.0
    assert float(statistic[:, 1].max()) < 12.0


def test_distances_of_gaussian_weights_are_those_of_chi_squared():
    mixing = noise(6, 6, seed=3)

    def weights(records: int, seed: int) -> torch.Tensor:
        return torch.stack([noise(records, 100, 6, seed=seed + i) @ mixing for i in range(2)], -1)

    detector = WeightDistance(ridge=0.0)
    detector.learn(weights(200, 10) + 7.0)
    distance = detector.statistics(weights(100, 20) + 7.0)
    for i in range(2):
        for q in (0.1, 0.5, 0.95):
            squared = distance[..., i].square().flatten()
            assert float(squared.quantile(q)) == pytest.approx(chi2.ppf(q, 6), rel=0.03)


@pytest.mark.parametrize(("records", "rate"), [(19, 0.05), (38, 0.1)])
def test_the_threshold_keeps_its_rate_whatever_the_distribution(records, rate):
    """Heavy-tailed peaks; over many calibrations the share is 1 − j/(m + 1)."""
    peaks = noise(20000, records + 1, seed=2).abs() ** 3
    thresholds = torch.tensor([conformal_threshold(p[:-1], rate) for p in peaks])
    share = float((peaks[:, -1] > thresholds).double().mean())
    exact = 1.0 - np.ceil((records + 1) * (1.0 - rate) - 1e-9) / (records + 1)
    assert exact <= rate + 1e-12
    assert share == pytest.approx(exact, abs=4.0 * np.sqrt(exact / 20000))


DETECTORS = {
    "level": lambda: ResidualLevel(settle=3),
    "cumulative_sum": lambda: CumulativeSum(settle=3),
    "distance": lambda: WeightDistance(settle=3),
    "drift": lambda: WeightDrift(settle=3),
}


@pytest.fixture(params=DETECTORS)
def calibrated(request) -> Detector:
    """On coloured noise, five columns of 'residuals' or 'weights' a block."""
    coloured = lfilter([1.0], [1.0, -0.6], noise(80, 40, 5, 3).numpy(), axis=1)
    detector = DETECTORS[request.param]()
    detector.calibrate(torch.from_numpy(coloured[:50]), torch.from_numpy(coloured[50:]), 0.05)
    return detector


@pytest.mark.parametrize(
    ("detector", "channel", "value", "dof"),
    [
        (ResidualLevel(), 1, 0.0, "2"),  # a sensor that is silent
        (CumulativeSum(), 1, 0.0, "2"),
        (CumulativeSum(slack=50.0), 1, 1.0, "1, 2"),
        (ResidualLevel(settle=20), 1, 1.0, "1, 2"),  # all of each record
        (ResidualLevel(), 0, math.nan, "1"),
    ],
)
def test_a_threshold_of_what_never_speaks_is_refused(detector, channel, value, dof):
    """It would be NaN, which nothing exceeds."""
    blocks = noise(40, 20, 5, 2)
    blocks[..., channel] *= value
    with pytest.raises(ValueError, match=f"statistic of DOF {dof} is zero or not finite"):
        detector.calibrate(blocks[:20], blocks[20:], 0.05)
    assert detector.usual is None


def test_no_level_depends_on_what_comes_later(calibrated):
    blocks = noise(1, 40, 5, 3, seed=9)
    changed = blocks.clone()
    changed[:, 25:] = 50.0
    before, after = calibrated.levels(blocks), calibrated.levels(changed)
    assert torch.equal(before[:, :25], after[:, :25])
    assert (after[:, 25] > before[:, 25]).all()


def test_nothing_is_said_before_it_has_settled(calibrated):
    levels = calibrated.levels(100.0 * noise(1, 40, 5, 3, seed=9))
    assert (levels[:, :3] == 0.0).all()
    assert calibrated.alarm(100.0 * noise(40, 5, 3, seed=9)).block == 3


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: CumulativeSum(slack=-0.1), "slack=-0.1"),
        (lambda: WeightDrift(slack=float("nan")), "slack=nan"),
        (lambda: WeightDistance(ridge=-1.0), "ridge=-1.0"),
        (lambda: ResidualLevel(settle=-1), "settle=-1"),
        (lambda: HighPass(60.0, 0.01), "Nyquist frequency 50 Hz"),
        (lambda: conformal_threshold(torch.rand(18), 0.05), "18 sound records.*at least 19"),
        (lambda: conformal_threshold(torch.rand(18), float("nan")), "rate=.*between 0 and 1"),
        (lambda: ResidualLevel().levels(noise(3, 5, 2)), "not calibrated"),
        (lambda: Monitor(WeightDrift(), 10), "not calibrated"),
    ],
)
def test_what_has_no_meaning_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


# A frame of linear springs: the equivalent linear system is the truth, weights have known values


@pytest.fixture(scope="module")
def frame() -> Simulation:
    ends = {"r1": ("s1", "x1"), "r2": ("x1", "x2"), "r3": ("x2", "x3")}
    springs = {
        name: Polynomial(between=nodes, stiffness=400.0, damping=1.5)
        for name, nodes in ends.items()
    }
    excitation = Excitation(force=BandLimitedGaussian(2.0, (0.0, 8.0)))
    structure = Structure([1.0, 1.0, 1.0], springs)
    return Simulation(structure, excitation, FullState(), 0.01, 30.0)


def noisy(record: Record, seed: int) -> Record:
    return replace(record, a=record.a + 0.05 * noise(*record.a.shape, seed=seed))


@pytest.fixture(scope="module")
def motions(frame) -> dict[str, list[Record]]:
    """Training motions, sound test motions, and test motions that lose r2 at 15 s."""
    hurt = replace(frame, damage=StiffnessLoss("r2", 15.0, 0.2))
    drawn = {
        "train": frame.records("train", 31, 0)[0],
        "sound": frame.records("test", 4, 0)[0],
        "damaged": hurt.records("test", 4, 0)[0],
    }
    return {
        split: [noisy(r, 100 * j + i) for i, r in enumerate(records)]
        for j, (split, records) in enumerate(drawn.items())
    }


def adaptive(record: Record) -> Online:
    """With a memory of 2 s."""
    law = RecursiveLeastSquares(forgetting=1.0 - 0.01 / 2.0)
    online = Online(3, 3, 0.01, EquivalentLinear(3, 3, 0.01), law)
    online.identify([record])
    return online


@pytest.mark.parametrize("kind", [WeightDistance, WeightDrift])
def test_a_loss_is_found_soon_and_points_to_the_dofs_it_joins(motions, kind):
    online, detector = adaptive(motions["train"][0]), kind(settle=10)
    train = weight_blocks(online, motions["train"][1:], EVERY)
    detector.calibrate(train[:11], train[11:], 0.05)
    damaged = detector.levels(weight_blocks(online, motions["damaged"], EVERY))
    for record in damaged:
        alarm = first_alarm(record, start=30)
        assert alarm is not None
        assert alarm.block < 30 + 6  # 3 s
        assert alarm.dof in (1, 2)
        assert set(record[-1].argsort()[1:].tolist()) == {0, 1}
        assert float(record[-1, :2].min()) > 3.0 * float(record[-1, 2])
    sound = detector.levels(weight_blocks(online, motions["sound"], EVERY))
    assert torch.equal(sound[:, :29], damaged[:, :29]) is False  # other sensor noise
    assert int((sound.amax(dim=(1, 2)) > 1.0).sum()) <= 2


def test_sample_by_sample_gives_the_alarms_of_the_whole_record(motions):
    online, high_pass = adaptive(motions["train"][0]), HighPass(0.5, 0.01)
    record = motions["damaged"][0].window(0, 2400)
    filtered = [HighPass(0.5, 0.01).record(r) for r in motions["train"]]
    expected, monitors = [], []
    for kind, blocks in ((WeightDrift, weight_blocks), (CumulativeSum, residual_blocks)):
        detector, train = kind(settle=10), blocks(online, filtered[1:], EVERY)
        detector.calibrate(train[:11], train[11:], 0.05)
        monitors.append(Monitor(detector, EVERY))
        expected.append(detector.levels(blocks(online, [high_pass.record(record)], EVERY))[0])
    stream, sensor, alarms = online.stream(), HighPass(0.5, 0.01), [[], []]
    for sample in samples_of(record.measured()):
        now = sensor.sample(sample)
        residual = now.a - stream.step(now)
        for monitor, own in zip(monitors, alarms, strict=True):
            own += [alarm] if (alarm := monitor.step(residual, stream.weights[0])) else []
    for monitor, own, levels in zip(monitors, alarms, expected, strict=True):
        torch.testing.assert_close(monitor.level, levels[-1], rtol=1e-6, atol=1e-9)
        first = first_alarm(levels)
        assert (own[0].block, own[0].dof) == (first.block, first.dof)


def test_weights_are_those_after_each_block_however_features_are_made(motions, monkeypatch):
    record = motions["sound"][0]
    online = Online(3, 3, 0.01)
    online.identify([motions["train"][0]])
    whole = weight_blocks(online, [record], EVERY)
    monkeypatch.setattr("models.vwnn.CHUNK", 256)
    torch.testing.assert_close(weight_blocks(online, [record], EVERY), whole)


def test_one_bad_sample_does_not_deafen_the_filter():
    sensor, damaged = HighPass(1.0, 0.01), HighPass(1.0, 0.01)
    signal = noise(400, 2)
    heard = []
    for k, a in enumerate(signal):
        bad = a.clone()
        bad[0] = math.nan if k == 100 else a[0]
        nothing = torch.zeros(1, dtype=torch.float64)
        heard.append([s.sample(Sample(nothing, own)).a for s, own in ((sensor, a), (damaged, bad))])
    first, second = (torch.stack(signals) for signals in zip(*heard, strict=True))
    assert torch.equal(first[:, 1], second[:, 1])
    assert second[100, 0].isnan()
    assert float((first - second)[300:].abs().max()) < 1e-3


def test_the_filter_stops_what_is_slow_and_knows_no_future(frame):
    (record,), _ = frame.records("train", 1, 3)
    sensor = HighPass(1.0, 0.01)
    drifting = replace(record, x=record.x + 5.0)
    settled = slice(500, None)
    drift = (sensor.record(drifting).x - sensor.record(record).x)[settled]
    assert float(drift.abs().max()) < 1e-6
    late = replace(record, a=record.a.clone())
    late.a[2000:] = 1e3
    assert torch.equal(sensor.record(late).a[:2000], sensor.record(record).a[:2000])


@pytest.mark.parametrize("missing", [None, torch.full((3,), torch.nan).double()])
def test_missing_samples_neither_alarm_nor_deafen(missing):
    """A whole block is missing, and part of another; what follows is found as without."""
    detector = CumulativeSum()
    detector.calibrate(noise(50, 40, EVERY, 3), noise(30, 40, EVERY, 3, seed=1), 0.05)
    residuals = noise(40 * EVERY, 3, seed=2)
    residuals[30 * EVERY :, 1] *= 2.0
    gap = range(10 * EVERY - 7, 12 * EVERY + 7)
    whole, holed = Monitor(detector, EVERY), Monitor(detector, EVERY)
    alarms: dict[Monitor, list[Alarm]] = {whole: [], holed: []}
    for k, residual in enumerate(residuals):
        for monitor in alarms:
            seen = missing if monitor is holed and k in gap else residual
            alarms[monitor] += [alarm] if (alarm := monitor.step(seen)) else []
    assert [a.block for a in alarms[holed]] == [a.block for a in alarms[whole]]
    assert alarms[holed][0].block in range(30, 36)
    assert alarms[holed][0].dof == 2


def test_a_fall_of_the_energy_is_found_as_well():
    detector = CumulativeSum()
    detector.learn(noise(40, 200, EVERY, 1))
    quieter = noise(1, 200, EVERY, 1, seed=5)
    quieter[0, 100:] *= 0.7
    statistic = detector.statistics(quieter)[0, :, 0]
    assert float(statistic[199]) > 10.0 * float(statistic[:100].max())


# Comparisons of before and after: what changed is found and placed, and nothing else is


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
