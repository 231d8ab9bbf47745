"""Laws of elements that no model of the zoo contains, simulated under an imposed motion.

They are elements of data/simulation/elements, but for one of Iwan's, followed at a motion's fine
steps. Their parameters were chosen before any model was fitted to them.   y [m], r [N], t [s]
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.unplanted.motions import DT, FINE
from data.simulation.element_test import force
from data.simulation.elements import (
    BaberNoori,
    Element,
    FrictionPendulum,
    MenegottoPinto,
    SelfCentering,
    SlackBrace,
    Takeda,
)

Law = Callable[[np.ndarray, np.ndarray], np.ndarray]  # y, ẏ (N,) in fine steps to r (N,)
TESTED = ("ground", "x1")  # an element test has an end that stands still

ELEMENTS: dict[str, Element] = {
    "steel": MenegottoPinto(
        between=TESTED,
        yield_displacement=0.010,
        stiffness=2.0e7,
        hardening_ratio=0.03,
        sharpness=18.0,
        a1=0.04,
        a3=0.04,
    ),
    "flag": SelfCentering(
        between=TESTED,
        activation_displacement=0.012,
        stiffness=1.5e7,
        hardening_ratio=0.08,
        flag=0.65,
    ),
    "slack": SlackBrace(
        between=TESTED,
        yield_displacement=0.0133,
        stiffness=1.2e7,
        hardening_ratio=0.02,
        gap=0.002,
    ),
    "pendulum": FrictionPendulum(
        between=TESTED,
        weight=1.0e6,
        radius=1.2,
        friction_fast=0.11,
        friction_slow=0.04,
        rate=20.0,
        yield_displacement=0.0006,
    ),
    "pinching": BaberNoori(  # in units of 10 mm and k (10 mm)² = 1500 J: ν' = 0.008, η' = 0.02
        between=TESTED,
        stiffness=1.5e7,
        post_yield_ratio=0.06,
        beta=0.5 * 0.010**-1.3,
        gamma=0.5 * 0.010**-1.3,
        exponent=1.3,
        eta_rate=0.02 / 1500.0,
        nu_rate=0.008 / 1500.0,
        pinching=0.75,
        pinching_rate=0.25 / 1500.0,
        pinching_place=0.15,
        pinching_width=0.0012,
        pinching_spread=3.0e-5 / 1500.0,
    ),
    "takeda": Takeda(
        between=TESTED,
        yield_displacement=0.008,
        stiffness=1.8e7,
        hardening_ratio=0.05,
        unloading_exponent=0.3,
    ),
}


def law(element: Element) -> Law:
    """The force of an element under a motion in fine steps."""
    return lambda y, rate: force(element, y, DT / FINE, rate)


def iwan(y: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Iwan (1967): elastoplastic units in parallel, loops within loops by Masing's rule."""
    k, units = 2.0e7, 12
    limits = 0.0015 * 1.4 ** np.arange(units)
    shares = 1.0 / limits**0.7
    shares /= shares.sum()
    z, r = np.zeros(units), np.zeros_like(y)
    for n in range(1, len(y)):
        z = np.clip(z + (y[n] - y[n - 1]), -limits, limits)
        r[n] = k * (0.02 * y[n] + 0.98 * shares @ z)
    return r


LAWS = {name: law(element) for name, element in ELEMENTS.items() if name != "takeda"}
HELD_BACK: dict[str, Law] = {"takeda": law(ELEMENTS["takeda"]), "iwan": iwan}  # until the end
SIZES = {  # largest deformations of the training motions [m]
    "steel": 0.06,
    "flag": 0.06,
    "slack": 0.05,
    "pendulum": 0.12,
    "pinching": 0.06,
    "takeda": 0.05,
    "iwan": 0.05,
}
