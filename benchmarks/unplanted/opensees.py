"""OpenSees' own materials under the same motions, where openseespy is installed: a peer."""

from __future__ import annotations

import ctypes
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

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


def opensees() -> Any | None:
    """The module, or None; its wheel needs its own BLAS loaded first where the system has none."""
    found = find_spec("openseespylinux")
    if found is not None and found.origin is not None:
        for name in ("libquadmath.so.0", "libgfortran.so.4", "libblas.so.3", "liblapack.so.3"):
            library = Path(found.origin).parent / "lib" / name
            if library.is_file():
                ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    try:
        return import_module("openseespy.opensees")
    except (ImportError, RuntimeError):  # it raises the latter where a library is missing
        return None


def material(words: list[object]) -> Law:
    """The stress of a uniaxial material under imposed strains."""

    def law(y: np.ndarray, rate: np.ndarray) -> np.ndarray:
        ops = opensees()
        assert ops is not None
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
