"""How high a sensor is, and along which axis, by what its column, file or folder is called.

Heights order the sensors of one structure; they are no metres. Zero is the ground, below it are
basements and boreholes; among the words that a name holds, the first that says a height counts.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from itertools import takewhile

import numpy as np

BASE = (  # in a column's name or its sensor's place: what stands below the structure
    r"ground|\bgnd|gnd\b|table|platform|\bbase\b|base(?![a-z])|basement|shaker?\b|foundation|free.?field|"
    r"keller|sous.?sol|s[oó]tano|(floor|level|store?y)[ _-]?0+(?!\d)|üg|(^|_)ag\b|"
    r"input.?(acc|motion)|bore.?hole|down.?hole|"
    r"\bb[1-9]f?\b|fundament|\bboden\b|\bbasis\b|tisch\b|\bsol\b|\bsuelo|\bsuolo|terreno|\bzemin|地表|地盤|地動|地面|基礎|"
    r"\bоснован|\bгрунт|\bgl\b|\bg/?f\b|\bmesa\b|\bsolo\b|振[動动]台|台面|지반"
)
FREE_FIELD = r"free.?field"  # beside the structure: the ground's motion where nothing else is
STOREY = (
    r"floor|flr?|level|lvl|store?y|storeys|[eé]tage|og|piso|piano|planta|kat|этаж|"
    r"nivel|niveau|andar|stock|decke?|mass|dof|[lm]"
)
HEIGHTS = (  # pattern → height, None where it is the number n, or that below the ground, b
    (r"pent.?house|\bph\b", 3e6),
    (
        r"roof|\br/?f\b|\bdach|azotea|techo|toit|tetto|copertura|cobertura|кровл|крыш|çat[ıý]|"
        r"屋[上顶頂]|[顶頂][层層]|옥상",
        2e6,
    ),
    (r"(?P<n>\d{1,3}) ?(?:st|nd|rd|th)\b(?! ?basement)", None),
    (rf"\b(?:{STOREY})[ -]?(?P<n>\d{{1,3}})\b", None),
    (r"\b(?P<n>\d{1,3})[. ]{0,2}/?(?:f|og|kat|этаж|(?:floor|flr?)(?! ?\d))\b", None),
    (r"(?<!\d)(?P<n>\d{1,3}) ?[階层層]", None),
    (r"\bb(?P<b>[1-9])f?\b|(?P<d>\d)?(?:st|nd|rd)? ?basement(?: ?(?P<c>\d))?", None),
    (rf"\b(?:{STOREY}) -(?P<b>\d)\b", None),
    (r"mezzanine|\beg\b|erdgescho", 0.5),
    (r"bore.?hole|down.?hole", -100.0),
    (BASE, 0.0),
)
VAGUE = ((r"deck|girder|mid.?span", 1e6), (r"\btop\b|surface", 2e6))  # where nothing else is said
UNNUMBERED = 1e6  # height of the lowest part that is above all numbered floors
ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth")
AXES = (  # in a name → axis
    (r"\b(\d{1,3}) ?deg", ""),  # of the compass
    (r"\b(?:up|down|vert\w*|u ?- ?d|ud\d?|[a-z]{2}z|z)\b", "z"),
    (r"\b(?:e ?- ?w|ew\d?|[a-z]{2}e|x)\b", "x"),
    (r"\b(?:n ?- ?s|ns\d?|[a-z]{2}n|y)\b", "y"),
)
PARTS = 5  # of a record: chance gives two floors one order in all of them once in sixteen
RESONANCE = 1.5  # times its frequency, up to which the first mode prevails; 1.2 and 2 do as well


def _plain(name: str) -> str:
    """Words in lower case, apart where a capital, a number or an underscore begins another."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z0-9])|_", " ", name)
    words = re.sub(r"[(),;:\[\]{}]", " ", apart).lower().split()
    ranks = {word: f"{k}th" for k, word in enumerate(ORDINALS, start=1)}
    return " ".join(ranks.get(word, word) for word in words)


def height(name: str) -> float | None:
    """Height in storeys above the ground, None for a name that says none: 8 of "8th Fl"."""
    text = _plain(name)
    for patterns in (HEIGHTS, VAGUE):
        found = [(one, value) for pattern, value in patterns if (one := re.search(pattern, text))]
        if found:
            one, value = min(found, key=lambda pair: pair[0].start())
            if value is not None:
                return value
            said = one.groupdict()
            below = [said[key] for key in ("b", "c", "d") if said.get(key)]
            return float(said["n"]) if said.get("n") else -float((below or ["1"])[0])
    return None


def without_shared(names: Sequence[str]) -> list[str]:
    """Names without the words up to a number that all begin with: Floor 2 of "Run 1 Floor 2".

    As they are where these words say a height, as two sensors on "Floor 1" share theirs.
    """
    words = [re.findall(r"\d+|[^\W\d_]+|[\W_]+", name) for name in names]
    same = takewhile(lambda each: len(set(each)) == 1, zip(*words, strict=False))
    shared = [each[0] for each in same]
    count = max((k for k, word in enumerate(shared, start=1) if word.isdecimal()), default=0)
    if len(names) < 2 or height("".join(shared[:count])) is not None:
        return list(names)
    return ["".join(own[count:]).lstrip(" _-./:") for own in words]


def is_base(name: str) -> bool:
    """Whether a name is of what stands below the structure."""
    return re.search(BASE, name.lower()) is not None or re.search(BASE, _plain(name)) is not None


def axis(name: str) -> str:
    """Axis that a name says: "x", "y", "z" or degrees; "" without one."""
    text = _plain(name)
    for pattern, called in AXES:
        found = re.search(pattern, text)
        if found is not None:
            return called or f"{int(found[1])} deg"
    return ""


def upwards(names: Sequence[str]) -> list[float] | None:
    """Heights of all names, or the numbers that alone tell the names apart; None where neither."""
    heights = [height(name) for name in names]
    if None not in heights:
        return [h for h in heights if h is not None]
    cut = [re.fullmatch(r"(.*?)(\d{1,6})(\D*)", name) for name in names]
    known = [found for found in cut if found is not None]
    stems = {(found[1], found[3]) for found in known}
    alike = len(known) == len(names) and len(stems) == 1
    return [float(found[2]) for found in known] if alike else None


def number_upwards(names: Mapping[str, str]) -> dict[str, int]:
    """{column: number of its DOF}, from the lowest floor up, by {column: what it is called}.

    Sensors at one height have one number; in the order given where names do not tell.
    """
    heights = upwards(list(names.values()))
    if heights is None:
        return {}
    rank = {h: k for k, h in enumerate(sorted(set(heights)), start=1)}
    return {column: rank[h] for column, h in zip(names, heights, strict=True)}


def from_below(base: np.ndarray, floors: Mapping[str, np.ndarray]) -> list[str]:
    """Names of accelerations (T,) on one base, the lowest floor first; [] where nothing tells.

    Up to the first resonance all floors move the same way, and the more the higher they are. Below
    it they move with the base, above it against it: so it is where the power in phase with the
    base, summed from the lowest frequency on, is largest. The floors must have one order in each of
    PARTS of the record with as much motion.
    """
    if len(floors) < 2 or any(len(a) != len(base) for a in floors.values()):
        return []
    relative = np.stack([a - base for a in floors.values()])  # (n, T)
    power, orders = np.cumsum(np.square(relative).sum(axis=0)), set[tuple[int, ...]]()
    if not (np.isfinite(power[-1]) and power[-1] > 0.0):
        return []
    in_phase = (_lines(relative) * _lines(base).conj()).real.cumsum(axis=1)
    first = int(in_phase.sum(axis=0).argmax())
    if not (in_phase[:, first] > 0.0).all():
        return []
    cycles = RESONANCE * (first + 1) / len(base)  # a sample
    cuts = np.searchsorted(power, power[-1] * np.arange(1, PARTS) / PARTS)
    for part in np.array_split(relative, cuts, axis=1):
        lines = _lines(part)[:, : int(cycles * part.shape[1])]
        along = (lines * lines.sum(axis=0).conj()).real.sum(axis=1)
        orders.add(tuple(np.argsort(along)) if (along > 0.0).all() else ())
    return [[*floors][k] for k in orders.pop()] if len(orders) == 1 else []


def _lines(signal: np.ndarray) -> np.ndarray:
    """Fourier transform (…, T // 2) without the mean; none of fewer than two samples."""
    T = signal.shape[-1]
    if T < 2:
        return signal[..., :0]
    still = signal - signal.mean(axis=-1, keepdims=True)
    return np.asarray(np.fft.rfft(still * np.hanning(T))[..., 1:])


def least_storeys(names: Sequence[str]) -> int:
    """Storeys that names of sensors above the ground say at least: 6 of "Floor 6" and "Roof".

    The lowest number may be the ground's, as it is in America.
    """
    heights = {h for name in without_shared(names) if (h := height(name)) is not None and h > 0.0}
    numbered = [h for h in heights if h < UNNUMBERED]
    return max(0, int(max(numbered, default=0.0)) - 1) + len(heights) - len(numbered)


def floor_numbers(names: Sequence[str]) -> list[int]:
    """Numbers of the floors that the names say, a roof's above all others; [] where one says none.

    Also [] where two say the same, and where more than one is above all numbered floors.
    """
    heights = [height(name) or 0.0 for name in without_shared(names)]
    roof = 1.0 + max((h for h in heights if h < UNNUMBERED), default=math.inf)
    numbers = [h if h < UNNUMBERED else roof for h in heights]
    told = all(0.0 < n < math.inf and n.is_integer() for n in numbers)
    return [int(n) for n in numbers] if told and len(set(numbers)) == len(names) else []


def one_axis(
    names: Mapping[str, str], base: Sequence[str], strength: Mapping[str, float]
) -> set[str]:
    """Columns along the axis that most of the structure is measured along, base included.

    An axis may also be words that nothing is known of, such as raw and filtered: those that tell
    sensors of the base apart, and come again above it. Of axes with as many sensors that along
    which the base shakes most. Columns without an axis belong to any; all columns where the base
    says no axis.
    """
    words = {c: {w for w in _plain(name).split() if not w.isdigit()} for c, name in names.items()}
    above = set[str]().union(*(own for c, own in words.items() if c not in base))
    alike = set.intersection(*(words[c] for c in base)) if base else set()
    kinds = {w for c in base for w in (words[c] - alike) & above if not axis(w)}
    axes = {c: (own & kinds) | ({axis(names[c])} - {""}) for c, own in words.items()}
    if not base or not all(axes[c] for c in base) or len(set[str]().union(*axes.values())) < 2:
        return set(names)

    def weight(one: str) -> tuple[int, float]:
        floors = {height(names[c]) for c in names if axes[c] <= axes[one] and c not in base}
        return len(floors), strength.get(one, -math.inf)

    best = axes[max(base, key=weight)]
    return {column for column, along in axes.items() if along <= best}
