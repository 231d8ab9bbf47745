"""Text files of many layouts, units and decimal signs whose truth is known, one for each seed.

Held back are units, spellings and layouts that were not looked at while the rules were made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfilt

UNITS = {  # signal: {unit as written: factor to SI}
    "a": {"g": 9.80665, "m/s^2": 1.0, "m/s²": 1.0, "gal": 0.01, "cm/s2": 0.01, "mg": 9.80665e-3,
          "mm/s^2": 1e-3, "in/s^2": 0.0254, "cm/sec^2": 0.01, "g's": 9.80665, "CM/SEC/SEC": 0.01,
          "m s^-2": 1.0, "ft/s/s": 0.3048, "%g": 0.0980665},
    "x": {"mm": 1e-3, "m": 1.0, "cm": 0.01, "in": 0.0254, "inches": 0.0254, "MM": 1e-3},
    "f": {"kN": 1e3, "N": 1.0, "kips": 4448.2216152605, "lbf": 4.4482216152605},
    "time": {"s": 1.0, "ms": 1e-3, "sec": 1.0, "msec": 1e-3, "us": 1e-6},
}  # fmt: skip
HELD_UNITS = {
    "a": {"Gal": 0.01, "milli-g": 9.80665e-3, "in./sec^2": 0.0254, "m.s-2": 1.0, "cm/s/s": 0.01},
    "x": {"feet": 0.3048, "in.": 0.0254, "millimetres": 1e-3},
    "f": {"lbs": 4.4482216152605, "KN": 1e3, "kgf": 9.80665}, "time": {"secs": 1.0, "msecs": 1e-3},
}  # fmt: skip
STYLES = (
    *("{n} [{u}]", "{n} ({u})", "{n}, {u}", "{n}/{u}", "{n} in {u}", "{n}_{u}", "row", "", ""),
    *("{n} - {u}", "{n} {{{u}}}", "{n}.{u}", "[{u}] {n}", "{n} (unit: {u})", "row above"),
)
HELD_STYLES = ("{n} <{u}>", "{n}: {u}", "{n} = {u}", "({u}) {n}", "{n} {u}", "{n} [unit = {u}]")
NAMES = {  # of base, floors, a displacement, a force
    "place": ("Ground acc", "Floor {} acc", "Floor {} disp", "Hammer force"),
    "ours": ("s_ddot1", "a{}", "x{}", "f{}"), "code": ("ACC_B", "ACC_{}", "LVDT_{}", "LOAD"),
}  # fmt: skip
LAYOUTS = (
    *("plain", "plain", "title", "keys", "toa5", "comment", "closed", "no header", "one more"),
    *("title of as many cells", "groups", "keys with tabs", "counted", "wrapped"),
)
HELD_LAYOUTS = ("quoted", "dashes", "descriptions", "numbered", "keys by commas", "blank columns")
GAPS = ("none", "none", "none", "cells", "NaN", "slow", "tail")


@dataclass(frozen=True)
class Written:
    """A file of text, what it holds, and what somebody knows who made it."""

    text: str
    encoding: str
    truth: dict[str, np.ndarray]  # {channel: (T,)} [SI]
    dt: float  # [s]
    columns: dict[str, str]  # {channel: column as written}
    units: dict[str, str]  # {channel: unit}
    said: str  # its kind


def written(seed: int, held: bool = False) -> Written:
    """The file of a seed. held: of the units and layouts that are held back, where they differ."""
    rng = np.random.default_rng(seed)
    units = {s: list((HELD_UNITS if held else UNITS)[s].items()) for s in UNITS}
    style = str(rng.choice(HELD_STYLES if held and rng.random() < 0.7 else STYLES))
    layout = str(rng.choice(HELD_LAYOUTS if held and rng.random() < 0.7 else LAYOUTS))
    gap, called = str(rng.choice(GAPS)), str(rng.choice(list(NAMES)))
    delimiter = str(rng.choice([",", ";", "\t", "  "]))
    comma = delimiter in (";", "\t") and rng.random() < 0.4
    dt, samples = float(rng.choice([0.01, 0.005, 0.02, 1 / 128])), int(rng.integers(120, 400))
    smooth = butter(3, 0.08, output="sos")
    floors = int(rng.integers(1, 4))
    signals = ["s_ddot1", *(f"a{k + 1}" for k in range(floors))]
    signals += ["x1"] * int(rng.integers(2)) + ["f1"] * int(rng.integers(2))
    size = {"s": 8.0, "a": 12.0, "x": 0.1, "f": 4e4}
    truth = {s: size[s[0]] * sosfilt(smooth, rng.standard_normal(samples)) for s in signals}
    names = dict(zip(("s_ddot", "a", "x", "f"), NAMES[called], strict=True))
    columns = {s: names[s.rstrip("0123456789")].format(s[-1]) for s in signals}
    unit = {kind: units[kind][int(rng.integers(len(units[kind])))] for kind in UNITS}
    unit = {**unit, "s": unit["a"]}
    if called == "ours" and style == "":
        unit = dict.fromkeys(unit, ("", 1.0)) | {"time": unit["time"]}
    if style == "" and unit["time"][1] == 1e-6:
        style = "row"
    table = {c: truth[c] / unit[c[0]][1] for c in signals}
    if rng.random() < 0.3:
        table = {c: table[c] for c in rng.permutation(signals)}
    timed = layout not in ("counted", "keys", "wrapped") or rng.random() < 0.5
    if layout == "wrapped":
        table, timed = {"s_ddot1": table["s_ddot1"]}, False
    clock = str(rng.choice(["time", "Time", "t", "Timestamp"]))
    heads = {"time": (clock, unit["time"][0])} if timed else {}
    heads |= {c: (columns[c], unit[c[0]][0]) for c in table}
    rows = [[_shown(v, 7) for v in column] for column in table.values()]
    if timed:
        rows.insert(0, [_shown(k * dt / unit["time"][1], 9) for k in range(samples)])
    last = len(rows) - 1
    if gap in ("cells", "NaN") and delimiter != "  " and last > 0:
        for k in rng.integers(5, samples - 5, 3):
            rows[last][k] = "" if gap == "cells" else "NaN"
    if gap == "slow" and delimiter != "  " and last > 1 and timed:
        rows[last][1::2] = [""] * len(rows[last][1::2])
    spelt = {c: style.format(n=n, u=u) if "{" in style and u else n for c, (n, u) in heads.items()}
    lines = [delimiter.join(cells) for cells in zip(*rows, strict=True)]
    lines = [line.replace(".", ",") for line in lines] if comma else lines
    text = _laid_out(layout, style, lines, spelt, heads, delimiter, dt, rng)
    if gap == "tail" and delimiter != "  ":
        text += (delimiter * last + "\n") * int(rng.integers(3, 60))
    text = text.replace("\n", str(rng.choice(["\n", "\n", "\r\n"])))
    encoding = str(rng.choice(["utf-8", "utf-8-sig", "cp1252"]))
    kept = {c: truth[c] for c in table}
    stated = {c: unit[c[0]][0] or "SI" for c in table} | {"time": unit["time"][0]}
    said = f"{layout} · {style or 'no unit'}"
    return Written(text, encoding, kept, dt, spelt, stated, said)


def _shown(value: float, digits: int) -> str:
    return f"{value:.{digits}g}"


def _laid_out(
    layout: str,
    style: str,
    rows: list[str],
    names: Mapping[str, str],
    heads: Mapping[str, tuple[str, str]],
    delimiter: str,
    dt: float,
    rng: np.random.Generator,
) -> str:
    """The text of rows below a head of some layout."""
    cells = [f'"{n}"' if delimiter.strip() and delimiter in n else n for n in names.values()]
    head = [delimiter.join(cells)]
    units = delimiter.join(u or "-" for _, u in heads.values())
    if style == "row" or layout == "toa5":
        head = [*head, units]
    if style == "row above":
        head = [units, *head]
    keys = [f"Station: 7{delimiter}", f"Sampling rate: {1 / dt:g} Hz", "Operator: N. N."]
    if layout in ("title", "keys"):
        head = [*(["Test of a frame, 3 March"] if layout == "title" else keys), "", *head]
    elif layout == "toa5":
        quoted = ['"' + delimiter.strip(" ").join(["TOA5", "CR6", "7"]) + '"']
        head = [*quoted, *head, delimiter.join(["Smp"] * len(cells))]
    elif layout == "comment":
        head = [f"# {line}" for line in head]
    elif layout == "closed" and delimiter.strip(" "):
        rows = [row + delimiter for row in rows]
    elif layout == "no header":
        head = []
    elif layout == "one more" and delimiter.strip(" "):
        head = [head[0] + delimiter + "Events", *head[1:]]
        rows = [rows[0] + delimiter + "Start", *rows[1:]]
    elif layout == "title of as many cells":
        head = [delimiter.join(f"run {k}" for k in range(len(cells))), *head]
    elif layout == "groups":
        head = [delimiter.join(f"Group {'AB'[k % 2]}" for k in range(len(cells))), *head]
    elif layout == "keys with tabs":
        head = ["Device\tLogger", f"Sampling interval [ms]\t{1000 * dt:g}", "", *head]
    elif layout == "counted":
        head = [f"dt = {dt:g} s", "Notes: none", *head]
    elif layout == "quoted":
        head[head.index(delimiter.join(cells))] = delimiter.join(f'"{n}"' for n in names.values())
    elif layout == "dashes":
        head = [*head, "-" * 40]
    elif layout == "descriptions":
        head = [*head, delimiter.join(["as recorded"] * len(cells))]
    elif layout == "numbered" and delimiter.strip(" "):
        head = [f"No{delimiter}{head[0]}", *(f"-{delimiter}{line}" for line in head[1:])]
        rows = [f"{k + 1}{delimiter}{row}" for k, row in enumerate(rows)]
    elif layout == "keys by commas":
        head = ["Logger,7", f"Sample rate,{1 / dt:g}", "Channels,3", *head]
    elif layout == "blank columns" and delimiter.strip(" "):
        head, rows = ([line + 2 * delimiter for line in part] for part in (head, rows))
    elif layout == "wrapped":
        width, unit = int(rng.integers(4, 9)), next(iter(heads.values()))[1]
        said = f"ACCELERATION UNIT: {unit}" if unit else "ACCELERATION"
        head = [said, f"NO. OF POINTS: {len(rows)} INTERVAL: {dt:g} SEC"]
        rows = ["  ".join(rows[k : k + width]) for k in range(0, len(rows), width)]
    return "\n".join([*head, *rows]) + "\n"
