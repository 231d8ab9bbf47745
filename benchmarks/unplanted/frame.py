"""A moment frame of fibre elements in OpenSees, of which the floors' motion is measured.

Columns and beams are force-based, with steel (Steel02) in the fibres of five sections; columns
have P-Δ. Floors are rigid along the frame; joints turn, so that every floor is joined to every
other one, and yielding wanders through sections: no law between two floors is planted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

STEEL = ("Steel02", 1, 3.0e8, 2.0e11, 0.02, 18.0, 0.925, 0.15)  # N, m
GRAVITY = 9.81  # m/s²
TURNING = 1e-6  # kg and kg m² of a joint across and around: none


@dataclass(frozen=True)
class Frame:
    """Masses of floors [kg], bays, heights, widths [m], sections, peak of the ground [m/s²].

    Sections (depth, width, flange, web) [m].
    """

    masses: Sequence[float]
    peak: float
    bays: int = 2
    height: float = 3.5
    width: float = 6.0
    column: Sequence[float] = (0.30, 0.25, 0.016, 0.010)
    beam: Sequence[float] = (0.32, 0.16, 0.012, 0.008)
    damping: float = 0.02  # ratio of the first and second mode
    modes: int = 2
    substeps: int = 4
    topology: str = "all"
    motions: int = 0  # added to the seeds of ground motions
    eigenvalues = ()  # OpenSees' own choice, of some modes

    def built(self, ops: Any) -> list[int]:
        """The frame under its weight; the numbers of the floors' nodes."""
        ops.model("basic", "-ndm", 2, "-ndf", 3)
        floors, lines = range(len(self.masses) + 1), range(self.bays + 1)
        node = {(i, j): 100 * i + j + 1 for i, j in product(floors, lines)}
        for (i, j), number in node.items():
            ops.node(number, self.width * j, self.height * i)
        for j in lines:
            ops.fix(node[0, j], 1, 1, 1)
        ops.uniaxialMaterial(*STEEL)
        for tag, sides, turn in ((1, self.column, "PDelta"), (2, self.beam, "Linear")):
            _section(ops, tag, *sides)
            ops.geomTransf(turn, tag)
            ops.beamIntegration("Lobatto", tag, tag, 5)
        ends = [(node[i - 1, j], node[i, j], 1) for i in floors[1:] for j in lines]
        ends += [(node[i, j], node[i, j + 1], 2) for i in floors[1:] for j in lines[:-1]]
        for number, (first, second, kind) in enumerate(ends, start=1):
            ops.element("forceBeamColumn", number, first, second, kind, kind)
        ops.timeSeries("Constant", 9)
        ops.pattern("Plain", 9, 9)
        for i, mass in enumerate(self.masses, start=1):
            ops.mass(node[i, 0], mass, TURNING, TURNING)
            for j in lines:
                ops.load(node[i, j], 0.0, -GRAVITY * mass / len(lines), 0.0)
                if j > 0:
                    ops.equalDOF(node[i, 0], node[i, j], 1)
        carried(ops)
        return [node[i, 0] for i in floors[1:]]


def _section(ops: Any, tag: int, depth: float, width: float, flange: float, web: float) -> None:
    """An I of fibres; its flanges in two layers, its web in eight."""
    y, z = depth / 2, width / 2
    ops.section("Fiber", tag)
    ops.patch("rect", 1, 2, 1, -y, -z, flange - y, z)
    ops.patch("rect", 1, 8, 1, flange - y, -web / 2, y - flange, web / 2)
    ops.patch("rect", 1, 2, 1, y - flange, -z, y, z)


def carried(ops: Any) -> None:
    """The weight, which stays."""
    ops.constraints("Transformation")
    ops.numberer("RCM")
    ops.system("BandGeneral")
    ops.test("NormDispIncr", 1e-10, 30)
    ops.algorithm("Newton")
    ops.integrator("LoadControl", 1.0)
    ops.analysis("Static")
    if ops.analyze(1):
        raise ValueError("the structure does not carry its weight; take heavier columns")
    ops.loadConst("-time", 0.0)
    ops.wipeAnalysis()
