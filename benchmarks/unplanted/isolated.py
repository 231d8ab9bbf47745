"""Buildings on friction pendulums in OpenSees, and such a bearing alone under imposed motion.

OpenSees' singleFPBearing slides on a curved surface, pressed by the weight above it, with friction
that grows with speed (VelDependent). Its angles are not small; without friction it has
about W y/(R cos² θ) where a weight on a circle has W y/(R cos θ).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.unplanted.frame import GRAVITY, TURNING, carried
from benchmarks.unplanted.laws import Law
from benchmarks.unplanted.motions import DT, FINE
from benchmarks.unplanted.opensees import opensees
from benchmarks.unplanted.shaken import Chain, joined, prepare_steps

STIFF = 1e5  # along a bearing, times weight over radius
ROUNDS, NEAR = 50, 1e-11  # of a bearing's own equilibrium, and how near it comes, of the weight


@dataclass(frozen=True)
class Bearing:
    """Radius [m], friction at rest and at speed, rate [s/m], shear before it slides [m]."""

    radius: float
    slow: float
    fast: float
    rate: float
    shear: float

    def built(self, ops: Any, weight: float) -> None:
        """Element 1 from node 0, which is fixed, to node 1, which carries the weight [N]."""
        ops.model("basic", "-ndm", 2, "-ndf", 3)
        ops.node(0, 0.0, 0.0)
        ops.node(1, 0.0, 0.0)
        ops.fix(0, 1, 1, 1)
        ops.fix(1, 0, 0, 1)
        ops.frictionModel("VelDependent", 1, self.slow, self.fast, self.rate)
        ops.uniaxialMaterial("Elastic", 1, STIFF * weight / self.radius)
        ops.uniaxialMaterial("Elastic", 2, 0.0)
        sticking = self.slow * weight / self.shear
        along = ["-P", 1, "-Mz", 2, "-orient", 0.0, 1.0, 0.0, -1.0, 0.0, 0.0]
        along += ["-iter", ROUNDS, NEAR * weight]
        ops.element("singleFPBearing", 1, 0, 1, 1, self.radius, sticking, *along)
        ops.timeSeries("Constant", 9)
        ops.pattern("Plain", 9, 9)
        ops.load(1, 0.0, -weight, 0.0)


@dataclass(frozen=True, kw_only=True)
class Isolated(Chain):
    """A chain whose lowest mass is on a bearing; `storeys` are those above it."""

    bearing: Bearing
    gravity: float = GRAVITY

    def built(self, ops: Any) -> list[int]:
        """The building under its weight; the numbers of its nodes."""
        self.bearing.built(ops, self.gravity * sum(self.masses))
        ops.mass(1, self.masses[0], TURNING * self.masses[0], 0.0)
        for i, materials in enumerate(self.storeys, start=2):
            ops.node(i, 0.0, 0.0)
            ops.fix(i, 0, 1, 1)
            ops.mass(i, self.masses[i - 1], 0.0, 0.0)
            joined(ops, i - 1, i, materials)
        carried(ops)
        return list(range(1, len(self.masses) + 1))


def drawn_bearing(rng: np.random.Generator, size: float) -> Bearing:
    """Of random numbers; size [m]: how far it is to slide in training."""
    draw = rng.uniform
    radius, fast = size * draw(4.0, 15.0), draw(0.05, 0.15)
    rate = draw(0.3, 3.0) / size  # some one over the speed of such motions
    return Bearing(radius, fast * draw(0.3, 0.9), fast, rate, size * 10.0 ** draw(-3.0, -1.7))


def alone(bearing: Bearing, weight: float) -> Law:
    """The force [N] of a bearing under imposed displacements [m] and velocities [m/s]."""

    def law(y: np.ndarray, rate: np.ndarray) -> np.ndarray:
        ops = opensees()
        assert ops is not None
        ops.wipe()
        bearing.built(ops, weight)
        carried(ops)
        step = DT / FINE
        motion = {"-disp": y, "-vel": rate, "-accel": np.gradient(rate, step)}
        for i, values in enumerate(motion.values(), start=10):
            ops.timeSeries("Path", i, "-dt", step, "-values", *values.tolist(), "-useLast")
        ops.pattern("MultipleSupport", 1)
        ops.groundMotion(1, "Plain", "-disp", 10, "-vel", 11, "-accel", 12)
        ops.imposedMotion(1, 1, 1)
        prepare_steps(ops, 1e-12 * float(np.abs(y).mean()))
        r = np.zeros_like(y)
        for n in range(1, len(y)):
            if ops.analyze(1, step):
                raise ValueError("OpenSees does not converge; lower the motion")
            r[n] = -ops.eleForce(1)[0]
        return r

    return law
