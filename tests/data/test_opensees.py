"""Named laws against the uniaxial materials of OpenSees (the extra `opensees`), imposed strains.

OpenSees takes a strain at a time and sees neither turning points nor corners between two; its force
tends to ours as the samples get finer.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from benchmarks.opensees import opensees, prepare_steps
from data import (
    Chaboche,
    Concrete,
    FrictionPendulum,
    NailedWall,
    PeakOriented,
    Pinching4,
    UnevenHysteretic,
    UnevenPinching4,
)
from data.simulation.element_test import force
from tests.data.named_laws import DT
from tests.data.test_elements import eased

K, FY, Y = 1e6, 1e4, 0.01
LOSS_PARTS = ("by_excursion", "by_energy", "excursion_power", "energy_power", "limit")
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


def require_force(element, material) -> None:
    """In small and large motions the force is that of a material within a thousandth."""
    for size in (0.2, 1.0, 2.0):
        y = size * random_motion(0.0005)
        theirs = stress(y, *material)
        ours = force(element, y, 0.0005)
        assert np.linalg.norm(ours - theirs) < 1e-3 * np.linalg.norm(theirs)


def difference(element, dt: float, *material) -> float:
    """Relative RMS difference from a material, or from the sum of several."""
    y = random_motion(dt)
    theirs = sum(stress(y, *one) for one in material)
    return float(np.linalg.norm(force(element, y, dt) - theirs) / np.linalg.norm(theirs))


def drawn_side(draw) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Places [m], strengths and shares of one side."""
    places = Y * np.cumprod([draw(0.4, 0.6), draw(1.5, 4.0), draw(1.5, 3.0), draw(1.5, 3.0)])
    strengths = np.cumprod([1.0, draw(1.1, 2.0), draw(0.9, 1.3), draw(0.5, 1.1)])
    unloading = draw(-0.2, 0.2)
    return places, strengths, [draw(0.1, 0.8), max(unloading, 0.0) + draw(0.1, 0.5), unloading]


@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_pinching4(seed, uneven):
    """Points, shares and losses drawn at random."""
    draw = np.random.default_rng(seed).uniform
    places, strengths, shares = drawn_side(draw)
    losses = [
        [draw(0.0, 0.5), draw(0.0, 0.4), draw(0.2, 1.5), draw(0.2, 1.5), draw(0.3, 0.9)]
        for _ in range(3)
    ]
    points = [n for pair in zip(K * Y * strengths, places, strict=True) for n in pair]
    named = {
        f"{loss}_{part}": number
        for loss, numbers in zip(("softening", "lengthening", "weakening"), losses, strict=True)
        for part, number in zip(LOSS_PARTS, numbers, strict=True)
    }
    own = {f"displacement_{i + 1}": places[i] for i in (1, 2, 3)}
    own |= {f"strength_{i + 1}": strengths[i] for i in (1, 2, 3)}
    own |= dict(zip(("reloading_place", "reloading_force", "unloading_force"), shares, strict=True))
    own |= {"between": BETWEEN, "stiffness": K * Y / places[0], "yield_displacement": places[0]}
    element = Pinching4(**own, **named)
    if uneven:
        places, strengths, other = drawn_side(draw)
        strengths *= draw(0.5, 1.5)
        points += [-n for pair in zip(K * Y * strengths, places, strict=True) for n in pair]
        shares += other
        back = {f"strength_{i + 1}": strengths[i] for i in range(4)}
        back |= {f"displacement_{i + 1}": places[i] for i in (1, 2, 3)}
        back |= {"yield_displacement": places[0], "reloading_place": other[0]}
        back |= {"reloading_force": other[1], "unloading_force": other[2]}
        element = UnevenPinching4(**own, **named, **{f"back_{n}": v for n, v in back.items()})
    words = ("Pinching4", *points, *shares, *losses[0], *losses[1], *losses[2], 10.0, "energy")
    assert difference(element, 0.0005, words) < 2e-3


@pytest.mark.parametrize("seed", range(4))
def test_hysteretic(seed):
    """Sides, pinching and damage drawn at random; the motion turns at samples.

    Their force is a part of a step late at corners, so that the difference falls with the step.
    """
    rng = np.random.default_rng(seed)
    draw = rng.uniform
    sides = [
        (Y * draw(0.7, 1.3) * np.cumprod([1.0, draw(1.5, 5.0), draw(1.5, 4.0)]),
         draw(0.7, 1.3) * np.cumprod([1.0, draw(1.1, 1.6), draw(0.6, 1.2)]))
        for _ in range(2)
    ]  # fmt: skip
    names = ("reloading_place", "reloading_force", "growth_by_ductility", "growth_by_energy",
             "unloading_exponent")  # fmt: skip
    shape = [draw(0.1, 1.0), draw(0.1, 1.0), draw(0.0, 0.04), draw(0.0, 0.1), draw(0.0, 0.5)]
    (y1, y2, y3), front = sides[0]
    own = dict(zip(names, shape, strict=True)) | {
        f"back_{n}": v
        for n, v in zip(("yield_displacement", "displacement_2", "displacement_3"), sides[1][0],
                        strict=True)
    } | {f"back_strength_{i + 1}": v / front[0] for i, v in enumerate(sides[1][1])}  # fmt: skip
    element = UnevenHysteretic(
        between=BETWEEN, stiffness=front[0] * FY / y1, yield_displacement=y1, displacement_2=y2,
        displacement_3=y3, strength_2=front[1] / front[0], strength_3=front[2] / front[0], **own,
    )  # fmt: skip
    points = [
        side * n
        for side, (places, heights) in zip((1.0, -1.0), sides, strict=True)
        for pair in zip(FY * heights, places, strict=True)
        for n in pair
    ]
    turns = 0.03 * np.linspace(0.1, 1.5, 24) * rng.standard_normal(24)
    far = []
    for samples in (400, 40_000):
        y, rate = eased(*turns, samples=samples)
        theirs = stress(y, "Hysteretic", *points, *shape)
        ours = force(element, y, DT, rate)
        far.append(float(np.linalg.norm(ours - theirs) / np.linalg.norm(theirs)))
    assert far[0] < 1e-3
    assert far[1] < 0.05 * far[0] or far[1] < 1e-6


@pytest.mark.parametrize("seed", range(4))
def test_nailed_wall(seed):
    """Numbers drawn at random; from motions below the slip line to some beyond the strength.

    Just beyond the elastic range SAWS decides by samples.
    """
    draw = np.random.default_rng(seed).uniform
    b, falls = draw(0.02, 0.1), draw(0.02, 0.1)
    strong, sloped = draw(0.05, 0.3), draw(0.01, 0.06)
    R, alpha, g, farthest = draw(1.0, 1.5), draw(0.4, 0.9), draw(1.02, 1.25), draw(5.0, 9.0) * Y
    element = NailedWall(
        between=BETWEEN, stiffness=K, yield_displacement=Y, hardening_ratio=b,
        ultimate_displacement=farthest, softening_ratio=b + falls, unloading_ratio=R,
        slip_force=strong, slip_ratio=sloped, degradation=alpha, growth=g,
    )  # fmt: skip
    words = ("SAWS", FY, strong * FY, farthest, K, b, -falls, R, sloped, alpha, g)
    motion, far = random_motion(0.0005), []
    for size in (0.05, 0.2, 1.0, 2.0):  # of 5 y₀
        y = size * motion
        theirs = stress(y, *words)
        far.append(np.linalg.norm(force(element, y, 0.0005) - theirs) / np.linalg.norm(theirs))
    assert np.median(far) < 1e-5
    assert max(far) < 3e-3


@pytest.mark.parametrize("seed", range(4))
def test_peak_oriented(seed):
    """Numbers drawn at random, with pinching for odd seeds; motions below the cap and beyond."""
    draw = np.random.default_rng(seed).uniform
    pinching = (draw(0.1, 0.9), draw(0.1, 0.9)) if seed % 2 else (0.0, 1.0)
    b, capped, d, phi = draw(0.01, 0.1), draw(3.0, 8.0) * Y, draw(0.02, 0.1), draw(0.0, 0.4)
    wear, S = 10.0 ** draw(-3.0, -1.6), draw(0.7, 1.4)
    element = PeakOriented(
        between=BETWEEN, stiffness=K, yield_displacement=Y, hardening_ratio=b,
        capping_displacement=capped, softening_ratio=b + d, residual_force=phi, deterioration=wear,
        pinching_place=pinching[0], pinching_force=pinching[1], back_strength=S,
    )  # fmt: skip
    sides = []
    for size in (1.0, S):  # where the lines before and beyond the cap meet
        u = size * ((b + d) * capped - b * Y * (1.0 - size)) / (size * b + d) - size * Y
        top = 1.0 + b * u / Y
        sides += [u, size * top * Y / d, 1e3, size * FY, top, phi]
    words = (K, *sides, *(4 * (Y / wear,)), *(6 * (1.0,)))
    name = "IMKPeakOriented"
    if seed % 2:
        name, words = "IMKPinching", (*words, pinching[1], 1.0 - pinching[0])
    require_force(element, (name, *words))


@pytest.mark.parametrize("seed", range(4))
def test_concrete(seed):
    """Numbers drawn at random, one in three without tension."""
    draw = np.random.default_rng(seed).uniform
    element = Concrete(
        between=BETWEEN, peak_displacement=draw(0.3, 2.0) * Y, stiffness=K,
        residual_force=draw(0.0, 0.9), ultimate_displacement=draw(2.5, 9.0) * Y,
        focus=draw(0.1, 4.0) * Y, cracking_displacement=draw(0.02, 0.3) * Y * (seed % 3 > 0),
        tension_softening=draw(0.01, 0.5),
    )  # fmt: skip
    require_force(element, *element.opensees())


@pytest.mark.parametrize("seed", range(3))
def test_metal(seed):
    """Numbers drawn at random: straight lines, one limit, two."""
    draw = np.random.default_rng(seed).uniform
    element = Chaboche(
        between=BETWEEN, yield_displacement=draw(0.3, 1.0) * Y, stiffness=K,
        kinematic_ratio=draw(0.0, 0.5), kinematic_rate=draw(0.0, 1.0) / Y * (seed > 0),
        isotropic_ratio=draw(0.0, 0.1), isotropic_rate=draw(0.0, 0.5) / Y * (seed > 1),
    )  # fmt: skip
    require_force(element, *element.opensees())


def single_friction_pendulum(
    y: np.ndarray, rate: np.ndarray, step: float, weight: float, radius: float
) -> np.ndarray:
    """OpenSees' singleFPBearing with VelDependent friction (0.04 to 0.1) under imposed motion."""
    ops = opensees()
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    ops.node(0, 0.0, 0.0)
    ops.node(1, 0.0, 0.0)
    ops.fix(0, 1, 1, 1)
    ops.fix(1, 0, 0, 1)
    ops.frictionModel("VelDependent", 1, 0.04, 0.1, 20.0)
    ops.uniaxialMaterial("Elastic", 1, 1e5 * weight / radius)
    ops.uniaxialMaterial("Elastic", 2, 0.0)
    along = ["-P", 1, "-Mz", 2, "-orient", 0.0, 1.0, 0.0, -1.0, 0.0, 0.0]
    along += ["-iter", 50, 1e-11 * weight]
    ops.element("singleFPBearing", 1, 0, 1, 1, radius, 0.04 * weight / 2e-3, *along)
    ops.timeSeries("Constant", 9)
    ops.pattern("Plain", 9, 9)
    ops.load(1, 0.0, -weight, 0.0)
    ops.constraints("Transformation")
    ops.numberer("RCM")
    ops.system("BandGeneral")
    ops.test("NormDispIncr", 1e-10, 30)
    ops.algorithm("Newton")
    ops.integrator("LoadControl", 1.0)
    ops.analysis("Static")
    assert ops.analyze(1) == 0
    ops.loadConst("-time", 0.0)
    ops.wipeAnalysis()
    motion = {"-disp": y, "-vel": rate, "-accel": np.gradient(rate, step)}
    for i, values in enumerate(motion.values(), start=10):
        ops.timeSeries("Path", i, "-dt", step, "-values", *values.tolist(), "-useLast")
    ops.pattern("MultipleSupport", 1)
    ops.groundMotion(1, "Plain", "-disp", 10, "-vel", 11, "-accel", 12)
    ops.imposedMotion(1, 1, 1)
    prepare_steps(ops, 1e-12 * float(np.abs(y).mean()))
    force = np.zeros_like(y)
    for n in range(1, len(y)):
        assert ops.analyze(1, step) == 0
        force[n] = -ops.eleForce(1)[0]
    return force


def test_single_friction_pendulum():
    """A large radius, as OpenSees has its own geometry; what sticks is a spring there."""
    if opensees() is None:
        pytest.skip("needs openseespy: pip install -c constraints.txt -e '.[opensees]'")
    step = DT / 8.0
    y = random_motion(step)
    rate = CubicSpline(step * np.arange(len(y)), y)(step * np.arange(len(y)), 1)
    theirs = single_friction_pendulum(y, rate, step, weight=1e6, radius=20.0)
    far = {}
    for share in (0.0, 1.0):
        ours = FrictionPendulum(
            between=BETWEEN, weight=1e6, radius=20.0, friction_fast=0.1, friction_slow=0.04,
            rate=20.0, yield_displacement=2e-3, spring_share=share,
        )  # fmt: skip
        far[share] = np.linalg.norm(force(ours, y, step, rate) - theirs) / np.linalg.norm(theirs)
    assert far[1.0] < 5e-3 < 0.05 < far[0.0]
