"""Named laws against the uniaxial materials of OpenSees (the extra `opensees`), imposed strains.

OpenSees takes a strain at a time and sees neither turning points nor corners between two; its force
tends to ours as the samples get finer.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from benchmarks.unplanted.opensees import opensees
from data.simulation.element_test import force
from data.simulation.elements import MenegottoPinto, SelfCentering, SlackBrace

K, FY, Y = 1e6, 1e4, 0.01
BETWEEN = ("s1", "x1")


def stress(y: np.ndarray, kind: str, *parameters: float | str) -> np.ndarray:
    ops = opensees()
    if ops is None:
        pytest.skip("needs openseespy: pip install -c constraints.txt -e '.[opensees]'")
    ops.wipe()
    ops.uniaxialMaterial(kind, 1, *parameters)
    ops.testUniaxialMaterial(1)
    out = []
    for strain in y:
        ops.setStrain(float(strain))
        out.append(ops.getStress())
    return np.array(out)


def random_motion(dt: float) -> np.ndarray:
    """The same 20 s of growing random motion, to 5 y_y, at any time step."""
    rng, t = np.random.default_rng(0), 0.002 * np.arange(10_000)
    waves = 2.0 * np.pi * np.arange(1, 31) / 20.0 * t[:, None]
    y = (np.sin(waves) * rng.standard_normal(30) + np.cos(waves) * rng.standard_normal(30)).sum(1)
    y *= 0.004 * np.minimum(t / 2.0, 1.0) ** 2
    return CubicSpline(t, y)(np.arange(0.0, t[-1], dt))


def difference(element, dt: float, *material) -> float:
    """Relative RMS difference from a material, or from the sum of several."""
    y = random_motion(dt)
    theirs = sum(stress(y, *one) for one in material)
    return float(np.linalg.norm(force(element, y, dt) - theirs) / np.linalg.norm(theirs))


@pytest.mark.parametrize(("a1", "a3"), [(0.0, 0.0), (0.05, 0.03)])
def test_steel02(a1, a3):
    element = MenegottoPinto(
        between=BETWEEN, yield_displacement=Y, stiffness=K, hardening_ratio=0.02, sharpness=18.0,
        a1=a1, a3=a3,
    )  # fmt: skip
    material = ("Steel02", FY, K, 0.02, 18.0, 0.925, 0.15, a1, 1.0, a3, 1.0)
    assert difference(element, 0.002, material) < 1e-4
    assert difference(element, 0.0005, material) < 1e-5


@pytest.mark.parametrize("beta", [0.3, 0.7, 1.0])
def test_self_centering(beta):
    """On a ramp to rounding; on random motion to first order in their step, past each corner."""
    element = SelfCentering(
        between=BETWEEN, activation_displacement=Y, stiffness=K, hardening_ratio=0.05, flag=beta
    )
    material = ("SelfCentering", K, 0.05 * K, FY, beta)
    ramp = np.concatenate([np.linspace(0.0, 0.03, 301), np.linspace(0.03, 0.0, 301)[1:]])
    assert np.abs(force(element, ramp, 0.01) - stress(ramp, *material)).max() < 1e-6 * FY
    coarse, fine = (difference(element, dt, material) for dt in (0.002, 0.0002))
    assert fine < 2e-3
    assert fine < 0.35 * coarse


@pytest.mark.parametrize("b", [0.0, 0.05])
def test_two_elastoplastic_gaps(b):
    element = SlackBrace(
        between=BETWEEN, yield_displacement=Y, stiffness=K, hardening_ratio=b, gap=0.003
    )
    pull = ("ElasticPPGap", K, FY, 0.003, b, "damage")
    push = ("ElasticPPGap", K, -FY, -0.003, b, "damage")
    assert difference(element, 0.002, pull, push) < 1e-4
