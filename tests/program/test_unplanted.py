"""The suite of structures whose law nobody planted: a quick run, resumed, and its page."""

from __future__ import annotations

import json
import math
import re
import sys
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.unplanted import __main__ as elements
from benchmarks.unplanted import chains, drawn_chains, shaken, structures, suite
from benchmarks.unplanted.drawn_chains import drawn_chain, ductilities, from_itself
from benchmarks.unplanted.frame import GRAVITY
from benchmarks.unplanted.frames import FRAMES
from benchmarks.unplanted.frames import HELD_BACK as FRAMES_HELD_BACK
from benchmarks.unplanted.isolated import Bearing, Isolated
from benchmarks.unplanted.opensees import opensees
from benchmarks.unplanted.page import lost, medians, write_page
from benchmarks.unplanted.structures import CASES, HELD_BACK, records
from data.simulation.elements import FrictionPendulum, Polynomial
from data.simulation.motion import simulate
from data.simulation.structure import Structure
from models import moment_frame as fit

FIT = {
    **{"train": 1.0, "unseen": 2.0, "farther": 3.0, "seconds": 4.0, "parameters": 5},
    **{"remark": "", "chosen": "more, less; 0.001"},
}


def test_a_quick_run_is_resumed_and_writes_its_page(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(structures, "SAMPLES", structures.SAMPLES)
    words = ["suite", "--quick", "--models", "zero", "element_network_branch"]
    page = tmp_path / "page.md"
    monkeypatch.setattr(sys, "argv", [*words, "--output", str(tmp_path), "--page", str(page)])
    suite.main()
    files = sorted((tmp_path / "quick").glob("*.json"))
    assert len(files) == 2
    branch = json.loads(files[0].read_text("utf-8"))
    assert 0.0 < branch["train"] < 60.0
    assert set(branch["chosen"].partition(";")[0].split(", ")) <= {"more", "less"}
    assert "slack braces, 2 storeys" in page.read_text("utf-8")
    assert (tmp_path / "figures" / "unplanted_slack_braces-2_storeys.png").is_file()
    before = [file.stat().st_mtime_ns for file in files]
    suite.main()
    assert [file.stat().st_mtime_ns for file in files] == before
    assert "`zero`" in capsys.readouterr().out


def test_a_quick_run_of_single_elements_has_a_row_for_every_model(monkeypatch, capsys):
    """Also of one that is searched, and has no objective whose settings could be short."""
    monkeypatch.setitem(elements.MODELS, "named_element", ("model.laws=[SelfCentering]",))
    models = ["named_element", "hysteretic_element"]
    monkeypatch.setattr(
        sys, "argv", ["unplanted", "--quick", "--laws", "flag", "--models", *models]
    )
    elements.main()
    rows = [line.split() for line in capsys.readouterr().out.splitlines() if "seeds" in line]
    assert [row[:2] for row in rows] == [["flag", model] for model in models]
    assert float(rows[0][3]) < 0.1 < float(rows[1][3]) < 30.0


def test_every_structure_stands_and_moves(monkeypatch):
    monkeypatch.setattr(structures, "SAMPLES", 300)
    for case in (*CASES.values(), *HELD_BACK.values()):
        motions = records(case)
        assert [len(those) for those in motions.values()] == [6, 4, 4]
        assert all(bool(r.a.isfinite().all()) for those in motions.values() for r in those)
        assert case.structure().natural_frequencies()[0] > 0.5


def test_a_fit_that_diverged_counts_as_the_worst(tmp_path):
    name = next(iter(CASES))
    fits = [
        {"structure": name, "model": "a", "seed": seed, **FIT, "farther": far}
        for seed, far in enumerate((3.0, None, None))
    ]
    assert "| 1.00 | 2.00 | diverged | 5 | 4 | 2 of 3 |" in medians(fits)
    assert f"- {name}, `a`, seed 1: diverged 1.5 times" in lost(fits)
    wanted = [(name, "a", 0), (name, "b", 1)]
    write_page(tmp_path / "page.md", fits, wanted, {}, limit=3.0)
    page = (tmp_path / "page.md").read_text("utf-8")
    assert f"- `b`, seed 1: {name}" in page
    assert "`a`, seed 0:" not in page.partition("## ")[0]
    assert f"Longer than 3 s: {name}, `a`, seed 0: 4 s" in page
    assert f"| {name} | `a` | 0 | more, less | 0.001 |" in page


def test_a_page_of_stored_fits_alone_fits_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(suite, "measured", None)
    page = tmp_path / "page.md"
    monkeypatch.setattr(
        sys, "argv", ["suite", "--stored", "--output", str(tmp_path / "none"), "--page", str(page)]
    )
    suite.main()
    assert "Not run for this page" in page.read_text("utf-8")


def test_a_stiffer_twin_is_apart_in_proportion_where_a_structure_is_not_sensitive(monkeypatch):
    monkeypatch.setattr(structures, "SAMPLES", 400)
    case = CASES["pinching walls, 2 storeys"]
    plain = records(case)["unseen"]
    near, far = (suite.apart(records(case, times)["unseen"], plain) for times in (1.0001, 1.001))
    assert far / near == pytest.approx(10.0, rel=0.2)


def test_noise_leaves_accelerations_alone_and_is_drawn_from_the_seed(monkeypatch):
    monkeypatch.setattr(structures, "SAMPLES", 300)
    plain = records(CASES["steel, 3 storeys"])["train"][0]
    one, same, other = (suite.noisy(plain, seed) for seed in (1, 1, 2))
    assert one.x is None
    assert one.v is None
    assert one.s is not None
    assert (one.a == same.a).all()
    assert not (one.a == other.a).all()
    share = (one.a - plain.a).std(dim=0) / plain.a.std(dim=0)
    assert share.tolist() == pytest.approx([suite.NOISE] * 3, rel=0.2)


def test_an_unknown_structure_is_refused():
    with pytest.raises(ValueError, match="expected some of"):
        suite.arguments(["--cases", "castle"])


@pytest.fixture
def brief(monkeypatch):
    """Motions of OpenSees that last 3 s, of which it is sure."""
    if opensees() is None:
        pytest.skip("needs openseespy: pip install -c constraints.txt -e '.[opensees]'")
    monkeypatch.setattr(shaken, "SAMPLES", 300)
    monkeypatch.setattr(drawn_chains, "from_itself", lambda chain: [0.0])


def test_a_chain_that_is_drawn_has_its_period_and_comes_as_far_as_was_drawn(brief):
    what, chain = drawn_chain("Steel02", 3)
    assert drawn_chain("Steel02", 3) == (what, chain)
    seed, storeys, period, ductility = re.findall(r"\d+\.?\d*", what.replace("Steel02", ""))
    assert (int(seed), int(storeys)) == (3, len(chain.masses))
    assert 2.0 * math.pi / shaken.natural_rates(chain)[0] == pytest.approx(float(period), abs=0.01)
    assert 0.06 <= float(period) / int(storeys) <= 0.2
    yielded = np.array([one[1] / one[2] for (one,) in chain.storeys])
    far = max(ductilities(chain, yielded, structures.TRAINED, drawn_chains.COARSE))
    assert far == pytest.approx(float(ductility), rel=0.1)


@pytest.mark.parametrize("name", [*drawn_chains.MATERIALS, "Isolated"])
def test_units_of_a_chain_that_is_drawn_change_no_motion(name, brief, monkeypatch):
    monkeypatch.setattr(drawn_chains, "HALVINGS", 2)
    moved = []
    for one, (newton, metre) in drawn_chains.UNITS.items():
        monkeypatch.setattr(drawn_chains, "UNITS", {one: (newton, metre)})
        moved.append(metre * shaken.record(drawn_chain(name, 4)[1], 300, 1.0).a.numpy())
    assert np.abs(moved[0]).max() > 0.0
    for other in moved[1:]:
        np.testing.assert_allclose(other, moved[0], atol=1e-4 * np.abs(moved[0]).max())


def test_a_building_on_a_bearing_moves_as_the_law_and_the_springs_do(brief):
    """OpenSees' bearing and springs against the simulation of the project, without damping."""
    of = Bearing(20.0, 0.04, 0.10, 20.0, 2e-3)
    masses, k = [3e4, 2e4], 4e6
    case = Isolated(masses, [[["Elastic", k]]], 4.0, 1e-9, bearing=of)
    ground = shaken.ground_motion(0, 4.0)
    theirs = shaken.simulated(case, ground)[0]
    bearing = FrictionPendulum(
        between=("ground", "x1"),
        weight=GRAVITY * sum(masses),
        radius=of.radius,
        friction_fast=of.fast,
        friction_slow=of.slow,
        rate=of.rate,
        yield_displacement=of.shear,
        spring_share=1.0,
    )
    above = Polynomial(between=("x1", "x2"), stiffness=k)
    structure = Structure(masses, {"bearing": bearing, "above": above})
    pushed = -ground[:, None] * np.array(masses)
    ours = simulate(structure, pushed, structures.DT).x
    assert np.abs(theirs[:, 0]).max() > 5.0 * of.shear
    np.testing.assert_allclose(theirs, ours, atol=0.01 * np.abs(ours).max())


def test_a_building_on_a_bearing_that_is_drawn_slides_as_far_as_was_drawn(brief):
    what, chain = drawn_chain("Isolated", 3)
    metres = float(what.split(", ")[-1].removesuffix(" m"))
    of_unit = drawn_chains.UNITS[", ".join(what.split(", ")[2:4])][1]
    slides = np.array([metres / of_unit, *[math.inf] * len(chain.storeys)])
    far = max(ductilities(chain, slides, structures.TRAINED, drawn_chains.COARSE))
    assert far == pytest.approx(1.0, rel=0.1)


def test_drawn_chains_are_a_table(brief, monkeypatch, capsys):
    words = ["chains", "--drawn", "SelfCentering", "--seeds", "5", "--noise", "0"]
    monkeypatch.setattr(drawn_chains, "HALVINGS", 2)
    monkeypatch.setattr(sys, "argv", [*words, "--settings", "model.laws=[SelfCentering]"])
    chains.main()
    assert "| SelfCentering 5, " in capsys.readouterr().out


def test_another_chain_is_drawn_where_opensees_is_in_doubt_of_one(brief, monkeypatch):
    monkeypatch.setattr(drawn_chains, "HALVINGS", 2)
    doubts = iter([[50.0, 1.0], [math.inf], [0.1, 0.2]])
    monkeypatch.setattr(drawn_chains, "from_itself", lambda chain: next(doubts))
    what, chain = drawn_chain("Steel02", 3)
    assert what.endswith(", after 2 in doubt")
    assert chain.masses != drawn_chains._drawn("Steel02", 3, 0)[1].masses
    monkeypatch.setattr(drawn_chains, "from_itself", lambda chain: [5.1])
    with pytest.raises(ValueError, match="sure of none of 10"):
        drawn_chain("Steel02", 3)


def test_opensees_is_the_nearer_to_itself_the_finer_its_steps(brief):
    chain = drawn_chain("Steel02", 3)[1]
    near, far = (max(from_itself(replace(chain, substeps=steps))) for steps in (64, 16))
    assert 0.0 < near < 0.1 * far  # of second order


def test_a_frame_that_only_cases_asks_for_is_a_table(brief, monkeypatch, capsys):
    name = "fibre frame, light roof"
    assert not {*FRAMES, *FRAMES_HELD_BACK} & {*chains.CASES}
    monkeypatch.setattr(fit, "ITERATIONS", (2, 2, 2))
    words = ["chains", "--cases", name, "--model", "moment_frame", "--noise", "0"]
    monkeypatch.setattr(sys, "argv", words)
    chains.main()
    row = capsys.readouterr().out.splitlines()[-1].split(" | ")
    assert row[0] == f"| {name}"
    assert 0.0 < float(row[1]) < 60.0
