"""How pictures look: colours of signals, dashes and marks of lines, marks of lost runs, ticks.

What a model is compared with is drawn wide and pale beneath it, so that both show where they
coincide. Lines differ in dash or mark too, for pictures are printed in grey. A model's colour
is set in conf/model (report/about.py). Colours are distinct to the colour-blind: Okabe & Ito
(2008), and of Tol (2021) what they lack.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from data.arguments import plain

MEASURED, ESTIMATED = "#222222", "#d1495b"
TRUE = "#b8b8b8"
WIDE, NARROW = 4.0, 0.9
DASHES: tuple[Any, ...] = (
    *("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)), (0, (9, 3))),
    *((0, (3, 1, 1, 1, 1, 1)), (0, (2.5, 2.5)), (0, (9, 1.5, 3, 1.5))),
)
MARKERS = "osD^vP*X"
TITLE = 11.0  # letters of a title in an inch
LINE, BELOW, BESIDE, RIGHT = 0.22, 0.5, 1.0, 0.3  # of a text, of axes and their numbers [inches]
DRAWN = 12  # panels of a figure: of what is largest, or slowest
MANY = 5.0  # decades, of which every second has a tick
SERIES = (  # of lines that are no model
    *("#D55E00", "#E69F00", "#56B4E9", "#0072B2", "#009E73", "#CC79A7", "#882255"),
    *("#777777", "#999933", "#663311", "#44AA99", "#BBBBBB", "#332288"),
)
APART = [SERIES[i] for i in (3, 0, 4, 5, 2, 1, 6, 7)]  # of few lines, the most different first


def titled(figure: Figure, title: str, legend: float = 0.0) -> Figure:
    """Write at the upper left what a figure shows, in lines that end before a legend [inches]."""
    letters = max(20, int(TITLE * (figure.get_figwidth() - legend)))
    text = "\n".join(textwrap.wrap(title, letters))
    figure.suptitle(text, fontsize="medium", x=0.01, ha="left")
    return figure


def placed(figure: Figure) -> Figure:
    """Place a grid of panels with margins [inches] that hold ticks, labels and titles of any.

    Matplotlib's constrained layout measures every text twice: a good part of the time.
    """
    width, height = figure.get_size_inches()
    inner = []
    for axes in figure.axes:
        place = axes.get_subplotspec()
        assert place is not None
        grid = place.get_gridspec()
        inner += [] if place.is_last_row() else [axes]
    titles = LINE * any(axes.get_title() for axes in figure.axes)
    above = figure.get_suptitle().count("\n") + 1 if figure.get_suptitle() else bool(figure.legends)
    top = 0.1 + LINE * above + titles
    between = titles + (BELOW if any(axes.get_xlabel() for axes in inner) else 0.15)
    wide = (width - BESIDE * grid.ncols - RIGHT) / grid.ncols
    high = (height - top - BELOW - between * (grid.nrows - 1)) / grid.nrows
    figure.subplots_adjust(
        left=BESIDE / width,
        right=1.0 - RIGHT / width,
        bottom=BELOW / height,
        top=1.0 - top / height,
        wspace=BESIDE / wide,
        hspace=between / high,
    )
    return figure


def panels(count: int, width: float, height: float, **how: Any) -> tuple[Figure, list[Axes]]:
    """A figure with `count` panels of a size [inches], three in a row at most.

    how: `more` width and height of the whole; settings of Matplotlib's Figure (layout) and subplots
    (sharex, sharey).
    """
    columns = min(3, count)
    rows = -(-count // columns)
    wider, higher = how.pop("more", (0.0, 0.0))
    size = (wider + width * columns, higher + height * rows)
    figure = Figure(figsize=size, layout=how.pop("layout", None))
    drawn = figure.subplots(rows, columns, squeeze=False, **how).flatten().tolist()
    for axes in drawn[count:]:
        axes.remove()
    return figure, drawn[:count]


def finish_loop(axes: Axes, title: str = "", force: str = "r [N]", y: str = "y [m]") -> None:
    """Title, labels and grid of a loop: force over deformation."""
    axes.set_title(title, fontsize="medium")
    axes.locator_params(axis="x", nbins=3)  # numbers such as −0.0025 are wide
    axes.tick_params(axis="x", labelsize="small")
    axes.set_xlabel(y)
    axes.set_ylabel(force)
    axes.grid(alpha=0.25)


def one_legend(
    figure: Figure, drawn: Iterable[Axes], order: Iterable[str] = (), **how: Any
) -> None:
    """A legend of a figure with every label of its panels once; those of `order` come first."""
    handles: dict[Any, Any] = {}
    for axes in drawn:
        handles |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    handles = {name: handles[name] for name in order if name in handles} | handles
    figure.legend(handles.values(), handles.keys(), frameon=False, **how)


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
    """Ticks that do not overlap: more of them within a decade."""
    low, high = axes.get_xlim()
    decades = np.log10(high / low)
    multiples = [1.0] if decades > 2.0 else [1.0, 2.0, 5.0]
    if decades < 1.0:
        multiples = [1.0, 2.0, 3.0, 4.0, 6.0]
    plain_decades(axes.xaxis, multiples, 100.0 if decades > MANY else 10.0)


def plain_decades(axis: Axis, multiples: Sequence[float], base: float = 10.0) -> None:
    """Ticks of a logarithmic axis written out, 0.1 and not a power of ten."""
    axis.set_major_locator(LogLocator(base=base, subs=multiples))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())
