"""Units at the end of a column's name: cm of disp_cm, kN of force_kN and force_kN2, ms of t_ms.

Only unambiguous words: the g of acc_g may mean the ground, the in of
force_in for what goes in.
"""

from __future__ import annotations

import re

from data.measured.units import has_dimension

TIMES = r"ms|us"  # ms2 is m/s²
WORDS = r"mm|cm|um|inch|ft|kN|MN|lbf|kips?|kgf|mg|gal|Gal"
RATES = r"(?P<length>mm|cm|in)[_/]?(per_)?s(?P<twice>\^?2|²)?"  # cm/s2, cms2, in_s2
UNIT = rf"({TIMES})$|({WORDS})(?=\d{{0,3}}$)|{RATES}"
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
