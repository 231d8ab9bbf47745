"""What the lines above the rows of a text file say: step, rate, unit, one series in columns."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from data.measured.files.columns import LONGEST, FileError, shorten
from data.measured.files.text_cells import is_number, numbers
from data.measured.units import has_dimension, is_unit, to_si

NUMBER = r"[-+]?\d[\d.]*(?:[eE][-+]?\d+)?"
VALUE = (
    r"(?:[ _]+(?P<said>[A-Za-zµ]{1,3})\b)?"
    r"[ ]*(?:[\[(](?P<before>[^\])]*)[\])])?(?P<apart>[\s:=,;]*)"
    rf"(?P<value>{NUMBER})(?P<more>(?:,\d+)*(?:\.\d+)?)[ ]*(?P<after>[A-Za-zµ/]*)"
)
STEP = re.compile(
    r"(?i:\bdt|delta[ _]?t|Δt|time[ _]*step|(?:interval|increment|period|spacing)s?"
    r"(?: +of)?)(?![A-Za-z0-9])" + VALUE
)
RATE = re.compile(
    r"(?i:\bfs|(?:sampl\w*|scan|data|acq\w*)[ _]*(?:rate|freq\w*)|(?:abtast|mess)rate|"
    r"(?:tasa|frecuencia) de muestreo|fréquence d.échantillonnage|frequenza di campionamento)"
    + VALUE
    + rf"|(?<![\w.])(?P<sps>{NUMBER}) ?(?i:sps|samples ?/ ?s(?:ec)?)\b"
)
SLOW = re.compile(r"[^,;:|]*(?:/|\bper\b) ?(?:min|h(?:ou)?r?\b)", re.I)  # a rate not in Hz
POINTS = r"(?:points|samples|data|values|muestras)"
COUNT = re.compile(
    rf"(?i:(?:no\.?|n[uú]mero|number|count|num)[ _]*(?:of|de)?[ _]*{POINTS}|points|npts|ndata|"
    rf"samples?[ _]*count)\s*[:=,;]?\s*(\d+)\b|(?<![\w.])(\d+) +(?i:{POINTS})\b"
)
THOUSANDS = re.compile(r"[1-9]\d{0,2}([.,]\d{3})+(\.\d+)?")
STEPS = (1e-5, 1.0)  # s, that loggers have: others are in a unit that is not said
FEWEST = 10  # rows that tell of a series written in several columns


def facts_of(lines: Sequence[str], notes: list[str], decimal: str) -> dict[str, float]:
    """dt [s] where the lines above the rows say a step or a rate, and do not contradict it.

    Longer lines than people write are cut: a search of all would take too long.
    """
    lines = [line[:LONGEST] for line in lines]
    found = [(p, m) for line in lines for p in (STEP, RATE) if (m := p.search(line)) is not None]
    known = [step for p, m in found if (step := _step(m, p is RATE, decimal)) is not None]
    if not known or max(known) > 1.01 * min(known):
        if known:
            notes.append(f"the header says steps of {known[0]:g} s and {known[-1]:g} s: not used")
        return {}
    notes.append(f"the header says steps of {known[0]:g} s")
    return {"dt": known[0]}


def _step(found: re.Match[str], rate: bool, decimal: str) -> float | None:
    """Seconds; None for what is none, and for the 1.000 of a file whose decimals are commas."""
    said, more = found["value"] or found["sps"], found["more"] or ""
    if more and "," not in found["apart"]:  # else they are cells of their own
        thousands = decimal == "." and THOUSANDS.fullmatch(said + more)
        said = (said + more).replace(",", "" if thousands else ".")
    elif decimal == "," and THOUSANDS.fullmatch(said):
        return None
    slow = rate and found["value"] and SLOW.match(found.string, found.end("value"))
    if not is_number(said) or slow:
        return None
    unit = (found["after"] or found["before"] or found["said"] or "").strip()
    value = float(said) * (1e3 if rate and unit.lower() in ("khz", "ksps") else 1.0)
    if unit and has_dimension(unit, "time"):  # a "rate" of 10 ms is a step
        value *= to_si(unit, "time")
    elif rate:
        value = 1.0 / value if value > 0.0 else 0.0
    return value if STEPS[0] <= value <= STEPS[1] else None


def unit_of(lines: Sequence[str]) -> str | None:
    """The unit that the lines above a series say: CM/SEC/SEC of "UNIT: CM/SEC/SEC"."""
    for line in (line[:LONGEST] for line in lines):
        said = r"(?i:\bunits?\b|\bunidad(?:es)?\b|\bin\b)\s*[:=]?\s*(.+)"
        for text in re.findall(said + r"|[\[(]([^\])]+)[\])]", line):
            words = "".join(text).strip(" []()").split()
            for k in range(len(words), 0, -1):
                unit = " ".join(words[:k]).strip(",;[]()")
                if is_unit(unit) and any(has_dimension(unit, signal) for signal in "avxf"):
                    return unit
    return None


def points_of(path: Path, offset: int, width: int, before: Sequence[str]) -> int | None:
    """Values of one series that is written `width` in a row, as the lines above say; else None.

    In one column it is where as many rows follow.
    """
    known = filter(None, (COUNT.search(line[:LONGEST]) for line in before))
    counts = [int(found[1] or found[2]) for found in known]
    lines = 0
    if counts:
        with path.open("rb") as file:
            file.seek(offset)
            lines = sum(line.strip() != b"" for line in file)
    counts = [n for n in counts if (lines - 1) * width < n <= lines * width]
    return next((n for n in counts if (n == lines) == (width == 1)), None)


def ask_whether_wrapped(path: Path, width: int, rows: Sequence[Sequence[str]]) -> None:
    """Raise FileError where rows without names look like one series, and nothing says so."""
    full = [row for row in rows if len(row) == width and all(map(is_number, row))]
    other = next((row for row in rows if not is_number(row[0])), None)
    if width > 2 and len(full) >= FEWEST and other and _runs_on(full):
        raise FileError(
            f"{path.name}: {shorten(' '.join(other))} begins another series; write a file for each"
        )
    if width > 2 and len(full) >= FEWEST and (_runs_on(full) or len(rows[-1]) < width):
        raise FileError(
            f"{path.name}: rows such as {shorten(' '.join(rows[0]))} look like one series, {width} "
            "values a row; to read it so write the line 'points: N' above the rows, N the number "
            f"of its values; for {width} channels write a line of {width} names"
        )


def _runs_on(rows: Sequence[Sequence[str]]) -> bool:
    """Whether each row goes on where the last one ended, and columns do not go on by themselves."""
    table = numbers(rows)
    seam = np.abs(table[1:, 0] - table[:-1, -1]).mean()
    along, down = np.abs(np.diff(table, axis=1)).mean(), np.abs(np.diff(table, axis=0)).mean()
    return bool(max(seam, along) < 0.6 * down and seam < 2.0 * along)
