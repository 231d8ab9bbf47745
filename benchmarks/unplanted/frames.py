"""Frames of fibre elements beside those of chains.py: other bays, floors, masses and sections.

Their numbers were chosen before any model was fitted to them. Masses [kg], lengths [m].
"""

from __future__ import annotations

from benchmarks.unplanted.frame import Frame

FRAMES = {
    "fibre frame, light roof": Frame(
        [4.5e4, 1.8e4],
        4.5,
        height=3.6,
        column=(0.28, 0.25, 0.014, 0.009),
        beam=(0.30, 0.15, 0.011, 0.007),
    ),
    "fibre frame, 1 bay, 3 floors": Frame(
        [2.5e4, 2.5e4, 2.0e4],
        4.0,
        bays=1,
        width=6.5,
        damping=0.03,
        column=(0.30, 0.25, 0.016, 0.010),
        beam=(0.32, 0.16, 0.012, 0.008),
    ),
}
HELD_BACK = {  # looked at when all else was done
    "fibre frame, weak beams": Frame(
        [4.5e4, 4.5e4, 4.0e4],
        4.0,
        bays=3,
        height=3.2,
        width=5.5,
        column=(0.34, 0.30, 0.018, 0.011),
        beam=(0.28, 0.14, 0.010, 0.007),
    ),
    "fibre frame, 5 floors": Frame(
        [4.5e4, 4.5e4, 4.5e4, 4.5e4, 3.5e4],
        4.0,
        height=3.4,
        damping=0.03,
        column=(0.38, 0.32, 0.022, 0.013),
        beam=(0.36, 0.17, 0.013, 0.008),
    ),
}
