"""Lines are told apart without colour; titles, legends and units are there."""

from __future__ import annotations

import numpy as np
import torch
from matplotlib.figure import Figure

from report.about import unit_of
from report.style import DASHES, MARKERS, one_legend, titled
from report.tuning.page import draw
from studies.detection.figures import delays_figure, levels_figure
from studies.detection.motions import SYSTEMS, WATCHES, Outcome


def test_units_are_those_of_the_comments_in_conf():
    keys = ("model.cutoff", "scenario.cutoff", "data.dt", "scenario.level", "seed", "no.such")
    assert [unit_of(key) for key in keys] == ["rad/s", "Hz", "s", "", "", ""]


def test_a_long_title_ends_before_the_legend():
    figure = titled(Figure(figsize=(5.0, 2.0)), "a title of many words " * 8, legend=2.0)
    assert max(map(len, figure.get_suptitle().split("\n"))) <= 33


def test_a_label_of_many_panels_stands_once_in_the_legend():
    figure = Figure()
    panels = figure.subplots(1, 2)
    for axes in panels:
        axes.plot([0.0, 1.0], label="one")
    panels[1].plot([1.0, 0.0], label="other")
    one_legend(figure, panels)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["one", "other"]


def test_watches_are_told_apart_without_colour_and_every_axis_has_numbers():
    random = torch.Generator().manual_seed(0)
    levels = torch.rand(3, 120, 3, generator=random).double() * 1.2
    outcomes = {s: {w.name: Outcome(levels, levels) for w in WATCHES} for s in SYSTEMS}
    for figure in (delays_figure(outcomes), levels_figure(outcomes)):
        figure.canvas.draw()
        assert len(figure.legends[0].get_texts()) == len(WATCHES)
        for axes in figure.axes:
            lines = axes.get_lines()[: len(WATCHES)]
            assert len({(str(u.get_linestyle()), u.get_marker()) for u in lines}) == len(WATCHES)
    for axes in delays_figure(outcomes).axes:
        assert all(tick.label1.get_visible() for tick in axes.xaxis.get_major_ticks())
        assert "[s]" in axes.get_xlabel()


def test_there_are_as_many_dashes_as_marks():
    assert len(DASHES) == len(MARKERS) == len(set(map(str, DASHES))) == len(set(MARKERS))


def test_both_ways_of_a_search_stand_in_the_legend():
    class Some:
        model, system = "vwnn", "bilinear"

        def errors(self, way: str) -> dict[int, float]:
            return {seed: float(seed + (way == "tuned")) for seed in range(1, 4)}

    figure = draw([Some()])
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words == ["as configured, a seed each", "tuned, a seed each"]
    configured, tuned = (line for line in figure.axes[0].get_lines() if len(line.get_xdata()) == 3)
    assert configured.get_marker() != tuned.get_marker()
    assert np.isfinite(tuned.get_xdata()).all()
