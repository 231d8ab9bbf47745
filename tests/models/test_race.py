"""Successive halving: which kind wins, at what cost; what a search of a law holds back."""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import pytest

from data import Polynomial
from models.fit.race import Settings, race
from models.named_laws.candidates import CANDIDATES
from models.named_laws.choice import Search, choose_law, hold_back
from models.named_laws.fit import Fit, Motion, followed, sized, units_of
from tests.models.test_named_laws import DT, PLANTED, TESTED, element_test


@dataclass(frozen=True)
class Runner:
    """Its error falls by a factor with every iteration, to a floor."""

    kind: str
    error: float
    factor: float
    floor: float


def test_a_kind_that_converges_late_wins_at_the_planned_cost():
    settings, steps = Settings(), Counter[int]()
    starts = [Runner(f"{i}", 1.0 + 0.1 * i, 0.9, 0.5) for i in range(3) for _ in range(60)]
    starts += [Runner("late", 1.25, 0.5, 0.01)] * 12  # behind an eighth, but in the better half
    starts += [Runner(f"bad {i}", 9.0, 0.9, 5.0) for i in range(4) for _ in range(12)]

    def follow(one: Runner, share: float, iterations: int) -> Runner:
        steps[iterations] += 1
        return replace(one, error=max(one.error * one.factor**iterations, one.floor))

    ends = race(starts, follow, settings)
    assert next(iter(ends)) == "late"
    assert ends["late"][0].error == pytest.approx(0.01)
    assert ends["bad 0"][0].error == 9.0  # that of its last round
    assert len(ends) == 8
    assert list(steps) == list(settings.iterations)
    assert steps[0] == len(starts)
    assert steps[2] == 60 + 3 * settings.kept  # all of the best kind, equal, and of three others


def motion(law: str, noise: float = 0.0, samples: int = 450) -> Motion:
    spring = Polynomial(between=TESTED, stiffness=2e7)
    record = element_test(PLANTED.get(law, spring), 0, 0.04, samples=450)
    y, rate = record.excitation[:samples].numpy().T.copy()
    r = record.a[:samples, 0].numpy().copy()
    r += noise * r.std() * np.random.default_rng(0).standard_normal(samples)
    return Motion(DT, y, rate, r, np.zeros((samples, 0)))


def test_forces_that_are_held_back_tell_no_start():
    whole = motion("Takeda")
    (rest,), (judged,) = hold_back([whole])
    assert (rest.kept() ^ judged.kept()).all()
    energy = (whole.r[judged.kept()] ** 2).sum() / (whole.r**2).sum()
    assert energy == pytest.approx(0.2, abs=0.03)
    other = replace(rest, r=np.where(rest.kept(), rest.r, -rest.r))
    searches = [Search([one], [judged], units_of([whole]), 0) for one in (rest, other)]
    one, two = ([s.q for s in search.starts(CANDIDATES["Hysteretic"])] for search in searches)
    assert np.array_equal(one, two)


@pytest.mark.parametrize("name", ["PowerDamperAndSpring", "MaxwellAndSpring", "Hysteretic"])
def test_what_is_linear_in_a_law_leaves_the_error_that_is_said(name):
    whole, law = motion("MenegottoPinto"), CANDIDATES[name]
    fit = Fit(law, units_of([whole]), law.at(np.full(len(law.parameters), 0.4)))
    found = sized(fit, [whole])
    assert found.error == pytest.approx(found.error_on([whole]), rel=1e-4)
    assert found.error < fit.error_on([whole])


def test_motions_too_short_to_hold_a_part_back_are_refused():
    with pytest.raises(ValueError, match="too short, or too still"):
        choose_law([motion("Takeda", samples=2)], ["Linear"], 0)


def test_the_typical_rate_follows_the_unit_of_time():
    whole = motion("Takeda")
    still = np.arange(450) < 300  # for more than half of the time
    one = replace(whole, rate=np.where(still, 0.0, whole.rate))
    assert units_of([replace(one, rate=60.0 * one.rate)]).rate == 60.0 * units_of([one]).rate


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_spring_is_no_larger_law(noise):
    names = [law.name for law in CANDIDATES.values() if len(law.parameters) <= 6]
    fit, errors = choose_law([motion("spring", noise)], names, 0)
    assert fit.kind == "Linear"
    assert max(len(CANDIDATES[name].parameters) for name in errors) <= 4  # it leaves noise


def test_a_spring_with_coloured_noise_is_no_larger_law():
    """No law leaves white noise there."""
    whole, rng = motion("spring"), np.random.default_rng(1)
    slow = np.convolve(rng.standard_normal(450), np.hanning(9), "same")
    heard = replace(whole, r=whole.r + 0.05 * whole.r.std() / slow.std() * slow)
    fit, errors = choose_law([heard], ["Linear", "Takeda", "MenegottoPinto", "Bilinear"], 0)
    assert fit.kind == "Linear"
    assert "Takeda" in errors


@pytest.mark.parametrize("samples", [12, 40])
@pytest.mark.parametrize("spike", [False, True])
def test_short_motions_and_a_still_one_have_a_law(samples, spike):
    whole = motion("Takeda", samples=150)
    short, still = (
        replace(whole, y=times * whole.y[-count:], rate=times * whole.rate[-count:],
                r=times * whole.r[-count:], shares=whole.shares[-count:])
        for times, count in ((1.0, samples), (0.0, samples // 2))
    )  # fmt: skip
    if spike:
        short.r[samples // 2] *= 1e3
    for motions in ([short], [short, still]):
        fit, _ = choose_law(motions, ["Linear", "Bilinear"], 0)
        assert np.isfinite(fit.q).all()


def test_numbers_that_motions_do_not_tell_go_to_the_middle_of_their_range():
    """The last point of an envelope, of motions that end before it, in clean force and in noise."""
    law = CANDIDATES["Hysteretic"]
    last, place = list(law.parameters).index("stronger_3"), list(law.parameters).index("farther_2")
    for noise in (0.0, 0.05):
        one = motion("MenegottoPinto", noise)
        q = law.at(np.full(len(law.parameters), 0.5))
        q[place] = np.log(50.0)
        q[last] = begin = law.parameters["stronger_3"].at(0.95)
        q[place + 1] = np.log(50.0)
        fit = followed(Fit(law, units_of([one]), q), [one], 20)
        middle = law.parameters["stronger_3"].at(0.5)
        assert abs(fit.q[last] - middle) < 0.5 * abs(begin - middle)
