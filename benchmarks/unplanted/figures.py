"""Loops of the storeys in the first unseen motion: the structure's, and the network's free run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from report.style import ESTIMATED, MEASURED

MODEL, SEED = "element_network_branch", 0
MOST, WIDTH = 4, 3.0  # storeys that are shown; inches of one


def draw_loops(folder: Path, stored: Path, results: Sequence[dict[str, Any]]) -> dict[str, Path]:
    """A picture of every structure whose fit has loops beside it: {structure: picture}."""
    pictures = {}
    for result in results:
        if result["model"] != MODEL or result["seed"] != SEED:
            continue
        name = result["structure"].replace(", ", "-").replace(" ", "_")
        loops = stored / f"{MODEL}-{name}-seed{SEED}.npz"
        if loops.is_file():
            folder.mkdir(parents=True, exist_ok=True)
            pictures[result["structure"]] = folder / f"unplanted_{name}.png"
            with np.load(loops) as stored_loops:
                signals = stored_loops["signals"]
            _draw(pictures[result["structure"]], signals)
    return pictures


def _draw(picture: Path, signals: np.ndarray) -> None:
    """signals (4, T, storeys): drifts and forces, true and simulated."""
    storeys = min(signals.shape[2], MOST)
    figure, axes = plt.subplots(
        1, storeys, figsize=(WIDTH * storeys, 2.6), layout="constrained", squeeze=False
    )
    for storey, place in enumerate(axes[0]):
        for first, colour, label in ((0, MEASURED, "true"), (2, ESTIMATED, "free run")):
            way, force = 1e3 * signals[first, :, storey], 1e-3 * signals[first + 1, :, storey]
            place.plot(way, force, color=colour, linewidth=0.6, label=label)
        place.set_xlabel("drift [mm]")
        place.set_title(f"storey {storey + 1}", fontsize=9)
        place.tick_params(labelsize=7)
    axes[0, 0].set_ylabel("force [kN]")
    axes[0, 0].legend(fontsize=7)
    figure.savefig(picture, dpi=90, metadata={"Software": None})
    plt.close(figure)
