"""Channels count by their noise: where a sensor is bad, and nowhere else unless asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.signal import butter, lfilter

from data.record import Drive, Record, stack
from models.element_network import ElementNetwork
from models.fit.free_run_objective import FreeRun
from models.fit.minimise import minimise
from models.fit.noise_weights import STEPS, refit, weigh_at_first
from models.fit.problem import FreeRunProblem
from models.uncertainty.intervals import intervals_of
from models.uncertainty.laplace import laplace
from report.uncertainty.intervals import unequal
from runner.scores.uncertainty import _residual
from tests.models.planted import DT, planted
from tests.models.two_masses import identified, motion

T = 800
GOOD, BAD = 0.03, 0.5  # noise over a channel's size


def linear() -> ElementNetwork:
    """Two masses on linear elements."""
    return planted([1.0, 1.5], [80.0, 50.0], cubic=False)


@pytest.fixture(scope="module")
def clean() -> Record:
    rng = np.random.default_rng(2)
    f = lfilter(*butter(4, 0.08), rng.standard_normal((T, 2)), axis=0)  # to 4 Hz
    rest = torch.zeros(2, dtype=torch.float64)
    drive = Drive(DT, torch.from_numpy(6.0 * f / f.std()), rest, rest)
    with torch.no_grad():
        return stack([Record(DT, linear().free_run(drive).a, drive.u)])


def noisy(clean: Record, levels: list[float], seed: int = 0) -> Record:
    noise = torch.from_numpy(np.random.default_rng(seed).standard_normal(clean.a.shape))
    size = torch.tensor(levels).double() * clean.a.std(dim=(0, 1))
    return replace(clean, a=clean.a + size * noise)


def fit(record: Record, channels: str | None) -> tuple[ElementNetwork, list[str]]:
    """A fit to all channels alike, and what follows it."""
    model = linear()
    model.admitted([record])
    minimise(FreeRunProblem(model, record, None), STEPS)
    told = refit(model, record, lambda r: FreeRunProblem(model, r, None), channels, None, list)
    return model, told


def off(model: ElementNetwork) -> float:
    """Root mean square of θ, which is zero at the truth."""
    theta = torch.cat([p.detach().reshape(-1) for p in model.parameters() if p.requires_grad])
    return float(theta.square().mean().sqrt())


def test_a_bad_sensor_does_not_take_over(clean):
    errors = {}
    for channels in ("equal", None):
        models = [fit(noisy(clean, [BAD, GOOD], seed), channels)[0] for seed in range(4)]
        errors[channels] = np.mean([off(model) for model in models])
    assert errors[None] < 0.5 * errors["equal"]
    record = noisy(clean, [BAD, GOOD])
    model, (told,) = fit(record, None)
    size = clean.a.std(dim=(0, 1))
    wanted = float(BAD * size[0] / (GOOD * size[1]))
    assert float(model.channels[1] / model.channels[0]) == pytest.approx(wanted, rel=0.15)
    assert told.startswith("channel 1 has noise of ")
    content = _residual(laplace(model, [record]), DT, [1, 2])
    assert unequal(content).startswith("channels are weighted by their noise")
    assert content["noise"] == pytest.approx((size * torch.tensor([BAD, GOOD])).tolist(), rel=0.1)


def test_intervals_of_weighed_channels_cover(clean):
    hits = []
    for seed in range(8):
        model, _ = fit(noisy(clean, [GOOD, BAD], 10 + seed), None)
        found = laplace(model, [noisy(clean, [GOOD, BAD], 10 + seed)])
        known = {"x1.mass": 1.0, "x2.mass": 1.5, "r1.stiffness": 80.0, "r2.stiffness": 50.0,
                 "r1.damping": 0.8, "r2.damping": 0.5}  # fmt: skip
        hits += [abs(i.value - known[i.name]) <= i.half for i in intervals_of(model, found)]
    assert np.mean(hits) > 0.85


@pytest.mark.parametrize("levels", [[0.0, 0.0], [0.05, 0.1]])
def test_channels_of_like_noise_count_alike(clean, levels):
    record = noisy(clean, levels)
    (model, told), (alike, _) = fit(record, None), fit(record, "equal")
    assert told == []
    weigh_at_first(model, [record], None)
    assert model.channels.tolist() == [1.0, 1.0]
    assert off(model) == off(alike)  # it was not fitted anew


def test_what_cannot_be_weighed_is_refused():
    with pytest.raises(ValueError, match=r"objective\.channels=noise: GlobalMLP"):
        FreeRun(channels="noise").prepare(identified("global", motion()), [motion()], False)
    with pytest.raises(ValueError, match=r"objective\.channels=noise needs all windows in one"):
        FreeRun(channels="noise").require_one_batch(linear())
