"""Lines are told apart without colour; titles, legends and units are there."""

from __future__ import annotations

from matplotlib.figure import Figure

from report.about import unit_of
from report.style import DASHES, MARKERS, one_legend, titled


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


def test_there_are_as_many_dashes_as_marks():
    assert len(DASHES) == len(MARKERS) == len(set(map(str, DASHES))) == len(set(MARKERS))
