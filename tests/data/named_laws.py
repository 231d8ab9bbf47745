"""The named laws with typical parameters, in N and m."""

from __future__ import annotations

from dataclasses import replace

import pytest

from data import (
    BaberNoori,
    Chaboche,
    Concrete,
    FrictionPendulum,
    Hysteretic,
    Maxwell,
    MenegottoPinto,
    NailedWall,
    PeakOriented,
    Pinching4,
    PowerDamper,
    SelfCentering,
    SlackBrace,
    Stop,
    Takeda,
    TanhDamper,
    UnevenHysteretic,
    UnevenPinching4,
)

DT, K, Y = 0.01, 2.0e6, 0.01  # s, N/m, m
BETWEEN = ("s1", "x1")
LAWS = {
    "steel": MenegottoPinto(
        between=BETWEEN, yield_displacement=Y, stiffness=K, hardening_ratio=0.03, a1=0.05, a3=0.02
    ),
    "flag": SelfCentering(
        between=BETWEEN, activation_displacement=Y, stiffness=K, hardening_ratio=0.05, flag=0.7
    ),
    "slack": SlackBrace(
        between=BETWEEN, yield_displacement=Y, stiffness=K, hardening_ratio=0.02, gap=0.003
    ),
    "pendulum": FrictionPendulum(
        between=BETWEEN, weight=1e6, radius=2.0, friction_fast=0.1, friction_slow=0.04, rate=20.0,
        yield_displacement=5e-4,
    ),
    "concrete": Takeda(between=BETWEEN, yield_displacement=Y, stiffness=K, hardening_ratio=0.03),
    "timber": BaberNoori(
        between=BETWEEN, stiffness=K, post_yield_ratio=0.05, beta=70.0, gamma=30.0, eta_rate=1e-5,
        nu_rate=5e-6, pinching=0.8, pinching_rate=1e-4, pinching_place=0.1, pinching_width=0.01,
        pinching_spread=1e-8, pinching_lambda=0.2,
    ),
    "wall": Pinching4(
        between=BETWEEN, stiffness=K, yield_displacement=Y, displacement_2=0.02,
        displacement_3=0.04, displacement_4=0.07, strength_2=1.6, strength_3=1.8, strength_4=1.1,
        unloading_force=-0.1, reloading_place=0.4, reloading_force=0.3,
        softening_by_excursion=0.3, softening_by_energy=0.2, softening_energy_power=0.5,
        lengthening_by_excursion=0.1, lengthening_by_energy=0.2, lengthening_excursion_power=0.5,
        weakening_by_excursion=0.1, weakening_by_energy=0.2,
    ),
}  # fmt: skip
LAWS["uneven stops"] = Stop(**vars(LAWS["slack"]), back_stiffness=0.4 * K, back_gap=0.001)
LAWS["spring bearing"] = replace(LAWS["pendulum"], spring_share=1.0, curvature=0.5)
LAWS["uneven wall"] = UnevenPinching4(
    **vars(LAWS["wall"]), back_yield_displacement=0.7 * Y, back_displacement_2=0.03,
    back_displacement_3=0.05, back_displacement_4=0.09, back_strength_1=0.6, back_strength_2=1.2,
    back_strength_3=1.3, back_strength_4=0.8, back_unloading_force=0.05, back_reloading_place=0.3,
    back_reloading_force=0.2,
)  # fmt: skip
LAWS["joint"] = Hysteretic(
    between=BETWEEN, stiffness=K, yield_displacement=Y, displacement_2=0.025, displacement_3=0.06,
    strength_2=1.4, strength_3=1.1, reloading_place=0.7, reloading_force=0.4,
    growth_by_ductility=0.02, growth_by_energy=0.05, unloading_exponent=0.3,
)  # fmt: skip
LAWS["uneven joint"] = UnevenHysteretic(
    **vars(LAWS["joint"]), back_yield_displacement=0.7 * Y, back_displacement_2=0.03,
    back_displacement_3=0.05, back_strength_1=0.8, back_strength_2=1.0, back_strength_3=1.3,
)  # fmt: skip
LAWS["nailed wall"] = NailedWall(
    between=BETWEEN, stiffness=K, yield_displacement=Y, hardening_ratio=0.05,
    ultimate_displacement=0.04, softening_ratio=0.15, unloading_ratio=1.2, slip_force=0.15,
    slip_ratio=0.04, degradation=0.7, growth=1.1,
)  # fmt: skip
LAWS["hinge"] = PeakOriented(
    between=BETWEEN, stiffness=K, yield_displacement=Y, hardening_ratio=0.05,
    capping_displacement=0.04, softening_ratio=0.15, deterioration=0.01,
)  # fmt: skip
LAWS["uneven hinge"] = replace(
    LAWS["hinge"], pinching_place=0.4, pinching_force=0.3, back_strength=0.7
)
LAWS["metal"] = Chaboche(
    between=BETWEEN, stiffness=K, yield_displacement=0.5 * Y, kinematic_ratio=0.1,
    kinematic_rate=50.0, isotropic_ratio=0.02, isotropic_rate=20.0,
)  # fmt: skip
LAWS["uneven concrete"] = Concrete(
    between=BETWEEN, stiffness=K, peak_displacement=2.0 * Y, residual_force=0.3,
    ultimate_displacement=0.06, focus=0.02, cracking_displacement=0.001, tension_softening=0.1,
)  # fmt: skip
LAWS["fluid damper"] = PowerDamper(
    between=BETWEEN, damping=2e4, exponent=0.4, stiffness=1e7, spring_exponent=1.5
)
LAWS["damper on a brace"] = Maxwell(between=BETWEEN, stiffness=K, damping=3e4, exponent=0.5)
LAWS["rubber"] = Maxwell(between=BETWEEN, stiffness=K, damping=2e5)
LAWS["relief valve"] = TanhDamper(between=BETWEEN, force=1e4, saturation_rate=0.05)
OF_RATE = ("fluid damper", "damper on a brace", "rubber", "relief valve")
LENGTHS = {  # power of the metre in each parameter, where there is one besides the stiffness
    "yield_displacement": 1, "activation_displacement": 1, "gap": 1, "radius": 1, "rate": -1,
    "back_gap": 1, "back_stiffness": -1,
    "curvature": -1, "beta": -1, "gamma": -1, "pinching_width": 1, "pinching_spread": 1,
    "stiffness": -1, "damping": -1, "linear_below": 1, "saturation_rate": 1,
    "displacement_2": 1, "displacement_3": 1, "displacement_4": 1, "back_yield_displacement": 1,
    "back_displacement_2": 1, "back_displacement_3": 1, "back_displacement_4": 1,
    "ultimate_displacement": 1, "peak_displacement": 1, "focus": 1, "cracking_displacement": 1,
    "kinematic_rate": -1, "isotropic_rate": -1,
    "capping_displacement": 1,
}  # fmt: skip
EVEN = {name: law for name, law in LAWS.items() if not name.startswith("uneven")}
every_law = pytest.mark.parametrize("element", LAWS.values(), ids=LAWS)
HISTORY = (0.004, -0.006, 0.018, 0.012, 0.03, -0.012, 0.008, -0.035, 0.05, -0.03, 0.0, -0.06, 0.02)


def _with_dt(history):
    y, rate = history
    return y, DT, rate
