"""What storeys of planted chains suffer: energies balance, an elastic storey stays as stiff."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from data.simulation.element_test import growing_cycles
from data.simulation.laws.bilinear import Bilinear
from data.simulation.laws.candidate import Units
from data.simulation.laws.polynomial import Polynomial
from data.simulation.laws.self_centering import SelfCentering
from data.simulation.laws.slack_brace import SlackBrace
from data.simulation.laws.takeda import Takeda
from models import ElementNetwork
from models.composition.topology import is_open
from models.element_network_named import ElementNetworkNamed
from models.named_laws.candidates import CANDIDATES
from models.named_laws.fit import Fit
from models.named_laws.free_run import Laws
from models.uncertainty.drifts import stiffness_of, storeys_of
from tests.models.test_hidden_floors import (
    DT,
    MASSES,
    PAIRS,
    SAMPLES,
    STIFFNESS,
    drive,
    record,
    shaken,
    structure,
)

YIELD, BETWEEN = 0.004, ("ground", "x1")


def planted(
    name: str, more: float = 1.0, longer: float = 1.0, heavier: float = 1.0, **built: object
) -> ElementNetworkNamed:
    """A chain of one law; the likely laws are so many times as stiff, or so much less."""
    masses, law = heavier * np.array(MASSES), CANDIDATES[name]
    options = {"forced": "base", "masses": masses.tolist(), "sensors": [3], **built}
    model = ElementNetwork(
        3, inputs=options.pop("inputs", 1), dt=DT, elements="chain", laws=[name], **options
    )
    assert isinstance(model, ElementNetworkNamed)
    model.mass.start(torch.from_numpy(masses))
    fits = []
    for k in STIFFNESS:
        force = heavier * longer * k * YIELD
        units = Units(longer * YIELD, longer * YIELD / 0.1, force, heavier * k)
        fits.append(Fit(law, units, law.at([0.5] * len(law.parameters))))
    laws = Laws(fits, masses, PAIRS, False, 0.1, "ground")
    model._take(laws)
    softer, stiffer = (
        replace(laws, fits=[replace(fit, units=fit.units.scaled(size, 1.0)) for fit in fits])
        for size in (1.0 / more, more)
    )
    for i, one in enumerate([softer, stiffer] * 16):
        model.drawn_damping[i] = one.mass_damping
        for e, fit in enumerate(one.fits):
            own = [*vars(fit.units).values(), *fit.q.tolist()]
            model.drawn[i, e, : len(own)] = torch.tensor(own)
    return model


def rows_of(model: ElementNetworkNamed, seed: int = 1, longer: float = 1.0) -> list[dict]:
    f = shaken(model.structure(), seed, longer)[0]
    return storeys_of(model, drive(f))


@pytest.mark.parametrize("name", ["Bilinear", "Takeda", "BaberNoori"])
def test_energies_balance(name: str) -> None:
    """Of a motion that is broken off where it is strong: input of the base = what there is."""
    model = planted(name)
    drives = drive(shaken(model.structure(), 1)[0][: 3 * SAMPLES // 4])
    (motion,) = model.motions_of(model.structure(), drives)
    m, alpha, f = np.array(MASSES), float(model.mass_damping), drives.u.numpy()
    entered = np.trapezoid((f * m * motion.v).sum(axis=1), dx=DT)
    by_masses = alpha * np.trapezoid((m * motion.v**2).sum(axis=1), dx=DT)
    moving = 0.5 * (m * motion.v[-1] ** 2).sum()
    springs = [sum(law.tangent()[0] for law in model.named_elements(e)) for e in range(3)]
    held = 0.5 * (motion.r[-1, :3] ** 2 / springs).sum()
    spent = sum(row["dissipated_energy"] for row in storeys_of(model, drives))
    assert spent + by_masses + moving + held == pytest.approx(entered, rel=0.02)
    assert moving + held > 0.03 * entered
    assert spent > 0.3 * entered


def test_an_elastic_storey_spends_nothing_and_keeps_its_stiffness() -> None:
    model = planted("Linear")
    model.named.numbers.data[:, 1] = -12.0  # next to no damper
    for row in rows_of(model):
        assert row["stiffness_left"] == pytest.approx(1.0, rel=1e-6)
        work = STIFFNESS[0] * row["peak"] ** 2
        assert abs(row["dissipated_energy"]) < 1e-3 * work


def test_floors_move_with_the_ground() -> None:
    """As sensors on them have it: of a base, and where its acceleration is applied as forces."""
    on_base, on_forces = planted("Takeda"), planted("Takeda", forced=[1, 2, 3], inputs=3)
    f, a, y = shaken(on_base.structure(), seed=1)
    seen, drifts = (a - f).abs().amax(dim=0), np.abs(y[:, :3]).max(axis=0)
    forces = drive(f * torch.tensor(MASSES))
    for rows in (storeys_of(on_base, drive(f)), storeys_of(on_forces, forces, -f[:, 0].numpy())):
        np.testing.assert_allclose([row["floor_acceleration"] for row in rows], seen, rtol=1e-5)
        np.testing.assert_allclose([row["peak"] for row in rows], drifts, rtol=1e-5)


def test_other_units_change_nothing() -> None:
    longer, heavier = 1000.0, 1e-3
    sizes = {"peak": longer, "residual": longer, "floor_acceleration": longer}
    sizes |= {"dissipated_energy": heavier * longer**2, "stiffness_left": 1.0}
    own = rows_of(planted("Takeda", 1.2))
    other = rows_of(planted("Takeda", 1.2, longer, heavier), longer=longer)
    for one, two in zip(own, other, strict=True):
        for key, size in sizes.items():
            assert two[key] == pytest.approx(size * one[key], rel=1e-3)
            assert two[f"{key}_half"] == pytest.approx(size * one[f"{key}_half"], rel=1e-2)


def test_intervals_are_those_of_the_likely_laws() -> None:
    model = planted("Takeda", 1.2)
    drives = drive(shaken(model.structure(), 1)[0])
    sure, unsure = storeys_of(planted("Takeda"), drives), storeys_of(model, drives)
    for row, wide in zip(sure, unsure, strict=True):
        assert 0.1 < row["stiffness_left"] < 0.95
        for key in ("peak", "residual", "floor_acceleration", "dissipated_energy"):
            assert row[f"{key}_half"] < 1e-3 * wide[f"{key}_half"]
            assert wide[key] == row[key]
            assert wide[f"{key}_half"] > 0.01 * abs(wide[key])
    moved = [next(iter(model.motions_of(one.structure(), drives))).y for one in model.likely()]
    far = np.abs(moved).max(axis=1)[:, :3] - [row["peak"] for row in unsure]
    half = [row["peak_half"] for row in unsure]
    np.testing.assert_allclose(half, 1.96 * np.sqrt((far**2).mean(axis=0)), rtol=1e-3)


@pytest.mark.parametrize("law", [Bilinear, SelfCentering])
def test_what_yields_and_holds_as_before_has_lost_nothing(law: type) -> None:
    given = {"stiffness": 1e6, "between": BETWEEN}
    if law is Bilinear:
        given |= {"yield_displacement": 1.0, "post_yield_stiffness": 1e5}
    else:
        given |= {"activation_displacement": 1.0, "hardening_ratio": 0.1, "flag": 0.8}
    y = growing_cycles(4.0, 5, DT, 0.5)
    before, after = stiffness_of([law(**given)], y, DT)
    assert before == pytest.approx(1e6, rel=1e-6)
    assert after == pytest.approx(before, rel=1e-2)


def test_a_storey_that_points_to_its_peaks_keeps_what_reloading_and_unloading_say() -> None:
    """Of Takeda after growing cycles to ±4 yield drifts: between the slopes of both."""
    k, ductility = 1e6, 4.0
    law = Takeda(between=BETWEEN, stiffness=k, yield_displacement=1.0, hardening_ratio=0.05,
                 unloading_exponent=0.4)  # fmt: skip
    y = growing_cycles(ductility, 5, DT, 0.5)
    before, after = stiffness_of([law], y, DT)
    peak = k * (1.0 + 0.05 * (ductility - 1.0))
    assert before == pytest.approx(k, rel=1e-6)
    lower = 0.85 * ductility  # the last peak forward
    assert 0.9 * peak / (2.0 * ductility) < after < 1.001 * k * lower**-0.4


def test_a_brace_that_went_slack_leaves_the_frame_alone() -> None:
    brace = SlackBrace(between=BETWEEN, stiffness=1e6, yield_displacement=1.0, gap=0.0,
                       hardening_ratio=0.02)  # fmt: skip
    frame = Polynomial(between=BETWEEN, stiffness=2e5)
    before, after = stiffness_of([brace, frame], growing_cycles(4.0, 5, DT, 0.5), DT)
    assert before == pytest.approx(1.2e6, rel=0.01)
    assert after == pytest.approx(2e5, rel=0.01)


def test_a_building_at_rest_has_suffered_nothing() -> None:
    model = planted("Takeda")
    for row in storeys_of(model, drive(torch.zeros(50, 1, dtype=torch.float64))):
        assert row["peak"] == row["floor_acceleration"] == 0.0
        assert row["stiffness_left"] is None


def test_energy_is_not_told_where_masses_are_not_known() -> None:
    model = planted("Takeda", masses=None)
    assert model.scale_is_open
    assert all(row["dissipated_energy"] is None and row["peak"] > 0.0 for row in rows_of(model))


def test_a_chain_with_all_sensors_tells_of_its_storeys_where_heights_are_given() -> None:
    told, (f, _, y) = planted("Bilinear", sensors=[1, 2, 3], heights=3.0), shaken(structure(), 8)
    told.identify([record([1, 2, 3], noise=0.02)])
    rows, true = storeys_of(told, drive(f, 3)), np.abs(y).max(axis=0)
    assert len(rows) == 3
    for row, peak in zip(rows, true, strict=True):
        assert abs(row["peak"] - peak) < 2.0 * row["peak_half"] < 0.1 * peak


def test_heights_change_no_motion() -> None:
    rows = rows_of(planted("Takeda", heights=[4.0, 3.0, 3.0]))
    assert [row.pop("height") for row in rows] == [4.0, 3.0, 3.0]
    assert rows == rows_of(planted("Takeda"))
    assert planted("Takeda", heights=3).heights == [3, 3, 3]


@pytest.mark.parametrize(
    ("heights", "said"),
    [
        ([3.0, 3.0], "expected 3 heights"),
        (-3.0, "=-3.0: expected"),
        ([3.0, 0.0, 3.0], "of 0.01 to 100 m"),
        (3500.0, "of 0.01 to 100 m"),
    ],
)
def test_heights_that_are_none_are_refused(heights: object, said: str) -> None:
    with pytest.raises(ValueError, match=rf"model\.heights.*{said}"):
        planted("Takeda", heights=heights)


def test_only_a_chain_has_storeys() -> None:
    with pytest.raises(ValueError, match=r"choose model\.elements=chain"):
        ElementNetwork(3, 1, DT, elements="all", forced="base", laws="named", heights=3.0)
    assert ElementNetwork(2, 2, DT, laws="named", heights=3.0).is_chain
    driven = {"inputs": 1, "forced": "base", "quantity": "acceleration", "measured": True}
    weightless: Any = SimpleNamespace(dofs=2, **driven)
    settings = {"elements": None, "masses": None, "forced": "base", "heights": None}
    assert is_open(settings, weightless)
    assert not is_open({**settings, "heights": 3.0}, weightless)
