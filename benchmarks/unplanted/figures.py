"""Loops of the storeys in the first unseen motion: the structure's, and the network's free run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from report.run.compared import LOOPS, few_cycles
from report.style import ESTIMATED, NARROW, TRUE, WIDE, one_legend, titled

MODEL = "element_network_branch"
MOST, WIDTH = 4, 3.0  # storeys that are shown; inches of one


def draw_loops(folder: Path, stored: Path, results: Sequence[dict[str, Any]]) -> dict[str, Path]:
    """A picture of every structure whose fit of the last seed has loops beside it."""
    pictures = {}
    last = max((result["seed"] for result in results if result["model"] == MODEL), default=0)
    for result in results:
        if result["model"] != MODEL or result["seed"] != last:
            continue
        name = result["structure"].replace(", ", "-").replace(" ", "_")
        loops = stored / f"{MODEL}-{name}-seed{last}.npz"
        if loops.is_file():
            folder.mkdir(parents=True, exist_ok=True)
            pictures[result["structure"]] = folder / f"unplanted_{name}.png"
            with np.load(loops) as stored_loops:
                signals = stored_loops["signals"]
            error = result["unseen"]
            gone = "diverged" if error is None else f"{error:.2f} %"
            title = f"{result['structure']}: {MODEL}, seed {last}, unseen motions: {gone}"
            if signals.shape[2] > MOST:
                title += f"; {MOST} of {signals.shape[2]} storeys"
            _draw(pictures[result["structure"]], signals, title)
    return pictures


def _draw(picture: Path, signals: np.ndarray, title: str) -> None:
    """signals (4, T, storeys): drifts and forces, true and simulated."""
    storeys = min(signals.shape[2], MOST)
    drifts = signals[0]
    part = few_cycles(drifts, slice(0, len(drifts)), LOOPS)
    figure = Figure(figsize=(WIDTH * storeys, 3.1), layout="constrained")
    for storey, place in enumerate(figure.subplots(1, storeys, squeeze=False)[0]):
        true, own = (
            (1e3 * signals[first, part, storey], 1e-3 * signals[first + 1, part, storey])
            for first in (0, 2)
        )
        place.plot(*true, color=TRUE, linewidth=WIDE, label="true")
        place.plot(*own, color=ESTIMATED, linewidth=NARROW, label="free run")
        place.set_xlabel("drift [mm]")
        place.set_title(f"storey {storey + 1}", fontsize=9)
        place.tick_params(labelsize=8)
        place.grid(alpha=0.25)
    figure.axes[0].set_ylabel("force [kN]")
    one_legend(figure, figure.axes[:1], loc="outside lower center", ncols=2, fontsize=9)
    titled(figure, title)
    figure.savefig(picture, dpi=110, metadata={"Software": None})
