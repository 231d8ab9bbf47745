"""Storeys that a weight pushes over (P–Δ): a law that hardens by less than that takes away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from data.record import Record
from data.simulation.laws.candidate import Units
from models.named_element import NamedElement
from models.named_laws.candidates import CANDIDATES
from models.named_laws.fit import Fit, Motion
from models.named_laws.free_run import FreeRuns
from models.named_laws.leaning import HARDENING, LEANING, OF_LAW, leant
from tests.models.test_named_laws import DT, PLANTED, element_test, error, heard_chain, motion

UNITS = Units(0.02, 0.1, 1e5, 2e7)
STEEL = {
    "yield_displacement": 0.003, "stiffness": 1.5e7, "hardening_ratio": 0.005, "sharpness": 18.0,
    "sharpness_loss": 0.9, "loss_excursion": 0.15, "growth": 0.01, "damping": 2e4,
}  # fmt: skip


def pushed_over(name: str, seed: int, size: float, share: float) -> Record:
    """A test of a planted law less so much of its stiffness."""
    record = element_test(PLANTED[name], seed, size)
    return replace(record, a=record.a - share * 2e7 * record.s)


@pytest.mark.parametrize("name", ["MenegottoPinto", "Takeda", "SlackBrace"])
def test_a_law_under_a_weight_is_found_and_holds_beyond_what_it_saw(name):
    model = NamedElement(1, 2, DT, laws=[name, "SelfCentering"])
    facts = model.identify([pushed_over(name, i, s, 0.1) for i, s in enumerate((0.04, 0.025))])
    assert facts["laws"] == f"{name} with P-Delta"
    unseen = [pushed_over(name, 7, 0.035, 0.1), pushed_over(name, 8, 0.06, 0.1)]
    assert error(model, unseen) < 1.0
    restored = NamedElement(1, 2, DT)
    restored.load_state_dict(model.state_dict())
    assert error(restored, unseen) == error(model, unseen)


@pytest.mark.parametrize("name", OF_LAW)
def test_a_law_under_a_weight_is_the_law_less_a_spring(name):
    """It begins with less hardening than the weight takes away, and with sides alike."""
    law = CANDIDATES[name]
    fit = Fit(law, UNITS, law.drawn(np.random.default_rng(0)))
    at = list(law.parameters).index(next(k for k in HARDENING if k in law.parameters))
    assert leant(fit, 0.02) is fit
    fit.q[at] = -7.0
    leaning = leant(fit, 0.02)
    assert LEANING[leaning.candidate.name] is leaning.candidate
    weight = leaning.candidate.values(leaning.q, UNITS)["gravity_stiffness"]
    stiffness = law.values(fit.q, UNITS)["stiffness"]
    assert weight == pytest.approx(0.05 * stiffness)
    hardens = replace(fit, q=leaning.q[1:])
    y, _ = motion(0, 0.04)
    test = Motion(DT, y, np.gradient(y, DT), y, np.zeros((len(y), 0)))
    (r,), (less,), (uneven,) = (one.forces([test]) for one in (hardens, leaning, leaning.uneven()))
    assert np.allclose(less, r - weight * y, rtol=1e-9, atol=1e-6)
    assert np.allclose(uneven, less, rtol=1e-9, atol=1e-6)


def test_storeys_lean_where_accelerations_with_noise_ask_for_it():
    """From laws that hardly harden."""
    name = "MenegottoPinto with P-Delta"
    laws, motions = heard_chain(name, {"gravity_stiffness": 0.04 * 1.5e7, **STEEL})
    runs = FreeRuns(motions[:2], lambda motion: motion.a)
    steel = CANDIDATES["MenegottoPinto"]
    plain = replace(laws, fits=[Fit(steel, fit.units, fit.q[1:]) for fit in laws.fits])
    found = runs.leaning(runs.followed(plain, 1.0, 2, 1e-8))
    assert [fit.candidate.name for fit in found.fits] == [name] * 2
