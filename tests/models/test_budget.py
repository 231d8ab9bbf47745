"""A fit that is out of time takes no further step, and says what it left out."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from data.simulation.laws.candidate import Units
from models.fit.progress import (
    announce,
    is_out_of_time,
    leaves_out,
    limited,
    present_budget,
    sharing,
)
from models.fit.solvers.adam import Adam
from models.fit.solvers.lbfgs import LBFGS
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from models.fit.solvers.solver import OUT_OF_TIME
from models.named_laws import fit, storey
from models.named_laws.candidates import CANDIDATES
from models.named_laws.fit import Fit, Motion, followed
from runner.config.settings import TRAIN, seconds_of
from tests.models.solver_problems import network


@pytest.mark.parametrize("solver", [Adam, LBFGS, LevenbergMarquardt])
def test_no_solver_moves_without_time(solver):
    problem, parameters = network()
    before = [p.detach().clone() for p in parameters]
    with limited(0.0):
        one = solver(parameters)
        assert one.solve(problem) == []
        assert one.finished
        assert one.why == OUT_OF_TIME
    assert all(torch.equal(p, b) for p, b in zip(parameters, before, strict=True))
    assert solver(parameters).solve(problem)  # the budget held within its block alone


def test_what_was_done_last_and_what_was_left_out_is_said():
    with limited(60.0) as budget:
        announce("one law")
        assert not leaves_out("another law")
        budget.end -= 60.0
        announce("a third law")
        assert all(leaves_out(f"law {k}") for k in range(9))
    told = budget.facts()["out_of_time"]
    assert told == (
        "60 s, during one law; not tried: law 0, law 1, law 2, law 3, law 4, law 5 and 3 more"
    )
    assert not is_out_of_time()


def test_a_share_of_the_time_ends_before_the_whole():
    with limited(60.0) as budget:
        with sharing(3):
            assert present_budget().remaining == pytest.approx(20.0, abs=0.1)
            present_budget().end -= 20.0
            assert leaves_out("a law of this part")
        assert not is_out_of_time()
    assert "a law of this part" in budget.facts()["out_of_time"]


def test_a_fit_that_its_share_of_the_time_cut_short_is_named():
    with limited(60.0) as budget:
        with sharing(3):
            announce("a law of this part")
            present_budget().end -= 30.0
            assert is_out_of_time()
        assert not is_out_of_time()
    assert "during a law of this part" in budget.facts()["out_of_time"]


def test_a_long_fit_of_a_law_ends_with_the_time(monkeypatch):
    t = np.linspace(0.0, 20.0, 400)
    one = Motion(t[1], np.sin(t), np.cos(t), np.zeros(400), np.zeros((400, 0)))
    law, units = CANDIDATES["Bilinear"], Units(1.0, 1.0, 1.0, 1.0)
    one = replace(one, r=Fit(law, units, np.zeros(4)).forces([one])[0])
    far = Fit(law, units, np.array([0.5, -0.5, -0.5, 0.5]))
    whole = followed(far, [one], 100)
    time_is_out = iter([False, False, True])  # before the first step, after it, after the second
    monkeypatch.setattr(fit, "is_out_of_time", lambda: next(time_is_out))
    assert whole.error < 0.1 * followed(far, [one], 100).error < 0.1 * far.error_on([one])


def test_a_storey_without_time_has_the_nearest_of_its_starts(monkeypatch):
    monkeypatch.setattr(storey, "is_adequate", lambda *_: False)
    raced = []

    def residuals(one, motions):
        raced.append(motions)
        return one.numbers - 0.3

    monkeypatch.setattr(storey, "residuals", residuals)
    begin = storey.Beginning(1.0, 0.1, 0.1, Units(1.0, 1.0, 1.0, 1.0))
    weak, strong, few = (SimpleNamespace(r=size * np.arange(3)) for size in (1.0, 2.0, 2.0))
    strong.thinned = lambda _: few
    law = CANDIDATES["Bilinear"]
    with limited(0.0) as budget:
        (found,) = storey.near_laws([weak, strong], [["Bilinear"], ["Hysteretic"]], begin, 0)
    assert raced[0] == [few]  # of the motion that shows most of how a law yields
    assert raced[-1] == [weak, strong]
    starts = begin.starts(law, 0).members
    nearest = min(starts, key=lambda one: np.linalg.norm(one.numbers - 0.3))
    np.testing.assert_array_equal(found.numbers, nearest.numbers)
    assert budget.left_out == ["Hysteretic"]


@pytest.mark.parametrize(
    ("text", "seconds"), [("90", 90.0), ("90s", 90.0), ("1.5min", 90.0), ("2 h", 7200.0), (3, 3.0)]
)
def test_a_budget_is_a_number_with_a_unit(text, seconds):
    TRAIN["budget"].check("budget", text)
    assert seconds_of(text) == seconds


@pytest.mark.parametrize("text", ["0", "-3", "10 weeks", "soon", ".inf"])
def test_what_is_no_time_is_refused(text):
    with pytest.raises(ValueError, match="such as 90s, 10min or 2h"):
        TRAIN["budget"].check("budget", text)
