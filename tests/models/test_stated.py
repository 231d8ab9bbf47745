"""What a person states before a fit: priors that count as much as they should, ties, masses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from data.record import Record, stack
from data.sample import Sensors
from models.composition.many_runs import ManyRuns
from models.element_network import ElementNetwork
from models.fit.noise_weights import refit
from models.fit.problem import FreeRunProblem
from models.uncertainty.intervals import intervals_of
from models.uncertainty.laplace import laplace
from models.uncertainty.parameters import free_vector
from models.uncertainty.posterior import Prior
from report.uncertainty.intervals import contradictions
from runner.config.compose import composed
from runner.scores.uncertainty import _priors
from tests.experiments import estimator_from
from tests.models.planted import DT, planted, under_forces

T, NOISE = 500, 0.1
CHAIN = [["ground", "x1"], ["x1", "x2"]]
K, C = 80.0, 0.8  # of both elements [N/m, N s/m]


def yielding(masses=None, **stated) -> ElementNetwork:
    """Two masses on two equal elements that yield."""
    known = {"masses": masses, "cubic": False, **stated}
    model = planted([1.0, 1.5], [K, K], yielding=0.6, damper=C / K, **known)
    model.keep_start()
    return model


@pytest.fixture(scope="module")
def measured() -> Record:
    """A noisy record of it, as a batch of one."""
    rng = np.random.default_rng(1)
    record = under_forces(yielding(), rng, T, 6.0)
    noise = torch.from_numpy(rng.standard_normal((T, 2)))
    return stack([Record(DT, record.a + NOISE * record.a.std() * noise, record.f)])


def fit(model: ElementNetwork, record: Record, channels: str | None = "equal") -> list[str]:
    """To the minimum, which is near."""
    model.admitted([record])
    return refit(
        model, record, lambda r: FreeRunProblem(model, r, None), channels, None, lambda losses: None
    )


def at_minimum(record: Record, **stated):
    """Model, its intervals by name, Laplace's approximation."""
    model = yielding(**stated)
    if not stated.get("priors"):
        model.hold_to({"r1.damping": [C, 1e6]}, None, model.laws, model.mass)  # as good as none
    fit(model, record)
    found = laplace(model, [record])
    return model, {i.name: i for i in intervals_of(model, found)}, found


@pytest.fixture(scope="module")
def alone(measured):
    """Intervals of the records' own answer."""
    return at_minimum(measured)[1]


def test_a_prior_counts_as_much_as_its_variance_beside_that_of_the_noise(measured, alone):
    """To first order the fit lies between the records' answer and the prior's mean."""
    own = alone["r1.damping"].half / 1.96 / alone["r1.damping"].value
    stated = alone["r1.damping"].value * np.exp(own)
    model, both, found = at_minimum(measured, priors={"r1.damping": [stated, own]})
    assert both["r1.damping"].value == pytest.approx(
        alone["r1.damping"].value * np.exp(0.5 * own), rel=0.1 * own
    )
    half = alone["r1.damping"].half / 2**0.5
    assert both["r1.damping"].half == pytest.approx(half, rel=0.1)
    assert abs(found.tension[0]) == pytest.approx(0.5**0.5, rel=0.15)
    assert Prior.of(model).width.min() == pytest.approx(own)


def test_records_that_contradict_a_prior_are_told_and_the_interval_spans_both(measured, alone):
    model, both, found = at_minimum(measured, priors={"r1.stiffness": [3.0 * K, 0.01]})
    assert abs(found.tension[0]) > 3.0
    told = both["r1.stiffness"]
    assert abs(told.value - alone["r1.stiffness"].value) < told.half
    (line,) = contradictions(_priors(model, found))
    assert line.startswith("model.priors.r1.stiffness=[240,0.01]: contradicted by the records")
    model, _, found = at_minimum(measured, priors={"r1.stiffness": [K, 0.1]})
    assert list(contradictions(_priors(model, found))) == []


def test_tied_elements_have_one_theta_and_the_derivatives_of_both(measured):
    free, tied = yielding(), yielding(ties=[["r1", "r2"]])
    assert free.identified_parameters == 14
    assert tied.identified_parameters == 8
    _, J = free.restarted_jacobian(measured, None)
    _, own = tied.restarted_jacobian(measured, None)
    count = len(free_vector(free)) - 2  # of the laws, in pairs, after the masses
    joined = torch.cat([J[..., :2], J[..., 2:].unflatten(-1, (count // 2, 2)).sum(dim=-1)], dim=-1)
    assert torch.allclose(own, joined, rtol=1e-12, atol=1e-12)
    ManyRuns(tied, measured.map(lambda u: u[0]).drive())  # raises where coefficients do not follow


def test_a_prior_sets_the_scale_that_no_force_tells():
    """Under a moving support: what has a mass of 500 kg has stiffnesses to suit."""
    more = {"elements": [["s1", "x1"], ["x1", "x2"]], "forced": [], "hinges": 0, "units": 0}
    free = ElementNetwork(2, 2, DT, **more)
    heavy = ElementNetwork(2, 2, DT, **more, priors={"x1": {"mass": [500.0, 0.05]}})
    t = DT * torch.arange(400, dtype=torch.float64)[:, None]
    s, rate = 0.01 * torch.sin(9.0 * t**1.3), torch.zeros_like(t)
    rate[1:-1] = (s[2:] - s[:-2]) / (2.0 * DT)
    one = torch.ones(2, dtype=torch.float64)
    free.mass.start(one)
    free.laws.start(300.0 * one, 2.0 * one, 0.01 * one, (0.5, 0.5))
    free.identified.fill_(1.0)
    record = Record(DT, torch.zeros(400, 2).double(), s[:, :0], s=s, s_dot=rate)
    with torch.no_grad():
        run = free.free_run(record.drive())
    record = replace(record, a=run.a, x=run.x, v=run.v)
    heavy.identify([record])
    assert heavy.mass().tolist() == pytest.approx([500.0, 500.0], rel=0.05)
    assert heavy.laws.stiffness().tolist() == pytest.approx([150e3, 150e3], rel=0.1)


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({"priors": {"r1": {"stifness": [1.0, 0.1]}}}, "did you mean r1.stiffness"),
        ({"priors": {"r7.mass": [1.0, 0.1]}}, "learns no such parameter"),
        ({"priors": {"x1.mass": [float("nan"), 0.1]}}, "two finite numbers"),
        ({"priors": {"x1.mass": [0.0, 0.1]}}, "differ from zero"),
        ({"priors": {"x1.mass": [-1.0, 0.1]}}, "must be positive"),
        ({"priors": {"x1.mass": [1.0, 0.0]}}, "upwards"),
        ({"priors": {"x1.mass": [1.0]}}, "expected .value, relative"),
        ({"priors": {"x1.mass": [1.0, 0.1]}, "masses": [1.0, 2.0]}, "no such parameter"),
        ({"priors": {"x1.mass": [1.0, 0.1]}, "masses": [1.0, None]}, "model.masses gives it"),
        ({"priors": {"r1.unit_1.stiffness": [1.0, 0.1]}, "units": 2}, "take one of each"),
        (
            {
                "priors": {"r1.damping": [1.0, 0.1], "r2.damping": [1.0, 0.1]},
                "ties": [["r1", "r2"]],
            },
            "are tied",
        ),
        ({"ties": [["r1"]]}, "two different names"),
        ({"ties": [["r1", "r2.stiffness"]]}, "model.ties=..r1,r2.stiffness..: r1: "),
        ({"ties": [["x1.mass", "r2.stiffness"]]}, "one parameter of several"),
        ({"ties": [["r1", "r2"], ["r1.damping", "r2.damping"]]}, "two groups"),
        ({"ties": [["x1.mass", "x2.mass"]], "masses": [1.0, None]}, "give all of the group"),
        ({"masses": [1.0]}, "expected 2 positive masses"),
        ({"masses": [1.0, float("inf")]}, "expected 2 positive masses"),
    ],
)
def test_what_cannot_be_stated_is_refused(stated, said):
    with pytest.raises(ValueError, match=said):
        ElementNetwork(2, 2, DT, CHAIN, **{"units": 1, **stated})


@pytest.mark.parametrize("model", ["vwnn", "latent_hysteresis_network"])
@pytest.mark.parametrize("word", ["model.priors.r1.stiffness=[1,0.1]", "model.ties=[[r1,r2]]"])
def test_models_without_such_parameters_say_so(model, word):
    cfg = composed(f"model={model}", word)
    with pytest.raises(ValueError, match="are for model=element_network"):
        estimator_from(cfg.model, Sensors(DT, 2, 2))
