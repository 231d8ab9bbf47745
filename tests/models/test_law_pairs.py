"""Two named laws in parallel, chains of unknown masses, weights aloft: planted ones are found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from data import Maxwell
from data.record import Record
from data.simulation.element_test import force
from data.simulation.laws.candidate import Units
from models.element_network_named import ElementNetworkNamed as Named
from models.fit.ensemble import Ensemble
from models.named_element import NamedElement
from models.named_laws import storey
from models.named_laws.candidates import BY_NAME, CANDIDATES, PAIRS
from models.named_laws.fit import Fit, Motion, halves
from models.named_laws.free_run import FreeRuns
from models.named_laws.p_delta import BY_LAW, HARDENING, P_DELTA_LAWS, with_p_delta
from tests.models.test_named_laws import (
    DT,
    PLANTED,
    element_test,
    error,
    heard_chain,
    motion,
    shaken,
    two_storeys,
)

UNITS = Units(0.04, 0.1, 3e5, 2e7)


def frame_and_brace(seed: int, size: float) -> Record:
    """A braced frame of steel: the braces go slack, the frame yields later."""
    frame = replace(PLANTED["MenegottoPinto"], yield_displacement=0.02, stiffness=1e7)
    brace = replace(PLANTED["SlackBrace"], yield_displacement=0.006)
    one, other = (element_test(law, seed, size) for law in (frame, brace))
    return replace(one, a=one.a + other.a)


@pytest.fixture(scope="module")
def braced() -> tuple[NamedElement, dict]:
    model = NamedElement(1, 2, DT, laws=["MenegottoPinto", "SlackBrace", "SelfCentering"])
    records = [frame_and_brace(i, size) for i, size in enumerate((0.04, 0.025, 0.03))]
    return model, model.identify(records)


def test_a_frame_and_its_braces_are_found_by_their_names(braced):
    model, facts = braced
    assert facts["laws"] == "MenegottoPinto + SlackBrace"
    assert error(model, [frame_and_brace(7, 0.035)]) < 3.0
    assert "damping" not in halves(model.laws[0])[1].candidate.parameters  # one damper for both
    told = {parameter.name: parameter.value for parameter in model.physical_parameters()}
    assert told["r1.law_1.stiffness"] == pytest.approx(1e7, rel=0.1)
    assert told["r1.law_2.yield_displacement"] == pytest.approx(0.006, rel=0.1)


@pytest.mark.parametrize("name", PAIRS)
def test_the_force_of_a_pair_is_that_of_its_laws(name):
    pair = PAIRS[name]
    fit = Fit(pair, UNITS, pair.drawn(np.random.default_rng(0)))
    y, _ = motion(1, 0.03)
    rate = np.gradient(y, DT, edge_order=2)
    elements, values = pair.elements(fit.q, UNITS), pair.values(fit.q, UNITS)
    damping = [value for key, value in values.items() if key.endswith(".damping")]
    beside = [getattr(one, "damping", 0.0) for one in elements if not isinstance(one, Maxwell)]
    assert [one for one in beside if one] == damping
    both = sum(force(one, y, DT, rate) for one in elements)
    apart = sum(
        force(one, y, DT, rate)
        for half in halves(fit)
        for one in half.candidate.elements(half.q, UNITS)
    )
    np.testing.assert_allclose(both, apart, rtol=1e-12, atol=1e-9 * np.abs(both).max())


def damped(name: str, error: float) -> storey.Damped:
    law = BY_NAME[name]
    q = law.drawn(np.random.default_rng(0))
    return storey.Damped(Fit(law, UNITS, q), np.append(0.0, q), error)


class Still:
    """A storey that is not simulated: a law leaves a slow wave as large as its error."""

    r = np.sin(np.linspace(0.0, 60.0, 900))

    def thinned(self, spring: storey.Damped) -> Still:
        return self


@pytest.fixture
def still(monkeypatch) -> storey.Beginning:
    def race(starts, follow, settings):
        return {some.kind: [some] for some in starts}

    def starts(self, law, seed, known=None):
        return Ensemble([damped(law.name, ERRORS[law.name])])

    monkeypatch.setattr(storey, "race", race)
    monkeypatch.setattr(storey, "refine", lambda one, storeys: one)
    monkeypatch.setattr(storey, "residuals", lambda one, storeys: one.error * Still.r)
    monkeypatch.setattr(storey.Beginning, "starts", starts)
    return storey.Beginning(1.0, 0.1, 0.1, UNITS)


ERRORS: dict[str, float] = {}


@pytest.mark.parametrize(("share", "first"), [(0.45, "pair"), (0.55, "law")])
def test_a_pair_comes_first_only_where_it_halves_the_misfit(still, monkeypatch, share, first):
    pair = "MenegottoPinto + SlackBrace"
    monkeypatch.setitem(ERRORS, "MenegottoPinto", 0.2)
    monkeypatch.setitem(ERRORS, pair, 0.2 * share)
    found = storey.near_laws([Still()], [["MenegottoPinto"], [pair]], still, 0)
    names = {"pair": pair, "law": "MenegottoPinto"}
    assert found[0].kind == names[first]
    assert len(found) == 2


def test_a_pair_starts_again_at_the_law_that_it_shares_with_a_nearer_one(monkeypatch):
    monkeypatch.setattr(storey, "refine", lambda one, storeys: one)
    names = "Takeda + BracedDamper", "MenegottoPinto + BracedDamper", "MenegottoPinto + SlackBrace"
    some, asked = [damped(*pair) for pair in zip(names, (0.02, 0.03, 0.05), strict=True)], []

    def again(one: storey.Damped, near: storey.Damped) -> storey.Damped:
        asked.append((one.kind, near.kind))
        return replace(one, error=0.01)

    found = storey.refine_all(some, [], again)
    assert asked == [(names[1], names[0])]  # the third has no law of the first
    assert [one.error for one in found] == [0.02, 0.01, 0.05]
    storey.refine_all([damped("Takeda", 0.02), damped("BaberNoori", 0.03)], [], again)
    assert len(asked) == 1


def test_starts_of_a_pair_have_the_numbers_that_are_known():
    begin = storey.Beginning(2e7, 1e4, 0.1, UNITS)
    near = damped("Takeda + BracedDamper", 0.02)
    known = dict(zip(near.fit.candidate.parameters, near.law.q.tolist(), strict=True))
    pair = PAIRS["MenegottoPinto + BracedDamper"]
    free, held = (np.array([one.law.q for one in begin.starts(pair, 0, about).members])
                  for about in (None, known))  # fmt: skip
    for i, name in enumerate(pair.parameters):
        if name in known:
            assert (held[:, i] == known[name]).all()
        else:
            np.testing.assert_array_equal(held[:, i], free[:, i])
    assert np.ptp(free, axis=0).min() > 0.0


def _of_base(record: Record) -> Record:
    """The same motion against its base, whose acceleration is −f."""
    assert record.s is not None
    assert record.s_dot is not None
    assert record.x is not None
    assert record.v is not None
    pushed = torch.from_numpy(np.gradient(record.s_dot.numpy(), DT, axis=0, edge_order=2).copy())
    x, v = record.x - record.s, record.v - record.s_dot
    return Record(DT, record.a - pushed, -pushed, x, v)


def test_masses_of_a_chain_are_found_with_its_laws():
    """The scale is open; masses stand in the ratio that they have, and laws are those planted."""
    structure = two_storeys(5e4, 3e4)
    *records, unseen = (_of_base(shaken(structure, *m)) for m in ((0, 0.3), (1, 0.22), (7, 0.28)))
    model = Named(2, 1, DT, "chain", forced="base", laws=["MenegottoPinto", "SelfCentering"])
    _, facts = model.searched(records, polished=False)  # the free run would mend other masses
    assert facts["laws"] == "MenegottoPinto, SelfCentering"
    light, heavy = sorted(model.mass().tolist())
    assert heavy / light == pytest.approx(5.0 / 3.0, rel=0.02)
    assert error(model, [unseen]) < 3.0


# --- storeys that a weight pushes over (P–Δ): a law that hardens by less than that takes away

WEIGHED = Units(0.02, 0.1, 1e5, 2e7)
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


@pytest.mark.parametrize("name", BY_LAW)
def test_a_law_under_a_weight_is_the_law_less_a_spring(name):
    """It begins with less hardening than the weight takes away, and with sides alike."""
    law = CANDIDATES[name]
    fit = Fit(law, WEIGHED, law.drawn(np.random.default_rng(0)))
    at = list(law.parameters).index(next(k for k in HARDENING if k in law.parameters))
    assert with_p_delta(fit, 0.02) is fit
    fit.q[at] = -7.0
    loaded = with_p_delta(fit, 0.02)
    assert P_DELTA_LAWS[loaded.candidate.name] is loaded.candidate
    weight = loaded.candidate.values(loaded.q, WEIGHED)["gravity_stiffness"]
    stiffness = law.values(fit.q, WEIGHED)["stiffness"]
    assert weight == pytest.approx(0.05 * stiffness)
    hardens = replace(fit, q=loaded.q[1:])
    y, _ = motion(0, 0.04)
    test = Motion(DT, y, np.gradient(y, DT), y, np.zeros((len(y), 0)))
    (r,), (less,), (uneven,) = (one.forces([test]) for one in (hardens, loaded, loaded.uneven()))
    assert np.allclose(less, r - weight * y, rtol=1e-9, atol=1e-6)
    assert np.allclose(uneven, less, rtol=1e-9, atol=1e-6)


def test_storeys_lean_where_accelerations_with_noise_ask_for_it():
    """From laws that hardly harden."""
    name = "MenegottoPinto with P-Delta"
    laws, motions = heard_chain(name, {"gravity_stiffness": 0.04 * 1.5e7, **STEEL})
    runs = FreeRuns(motions[:2], lambda motion: motion.a)
    steel = CANDIDATES["MenegottoPinto"]
    plain = replace(laws, fits=[Fit(steel, fit.units, fit.q[1:]) for fit in laws.fits])
    found = runs.with_p_delta(runs.followed(plain, 1.0, 2, 1e-8))
    assert [fit.candidate.name for fit in found.fits] == [name] * 2
