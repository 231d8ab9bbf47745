"""Tables and pictures of a run: they fit the terminal, show what happens and say of what."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import torch

from data import MenegottoPinto, Polynomial
from data.record import Record, Response
from data.simulation.records import measured_at
from models.hysteretic_element import HystereticElement
from report.describe.description import Modes, draw_modes
from report.paper.figures import behaviour
from report.run.figures import (
    CYCLES,
    LONGEST,
    SHORTEST,
    acceleration,
    error_over_time,
    few_cycles,
    finish,
    free_run_acceleration,
    free_run_displacement,
    identified_loops,
    strong_motion,
)
from report.run.rescore import agree, draw_record, print_evaluation, titled_picture
from report.run.table import error_table
from report.run.true_loops import loops_over_truth, matched
from report.style import placed
from runner.scores.numbers import scores_of


def test_the_strong_motion_is_where_the_power_is():
    a = np.full((6000, 2), 1e-3)
    a[4000:4300] = 1.0
    part = strong_motion(a, 0.01)
    assert part.start <= 4000
    assert part.stop >= 4300
    assert part.stop - part.start == round(SHORTEST / 0.01)
    assert strong_motion(np.ones((6000, 2)), 0.01).stop == round(LONGEST / 0.01)
    assert strong_motion(a[:50], 0.01) == slice(0, 50)


def test_what_is_not_scored_is_not_drawn():
    t = 0.01 * torch.arange(6000, dtype=torch.float64)[:, None]
    a = torch.sin(9.0 * t) * torch.where(t < 30.0, 5.0, 1.0)  # strongest where it was trained on
    record = Record(0.01, a, a, warmup=3000)
    for estimate in (a + 0.1, torch.where(t < 20.0, 1e9, a)):  # the second is far off before
        axes = acceleration(record, estimate).axes
        assert min(ax.get_xlim()[0] for ax in axes) >= 30.0


def test_a_title_says_model_record_error_and_what_is_odd():
    scores = {"relative_rms_percent": 5.0, "per_dof_percent": [5.0]}
    free = {"relative_rms_percent": None, "per_dof_percent": [None]}
    told = titled_picture("gru", "kobe", scores, free, "2.1 × the trained deformation")
    assert told == (
        "gru on kobe: one step 5.00 %, free run diverged; 2.1 × the trained deformation"
    )
    assert titled_picture("gru", "kobe", scores, scores) == "gru on kobe: free run 5.00 %"
    assert titled_picture("two_point", "kobe", scores, {"no_free_run": "why"}).endswith(
        "one step 5.00 %"
    )


def test_every_picture_of_a_new_record_has_the_title():
    t = 0.01 * torch.arange(400, dtype=torch.float64)[:, None]
    s, rate = torch.sin(t), torch.cos(t)
    record = Record(0.01, 3.0 * s + rate, s[:, :0], s=s, s_dot=rate, quantity="force")
    model = HystereticElement(1, 2, 0.01)
    model.identify([record])
    drawn = draw_record(model, record, "element", "sine")
    assert {"acceleration", "element_loops", "free_run_acceleration"} <= drawn.keys()
    for figure in drawn.values():
        assert "element on sine" in " ".join(figure.get_suptitle().split())


def test_channels_are_called_by_the_numbers_of_their_floors(bilinear_record):
    record = measured_at(bilinear_record, [1, 3])
    run = Response(record.x, record.v, record.a)
    drawn = (acceleration(record, record.a), free_run_displacement(record, run))
    for figure, symbol in zip(drawn, ("ẍ", "x"), strict=True):
        words = " ".join(axes.get_ylabel() + axes.get_title() for axes in figure.axes)
        assert [f"{symbol}{i}" in words for i in (1, 2, 3)] == [True, False, True]
    scores = {"relative_rms_percent": 5.0, "per_dof_percent": [4.0, 6.0]}
    table = error_table([("fir", {"test": scores})], 2, splits=("test",), numbers=[1, 3])
    assert [c.header for c in table.columns] == ["", "test\ntotal", "test\nx1", "test\nx3"]
    found = {s.name: s.value for s in scores_of({"test": scores, "numbers": [1, 3]})}
    assert found["test/per_dof_percent/x3"] == 6.0


def test_so_few_cycles_are_drawn_that_an_eye_can_follow_them():
    t = 0.01 * np.arange(4000)
    fast = np.sin(2.0 * np.pi * 10.0 * t) * np.exp(-(((t - 20.0) / 5.0) ** 2))
    signals = np.stack([fast, np.sin(t)], axis=1)
    part = few_cycles(signals, slice(1000, 3000))
    assert part.start >= 1000
    assert part.stop <= 3000
    rises = ((fast[part][:-1] < 0.0) & (fast[part][1:] >= 0.0)).sum()
    assert CYCLES - 2 <= rises <= CYCLES + 2
    assert part.start < 2000 < part.stop  # where it is strongest
    assert few_cycles(signals[:, 1:], slice(1000, 3000)) == slice(1000, 3000)


@pytest.mark.parametrize(("size", "joined"), [(1e-7, 5), (7e9, 1)])
def test_all_that_is_written_lies_in_the_picture(linear_record, size, joined):
    record = linear_record.map(lambda u: size * u)
    errors = {"one step": torch.ones(record.samples), "free run": torch.ones(record.samples)}
    any_seed = torch.Generator().manual_seed(joined)
    loops = size * torch.randn(2, record.samples, joined, generator=any_seed).double()
    run = Response(record.x, record.v, 1.01 * record.a)
    names = [f"rubber bearing {i}" for i in range(joined)]
    title = "element_network_branch on a structure with a long name, test 1: free run 12.34 %; odd"
    drawn = {
        "acceleration": acceleration(record, run.a),
        "error_over_time": error_over_time(errors, record.dt),
        "free_run_acceleration": free_run_acceleration(record.measured(), run, 0.1 * run.a.abs()),
        "free_run_displacement": free_run_displacement(record, run),
        "element_loops": identified_loops(loops[0], loops[1], names),
    }
    finish(drawn, title)
    for name, figure in drawn.items():
        figure.canvas.draw()
        box, page = figure.get_tightbbox(), figure.bbox_inches
        assert box.x0 >= 0.0, name
        assert box.y0 >= 0.0, name
        assert box.x1 <= page.x1, name
        assert box.y1 <= page.y1, name


@pytest.mark.parametrize("ends", [(-0.036, 0.048), (-0.0026, 0.0024), (-110.0, 90.0)])
def test_numbers_below_a_loop_stand_apart(ends):
    y = torch.linspace(*ends, 200, dtype=torch.float64)[:, None]
    figure = placed(identified_loops(y, y, ["storey 1"]))
    figure.canvas.draw()
    (axes,) = figure.axes
    shown = [label.get_window_extent() for label in axes.get_xticklabels()]
    inside = [box for box in shown if axes.bbox.x0 <= box.x0 + box.width / 2 <= axes.bbox.x1]
    assert len(inside) > 1
    for left, right in pairwise(inside):
        assert left.x1 + 0.3 * left.height < right.x0


@pytest.mark.parametrize("dofs", [1, 3, 14])
def test_a_picture_of_modes_holds_its_title_and_begins_at_the_ground(dofs):
    shapes = np.eye(dofs, dtype=complex)
    figure = draw_modes(
        Modes(np.arange(1.0, dofs + 1.0), np.full(dofs, 0.02), shapes),
        "small motions of element_network on a structure with a long name",
    )
    figure.canvas.draw()
    box, page = figure.get_tightbbox(), figure.bbox_inches
    assert page.x0 <= box.x0 < box.x1 <= page.x1
    assert box.y1 <= page.y1
    assert figure.axes[0].get_yticklabels()[0].get_text() == "ground"


# --- a run scored again on other seeds


def test_medians_over_seeds_count_what_diverged_and_what_escaped(capsys):
    def scores(test: float, free_run: float | None) -> dict:
        one_step = {"relative_rms_percent": test, "per_dof_percent": [test]}
        return {"test": one_step, "free_run": {"relative_rms_percent": free_run}}

    results = {"5": scores(9.0, 20.0), "6": scores(11.0, None), "7": {"failed": "it escaped"}}
    metrics = {"model": "linear", "system": "bilinear", "scenario": "noisy", **scores(9.0, 20.0)}
    print_evaluation(results, metrics, altered=True)
    *_, one_step, free_run = capsys.readouterr().out.splitlines()
    assert one_step == "test: median 10.00 (9.00 – 11.00) %, seeds: 3, 1 escaped"
    assert free_run.endswith("diverged (20.00 – diverged) %, seeds: 3, 1 diverged, 1 escaped")


def test_rounding_is_no_difference_and_more_is():
    some = {"test": {"relative_rms_percent": 10.0, "per_dof_percent": [1.0, None]}}
    near = {"test": {"relative_rms_percent": 10.0 + 1e-9, "per_dof_percent": [1.0, None]}}
    far = {"test": {"relative_rms_percent": 10.0 + 1e-7, "per_dof_percent": [1.0, None]}}
    assert agree(some, near)
    assert not agree(some, far)
    assert not agree(some, {"test": {}})


# --- a free run and its loops over the true ones

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
    places = matched(elements, pairs)
    drawn = loops_over_truth(bilinear_record, (-truth.y, -truth.r), elements, places, "0.04 %").axes
    assert [axes.get_ylabel() for axes in drawn] == ["r [N]"] * len(elements)
    for loop in drawn:
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
