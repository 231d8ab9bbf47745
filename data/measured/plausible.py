"""Do the channels of a base-excited structure fit together?   T samples.

Well below its first resonance a structure follows its base: an absolute acceleration is then that
of the base itself, H(f) = 1; a relative one is +(f/f₁)² of it; and where a displacement of the base
represents its acceleration, H(f) = −(2πf)².  Slope, sign and size of H decide which.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from data.measured.channels import CLOCKS, numbered, signal_of
from data.measured.delays import delay_findings, transfer_function
from data.measured.files.columns import shorten
from data.measured.floors import from_below
from data.measured.raw_record import Finding, RawRecord
from data.measured.units import DIMENSIONS, to_si

COHERENT = 0.8  # least coherence of base and response
BELOW = 0.6  # of the frequency of the largest amplification: H of a single mode is below 1.6
LINES = 4  # frequencies at least
WIDE = 2.0  # highest over lowest of them
UNITS = {"m/s^2": 1.0, "g": 9.80665, "cm/s^2": 0.01, "mg": 9.80665e-3, "in/s^2": 0.0254}  # of a
LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 1e-3, "in": 0.0254}
# a motion, its rate, the order of this derivative, and the base's rate that it may contain
RATES = (
    *(("x", "a", 2, "s_ddot1"), ("x", "v", 1, "s_dot1"), ("v", "a", 1, "s_ddot1")),
    *(("s", "s_dot", 1, ""), ("s_dot", "s_ddot", 1, "")),
)
NEAR = 0.25  # of a ratio of two units, of which the transfer function well below resonance errs
GIVEN = 0.1  # of the work that an element takes and gives: more is no noise
AGAINST = 0.2  # share of power: masses have a quarter and more, elements by their friction 0.07
PASSIVE = (0.05, 0.1)  # share of negative power where a force acts at most, elsewhere at least
RELATIVE, AT_REST, REVERSED = "relative accelerations", "absolute displacements", "reversed sensor"
UNFIT = "units that do not fit"


@dataclass(frozen=True)
class Transfer:
    """Transfer function from the base well below the first resonance."""

    slope: float  # of log |H| over log f
    gain: float  # median of Re H
    along: float  # share of H that is real, with its sign
    low: float  # [Hz]
    high: float  # [Hz]


def plausibility(
    channels: Mapping[str, np.ndarray], dt: float, accelerations: str = "absolute"
) -> list[Finding]:
    """Contradictions between a support's acceleration s_ddot1 and the accelerations a1, … [SI].

    And between the deformation s1 of an element and its force r1.
    """
    numbers = numbered(channels, "a")
    if "s_ddot1" not in channels:
        element = _of_element(channels) if {"s1", "r1"} <= channels.keys() else []
        return [*element, *unfit_rates(channels, dt)]
    base = channels["s_ddot1"]
    of = {f"a{i}": transfer(base, channels[f"a{i}"], dt) for i in numbers}
    known = {name: h for name, h in of.items() if h is not None}
    rates = [name for name, h in known.items() if 1.3 < h.slope < 3.0 and abs(h.along) > 0.8]
    if known and len(rates) > len(known) / 2:
        found = _of_rates(rates, [known[name] for name in rates], accelerations)
        relative = any(one.what == RELATIVE for one in found)
        accelerations = "relative" if relative else accelerations
    else:
        flat = {name: h for name, h in known.items() if abs(h.slope) < 0.8}
        found = [one for name, h in flat.items() for one in _of_gain(name, h, accelerations)]
        rising = from_below(base, names := {f"a{i}": channels[f"a{i}"] for i in numbers})
        if rising not in ([], [*names]):
            text = f"the motion suggests the order {', '.join(rising)} from the lowest floor up"
            found.append(Finding("order of floors", "", f"{text}; check data.channels"))
        turned = {one.channel for one in found if one.what == REVERSED}
        if accelerations == "absolute":
            rest = {c: u for c, u in channels.items() if c not in turned}
            found = [*delay_findings(rest, dt), *found]
    return [*found, *_of_displacements(channels, dt, accelerations), *unfit_rates(channels, dt)]


def unfit_rates(channels: Mapping[str, np.ndarray], dt: float) -> Iterator[Finding]:
    """Motions [SI] whose derivatives are not the rates beside them, absolute or relative to a base.

    Where two units explain what is between them, only a person knows which of them is wrong. Beside
    a base that moves nothing else is said: harmonic motions against any points have a ratio.
    """
    for motion, rate, order, driving in RATES:
        own, base = numbered(channels, motion), channels.get(driving, np.zeros(0))
        still = not driving or not {"s1", "s_dot1", "s_ddot1"} & channels.keys()
        gains: dict[int, float] = {}
        for i in sorted({*own} & {*numbered(channels, rate)}):
            x, y = channels[f"{motion}{i}"], channels[f"{rate}{i}"]
            rates = [y] if len(base) != len(y) else [y, y - base, y + base]
            sizes = [size for one in rates if (size := _ratio(x, one, dt, order))]
            if sizes and all(abs(math.log(size)) > NEAR for size in sizes):
                gains[i] = sizes[0]
        for i, gain in [*gains.items()][:1]:
            n = "" if len(gains) == len(own) else str(i)  # of the option: all channels, or that one
            seem = _apart(gain, ALIKE, LENGTHS, UNITS) or f"{gain:.3g} times apart" * still
            moved = ", ".join(f"{rate}{k}" for k in gains)
            text = f"their {'second ' * (order == 2)}derivative and {moved} seem {seem}; "
            text += f"check data.units.{motion}{n}, data.units.{rate}{n}, and data.units.time"
            if seem:
                yield Finding(UNFIT, ", ".join(f"{motion}{k}" for k in gains), text, " as " in seem)


def transfer(base: np.ndarray, response: np.ndarray, dt: float) -> Transfer | None:
    """H(f) below the first resonance; None where too little is coherent there."""
    found = transfer_function(base, response, dt, 4096)
    if found is None:
        return None
    f, h, coherence, _ = found
    good = coherence > COHERENT
    if good.sum() < LINES:
        return None
    first = float(f[good][np.abs(h[good]).argmax()])
    lost = f[(coherence <= COHERENT) & (f > f[good][0])]
    hidden = float(lost.min()) if lost.size else math.inf  # a resonance that yields may be there
    steady = good & (f < min(BELOW * first, hidden))
    if steady.sum() < LINES or f[steady].max() < WIDE * f[steady].min():
        return None
    at, size = f[steady], h[steady]
    slope = float(np.polyfit(np.log(at), np.log(np.abs(size)), 1)[0])
    along = float(np.median(size.real / np.abs(size)))
    return Transfer(slope, float(np.median(size.real)), along, float(at.min()), float(at.max()))


def _of_element(channels: Mapping[str, np.ndarray]) -> list[Finding]:
    """A force whose sign is reversed: with it, the element would supply energy.

    Or push along with its deformation, and take up none. One that is let go supplies some, too, but
    its force and its deformation have the same sign.
    """
    s, r = channels["s1"], channels["r1"]
    if len(s) != len(r) or not (np.isfinite(s).all() and np.isfinite(r).all()):
        return []
    work = 0.5 * (r[1:] + r[:-1]) * np.diff(s)
    gain, turned = float(work.sum()), float(np.abs(work).sum())
    along = float(np.mean((r - r.mean()) * (s - s.mean())) / max(r.std() * s.std(), 1e-300))
    against = along < -0.5 and gain < GIVEN * turned
    if against or (along < 0.5 and gain < -GIVEN * turned):
        text = "by its sign the element would supply energy, not take it up"
        return [Finding(REVERSED, "r1", f"{text}; {_turn('r1')}")]
    return []


def _turn(channel: str) -> str:
    signal = channel.rstrip("0123456789")
    return (
        f"data.units.{channel} with a minus, such as -{'kN' if signal == 'r' else 'g'}, reverses it"
    )


def _of_rates(names: list[str], found: list[Transfer], accelerations: str) -> list[Finding]:
    low, high = min(h.low for h in found), max(h.high for h in found)
    where = f"from {low:.2g} to {high:.2g} Hz {names[0]} grows like f² times s_ddot1"
    if all(h.along < 0.0 for h in found):
        text = (
            f"{where}, against it: s_ddot1 looks like a displacement of the base; name it s1, with "
            "its unit"
        )
        return [Finding("displacement for acceleration", "s_ddot1", text)]
    if accelerations == "relative" or not all(h.along > 0.0 for h in found):
        return []
    text = (
        f"{where}, where an absolute acceleration equals it: these look relative to the base; "
        "if so say data.accelerations=relative"
    )
    return [Finding(RELATIVE, ", ".join(names), text)]


def _of_displacements(
    channels: Mapping[str, np.ndarray], dt: float, accelerations: str
) -> list[Finding]:
    """Displacements that move with the base, as seen from a point at rest.

    Their second derivatives are absolute accelerations: those measured beside them, else, well
    below the first resonance, that of the base.
    """
    base, found, alone = channels["s_ddot1"], [], not numbered(channels, "a")
    for i in numbered(channels, "x"):
        x, a = channels[f"x{i}"], channels.get(f"a{i}")
        if a is None and len(x) == len(base):
            h = transfer(base[1:-1], np.diff(x, 2) / dt**2, dt)
            moves = h is not None and abs(h.slope) < 0.8 and h.along > 0.8 and 0.33 < h.gain < 3.0
        elif a is not None:
            absolute, relative = (a, a - base) if accelerations == "absolute" else (a + base, a)
            sizes = (_ratio(x, rate, dt) for rate in (absolute, relative))
            far, near = (math.inf if s is None else abs(math.log(s)) for s in sizes)
            moves = far < min(near, NEAR)
        else:
            moves = False
        found += [f"x{i}"] * moves
    if not found:
        return []
    remedy = "leave them out"
    if alone:
        remedy = "say data.channels.s1=COLUMN, that displacement, in place of s_ddot1"
    text = (
        "their second derivatives are absolute accelerations, not those relative to the base; "
        f"subtract the displacement of the base from them, or {remedy}"
    )
    return [Finding(AT_REST, ", ".join(found), text, blocks=alone)]


def driven_floor(force: np.ndarray, accelerations: Mapping[int, np.ndarray]) -> int | None:
    """Which mass a force (T,) acts on, by the accelerations (T,) of all; None where they agree.

    A structure is passive: where the force acts, velocity over force has a real part that is not
    negative at any frequency. Elsewhere it is, in each mode that moves against that place.
    """
    shares = {}
    for number, a in accelerations.items():
        found = transfer_function(force, a, 1.0, 1024)
        if found is None:
            return None
        _, h, coherence, _ = found
        real = (h.imag * coherence)[coherence > 0.5]
        shares[number] = -real.clip(max=0.0).sum() / np.abs(real).sum() if real.size else 1.0
    first, second = sorted(shares, key=shares.__getitem__)[:2]
    return first if shares[first] < PASSIVE[0] and shares[second] > PASSIVE[1] else None


def has_mass(displacement: np.ndarray, force: np.ndarray) -> bool:
    """Whether a force (T,) moves a mass: it is against the displacement (T,) beyond a resonance.

    That of an element is along or supplies energy; with a reversed sensor it is against or takes.
    """
    found = transfer_function(displacement, force, 1.0, 1024)
    if found is None:
        return False
    _, h, coherence, power = found
    both = (h * power)[coherence > 0.5]
    size = float(np.abs(both).sum())
    along, against = float(both.real.clip(min=0.0).sum()), -float(both.real.clip(max=0.0).sum())
    return along + float(both.imag.sum()) > PASSIVE[0] * size and against > AGAINST * size


def _of_gain(name: str, h: Transfer, accelerations: str) -> list[Finding]:
    where = f"from {h.low:.2g} to {h.high:.2g} Hz {name} is {h.gain:.3g} times s_ddot1"
    if accelerations == "relative":
        if 0.6 < h.gain < 1.7:
            text = f"{where}, as an absolute acceleration is; say data.accelerations=absolute"
            return [Finding("absolute accelerations", name, text)]
        return []
    if h.along < -0.8 and 0.5 < -h.gain < 2.0:
        text = f"{where}, where both should move alike: one of the sensors points the other way"
        return [Finding(REVERSED, name, f"{text}; {_turn(name)}")]
    if h.along > 0.8 and not 0.33 < h.gain < 3.0:
        seem = _apart(h.gain, NEAR, UNITS)
        text = f"{where}, where both should move alike; {seem and f'their units seem {seem}; '}"
        text += f"check data.units.{name} and data.units.s_ddot"
        return [Finding(UNFIT, name, text, blocks=bool(seem))]
    return []


def _apart(gain: float, near: float, *units: Mapping[str, float]) -> str:
    """Units of one kind by whose ratio, but for `near`, a signal is `gain` times too large; ""."""
    pairs = {(a, b): of[b] / of[a] for of in units for a in of for b in of if a != b}
    far = {pair: abs(float(np.log(gain / ratio))) for pair, ratio in pairs.items()}
    fitting = sorted((pair for pair in pairs if far[pair] <= near), key=lambda pair: far[pair])
    return ", or ".join(
        f"{max(pairs[pair], 1.0 / pairs[pair]):.4g} times apart, as {pair[0]} and {pair[1]} are"
        for pair in fitting
    )


# Units that nobody said: what else a record tells of them.   T samples.

USUAL = {  # SI units, units in use, and the peaks that structures have [SI]
    "s": (("s", "ms", "us"), (5e-4, 0.5)),  # of a clock's steps
    "m/s^2": (("m/s^2", "g", "gal", "mm/s^2", "mg", "in/s^2"), (0.02, 60.0)),
    "m/s": (("m/s", "mm/s", "cm/s", "in/s"), (1e-4, 10.0)),
    "m": (("mm", "m", "cm", "in"), (1e-5, 1.0)),
    "N": (("kN", "N", "kip", "lbf"), (1.0, 1e7)),
    "m/m": (("microstrain", "mm/m", "m/m"), (1e-6, 0.1)),
}


ALIKE = 0.03  # of a unit, by which what a displacement tells may err
STEADY = 0.1  # of the ratio of an acceleration to a displacement, by which it may vary
LOW = 0.05  # of the sampling rate: below it differences are derivatives to 1 %


def unit_findings(raw: RawRecord) -> list[Finding]:
    """Questions for the units of channels, and of the clock, that nobody said."""
    findings, _ = questions_of_units(raw)
    column, dt = raw.unsaid.get("time"), _step(raw)
    if column is not None and (raw.clocks or raw.time is not None) and dt > 0.0:
        low, high = (1e-6, 1.0 - 1e-9) if column in CLOCKS else USUAL["s"][1]
        if not low <= dt <= high:
            findings.append(_question(["time"], [column], "time", _fitting("time", dt)))
    return findings


def _step(raw: RawRecord) -> float:
    clock = next(iter(raw.clocks.values()), raw.time)
    steps = np.diff([] if clock is None else clock)
    known = steps[np.isfinite(steps)]
    return float(np.median(known)) if known.size else raw.dt or 0.0


def questions_of_units(raw: RawRecord) -> tuple[list[Finding], dict[str, str]]:
    """Questions for units, one for each signal, and units to propose, as in {"a": "g|m/s^2"}.

    A displacement in a known unit tells that of accelerations beside it.
    """
    findings, likely = [], {}
    told, how = _beside_displacement(raw)
    unsaid = {name: column for name, column in raw.unsaid.items() if name in raw.channels}
    for signal in dict.fromkeys(map(signal_of, unsaid)):
        names = [name for name in unsaid if signal_of(name) == signal]
        finite = [np.abs(raw.channels[c][np.isfinite(raw.channels[c])]) for c in names]
        fitting = _fitting(signal, max(float(size.max(initial=0.0)) for size in finite))
        of_rate = told and DIMENSIONS[signal][1] == "m/s^2"
        fitting, why = ([told], how) if of_rate else (fitting, "")
        findings.append(_question(names, [unsaid[name] for name in names], signal, fitting, why))
        units = fitting if why or len(fitting) > 1 else USUAL[DIMENSIONS[signal][1]][0]
        likely[signal] = "|".join(units)  # a size alone, such as that of counts, settles no unit
    return findings, likely


def _question(
    names: Sequence[str], columns: Sequence[str], signal: str, fitting: Sequence[str], why: str = ""
) -> Finding:
    si = DIMENSIONS[signal][1]
    more = f" and {len(columns) - 3} more" if len(columns) > 3 else ""
    text = f"no unit is understood in {', '.join(map(shorten, columns[:3]))}{more}"
    first = [unit for unit in fitting if unit != si] or USUAL[si][0]
    size = f"; by its size it may be {', '.join(fitting)}" if fitting else ""
    text += f"; {why}: say data.units.{signal}={fitting[0]}" if why else size
    if not why:
        text += f": say data.units.{signal}={first[0]}, or what it is; {si} is taken only with "
        text += f"data.units.{signal}={si}"
    return Finding("no unit", ", ".join(names[:6]), text, True)


def _fitting(signal: str, peak: float) -> list[str]:
    """Usual units in which a peak, or the step of a clock, has a size that structures have."""
    units, (low, high) = USUAL[DIMENSIONS[signal][1]]
    return [unit for unit in units if low <= peak * to_si(unit, signal) <= high]


def _beside_displacement(raw: RawRecord) -> tuple[str, str]:
    """The unit of accelerations by a displacement beside them, and how it tells; "" without."""
    known = [c for c in raw.channels if signal_of(c) in ("x", "s") and c not in raw.unsaid]
    rates = [c for c in raw.unsaid if signal_of(c) in ("a", "s_ddot") and c in raw.channels]
    for name, other in product(rates, known if _step(raw) > 0.0 else ()):
        size = _ratio(raw.channels[other], raw.channels[name], _step(raw))
        far = {u: abs(size / to_si(u, "a") - 1.0) for u in USUAL["m/s^2"][0]} if size else {}
        unit = min(far, key=lambda u: far[u], default="")
        if unit and far[unit] < ALIKE:
            return unit, f"as the second derivative of {other!r}, {raw.unsaid[name]!r} is in {unit}"
    return "", ""


def _ratio(
    displacement: np.ndarray, acceleration: np.ndarray, dt: float, order: int = 2
) -> float | None:
    """SI units in one unit of an acceleration (T,) that is a displacement's [m]; None for others.

    Differences of second order stand for the derivative, and their gain is taken out: a drift of
    the displacement then leaks nowhere. order: 1 for a velocity in place of the acceleration.
    """
    if len(displacement) != len(acceleration):
        return None
    curve = np.diff(displacement, 2) / dt**2
    if order == 1:
        curve = (displacement[2:] - displacement[:-2]) / (2.0 * dt)
    found = transfer_function(curve, acceleration[1:-1], dt, 1024)
    if found is None:
        return None
    f, h, coherence, _ = found
    good = (coherence > 0.95) & (f < LOW / dt)
    if good.sum() < LINES:
        return None
    ratio = (np.sign(h.real) * np.abs(h) * np.sinc(2.0 * f * dt / order) ** order)[good]
    middle = float(np.median(ratio))
    if not middle > 0.0 or float(np.median(np.abs(ratio / middle - 1.0))) > STEADY:
        return None
    return 1.0 / middle
