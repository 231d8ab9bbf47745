"""A friction pendulum among the named laws: its spring and curvature are learned, in any units."""

from __future__ import annotations

import numpy as np
import pytest

from data.simulation.elements import FrictionPendulum
from models.named_element import NamedElement
from models.named_laws.candidate import Units
from models.named_laws.candidates import CANDIDATES
from tests.models.test_named_laws import DT, TESTED, element_test, error

BEARING = FrictionPendulum(
    between=TESTED, weight=1e6, radius=0.15, friction_fast=0.1, friction_slow=0.05, rate=8.0,
    yield_displacement=1e-3, spring_share=1.0, curvature=1.0 / 0.15,
)  # fmt: skip


@pytest.mark.parametrize("per", [1.0, 1e3])
def test_the_spring_and_the_curvature_of_a_bearing_are_found(per):
    model = NamedElement(1, 2, DT, laws=["FrictionPendulum"])
    model.identify([element_test(BEARING, i, s, per=per) for i, s in enumerate((0.04, 0.025))])
    unseen = [element_test(BEARING, 7, 0.035, per=per), element_test(BEARING, 8, 0.06, per=per)]
    assert error(model, unseen) < 0.5
    fit = model.laws[0]
    values = fit.candidate.values(fit.q, fit.units)
    assert values["spring_share"] > 0.9
    assert values["curvature"] * per == pytest.approx(BEARING.curvature, rel=0.05)


def test_a_bearing_without_spring_and_curvature_is_that_of_models_saved_before():
    """Which have zeros where these are now."""
    law, units = CANDIDATES["FrictionPendulum"], Units(0.05, 0.2, 2e4, 2e6)
    q = np.append(law.drawn(np.random.default_rng(0))[:-2], [0.0, -1.0])
    (bearing,) = law.elements(q, units)
    assert isinstance(bearing, FrictionPendulum)
    assert (bearing.spring_share, bearing.curvature) == (0.0, 0.0)
