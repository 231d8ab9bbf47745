"""Cautious guesses of the channels in a file, by the units, names and places of its columns."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from data.measured.channels import signal_of
from data.measured.units import has_dimension

BASE = (  # in a column's name or its sensor's place: what stands below the structure
    r"ground|\bgnd|gnd\b|table|platform|\bbase\b|base(?![a-z])|basement|shaker?\b|foundation|free.?field|"
    r"(floor|level|store?y)[ _-]?0+(?!\d)|üg|(^|_)ag\b|input.?(acc|motion)"
)
PLACE = (
    r"roof|floor|store?y|level|top|mass[ _-]?\d|dof[ _-]?\d|deck|pier|girder|mid.?span|"
    r"\b(l|lvl|m)[ _-]?\d+\b"
)
KINDS = (  # in a column's name → signal
    (r"acc|^a[_ ]?[xyz]?\d*$", "a"),
    (r"disp|lvdt|stroke|laser|deflection|position", "x"),
    (r"vel(o|\b|_|\d|$)|^v[_ ]?\d*$", "v"),
    (r"force|load|hammer|^f[_ ]?\d*$", "f"),
)
OTHER = (
    r"volt|current|command|temperature|pressure|preload|pretension|"
    r"(normal|vertical|axial|gravity).?(force|load)"
)
ELEMENT = r"damper|device|bearing|isolator|brace|piston|stroke|actuator|element|hysteresis"
CLOCK = r"time|zeit|temps|tiempo|seconds?$|^t$|^t[_ ]?\[?[mu]?s\]?$"
UNITS = (("m/s^2", "a"), ("m/s", "v"), ("m", "x"), ("N", "f"))
OTHER_UNITS = ("V", "mV", "A", "mA", "degC", "°C", "C", "K", "bar", "kPa", "MPa", "psi")
OF_BASE = {"a": "s_ddot", "v": "s_dot", "x": "s"}
OF_ELEMENT = {"f": "r", "x": "s", "v": "s_dot"}
EXPLAINED = 0.5  # of what a motion leaves of a force: less is left where a mass is in it


def is_clock(column: str) -> bool:
    """Whether a column's name sounds like a clock."""
    return re.search(CLOCK, column.lower()) is not None


def suggest(
    columns: Sequence[str],
    units: Mapping[str, str],
    places: Mapping[str, str] | None = None,
    values: Mapping[str, np.ndarray] | None = None,
    title: str = "",
) -> dict[str, str]:
    """{column: channel} by units, names and places; columns that say nothing are omitted.

    places: of sensors, as agencies say them; values (T,) by column tell an element test from a
    structure under a force, and so does the title, such as a file's name. A stuck sensor is
    no channel.
    """
    said = {c: f"{c} {(places or {}).get(c, '')}".lower() for c in columns}
    signals = {c: _signal(c, said[c], units.get(c)) for c in columns}
    if "s_ddot" in signals.values() or "s" in signals.values():
        for column in columns:
            if signals[column] is None and units.get(column) is None:
                signals[column] = "a" if re.search(PLACE, said[column]) else None
    stuck = {c for c, u in (values or {}).items() if np.isfinite(u).all() and np.ptp(u) == 0.0}
    signals = {c: None if c in stuck else signal for c, signal in signals.items()}
    kinds = [s for s in signals.values() if s]
    if _is_element_test(kinds, f"{title} {' '.join(said.values())}".lower(), signals, values):
        signals = {c: _of_element(c, said[c], s, units.get(c)) for c, s in signals.items()}
    return _numbered(_driven(signals, places or {}))


def _numbered(signals: Mapping[str, str | None]) -> dict[str, str]:
    guesses: dict[str, str] = {}
    count: dict[str, int] = {}
    for column, signal in signals.items():
        if signal == "time" and "time" not in guesses.values():
            guesses[column] = "time"
        elif signal is not None and signal != "time":
            count[signal] = count.get(signal, 0) + 1
            guesses[column] = f"{signal}{count[signal]}"
    return guesses


def _driven(signals: dict[str, str | None], places: Mapping[str, str]) -> dict[str, str | None]:
    """Where the base's acceleration was measured, its velocity and displacement say no more.

    Nor do velocities and displacements of the very sensor that measured an acceleration, which are
    integrals of it, as agencies publish them.
    """
    if "s_ddot" not in signals.values() or "a" not in signals.values():
        return signals
    seen, kept = False, {}
    sensors = {places.get(column) for column, signal in signals.items() if signal == "a"} - {None}
    for column, signal in signals.items():
        again = signal == "s_ddot" and seen
        seen = seen or signal == "s_ddot"
        integral = signal in ("x", "v") and places.get(column) in sensors
        kept[column] = None if again or integral or signal in ("s", "s_dot") else signal
    return kept


def _signal(column: str, said: str, unit: str | None) -> str | None:
    if is_clock(column) and (unit is None or has_dimension(unit, "time")):
        return "time"
    if re.search(OTHER, said):
        return None
    base = re.search(BASE, said) is not None
    named = next((s for pattern, s in KINDS if re.search(pattern, column.lower())), None)
    if named is None and base and unit is None:
        named = "a"
    if unit is not None:
        fits = [signal for _, signal in UNITS if has_dimension(unit, signal)]
        named = fits[0] if fits else None
    return OF_BASE.get(named, named) if base and named else named


def _is_element_test(
    kinds: Sequence[str],
    said: str,
    signals: Mapping[str, str | None],
    values: Mapping[str, np.ndarray] | None,
) -> bool:
    """Whether a motion is imposed on an element: one force, one displacement, no ground."""
    if kinds.count("f") != 1 or kinds.count("x") != 1 or set(kinds) & set(OF_BASE.values()):
        return False
    if re.search(ELEMENT, said) or "a" not in kinds:
        return True
    if kinds.count("a") > 1 or values is None:
        return False
    column = {signal: c for c, signal in signals.items() if signal}
    of = {s: values[c] for s, c in column.items() if s in ("x", "v", "a", "f") and c in values}
    if not {"x", "a", "f"} <= of.keys() or not all(np.isfinite(u).all() for u in of.values()):
        return False
    rate = of.get("v", np.gradient(of["x"]))
    law = [np.ones_like(rate), of["x"], rate, np.sign(rate), of["x"] ** 3]
    without, with_mass = (_residual_norm(of["f"], c) for c in (law, [*law, of["a"]]))
    return with_mass > EXPLAINED * without


def _residual_norm(force: np.ndarray, causes: Sequence[np.ndarray]) -> float:
    """Norm of what a linear combination of causes leaves of a force."""
    table = np.stack([c / (np.abs(c).max() or 1.0) for c in causes], axis=1)
    known = np.linalg.lstsq(table, force, rcond=1e-8)[0]
    return float(np.linalg.norm(force - table @ known))


def _of_element(column: str, said: str, signal: str | None, unit: str | None) -> str | None:
    if signal is None and (re.search(OTHER, said) or unit in OTHER_UNITS):
        return "u"
    if signal in (None, "time", *OF_ELEMENT):
        return OF_ELEMENT.get(signal, signal) if signal else None
    return None  # an acceleration says no more than the displacement that was imposed


def lacking(guesses: Mapping[str, str]) -> str:
    """What the guessed channels lack to be trained on, "" where they suffice."""
    signals = {signal_of(channel) for channel in guesses.values()}
    if not signals & {"a", "r", "x"}:
        return "nothing here is a response: name accelerations a1, …, or a force of an element r1"
    if not signals & {"f", "s_ddot", "s"}:
        return (
            "nothing here drives the motion: name the acceleration of the ground or table s_ddot1, "
            "or a force f1"
        )
    return ""
