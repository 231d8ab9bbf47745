"""Colours of all pictures: of signals, and of models, of which each has the same everywhere.

Distinct to the colour-blind: Okabe & Ito (2008), and of Tol (2021) what they lack.
"""

from __future__ import annotations

import zlib

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

MEASURED, ESTIMATED = "#222222", "#d1495b"
COLOURS = {
    "vwnn": "#D55E00",
    "power_series_residual": "#E69F00",
    "power_series_restoring_force": "#56B4E9",
    "chebyshev_restoring_force": "#0072B2",
    "residual_mlp": "#009E73",
    "residual_mlp_own_residual": "#CC79A7",
    "global_mlp": "#882255",
    "linear": "#777777",
    "vwnn_first_order": "#999933",
    "vwnn_third_order": "#663311",
    "filtered_extrapolation": "#44AA99",
    "last_value": "#BBBBBB",
    "two_point": "#332288",
    "element_network": "#EE3377",
    "element_network_tanh": "#33BBEE",
    "element_network_accelerations": "#AA4499",
    "latent_hysteresis_network": "#117733",
    "vwnn_forward": "#4477AA",
    "gru": "#BBCC33",
    "lstm": "#009988",
    "neural_state_space": "#663311",
}
OTHERS = ("#DDCC77", "#661100", "#6699CC", "#888888")


def colour_of(model: str) -> str:
    """The same in every picture."""
    return COLOURS.get(model) or OTHERS[zlib.crc32(model.encode()) % len(OTHERS)]


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
