"""What others have published on the benchmarks' official tests, in the benchmarks' own metrics."""

from __future__ import annotations

from dataclasses import dataclass

GOALS = "quoted in this project's list of goals, not looked up in a paper here"


@dataclass(frozen=True)
class Published:
    """A value and where it stands; percent: relative, of the output's RMS; else in its unit."""

    value: float
    source: str
    percent: bool = False


PUBLISHED = {  # by benchmark and test series
    ("bouc_wen", "multisine"): Published(7.5e-6, "neural state space, quoted with the data"),
    ("silverbox", "multisine"): Published(0.30e-3, GOALS),
    ("silverbox", "arrow_full"): Published(0.60e-3, GOALS),
    ("silverbox", "arrow_no_extrapolation"): Published(0.26e-3, GOALS),
    ("f16", "FullMSine_Level2"): Published(16.2, GOALS + ", over levels 2, 4 and 6", True),
    ("f16", "FullMSine_Level4"): Published(16.2, GOALS + ", over levels 2, 4 and 6", True),
    ("f16", "FullMSine_Level6"): Published(16.2, GOALS + ", over levels 2, 4 and 6", True),
}
