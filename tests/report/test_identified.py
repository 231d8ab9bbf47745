"""The picture of a free run and its loops over the true ones."""

from __future__ import annotations

import torch

from data import MenegottoPinto, Polynomial
from data.record import Response
from report.paper.figures import behaviour
from report.run.identified import matched, picture

PAIRS = [["ground", "x1"], ["x2", "x1"], ["x1", "x3"]]


def spring(first: str, second: str) -> Polynomial:
    return Polynomial(between=(first, second), stiffness=1.0)


def test_elements_are_matched_by_their_nodes_in_either_direction():
    elements = {"r1": spring("s1", "x1"), "r2": spring("x1", "x2"), "r3": spring("x2", "x3")}
    assert matched(elements, PAIRS) == {"r1": (0, 1.0), "r2": (1, -1.0)}


def test_the_true_loop_lies_under_that_of_the_model(bilinear_record):
    truth = bilinear_record.truth
    elements = {f"r{i + 1}": spring("s1", f"x{i + 1}") for i in range(truth.y.shape[-1])}
    pairs = [[f"x{i + 1}", "ground"] for i in range(truth.y.shape[-1])]
    own = Response(truth.x, truth.v, 1.1 * truth.a)
    found = picture(bilinear_record, own, (-truth.y, -truth.r), elements, pairs, "0.04 %")
    axes = found["identified"].axes
    assert [a.get_ylabel() for a in axes] == ["ẍ3 [m/s²]", "its error [m/s²]", "r [N]", "r [N]"]
    for loop in axes[2:]:
        true, learned = loop.get_lines()
        assert true.get_linewidth() > learned.get_linewidth()
        torch.testing.assert_close(
            torch.from_numpy(true.get_xydata()), torch.from_numpy(learned.get_xydata())
        )


def test_an_element_without_a_word_of_the_papers_has_the_name_of_its_law():
    ends = ("s1", "x1")
    assert behaviour(spring(*ends)) == "softening"
    steel = MenegottoPinto(
        between=ends, yield_displacement=0.01, stiffness=10.0, hardening_ratio=0.1
    )
    assert behaviour(steel) == "MenegottoPinto"
