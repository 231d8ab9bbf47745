"""A friction pendulum among the named laws: its spring and curvature are learned, in any units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from data import FrictionPendulum
from models.named_element import NamedElement
from models.named_laws.candidate import Units
from models.named_laws.candidates import CANDIDATES
from models.named_laws.fit import Fit
from tests.models.test_named_laws import DT, TESTED, element_test, error

BEARING = FrictionPendulum(
    between=TESTED, weight=1e6, radius=0.15, friction_fast=0.1, friction_slow=0.05, rate=8.0,
    yield_displacement=1e-3, spring_share=1.0, curvature=1.0 / 0.15,
)  # fmt: skip


def test_the_spring_and_the_curvature_of_a_bearing_are_found():
    model = NamedElement(1, 2, DT, laws=["FrictionPendulum"])
    tests = [element_test(BEARING, i, s, per=1e3) for i, s in enumerate((0.04, 0.025))]
    assert model.identify(tests)["laws"] == "CurvedFrictionPendulum"
    unseen = [element_test(BEARING, 7, 0.035, per=1e3), element_test(BEARING, 8, 0.06, per=1e3)]
    assert error(model, unseen) < 0.5
    fit = model.laws[0]
    values = fit.candidate.values(fit.q, fit.units)
    assert values["spring_share"] > 0.9
    assert values["curvature"] * 1e3 == pytest.approx(BEARING.curvature, rel=0.05)


def test_a_bearing_without_spring_and_curvature_needs_no_other_law_beside_it():
    """From a single motion, too."""
    plain = replace(BEARING, spring_share=0.0, curvature=0.0)
    model = NamedElement(1, 2, DT, laws=["FrictionPendulum", "SelfCentering"], seed=0)
    laws = model.identify([element_test(plain, 0, 0.04)])["laws"]
    assert laws in ("FrictionPendulum", "CurvedFrictionPendulum")
    assert error(model, [element_test(plain, 7, 0.035)]) < 0.5


def test_a_wider_bearing_is_the_same_at_zero():
    law, units = CANDIDATES["FrictionPendulum"], Units(0.05, 0.2, 2e4, 2e6)
    fit = Fit(law, units, law.drawn(np.random.default_rng(0)))
    (bearing,), (wider,) = (one.candidate.elements(one.q, units) for one in (fit, fit.uneven()))
    assert wider == bearing
    assert fit.uneven().candidate.name == "CurvedFrictionPendulum"
