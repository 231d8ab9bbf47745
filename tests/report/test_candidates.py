"""Candidates: the fewest parameters that simulate unseen motion as the best does; odds by BIC."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rich.console import Console

from models.uncertainty.laplace import about
from report.candidates import Candidate, odds_of, print_candidates, recommended

CHAIN = Candidate("elements=chain", 10.0, 100.0, 30.0)
ALL = Candidate("elements=all", 20.0, 90.0, 5.0)
MORE = Candidate("elements=all, units=3", 40.0, 94.0, 4.9)
LOST = Candidate("elements=all, units=9", math.nan, math.inf, math.inf, "not identified")


def test_the_fewest_parameters_as_good_as_the_best_are_recommended():
    assert recommended([CHAIN, ALL, MORE, LOST]) is ALL
    assert recommended([LOST]) is None


def test_odds_are_those_of_bic():
    odds = odds_of([CHAIN, ALL, MORE, LOST])
    assert sum(odds) == pytest.approx(1.0)
    assert odds[1] / odds[2] == pytest.approx(math.exp(2.0))
    assert odds[3] == 0.0


def test_a_law_of_no_class_is_taken_where_every_class_errs_by_far_more():
    smooth, slip = (Candidate(k, 6.0, 0.0, 2.4, kind=k) for k in ("bouc_wen", "slip"))
    other = Candidate("any_other", 18.0, 0.0, 2.1, kind="any_other")
    assert recommended([smooth, slip, other]) is smooth
    console = Console(width=80)
    with console.capture() as capture:
        print_candidates(console, [smooth, slip, other])
    assert "no class is exact: the error of a law outside them is 12 % smaller" in capture.get()
    far = Candidate("any_other", 18.0, 0.0, 1.0, kind="any_other")
    assert recommended([smooth, slip, far]) is far
    assert recommended([other]) is other


def test_bic_finds_the_columns_that_are_there():
    """Least squares with 3 true columns: of nested sets the one with 3 has the least BIC."""
    rng = np.random.default_rng(0)
    columns = rng.standard_normal((4000, 1, 8))
    y = columns[:, :, :3].sum(axis=2) + 0.5 * rng.standard_normal((4000, 1))
    bics = []
    for count in range(1, 9):
        J = columns[:, :, :count]
        error = y - J @ np.linalg.lstsq(J[:, 0], y[:, 0], rcond=None)[0]
        found = about([error], [J], np.zeros(count), np.zeros(count))
        bics.append(-2.0 * found.noise.log_likelihood + found.determined * math.log(found.samples))
    assert int(np.argmin(bics)) + 1 == 3
