"""A picture of the shapes of small motions, DOF over DOF, a mode each."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from export.modes import Modes
from report.style import ESTIMATED, MEASURED, one_legend

MOST = 12  # modes that are drawn, the slowest


def draw_modes(modes: Modes, title: str) -> Figure:
    """Displacement of every DOF in each mode; faint: the part that is out of phase."""
    count, dofs = min(MOST, len(modes.frequencies)), len(modes.shapes)
    columns = min(6, count)
    rows = -(-count // columns)
    height = 1.2 + 0.22 * min(max(dofs, 4), 12)
    figure = Figure(figsize=(0.8 + 1.5 * columns, 0.7 + rows * height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    place = np.arange(dofs + 1)
    for i, ax in enumerate(axes[:count]):
        shape = np.concatenate([[0.0], modes.shapes[:, i]])
        ax.axvline(0.0, color="#bbbbbb", linewidth=0.8)
        if np.abs(shape.imag).max() > 0.02:
            ax.plot(shape.imag, place, ":", color=ESTIMATED, linewidth=1.0, label="out of phase")
        ax.plot(
            shape.real, place, ".-", color=MEASURED, linewidth=1.2, markersize=6, label="in phase"
        )
        hertz, share = modes.frequencies[i], 100.0 * modes.damping[i]
        ax.set_title(f"{hertz:.3g} Hz, {share:.2g} %", fontsize=8)
        ax.set_xlim(-1.15, 1.15)
        ax.tick_params(labelsize=7)
        step = -(-dofs // 12)
        ax.set_yticks(place[::step], ["rest", *(f"x{j}" for j in place[1:])][::step])
    for ax in axes[count:]:
        ax.set_visible(False)
    more = (
        f", the slowest {count} of {len(modes.frequencies)}"
        if count < len(modes.frequencies)
        else ""
    )
    figure.suptitle(f"{title}{more}", fontsize=9)
    for ax in axes[max(0, count - columns) : count]:
        ax.set_xlabel("shape [–]", fontsize=8)
        ax.tick_params(labelbottom=True)
    one_legend(figure, axes[:count], loc="outside lower center", ncols=2, fontsize=8)
    return figure
