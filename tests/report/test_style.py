"""Lines are told apart without colour; titles, legends and units are there."""

from __future__ import annotations

from matplotlib.figure import Figure

from report.about import unit_of
from report.style import titled


def test_units_are_those_of_the_comments_in_conf():
    keys = ("model.cutoff", "scenario.cutoff", "data.dt", "scenario.level", "seed", "no.such")
    assert [unit_of(key) for key in keys] == ["rad/s", "Hz", "s", "", "", ""]


def test_a_long_title_ends_before_the_legend():
    figure = titled(Figure(figsize=(5.0, 2.0)), "a title of many words " * 8, legend=2.0)
    assert max(map(len, figure.get_suptitle().split("\n"))) <= 33
