"""Tables and pictures of a run: they fit the terminal, show what happens and say of what."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import torch

from data.record import Record, Response
from models.hysteretic_element import HystereticElement
from report.describe.description import Modes, draw_modes
from report.run.figures import (
    CYCLES,
    LONGEST,
    SHORTEST,
    few_cycles,
    identified_loops,
    run_figures,
    strong_motion,
)
from report.run.rescore import draw_record, titled_picture
from report.style import placed


def test_the_strong_motion_is_where_the_power_is():
    a = np.full((6000, 2), 1e-3)
    a[4000:4300] = 1.0
    part = strong_motion(a, 0.01)
    assert part.start <= 4000
    assert part.stop >= 4300
    assert part.stop - part.start == round(SHORTEST / 0.01)
    assert strong_motion(np.ones((6000, 2)), 0.01).stop == round(LONGEST / 0.01)
    assert strong_motion(a[:50], 0.01) == slice(0, 50)


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


def test_every_picture_of_a_new_record_has_the_title(linear_record):
    t = 0.01 * torch.arange(400, dtype=torch.float64)[:, None]
    s, rate = torch.sin(t), torch.cos(t)
    record = Record(0.01, 3.0 * s + rate, s[:, :0], s=s, s_dot=rate, quantity="force")
    model = HystereticElement(1, 2, 0.01)
    model.identify([record])
    drawn = draw_record(model, record, "element", "sine")
    assert {"acceleration", "element_loops", "free_run_acceleration"} <= drawn.keys()
    for figure in drawn.values():
        assert "element on sine" in " ".join(figure.get_suptitle().split())


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
    drawn = run_figures(
        record.measured(), run.a, errors, names, run, (loops[0], loops[1]), title, 0.1 * run.a.abs()
    )
    assert len(drawn) == 5
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
