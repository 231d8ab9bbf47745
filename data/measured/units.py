"""Units as people write them, and their factors to SI.

One grammar: symbols with powers, in products and quotients (m/s^2, cm/sec/sec, m s⁻², kg*m/s2),
with the meanings that engineers give to g, lb, kip and in: `to_si("g", "a")` is 9.80665 m/s².
Factors only: a unit with an offset, such as °C, belongs to no signal here.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator

import numpy as np

# signal → (what it is, SI unit, examples)
DIMENSIONS = {
    "time": ("a time", "s", "s, ms, us, ns, min"),
    "f": ("a force", "N", "N, kN, kgf, tf, lbf, kip"),
    "r": ("a force", "N", "N, kN, kgf, tf, lbf, kip"),
    "x": ("a displacement", "m", "m, mm, in, ft"),
    "s": ("a displacement", "m", "m, mm, in, ft"),
    "drift": ("a displacement", "m", "m, mm, in, ft"),
    "strain": ("a strain", "m/m", "m/m, mm/m, um/m, microstrain"),
    "v": ("a velocity", "m/s", "m/s, mm/s, in/s, cm/s"),
    "s_dot": ("a velocity", "m/s", "m/s, mm/s, in/s, cm/s"),
    "a": ("an acceleration", "m/s^2", "m/s^2, g, mg, gal, cm/s^2, in/s^2"),
    "s_ddot": ("an acceleration", "m/s^2", "m/s^2, g, mg, gal, cm/s^2, in/s^2"),
    "u": ("an input of any dimension", "", "V, A, degC, kN"),  # kept as it is
}
Factor = tuple[float, tuple[int, ...]]  # to SI, and the exponents of m, kg, s, A, K

GRAVITY, INCH, POUND = 9.80665, 0.0254, 0.45359237  # m/s², m, kg
LENGTH, MASS, TIME, CURRENT, HEAT = (tuple(int(i == k) for i in range(5)) for k in range(5))
FORCE, ACCELERATION = (1, 1, -2, 0, 0), (1, 0, -2, 0, 0)
PREFIXES = {
    "n": ("nano", 1e-9), "u": ("micro", 1e-6), "m": ("milli", 1e-3), "c": ("centi", 1e-2),
    "d": ("deci", 0.1), "k": ("kilo", 1e3), "M": ("mega", 1e6), "G": ("giga", 1e9),
}  # fmt: skip
PREFIXED = (  # symbol, name, factor, dimension, prefixes in use
    ("m", "meter metre", 1.0, LENGTH, "numcdk"), ("s", "second sec", 1.0, TIME, "num"),
    ("N", "newton", 1.0, FORCE, "mkM"), ("g", "", GRAVITY, ACCELERATION, "um"),
    ("Gal", "gal", 0.01, ACCELERATION, "m"), ("gal", "", 0.01, ACCELERATION, "m"),
    ("V", "volt", 1.0, (2, 1, -3, -1, 0), "umk"), ("A", "ampere amp", 1.0, CURRENT, "um"),
    ("Hz", "hertz", 1.0, (0, 0, -1, 0, 0), "k"), ("Pa", "pascal", 1.0, (-1, 1, -2, 0, 0), "kMG"),
)  # fmt: skip
OTHERS: tuple[tuple[str, float, tuple[int, ...]], ...] = (
    ("kg kilogram kilograms", 1.0, MASS), ("in inch inches \" ″", INCH, LENGTH),
    ("ft foot feet ' ′", 12.0 * INCH, LENGTH), ("mil mils thou", 1e-3 * INCH, LENGTH),
    ("micron microns", 1e-6, LENGTH), ("yd", 0.9144, LENGTH), ("secs", 1.0, TIME),
    ("msec msecs millis", 1e-3, TIME), ("usec usecs micros", 1e-6, TIME), ("nsec", 1e-9, TIME),
    ("min mins minute minutes", 60.0, TIME), ("h hr hrs hour hours", 3600.0, TIME),
    ("day days", 86400.0, TIME), ("G gn g0 gs g's g’s gravity", GRAVITY, ACCELERATION),
    ("%g", 0.01 * GRAVITY, ACCELERATION), ("mG milli-g millig", 1e-3 * GRAVITY, ACCELERATION),
    ("lb lbs lbf pound pounds", POUND * GRAVITY, FORCE),
    ("kip kips klb klbs klbf", 1e3 * POUND * GRAVITY, FORCE), ("kgf kp", GRAVITY, FORCE),
    ("tf", 1e3 * GRAVITY, FORCE), ("tonf", 2e3 * POUND * GRAVITY, FORCE),
    ("dyn dyne", 1e-5, FORCE), ("kn knot", 1852.0 / 3600.0, (1, 0, -1, 0, 0)),
    ("psi", POUND * GRAVITY / INCH**2, (-1, 1, -2, 0, 0)), ("bar", 1e5, (-1, 1, -2, 0, 0)),
    ("ksi", 1e3 * POUND * GRAVITY / INCH**2, (-1, 1, -2, 0, 0)),
    ("degC °C C degF °F K", 1.0, HEAT), ("rad deg °", 1.0, (0, 0, 0, 0, 0)),
    ("strain", 1.0, (0, 0, 0, 0, 0)), ("%", 0.01, (0, 0, 0, 0, 0)),
    ("microstrain ustrain", 1e-6, (0, 0, 0, 0, 0)),
)  # fmt: skip
SPELT_TOGETHER = (  # mps2, ips and cms2, ms-2, where the letters alone would mean something else
    (re.compile(r"(m|cm|mm|in|ft)ps(\^?2)?", re.I), r"\1/s\2"),
    (re.compile(r"ips(\^?2)?", re.I), r"in/s\1"), (re.compile(r"fps(\^?2)?", re.I), r"ft/s\1"),
    (re.compile(r"(m|cm|mm|in|ft)s\^?-?2", re.I), r"\1/s^2"),
    (re.compile(r"(.*\w) squared", re.I), r"\1^2"),
)  # fmt: skip
POWERS = str.maketrans("⁻⁰¹²³⁴−ý", "-01234-2")  # ý: a square in the code pages of DOS
WORD = r"""%\ ?g\b|g['’]s|milli-g|g0|[A-Za-z°]+|["″'′%]"""
TERM = re.compile(
    rf"(?P<operator>\s*/\s*|\s*\*\s*|\s+per\s+|\s+|(?<=\w)\.(?=[a-z]))?"
    rf"(?P<word>{WORD})(\.(?![A-Za-z]))?"
    r"(\ ?\^\ ?\(?(?P<power>-?[1-4])\)?(?![\d.^])|\ ?(?P<digit>-[1-4]|[2-4])(?![\d.^]))?",
    re.X,
)
LONGEST = 32  # characters; longer than any unit
LABELLED = re.compile(  # unit: g, in units of g, in g; but in lb is a moment
    r"(in\s+)?units?\s*(of\s+|[:=]\s*|\s+)|in\s+(?!k?lb|kip|oz|pound)(?=\S)", re.I
)


def to_si(unit: str, signal: str) -> float:
    """Factor that turns values in `unit` into SI: s, N, m, m/s or m/s², as `signal` asks.

    `signal` is one of DIMENSIONS, such as "a" or "time"; the unit of "u" is kept.
    A minus before the unit is that of a sensor that points the other way: `to_si("-mm", "x")`; a
    number is a sensitivity, as of a gauge in volts: `to_si("0.35 mm", "drift")`.
    Raises ValueError for another signal, an unknown unit, or a unit of another dimension.
    """
    if signal not in DIMENSIONS:
        raise ValueError(f"signal={signal!r}: choose {', '.join(DIMENSIONS)}")
    if signal == "u":
        return 1.0
    if unit.startswith("-") and signal != "time":
        return -to_si(unit[1:], signal)
    many = re.match(r"(\d+(?:\.\d+)?(?:e-?\d\d?)?) +", unit)
    if many and float(many[1]) > 0.0:
        return float(many[1]) * to_si(unit[many.end() :], signal)
    what, si, examples = DIMENSIONS[signal]
    expected = f"signal {signal} is {what} and wants a unit of {si}, for example {examples}"
    known = factor_of(unit)
    if known is None:
        raise ValueError(f"unit={unit!r} is not known; {expected}")
    if known[1] != _dimension(signal):
        raise ValueError(f"unit={unit!r} has another dimension; {expected}")
    return known[0]


@functools.cache
def ratios() -> np.ndarray:
    """Of two units of one signal in use, such as 1000 of kN and N, or 9.80665 of g and m/s²."""
    signals = [signal for signal in DIMENSIONS if signal not in ("time", "u")]
    units = [[to_si(u, s) for u in DIMENSIONS[s][2].split(", ")] for s in signals]
    return np.unique([one / other for own in units for one in own for other in own])


def has_dimension(unit: str, signal: str) -> bool:
    """Whether `unit` is one of `signal`."""
    known = factor_of(unit)
    return signal == "u" or (known is not None and known[1] == _dimension(signal))


def is_unit(text: str) -> bool:
    """Whether `text` is a unit, such as "m/s^2", "g's" or "unit: CM/SEC/SEC"."""
    return factor_of(text) is not None


@functools.lru_cache(maxsize=4096)
def factor_of(text: str) -> Factor | None:
    """Factor to SI and dimension of a unit; None for what is none.

    Letters in another case than usual, as in KN and CM/SEC/SEC, are understood where one unit only
    can be meant.
    """
    if len(text) > LONGEST or "\n" in text or text.lower() == "n/a":
        return None
    text = unlabelled(text)
    raised = re.sub(r"(?<=\w)([⁻⁰¹²³⁴ý]+)", r"^\1", text).translate(POWERS)
    text = raised.replace("**", "^").replace("µ", "u").replace("μ", "u")
    text = re.sub(r"[·×]", "*", re.sub(r"/\s*\(([^()/]+)\)", r"/\1", text))
    for spelling, meaning in SPELT_TOGETHER:
        text = spelling.sub(meaning, text) if spelling.fullmatch(text) else text
    factor, exponents, at = 1.0, [0] * 5, 0
    while at < len(text):
        term = TERM.match(text, at)
        if term is None or (at == 0) != (term["operator"] is None):
            return None
        known = _symbol(term["word"].replace(" ", ""))
        if known is None:
            return None
        divided = term["operator"] is not None and term["operator"].strip() in ("/", "per")
        power = int(term["power"] or term["digit"] or 1) * (-1 if divided else 1)
        factor *= known[0] ** power
        exponents = [e + power * d for e, d in zip(exponents, known[1], strict=True)]
        at = term.end()
    return (factor, tuple(exponents)) if at else None


def unlabelled(text: str) -> str:
    """The unit of "unit: g" and "in g" alone."""
    labelled = LABELLED.match(text.strip())
    return text.strip()[labelled.end() if labelled else 0 :]


def _dimension(signal: str) -> tuple[int, ...]:
    known = factor_of(DIMENSIONS[signal][1])
    assert known is not None
    return known[1]


@functools.cache
def _symbols() -> dict[str, Factor]:
    known = {word: (size, kind) for words, size, kind in OTHERS for word in words.split()}
    for symbol, names, size, kind, prefixes in PREFIXED:
        for prefix, (long, times) in (("", ("", 1.0)), *PREFIXES.items()):
            if prefix == "" or prefix in prefixes:
                known.setdefault(prefix + symbol, (times * size, kind))
            for name in names.split():
                known |= dict.fromkeys((long + name, f"{long}{name}s"), (times * size, kind))
    return known


@functools.cache
def _folded() -> dict[str, set[Factor]]:
    found = dict[str, set[Factor]]()
    for word, known in _symbols().items():
        if word != "kn":
            found.setdefault(word.casefold(), set()).add(known)
    return found


def _symbol(word: str) -> Factor | None:
    if word in _symbols():
        return _symbols()[word]
    single = len(word) == 1 and word not in "MS"  # a, c, n may be anything
    found = set() if single else _folded().get(word.casefold(), set())
    return next(iter(found)) if len(found) == 1 else None


# Units in names: in brackets anywhere, else at the end: Acc/g, Acc, g, Acc in g, disp_cm.
#
# A comma, a stroke or the word "in" before it make a unit of any symbol. After a blank or an
# underscore the short ones may be other words (the ground of acc_g, what goes in of disp_in), so
# there they count only where the dimension is that of what the column is taken for.

BRACKETS = re.compile(r"\[([^\[\]]*)\]|\(([^()]*)\)|\{([^{}]*)\}|<([^<>]*)>")
SURE = re.compile(
    r"\s*,\s*|\s*;\s*|\s*:\s+|\s+[-–—|@]\s+|\s+in\s+|\s*/\s*|_in_(?=\w)|\s*=\s*", re.I
)
LOOSE = re.compile(r"[\s_.\-]+")
SHORT = re.compile(r"[a-z]|in|min|gs", re.I)  # of these a letter or a word may mean something else
PLAIN_WORDS = frozenset({"deg", "bar", "gravity", "thou"})
KINDS = (  # in a column's name → signal
    (r"acc|^a[_ ]?[xyz]?\d*$", "a"),
    (r"disp|lvdt|stroke|laser|deflection|position", "x"),
    (r"vel(o|\b|_|\d|$)|^v[_ ]?\d*$", "v"),
    (r"force|load|hammer|frc|react|^f[_ ]?\d*$", "f"),
)


DAY = 86_400.0  # s
EPOCH_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
DAYS_TO_1970 = (25_569.0, 719_529.0)  # as spreadsheets and MATLAB count days
CLOCK = (
    r"time|zeit|temps|tiempo|tempo\b|elapsed|seconds?$|^t$|^t[_ ]?\[?[mu]?s\]?$|"
    r"время|时间|時[間刻]|시간|zaman"
)


def is_clock(column: str) -> bool:
    """Whether a column's name sounds like a clock."""
    return re.search(CLOCK, column.lower()) is not None or _is_time(column)


def _is_time(column: str) -> bool:
    """Whether the name of a column is a unit of time: sec, ms, millis; min is the least of all."""
    return len(column) > 1 and column.lower() != "min" and has_dimension(column, "time")


def epoch_unit(time: float, step: float) -> str | None:
    """The unit in which a clock counts from 1970, if it shows a time between 1990 and 2100.

    Or that of a date of a spreadsheet or MATLAB, in days. step: between samples, which in this unit
    is one of a logger, 10 µs to 1 s: a counter that started yesterday may look like a date.
    """
    for start in DAYS_TO_1970:
        if 6.3e8 <= DAY * (time - start) < 4.1e9 and 1e-5 <= DAY * step <= 1.0:
            return "day"
    for unit, size in EPOCH_UNITS.items():
        if 6.3e8 <= size * time < 4.1e9 and 1e-5 <= size * step <= 1.0:
            return unit
    return None


def signal_by_words(column: str) -> str | None:
    """The signal that the words of a column's name say: a of "Roof acc X"; None without such."""
    if is_clock(column):
        return "time"
    return next((s for pattern, s in KINDS if re.search(pattern, column.lower())), None)


def split_brackets(header: str) -> tuple[str, str | None]:
    """("acc X", "g") for "acc [g] X": the name without the brackets that hold its unit.

    Square brackets at the end hold a unit even where it is not known, others only a known one.
    """
    found = sorted(BRACKETS.finditer(header), key=lambda match: (match[1] is None, -match.start()))
    for match in found:
        square = match[1]
        inside = next((text for text in match.groups() if text is not None), "").strip()
        parts = [part for part in re.split(r"[,;]", inside) if is_unit(part)]
        last = not header[match.end() :].strip()
        if len(parts) == 1 or (square and last and inside and not inside.isdigit()):
            rest = f"{header[: match.start()].rstrip()} {header[match.end() :].lstrip()}".strip()
            rest = re.sub(r"^([ ,;:_]|-(?!\w))+|[ ,;:_-]+$", "", rest)  # -a1 is no a1
            if rest:
                return rest, unlabelled(parts[0]) if len(parts) == 1 else inside
    return header.strip(), None


def unit_in_name(column: str, signal: str | None = None, sure: bool = False) -> str | None:
    """The unit that the name of a column ends with, None without one.

    signal: what the column is taken for; the unit of another is none. Without it, what the name's
    own words say. sure: only a unit that can be no other word.
    """
    name = column.strip()
    said = signal or signal_by_words(name)
    if said == "time" and _is_time(name):
        return name
    ends = [(match.start(), match.end(), True) for match in SURE.finditer(name)]
    ends += [(match.start(), match.end(), False) for match in LOOSE.finditer(name)]
    ends.sort(key=lambda end: (end[1], -end[0]))  # the longest unit first
    for start, end, strong in ends:
        for unit in _spellings(name[end:], strong, said) if start else ():
            short = not strong and SHORT.fullmatch(unit) is not None
            if short and sure:
                continue
            of_ground = short and unit in "gG" and start == 1  # a_g
            if said is not None and has_dimension(unit, said) and not of_ground:
                return unit
            of_sensor = not short or (unit == "g" and name[start - 1].isdigit())  # roof_2_g
            if signal is None and said is None and _of_signal(unit) and of_sensor:
                return unit
    return None


def _spellings(text: str, strong: bool, signal: str | None) -> Iterator[str]:
    """The units that the end of a name may be, with strokes for underscores."""
    rate = re.sub(r"_per_", "/", re.sub(r"_(?=-?\d$)", "", unlabelled(text)), flags=re.I)
    rate = re.sub(r"(?<=[a-z])_(?=s)", "/", rate, flags=re.I)
    together = re.fullmatch(r"(mm|cm|m|in|ft)s(\^?[2²])?", rate, re.I)
    if together and (together[2] or signal in ("v", "s_dot")):
        rate = f"{together[1]}/s{'^2' if together[2] else ''}"
    rate = re.sub(r"(?<=/s)[2²]$", "^2", rate, flags=re.I)
    if is_unit(rate) and (strong or rate.lower() not in PLAIN_WORDS):
        yield rate
    numbered = re.fullmatch(r"(\D{2,}?)\d{1,3}", rate)  # kN of force_kN2, but no m of disp_m2
    if numbered and numbered[1] not in ("in", "min") and is_unit(numbered[1]):
        yield numbered[1]


def _of_signal(unit: str) -> bool:
    known = factor_of(unit)
    kinds = {_dimension(signal) for signal in DIMENSIONS if signal != "u"}
    return known is not None and known[1] in kinds
