"""OpenSees' own materials under the same motions, where openseespy is installed: a peer."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec

import numpy as np

from benchmarks.unplanted.laws import Law

MATERIALS: dict[str, tuple[float, list[object]]] = {  # largest deformation [m], the command's words
    "opensees Steel02": (
        0.05,
        ["Steel02", 1, 250.0, 2.5e4, 0.02, 18.5, 0.925, 0.15, 0.02, 1.0, 0.02, 1.0],
    ),
    "opensees SelfCentering": (0.05, ["SelfCentering", 1, 2.0e4, 1.5e3, 180.0, 0.7]),
    "opensees Pinching4": (
        0.04,
        [
            *["Pinching4", 1, 90.0, 0.004, 160.0, 0.012, 190.0, 0.03, 120.0, 0.08],
            *[0.5, 0.25, 0.05, 0.3, 0.2, 0.3, 0.2, 0.6],
            *[0.2, 0.2, 0.2, 0.2, 0.3, 0.1, 0.1, 0.1, 0.1, 0.2, 10.0, "energy"],
        ],
    ),
}


def installed() -> bool:
    return find_spec("openseespy") is not None


def material(words: list[object]) -> Law:
    """The stress of a uniaxial material under imposed strains."""

    def law(y: np.ndarray, rate: np.ndarray) -> np.ndarray:
        ops = import_module("openseespy.opensees")
        ops.wipe()
        ops.uniaxialMaterial(*words)
        ops.testUniaxialMaterial(1)
        r = np.zeros_like(y)
        for n, now in enumerate(y):
            ops.setStrain(float(now))
            r[n] = ops.getStress()
        return r

    return law


def laws() -> dict[str, tuple[Law, float]]:
    return {name: (material(words), size) for name, (size, words) in MATERIALS.items()}
