"""Units as FMI describes them: powers of kilogram, metre and second."""

from __future__ import annotations

import re
from collections.abc import Iterable
from xml.etree.ElementTree import Element, SubElement

BASES = {"kg": (1, 0, 0), "m": (0, 1, 0), "s": (0, 0, 1), "N": (1, 1, -2), "J": (1, 2, -2)}
NAMES = ("kg", "m", "s")


def powers_of(unit: str) -> tuple[int, int, int] | None:
    """Powers of kg, m and s of a unit such as N s/m3; None for one that has others."""
    total = [0, 0, 0]
    for part, sign in zip(unit.split("/", 1), (1, -1), strict=False):
        for word in part.split():
            if word == "1":
                continue
            found = re.fullmatch(r"([A-Za-z]+)(\d*)", word)
            if found is None or found[1] not in BASES:
                return None
            power = sign * int(found[2] or 1)
            total = [t + power * b for t, b in zip(total, BASES[found[1]], strict=True)]
    return total[0], total[1], total[2]


def definitions(units: Iterable[str], version: str) -> Element | None:
    """<UnitDefinitions>; None without a unit."""
    found, names = Element("UnitDefinitions"), {u for u in units if u}
    for unit in sorted(names | ({"s"} if version == "3" else set())):
        one, powers = SubElement(found, "Unit", name=unit), powers_of(unit)
        if powers is not None:
            pairs = zip(NAMES, powers, strict=True)
            SubElement(one, "BaseUnit", {name: str(power) for name, power in pairs if power})
    return found if len(found) else None
