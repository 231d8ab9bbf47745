"""How pictures look: colours of signals, marks of lost runs, ticks.

A model's colour stands in conf/model (report/about.py). Colours are distinct to the colour-blind:
Okabe & Ito (2008), and of Tol (2021) what they lack.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from data.arguments import plain

MEASURED, ESTIMATED = "#222222", "#d1495b"
SERIES = (  # of what is no model
    *("#D55E00", "#E69F00", "#56B4E9", "#0072B2", "#009E73", "#CC79A7", "#882255"),
    *("#777777", "#999933", "#663311", "#44AA99", "#BBBBBB", "#332288"),
)


def words_as_they_stand(figure: Figure) -> None:
    """Titles, labels and legends without formulas and control characters.

    They hold names from files and configs; a $ there is a $. Ticks may be powers of ten, as ever.
    """
    texts = [t for axes in figure.axes for t in (axes.title, axes.xaxis.label, axes.yaxis.label)]
    legends = [axes.get_legend() for axes in figure.axes] + figure.legends
    texts += [text for legend in legends if legend is not None for text in legend.get_texts()]
    for text in (*texts, *figure.texts):
        text.set_parse_math(False)
        text.set_text("\n".join(map(plain, text.get_text().split("\n"))))


def mark_lost(axes: Axes, place: float, count: int, colour: str) -> None:
    """▶ at the right edge of a row, and how many runs diverged or failed in it."""
    if count:
        edge = axes.get_yaxis_transform()
        axes.plot(0.985, place, ">", markersize=6, transform=edge, color=colour)
        axes.text(0.955, place, str(count), transform=edge, ha="right", va="center", fontsize=7)


def percent_ticks(axes: Axes) -> None:
    """Ticks that fit in beside each other: more of them within a decade."""
    low, high = axes.get_xlim()
    decades = np.log10(high / low)
    multiples = [1.0] if decades > 2.0 else [1.0, 2.0, 5.0]
    if decades < 1.0:
        multiples = [1.0, 2.0, 3.0, 4.0, 6.0]
    axes.xaxis.set_major_locator(LogLocator(subs=multiples))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
