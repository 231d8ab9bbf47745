"""Restoring-force elements: one law, one file; how the integrator calls them: laws.py."""

from data.simulation.elements.baber_noori import BaberNoori
from data.simulation.elements.bilinear import Bilinear
from data.simulation.elements.bouc_wen import BoucWen
from data.simulation.elements.element import Element
from data.simulation.elements.friction_pendulum import FrictionPendulum
from data.simulation.elements.hysteretic import Hysteretic, UnevenHysteretic
from data.simulation.elements.limited_slip import LimitedSlip
from data.simulation.elements.menegotto_pinto import MenegottoPinto
from data.simulation.elements.pinching4 import Pinching4, UnevenPinching4
from data.simulation.elements.polynomial import Polynomial
from data.simulation.elements.self_centering import SelfCentering
from data.simulation.elements.slack_brace import SlackBrace
from data.simulation.elements.takeda import Takeda

__all__ = [
    "BaberNoori",
    "Bilinear",
    "BoucWen",
    "Element",
    "FrictionPendulum",
    "Hysteretic",
    "LimitedSlip",
    "MenegottoPinto",
    "Pinching4",
    "Polynomial",
    "SelfCentering",
    "SlackBrace",
    "Takeda",
    "UnevenHysteretic",
    "UnevenPinching4",
]
