"""Records of structures and elements with known answers, as files that somebody has.

Chains of 1 to 5 masses of 1 kg to 1,000 t, periods of 0.1 to 5 s, with every law of the list, under
forces or on a moving base; one element in a testing machine. Text files with names and units, one
event or four of them. Noise is white, in percent of each response; excitations have none.
T samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path

import numpy as np

from data import (
    BaberNoori,
    Bilinear,
    BoucWen,
    FrictionPendulum,
    Hysteretic,
    LimitedSlip,
    Maxwell,
    MenegottoPinto,
    Pinching4,
    Polynomial,
    PowerDamper,
    SelfCentering,
    SlackBrace,
    Structure,
    Takeda,
    TanhDamper,
)  # fmt: skip
from data.measured.units import to_si
from data.simulation import element_test
from data.simulation.laws.element import Element
from data.simulation.motion import simulate

SAMPLES, DAMPING = 4000, 0.02  # of all events together; share of critical, first mode
RATES = [n * 10.0**p for p in range(5) for n in (1.0, 2.0, 2.5, 5.0)]  # Hz, that people choose
Event = dict[str, np.ndarray]  # channels (T,) in SI


def laws(b: Sequence[str], k: float, y: float, v: float) -> dict[str, list[Element]]:
    """Elements in parallel: initial stiffness k [N/m], bent at y [m], passed at v [m/s]."""
    e, hard = k * y * y, {"stiffness": k, "hardening_ratio": 0.05}

    def spring(share: float) -> Element:
        return Polynomial(between=b, stiffness=share * k)

    return {
        "linear": [spring(1.0)],
        "bilinear": [Bilinear(between=b, yield_displacement=y, stiffness=k,
                              post_yield_stiffness=0.15 * k)],
        "steel": [MenegottoPinto(between=b, yield_displacement=y, a1=0.02, a3=0.02, **hard)],
        "flag": [SelfCentering(between=b, activation_displacement=y, flag=0.7, **hard)],
        "concrete": [Takeda(between=b, yield_displacement=y, **hard)],
        "joint": [Hysteretic(between=b, stiffness=k, yield_displacement=y, displacement_2=3.0 * y,
                             displacement_3=8.0 * y, strength_2=1.5, strength_3=1.7,
                             reloading_place=0.7, reloading_force=0.4)],
        "hardening": [Polynomial(between=b, stiffness=k, cubic_stiffness=0.2 * k / y**2)],
        "wall": [Pinching4(between=b, stiffness=k, yield_displacement=y, displacement_2=2.0 * y,
                           displacement_3=5.0 * y, displacement_4=9.0 * y, strength_2=1.5,
                           strength_3=1.9, strength_4=1.6, unloading_force=-0.1,
                           reloading_place=0.4, reloading_force=0.3)],
        "Bouc-Wen": [BoucWen(between=b, stiffness=0.85 * k, beta=0.6 / y, gamma=0.4 / y),
                     spring(0.15)],
        "timber": [BaberNoori(between=b, stiffness=k, post_yield_ratio=0.1, beta=0.6 / y,
                              gamma=0.4 / y, eta_rate=2e-3 / e, nu_rate=1e-3 / e, pinching=0.7,
                              pinching_rate=0.05 / e, pinching_place=0.1, pinching_width=0.5 * y,
                              pinching_lambda=0.3)],
        "limited slip": [LimitedSlip(between=b, yield_displacement=y, stiffness=0.7 * k,
                                     gap_stiffness=0.7 * k, gap=2.0 * y), spring(0.3)],
        "slack brace": [SlackBrace(between=b, stiffness=0.6 * k, yield_displacement=y,
                                   hardening_ratio=0.05, gap=0.3 * y), spring(0.4)],
        "pendulum": [FrictionPendulum(between=b, weight=k * y, radius=y / 0.15, friction_fast=0.4,
                                      friction_slow=0.2, rate=1.0 / v, yield_displacement=0.2 * y)],
        "fluid damper": [PowerDamper(between=b, damping=0.3 * k * y / v**0.4, exponent=0.4,
                                     linear_below=0.02 * v), spring(1.0)],
        "damper on a brace": [Maxwell(between=b, stiffness=k, damping=0.3 * k * y / v**0.5,
                                      exponent=0.5), spring(0.7)],
        "relief valve": [TanhDamper(between=b, force=0.3 * k * y, saturation_rate=0.2 * v),
                         spring(1.0)],
    }  # fmt: skip


LAWS = tuple(laws(("ground", "x1"), 1.0, 1.0, 1.0))
BENT, STRAIGHT, RATE_FREE = LAWS[1:], LAWS[1:7], LAWS[1:13]  # STRAIGHT: linear far below y


@dataclass(frozen=True)
class Kind:
    """How records of a kind are made."""

    share: int  # of 42
    laws: Sequence[str] = BENT
    noise: Sequence[float] = (0.0, 1.0, 2.0)  # percent
    reach: tuple[float, float] = (2.5, 6.0)  # largest deformation, in y
    dofs: Sequence[int] = (1, 1, 2, 2, 3, 3, 4, 5)
    events: Sequence[int] = (1, 4)
    drives: Sequence[str] = ("all", "one", "base", "base")  # forces on all masses, on one
    measured: Sequence[str] = ("a", "a", "xa", "xva")


TESTS = CLOCK, NO_CLOCK = "element test", "element test, no clock"
SURE, LOUD, LOUDER = "planted, 0 to 2 % noise", "planted, 5 and 10 %", "planted, 20 and 50 %"
WHITE, OTHER = "white noise", "other noise"
ELSEWHERE, EARLIER = "another structure", "another event"
SENSOR, SWAPPED, SWAPPED_ONCE = "wrong sensor", "floors swapped", "swapped in one event"
MASSES, UNDRIVEN, AMBIENT = "wrong masses", "no excitation", "ambient only"
LINEAR, SMALL = "linear structure", "never yields"
KINDS = {
    SURE: Kind(10),
    LOUD: Kind(4, noise=(5.0, 10.0)),
    LOUDER: Kind(3, noise=(20.0, 50.0)),
    LINEAR: Kind(3, ("linear",), (0.0, 2.0, 10.0)),
    SMALL: Kind(2, STRAIGHT, reach=(0.1, 0.3)),
    CLOCK: Kind(3, noise=(0.0, 1.0, 2.0, 5.0)),
    NO_CLOCK: Kind(2, RATE_FREE),
    WHITE: Kind(2),
    OTHER: Kind(2),
    ELSEWHERE: Kind(2),
    EARLIER: Kind(1),
    SENSOR: Kind(2, dofs=(2, 3), measured=("a",)),
    SWAPPED: Kind(1, dofs=(2, 3, 4)),
    SWAPPED_ONCE: Kind(1, dofs=(2, 3), events=(2,)),
    MASSES: Kind(2, dofs=(2, 3)),
    UNDRIVEN: Kind(1),
    AMBIENT: Kind(1),
}
UNITS = {
    "time": ("s", "s", "ms"), "f": ("N", "kN"), "x": ("m", "mm", "cm"), "v": ("m/s", "mm/s"),
    "a": ("m/s^2", "g", "cm/s^2"),
}  # fmt: skip
NAMES = {
    "time": ("Time", "Zeit"), "f": ("Force", "Load"), "x": ("Displacement", "Disp"),
    "v": ("Velocity", "Vel"), "a": ("Acceleration", "Acc"), "s_ddot": ("Ground acc", "Base acc"),
}  # fmt: skip


@dataclass
class Case:
    """What was made."""

    kind: str
    law: str
    number: int
    noise: float  # percent
    dofs: int
    drive: str
    files: int
    measured: str  # of each DOF
    words: list[str] = field(default_factory=list)
    spoilt: str = ""  # a channel


def harmonic(rng: np.random.Generator, band: Sequence[float], t: np.ndarray) -> np.ndarray:
    """A Gaussian process (T,) of a band [Hz], of standard deviation one, eased in and out."""
    frequency = np.fft.rfftfreq(2 * t.size, t[1])
    inside = (frequency >= band[0]) & (frequency <= band[1])
    noise = np.where(inside, rng.standard_normal((2, frequency.size)), 0.0)
    wave = np.fft.irfft(noise[0] + 1j * noise[1])[: t.size]
    ease = np.clip(np.minimum(t, t[-1] - t) * band[1] / 2.0, 0.0, 1.0)
    return ease * wave / wave.std()


class Plant:
    """A chain of storeys drawn at random, and its motions."""

    def __init__(self, rng: np.random.Generator, case: Case, period: float) -> None:
        n, self.case = case.dofs, case
        self.masses = 10.0 ** rng.uniform(0.0, 6.0) * rng.uniform(0.7, 1.3, n)
        self.omega, half = 2.0 * np.pi / period, np.pi / (2.0 * (2 * n + 1))
        k = float(self.masses.mean()) * (self.omega / (2.0 * np.sin(half))) ** 2
        self.y = rng.uniform(0.5, 5.0) / self.omega**2 / max(1.0, period)  # [m]
        modes = np.sin((2 * np.arange(1, n + 1) - 1) * half) / np.sin(half) / period  # Hz
        self.band = (0.2 / period, 1.3 * float(modes[min(n, 3) - 1]))
        needed = max(20.0 * self.band[1], 4.0 * float(modes[-1]))
        self.dt = 1.0 / min(rate for rate in RATES if rate >= needed)
        first_only = n > 1 and rng.random() < 0.5
        elements: dict[str, Element] = {}
        for i in range(n):
            between = ("ground" if i == 0 else f"x{i}", f"x{i + 1}")
            stiffness = k * rng.uniform(0.85, 1.15)
            law = "linear" if i and first_only else case.law
            damping = 2.0 * DAMPING * stiffness / self.omega
            own = laws(between, stiffness, self.y, self.omega * self.y)[law]
            own.append(Polynomial(between=between, stiffness=0.0, damping=damping))
            elements |= {f"r{i + 1}_{j}": one for j, one in enumerate(own)}
        self.structure = Structure(list(self.masses), elements)
        self.driven = list(range(n)) if case.drive == "all" else [int(rng.integers(n))]

    def motion(self, rng: np.random.Generator, t: np.ndarray, size: float) -> Event:
        """Channels (T,) in SI; size: of the excitation [m/s²]."""
        force, ground = np.zeros((t.size, self.case.dofs)), np.zeros(t.size)
        if self.case.drive == "base":
            ground = size * harmonic(rng, self.band, t)
            force -= ground[:, None] * self.masses
            found = {"time": t, "s_ddot1": ground}
        else:
            for i in self.driven:
                force[:, i] = size * self.masses.mean() * harmonic(rng, self.band, t)
            found = {"time": t} | {f"f{i + 1}": force[:, i] for i in self.driven}
        motion = simulate(self.structure, force, float(t[1]))
        assert motion.escape_time is None
        self.reached = float(np.abs(motion.y).max()) / self.y
        for signal, values in (("x", motion.x), ("v", motion.v), ("a", motion.a + ground[:, None])):
            if signal in self.case.measured:
                found |= {f"{signal}{i + 1}": values[:, i] for i in range(self.case.dofs)}
        return found

    def size(self, rng: np.random.Generator, t: np.ndarray, reach: float) -> float:
        """The excitation [m/s²] under which the largest deformation is so many times y."""
        size, seed = self.y * self.omega**2, int(rng.integers(2**31))
        for _ in range(12):
            self.motion(np.random.default_rng(seed), t, size)
            size *= float(np.clip(reach / self.reached, 0.2, 3.0)) ** 0.7
        return size


def events_of(case: Case, rng: np.random.Generator) -> list[Event]:
    """What was measured in each event; at last one without noise that nobody is given."""
    kind, period = KINDS[case.kind], float(10.0 ** rng.uniform(-1.0, np.log10(5.0)))
    if case.kind in TESTS:
        return element_tests(case, rng, period)
    plant = Plant(rng, case, period)
    t = plant.dt * np.arange(SAMPLES // case.files)
    size = plant.size(rng, t, rng.uniform(*kind.reach))
    sizes = [*([1.0] if case.files == 1 else rng.uniform(0.6, 1.0, case.files)), 0.85]
    events = [plant.motion(rng, t, size * share) for share in sizes]
    away = case.kind == ELSEWHERE
    donor = Plant(rng, case, period * rng.uniform(0.6, 1.7)) if away else plant
    for i, event in enumerate(events):
        if i < case.files:
            spoil(case, rng, event, donor.motion(rng, t, size), i == case.files - 1)
        elif case.kind == SWAPPED:
            swap(event)
    if case.kind == MASSES:
        wrong = plant.masses * np.where(np.arange(case.dofs) % 2 == 0, 4.0, 0.3)
        case.words = [f"model.masses=[{','.join(f'{mass:.4g}' for mass in wrong)}]"]
    return events


def swap(event: Event) -> None:
    for signal in "xva":
        if f"{signal}1" in event:
            event[f"{signal}1"], event[f"{signal}2"] = event[f"{signal}2"], event[f"{signal}1"]


def spoil(case: Case, rng: np.random.Generator, event: Event, other: Event, last: bool) -> None:
    """Spoil an event as its kind says, and add the noise; other: of a motion beside."""
    t, drives = event["time"], [c for c in event if c[0] in "fs"]
    responses = [c for c in event if c[0] in "xva"]
    std = {c: float(event[c].std()) for c in event}
    band = (0.004 / t[1], 0.05 / t[1])
    if case.kind == WHITE:
        event |= {c: std[c] * rng.standard_normal(t.size) for c in responses}
    elif case.kind == OTHER:
        event |= {c: std[c] * harmonic(rng, band, t) for c in responses}
    elif case.kind in (ELSEWHERE, EARLIER):
        event |= {c: std[c] / other[c].std() * other[c] for c in responses}
    elif case.kind == SENSOR:
        case.spoilt = case.spoilt or str(rng.choice(responses))
        event[case.spoilt] = std[case.spoilt] * harmonic(rng, band, t)
    elif case.kind == SWAPPED or (case.kind == SWAPPED_ONCE and last):
        swap(event)
    elif case.kind == UNDRIVEN:
        for c in drives:
            del event[c]
    elif case.kind == AMBIENT:
        event |= {c: 0.01 * std[c] * rng.standard_normal(t.size) for c in drives}
    for c in responses:
        event[c] = event[c] + 0.01 * case.noise * std[c] * rng.standard_normal(t.size)


def element_tests(case: Case, rng: np.random.Generator, period: float) -> list[Event]:
    """One element under cycles that grow, or an irregular motion; and under another."""
    dt = 1.0 / min(rate for rate in RATES if rate >= 50.0 / period)
    k, y = 10.0 ** rng.uniform(3.0, 8.0), 10.0 ** rng.uniform(-3.0, -1.0)
    element = laws(("ground", "x1"), k, y, 2.0 * np.pi * y / period)[case.law]
    reach, events = y * rng.uniform(*KINDS[case.kind].reach), []
    t, case.files = dt * np.arange(SAMPLES // 2), 1
    cycles = case.kind == NO_CLOCK or rng.random() < 0.5
    for size in (reach, 0.85 * reach):
        s = size * harmonic(rng, (0.1 / period, 1.0 / period), t) / 3.0
        if cycles:  # of every amplitude two
            turns = t / period
            steps = np.ceil((np.floor(turns) + 1.0) / 2.0)
            s = size * steps / steps[-1] * np.sin(2.0 * np.pi * turns)
        r = sum(element_test.force(one, s, dt) for one in element)
        events.append({"time": t, "s1": s, "r1": r})
    if case.kind == NO_CLOCK:
        for event in events:
            del event["time"]
    force = events[0]["r1"]
    events[0]["r1"] = force + 0.01 * case.noise * force.std() * rng.standard_normal(t.size)
    return events


# Files


def write(path: Path, event: Event, style: int, units: Mapping[str, str]) -> None:
    """A table with names as people write them: 0 as channels are called, 1 and 2 with units."""
    of_element, columns = "r1" in event, {}
    for channel, values in event.items():
        signal, number = channel.rstrip("0123456789"), channel.lstrip("abcdefghijklmnopqrstuvwxyz_")
        kind = {"s": "x", "s_ddot": "a", "r": "f"}.get(signal, signal)
        unit = units[kind]
        name = NAMES["s_ddot" if signal == "s_ddot" else kind][style - 1]
        name += "" if of_element or signal in ("time", "s_ddot") else f" {number}"
        bracketed = f"{name} [{unit}]" if style == 1 else f"{name} ({unit})"
        factor = to_si(unit, kind) if style else 1.0
        columns[bracketed if style else channel] = values / factor
    rows = np.column_stack(list(columns.values()))
    path.parent.mkdir(parents=True, exist_ok=True)
    sign = ";" if style == 2 else ","
    text = StringIO()
    np.savetxt(text, rows, fmt="%.7g", delimiter=sign, header=sign.join(columns), comments="")
    path.write_text(text.getvalue().replace(".", ",") if style == 2 else text.getvalue())


def make(folder: Path, seed: int, i: int) -> Case:
    """Case i of a seed: its files in the folder `records`, the fresh event beside them."""
    table = [name for name, kind in KINDS.items() for _ in range(kind.share)]
    order = np.random.default_rng(0).permutation(len(table))  # a few cases are of many kinds
    turn, place = divmod(i, len(table))
    name = table[order[place]]
    kind, test = KINDS[name], name in TESTS
    one = turn * kind.share + sum(table[j] == name for j in order[:place])  # of its kind
    law = kind.laws[(one + list(KINDS).index(name) + 7 * seed) % len(kind.laws)]
    rng = np.random.default_rng([seed, i])
    case = Case(
        kind=name, law=law, number=i, noise=kind.noise[(one + turn) % len(kind.noise)],
        dofs=1 if test else int(rng.choice(kind.dofs)), files=int(rng.choice(kind.events)),
        drive="element" if test else str(rng.choice(kind.drives)),
        measured="sr" if test else str(rng.choice(kind.measured)),
    )  # fmt: skip
    style, units = int(rng.integers(3)), {s: str(rng.choice(u)) for s, u in UNITS.items()}
    events = events_of(case, rng)
    for number, event in enumerate(events[:-1], 1):
        write(folder / "records" / f"event_{number}.csv", event, style, units)
    write(folder / "fresh.csv", events[-1], style, units)
    return case
