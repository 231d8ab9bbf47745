"""Factors to SI units, with the meanings that engineers give to g, lb, kip and in.

`to_si("g", "a")` is 9.80665 m/s², where a plain units library reads gram. Factors only: a unit with
an offset, such as °C, belongs to no signal here.
"""

from __future__ import annotations

import functools
import math
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pint import UnitRegistry


# signal → (what it is, SI unit, examples)
DIMENSIONS = {
    "time": ("a time", "s", "s, ms, us, ns, min"),
    "f": ("a force", "N", "N, kN, lb, lbf, kip"),
    "r": ("a force", "N", "N, kN, lb, lbf, kip"),
    "x": ("a displacement", "m", "m, mm, in, ft"),
    "s": ("a displacement", "m", "m, mm, in, ft"),
    "v": ("a velocity", "m/s", "m/s, mm/s, in/s, cm/s"),
    "s_dot": ("a velocity", "m/s", "m/s, mm/s, in/s, cm/s"),
    "a": ("an acceleration", "m/s^2", "m/s^2, g, mg, gal, cm/s^2, in/s^2"),
    "s_ddot": ("an acceleration", "m/s^2", "m/s^2, g, mg, gal, cm/s^2, in/s^2"),
    "u": ("an input of any dimension", "", "V, A, degC, kN"),  # kept as it is
}

ANY_SIGNAL = {"secs": "s", "usec": "us", "msecs": "ms"}
FORCE = {
    "lb": "force_pound", "lbs": "force_pound", "lbf": "force_pound", "Lb": "force_pound",
    "LB": "force_pound", "LBF": "force_pound", "klb": "kip", "kips": "kip", "KIP": "kip",
    "Kip": "kip", "kp": "force_kilogram", "tonf": "force_ton",
}  # fmt: skip
ACCELERATION = {
    "g": "standard_gravity", "G": "standard_gravity", "gn": "standard_gravity",
    "mg": "millistandard_gravity", "ug": "microstandard_gravity", "gal": "Gal", "GAL": "Gal",
    "gals": "Gal", "mgal": "mGal",
}  # fmt: skip
ENGINEERING = {"a": ACCELERATION, "s_ddot": ACCELERATION, "f": FORCE, "r": FORCE}

# texts in the round brackets of a header that are surely units
WORDS = frozenset(
    {"s", "sec", "secs", "ms", "msec", "us", "usec", "ns", "min", "h", "hr", "Hz", "kHz"}
    | {"m", "mm", "cm", "um", "km", "in", "inch", "inches", "ft", "feet", "mil", "rad", "deg"}
    | {"g", "mg", "ug", "gal", "Gal", "mGal", "kg", "t", "V", "mV", "A", "mA", "C", "K"}
    | {"N", "kN", "MN", "mN", "lb", "lbf", "lbs", "kip", "kips", "kgf", "tf"}
    | {"Pa", "kPa", "MPa", "GPa", "psi", "ksi"}
)

ALLOWED = re.compile(r"[A-Za-z0-9^*/.²³µμ ()_-]+")
LONGEST = 32  # characters; longer than any unit, too short to keep the parser busy


def to_si(unit: str, signal: str) -> float:
    """Factor that turns values in `unit` into SI: s, N, m, m/s or m/s², as `signal` asks.

    `signal` is "time", "f", "r", "x", "s", "v", "s_dot", "a", "s_ddot", or "u", whose
    unit is kept. Raises ValueError for
    another signal, an unknown unit, or a unit of another dimension.
    """
    if signal not in DIMENSIONS:
        raise ValueError(f"signal={signal!r}: choose {', '.join(DIMENSIONS)}")
    if signal == "u":
        return 1.0
    what, si, examples = DIMENSIONS[signal]
    expected = f"signal {signal} is {what} and wants a unit of {si}, for example {examples}"
    words = _readable(unit)
    if words is None:
        raise ValueError(f"unit={unit!r} cannot be read as a unit; {expected}")
    return _factor(unit, _engineering(words, signal), si, expected)


def has_dimension(unit: str, signal: str) -> bool:
    """Whether `unit` is one of `signal`."""
    try:
        to_si(unit, signal)
    except ValueError:
        return False
    return True


def is_unit(text: str) -> bool:
    """Whether `text` is made of well-known unit symbols only, such as "m/s^2"."""
    words = re.findall(r"[A-Za-z]+", text.replace("µ", "u").replace("μ", "u"))
    return ALLOWED.fullmatch(text) is not None and bool(words) and WORDS.issuperset(words)


def _readable(unit: str) -> str | None:
    """`unit` with its powers written as **; None where it holds what no unit holds."""
    if len(unit) > LONGEST or not ALLOWED.fullmatch(unit):
        return None
    plain = unit.strip().replace("²", "^2").replace("³", "^3").replace("µ", "u").replace("μ", "u")
    plain = re.sub(r"([A-Za-z])(-?\d)", r"\1^\2", plain.replace("**", "^"))  # m/s2, m s-2
    powers = plain.count("^")
    # one digit each and few of them: a tower of powers would be computed for ever
    if powers > 3 or len(re.findall(r"[A-Za-z)] ?\^ ?\(?-?\d\)?(?![\d^.])", plain)) != powers:
        return None
    return plain.replace("^", "**") or None


def _engineering(words: str, signal: str) -> str:
    meanings = ANY_SIGNAL | ENGINEERING.get(signal, {})
    return re.sub(r"[A-Za-z_]+", lambda word: meanings.get(word[0], word[0]), words)


def _factor(unit: str, words: str, si: str, expected: str) -> float:
    import pint  # takes 0.3 s, which only those who convert should pay

    try:
        factor = float(_registry().Quantity(words).to(si).magnitude)
    except pint.DimensionalityError:
        raise ValueError(f"unit={unit!r} has another dimension; {expected}") from None
    except Exception:  # pint passes on whatever its tokenizer raises
        raise ValueError(f"unit={unit!r} is not known; {expected}") from None
    if not (math.isfinite(factor) and factor > 0.0):
        raise ValueError(f"unit={unit!r} means a factor of {factor:g}; {expected}")
    return factor


@functools.cache
def _registry() -> UnitRegistry:
    import pint

    return pint.UnitRegistry()


# Units at the end of a column's name: cm of disp_cm, kN of force_kN and force_kN2, ms of t_ms.
#
# Only unambiguous words: the g of acc_g may mean the ground, the in of
# force_in for what goes in.

TIMES = r"ms|us"  # ms2 is m/s²
ENDINGS = r"mm|cm|um|inch|ft|kN|MN|lbf|kips?|kgf|mg|gal|Gal"
RATES = r"(?P<length>mm|cm|in)[_/]?(per_)?s(?P<twice>\^?2|²)?"  # cm/s2, cms2, in_s2
UNIT = rf"({TIMES})$|({ENDINGS})(?=\d{{0,3}}$)|{RATES}"
ENDS = re.compile(rf".*[A-Za-z0-9][_ ](?P<unit>{UNIT})\d{{0,3}}")
GRAVITY = re.compile(r".*\d[_ ]g")  # of a sensor with a number


def unit_in_name(column: str, signal: str | None = None) -> str | None:
    """The unit that the name of a column ends with, None without one.

    signal: what the column is taken for; the unit of another is none. Without it any is taken.
    """
    name = column.strip()
    if GRAVITY.fullmatch(name):
        unit = "g"
    elif found := ENDS.fullmatch(name):
        rate = f"{found['length']}/s{'^2' if found['twice'] else ''}"
        unit = rate if found["length"] else found["unit"]
    else:
        return None
    return unit if signal is None or has_dimension(unit, signal) else None
