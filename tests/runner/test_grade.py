"""What a model may be used for: planted motions, and channels that follow from nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.signal import butter, lfilter

from data.record import Drive, Record, Response
from data.terminal import terminal
from models.estimator import Estimator
from models.fir import FIR
from models.vwnn import VWNN
from report.run.table import print_verdict
from runner.scores.grade import NOTHING, ONE_STEP, SIMULATES, Errors, Judged, grade_of
from runner.scores.verdict import compare_with, judgement

DT, T = 0.02, 2000
POLES = np.poly([0.9 * np.exp(0.3j), 0.9 * np.exp(-0.3j)]).real  # of a mode at 2.4 Hz


def linear(u: np.ndarray) -> np.ndarray:
    """The answer (T, n) of a mode to forces (T, n)."""
    return lfilter([0.2, 0.1], POLES, u, axis=0)


def softening(u: np.ndarray) -> np.ndarray:
    return linear(u) - 0.03 * linear(u) ** 3


class Answer(Estimator):
    """A law that is known, but for a share of its motion."""

    reads = ("f",)

    def __init__(self, law: Callable[[np.ndarray], np.ndarray], dofs: int = 1, less: float = 0.0):
        super().__init__(dofs, dofs, DT)
        self.law, self.share = law, torch.nn.Parameter(torch.tensor(1.0 - less))

    def forward(self, record: Record) -> torch.Tensor:
        return self.free_run(record.drive()).a

    def free_run(self, drive: Drive) -> Response:
        runs = [self.law(u.numpy()) for u in drive.u.reshape(-1, *drive.u.shape[-2:])]
        a = float(self.share) * torch.from_numpy(np.stack(runs)).reshape(drive.u.shape)
        return Response(a, a, a)


def white(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    return rng.standard_normal(shape)


def smooth(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    band = butter(2, [0.5, 3.0], "bandpass", fs=1.0 / DT)
    return 4.0 * lfilter(*band, white(rng, shape), axis=0)


def quake(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    t = np.linspace(0.0, 5.0, shape[0])[:, None]
    return np.minimum(4.0 * t, 1.0) * np.exp(-t) * smooth(rng, shape)


def record(a: np.ndarray, f: np.ndarray) -> Record:
    return Record(DT, torch.from_numpy(a), torch.from_numpy(f))


def planted(
    seed: int, noise: float = 0.0, law=softening, dofs: int = 1, samples: int = T, memory=0.0
) -> Record:
    """A motion with noise, of which a share lasts from one sample to the next."""
    rng = np.random.default_rng(seed)
    f = white(rng, (samples, dofs))
    a, error = law(f), lfilter([1.0], [1.0, -memory], white(rng, f.shape), axis=0)
    return record(a + noise * a.std(axis=0) * error / error.std(axis=0), f)


def fitted(model: Estimator, train: Record) -> Estimator:
    model.identify([train])
    return model


def graded(model: Estimator, train: Record, *tests: Record) -> dict:
    """Grade of an identified model, beside a linear one if it simulates."""
    way = "one step" if isinstance(model, VWNN) else "free run"
    plain = {"fir": fitted(FIR(train.dofs, train.f.shape[-1], DT, 120), train)}
    verdict = judgement(way, {"relative_rms_percent": 10.0}, False)
    motions = {"test": list(tests)}
    verdict |= compare_with(model, plain if way == "free run" else {}, [train], motions, way)
    return grade_of(Judged(model, [train], motions, verdict, {}))["grade"]


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.1, 0.2, 0.5])
def test_a_planted_law_simulates_under_white_noise(noise):
    """The error is all noise, and the grade knows that."""
    found = graded(Answer(softening), planted(0, noise), planted(1, noise))
    assert (found["grade"], found["by"]) == (SIMULATES, "free run")
    share = 100.0 * noise / np.hypot(1.0, noise)  # of the measured motion
    assert found["error_percent"] == pytest.approx(share, rel=0.1, abs=1e-6)
    assert found["noise_percent"] == pytest.approx(share, rel=0.2, abs=1e-6)


@pytest.mark.parametrize("noise", [0.0, 0.2])
@pytest.mark.parametrize(("less", "grade"), [(0.29, SIMULATES), (0.34, ONE_STEP), (0.8, NOTHING)])
def test_a_model_may_miss_a_tenth_of_the_power_beside_noise(less, grade, noise, monkeypatch):
    monkeypatch.setattr("runner.scores.verdict.PLAIN", ())
    found = graded(Answer(softening, less=less), planted(0, noise), planted(1, noise))
    assert found["grade"] == grade, found["reason"]


def test_noise_that_lasts_counts_as_the_models():
    """Nobody can tell it from a drift that a law should have: strict where it is not known."""
    found = graded(Answer(softening), *(planted(seed, 0.5, memory=0.95) for seed in (0, 1)))
    assert found["grade"] == ONE_STEP
    assert found["noise_percent"] < 15.0


def test_noise_that_a_model_makes_up_is_its_error():
    def noisy(u):
        return softening(u) + 0.4 * softening(u).std() * white(np.random.default_rng(5), u.shape)

    assert graded(Answer(noisy), planted(0), planted(1))["noise_percent"] < 10.0


def test_a_model_that_misses_its_training_motion_does_not_simulate():
    found = graded(Answer(softening), planted(0, law=lambda u: -softening(u)), planted(1))
    assert found["grade"] == ONE_STEP
    assert "that of the training motion errs by" in found["reason"]


def test_a_linear_model_that_is_better_takes_the_grade():
    train, test = planted(0, 0.02, linear), planted(1, 0.02, linear)
    assert graded(fitted(FIR(1, 1, DT, 120), train), train, test)["grade"] == SIMULATES
    found = graded(Answer(linear, less=0.1), train, test)
    assert found["grade"] == ONE_STEP
    assert "fir by " in found["reason"]
    assert any(line.startswith("fir in its place: it errs by ") for line in found["advice"])


@pytest.mark.parametrize("response", [white, smooth, quake])
@pytest.mark.parametrize("force", [white, smooth, quake])
def test_channels_that_have_nothing_to_do_with_each_other_identify_nothing(response, force):
    for seed in range(2):
        rng = np.random.default_rng(seed)
        train, test = (record(response(rng, (n, 1)), force(rng, (n, 1))) for n in (1000, 500))
        for model in (FIR(1, 1, DT, 40), VWNN(1, 1, DT)):
            found = graded(fitted(model, train), train, test)
            assert found["grade"] == NOTHING, found["reason"]


@pytest.mark.parametrize("size", [0.05, 0.3, 0.7])
def test_sensors_that_move_less_than_the_base_are_not_simulated_by_its_motion(size):
    """Relative to the base all of them move as it does, the other way."""
    rng = np.random.default_rng(0)
    base = [smooth(rng, (n, 1)) for n in (1000, 500)]
    for response in (white, smooth):
        rows = [size * s.std() * response(rng, s.shape) - s for s in base]
        train, test = (record(a, -s) for a, s in zip(rows, base, strict=True))
        found = graded(fitted(FIR(1, 1, DT, 40), train), train, test)
        assert found["grade"] == NOTHING, found["reason"]


def test_one_channel_of_three_that_follows_nothing_is_named():
    records = [planted(seed, 0.02, linear, dofs=3) for seed in (0, 1)]
    for one in records:
        one.a[:, 2] = 0.1 * torch.randn(T, generator=torch.Generator().manual_seed(len(records)))
    records[1].a[:, 2] = records[1].a[:, 2].flip(0)
    found = graded(fitted(FIR(3, 3, DT, 360), records[0]), *records)
    assert found["grade"] == ONE_STEP
    assert "in channel 3 is no better" in found["reason"]
    assert any("look at channel 3" in line for line in found["advice"])


def test_estimates_that_the_excitation_does_not_help_identify_nothing():
    """The past of the response tells a half of it, whatever drives it."""
    train, test = planted(0, 0.02, linear), planted(1, 0.02, linear)
    model = fitted(VWNN(1, 1, DT, unfiltered_excitation=True), train)
    assert graded(model, train, test)["grade"] != NOTHING
    rng = np.random.default_rng(9)
    mute = [replace(r, f=torch.from_numpy(white(rng, r.f.shape))) for r in (train, test)]
    found = graded(fitted(model, mute[0]), *mute)
    assert found["grade"] == NOTHING
    assert found["error_percent"] < 70.0
    assert any("excitation" in line for line in found["advice"])


@pytest.mark.parametrize("unit", [1e-6, 1e5])
def test_a_grade_knows_no_unit(unit):
    found = []
    for size in (1.0, unit):
        train, test = (replace(r, a=size * r.a, quantity="force")
                       for r in (planted(0, 0.1), planted(1, 0.1)))  # fmt: skip
        found.append(graded(fitted(FIR(1, 1, DT, 120), train), train, test))
    assert found[0]["grade"] == found[1]["grade"]
    assert found[0]["interval_percent"] == pytest.approx(found[1]["interval_percent"], rel=1e-6)


@pytest.mark.parametrize("samples", [50, 120])
def test_short_and_unequal_records_are_graded(samples):
    tests = [planted(1, 0.02, samples=samples), planted(2, 0.02, samples=2 * samples)]
    assert graded(Answer(softening), planted(0, 0.02), *tests)["grade"] == SIMULATES
    assert graded(Answer(softening, less=2.0), planted(0), *tests)["grade"] == NOTHING


def test_an_interval_is_that_of_student():
    """The error of blocks of noise lies in 95 % of the intervals."""
    rng = np.random.default_rng(0)
    intervals = [Errors(rng.chisquare(40, 5) / 40, 0.0, []).interval for _ in range(400)]
    assert 0.92 < np.mean([low <= 100.0 <= high for low, high in intervals]) < 0.98


def test_the_grade_is_printed_in_words(capsys):
    found = graded(Answer(softening), planted(0, 0.02), planted(1, 0.02))
    print_verdict(terminal(80), {"verdict": {"identified": True, "grade": found}})
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(
        "simulates the structure: its simulation of unseen motion errs by 2."
    )
    assert all(len(line) <= 80 for line in lines)
