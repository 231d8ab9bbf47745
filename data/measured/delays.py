"""Sensors that come later than that of the base: how late, by the phase below the first mode.

There a structure moves with its base. In H = 1 + ω² (K + iωC − ω²M)⁻¹ M ι, of an absolute a,
friction turns the phase by a term of f² and dashpots by one of f³; a term of f is a delay τ:
−arg H = 2πfτ + |H| (b₂ f² + b₃ f³).   T samples.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from data.measured.channels import numbered, signal_of
from data.measured.raw_record import Finding, RawRecord

SHORTEST = 512  # samples
FAINT = 1e-5  # of the base's largest power density: below it there is noise
PARTS = 8  # of a record, by whose scatter the coherence is known; each shares a half with the next
COHERENT = 0.95  # least coherence: a structure that yields has less
NEAR_ONE = 1.6  # gain that a single mode has at 0.6 of its frequency: beyond, it is a resonance
LINES = 6  # frequencies at least, for three unknowns
ALIKE = 35 / 18  # of neighbouring lines: 1 + 2 (2/3)² + 2 (1/6)² of Hann's window see the same
SURE = 5.0  # standard errors: one of 600 structures of `benchmarks.delays` without one had more


@dataclass(frozen=True)
class Delay:
    """How much later than the base's an acceleration comes, and the standard error of it."""

    seconds: float
    error: float  # [s]
    least: float = 0.0  # [s], half a sample: less is no matter of a clock
    low: float = 0.0  # [Hz]
    high: float = 0.0  # [Hz]

    @property
    def sure(self) -> bool:
        return abs(self.seconds) > max(SURE * self.error, self.least)


def transfer_function(
    u: np.ndarray, y: np.ndarray, dt: float, longest: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None:
    """f [Hz], H(f) from u to y (T,), their coherence and the power of u, where u has some.

    Averaged over parts of `longest` samples at most. None for signals of unequal length, of fewer
    than SHORTEST samples, and with samples that are not finite.
    """
    from scipy.signal import csd, welch  # slow to import

    finite = np.isfinite(u).all() and np.isfinite(y).all()
    if not finite or not SHORTEST <= len(u) == len(y):
        return None
    rate: dict[str, float | int] = {"fs": 1.0 / dt, "nperseg": min(len(u) // 4, longest)}
    f, s_uu = welch(u, **rate)
    s_yy, s_uy = welch(y, **rate)[1], csd(u, y, **rate)[1]
    driven = (s_uu > FAINT * s_uu.max()) & (f > 1.5 * f[1])  # below is noise, and what drifts
    with np.errstate(divide="ignore", invalid="ignore"):
        h, coherence = s_uy / s_uu, np.abs(s_uy) ** 2 / (s_uu * s_yy)
    return f[driven], h[driven], coherence[driven], s_uu[driven]


def delay_of(base: np.ndarray, response: np.ndarray, dt: float) -> Delay | None:
    """The delay of an absolute acceleration (T,); None where too little moves with the base.

    What a structure may turn the phase by is a radian at the end of the band, either way.
    """
    found = transfer_function(base, response, dt, 2 * len(base) // (PARTS + 1))
    if found is None or len(found[0]) < LINES:  # no frequency, where the base stands still
        return None
    f, h, coherence = *found[:2], np.minimum(found[2], 1.0 - 1e-9)
    with np.errstate(divide="ignore"):
        size = np.log(np.abs(h)) / math.log(NEAR_ONE)
    resonance = (size > 1.0) & (coherence > 0.5)  # more of the response is the base's than not
    alike = (coherence > COHERENT) & (size > -1.0) & ~np.logical_or.accumulate(resonance)
    several = np.convolve(alike, np.ones(LINES), "valid") > LINES - 0.5
    if not several.any():
        return None
    first = int(several.argmax())
    band = slice(first, first + int(np.append(alike[first:], False).argmin()))
    f, h, coherence = f[band], h[band], coherence[band]
    turn = [np.abs(h) * (f / f[-1]) ** power for power in (2, 3)]
    terms, phase = np.stack([2.0 * np.pi * f, *turn], axis=1), -np.unwrap(np.angle(h))
    weight = 2.0 * PARTS * coherence / (1.0 - coherence)  # 1/rad²
    scatter, unknown = 1.0, np.diag([0.0, 1.0, 1.0])
    for _ in range(2):
        table = terms.T @ (terms * weight[:, None]) / scatter + unknown
        solved = np.linalg.solve(table, terms.T @ (weight * phase) / scatter)
        left = float(weight @ (phase - terms @ solved) ** 2)
        scatter = max(1.0, left / max(len(f) - ALIKE * len(solved), 1.0))
    error = math.sqrt(ALIKE * np.linalg.inv(table)[0, 0])
    return Delay(float(solved[0]), error, 0.5 * dt, float(f[0]), float(f[-1]))


def delays(records: Iterable[tuple[float, Mapping[str, np.ndarray]]]) -> dict[str, Delay]:
    """Delays of absolute accelerations against s_ddot1 by records, each a dt [s] and channels (T,).

    One delay of all floors, such as their logger has, or one of each; what fits better by Akaike's
    criterion. Empty where nothing tells.
    """
    found: dict[str, list[Delay]] = {}
    for dt, channels in records:
        for name in (f"a{i}" for i in numbered(channels, "a") if "s_ddot1" in channels):
            one = delay_of(channels["s_ddot1"], channels[name], dt)
            found.setdefault(name, []).extend([one] if one else [])
    each = {name: _mean(several) for name, several in found.items() if several}
    if not each:
        return {}
    common = _mean(list(each.values()), alike=True)
    apart = [one for one in each.values() if one.sure]
    as_one = sum(((d.seconds - common.seconds) / d.error) ** 2 for d in each.values()) + 2.0
    unsure = (one for one in each.values() if not one.sure)
    as_many = sum((d.seconds / d.error) ** 2 for d in unsure) + 2.0 * len(apart)
    return dict.fromkeys(found, common) if apart and as_one < as_many else each


def _mean(several: list[Delay], alike: bool = False) -> Delay:
    """Mean by the inverse squares of errors; alike: of floors, whose errors are the base's."""
    weights = np.array([one.error**-2 for one in several])
    seconds = float(weights @ [one.seconds for one in several] / weights.sum())
    error = min(one.error for one in several) if alike else float(weights.sum() ** -0.5)
    low, high = min(one.low for one in several), max(one.high for one in several)
    return Delay(seconds, error, max(one.least for one in several), low, high)


def delay_findings(channels: Mapping[str, np.ndarray], dt: float) -> list[Finding]:
    """One finding for each delay of a floor, or of all floors, with its remedy."""
    found, findings = delays([(dt, channels)]), []
    for delay in dict.fromkeys(d for d in found.values() if d.sure):
        names = [name for name, of in found.items() if of == delay]
        key = names[0] if len(names) < len(numbered(channels, "a")) else "a"
        text = (
            f"{_words(delay)} from {delay.low:.2g} to {delay.high:.2g} Hz, where a structure moves "
            f"with its base; data.delay.{key}={_used(delay):g} removes it, data.delay=estimate "
            "removes what the training records show"
        )
        findings.append(Finding("delay", ", ".join(names), text))
    return findings


def _words(delay: Delay) -> str:
    size, side = 1e3 * abs(delay.seconds), "after" if delay.seconds > 0.0 else "before"
    return f"{size:.3g} ms (± {2e3 * delay.error:.2g}, 95 %) {side} s_ddot1"


def _used(delay: Delay) -> float:
    """Seconds as they are printed and taken out; 0 where no delay is sure."""
    return float(f"{delay.seconds:.3g}") if delay.sure else 0.0


def settle_delays(
    asked: Mapping[str, float | str],
    training: Sequence[RawRecord],
    mend: Callable[[RawRecord], tuple[float, Mapping[str, np.ndarray], list[str]]],
    accelerations: str,
) -> tuple[dict[str, float], list[str]]:
    """Delays [s] by channel or signal, and what was found for those that are "estimate".

    Raises ValueError for keys that fit no channel, and for channels without a base to compare with.
    """
    channels = list(training[0].channels)
    for key, seconds in asked.items():
        if key not in channels and key not in map(signal_of, channels):
            raise ValueError(
                f"data.delay.{key} fits no signal or channel of {training[0].name}, which holds "
                f"{', '.join(channels)}"
            )
        if not isinstance(seconds, str) and not math.isfinite(seconds):
            raise ValueError(f"data.delay.{key}={seconds} must be a time in seconds, or estimate")
    said = {c: asked.get(c, asked.get(signal_of(c), 0.0)) for c in channels}
    wanted = [channel for channel, seconds in said.items() if seconds == "estimate"]
    alone = "s_ddot1" not in channels or accelerations == "relative"
    if wanted and (alone or any(signal_of(c) != "a" for c in wanted)):
        raise ValueError(
            "data.delay: estimate is of absolute accelerations a1, … beside that of their base, "
            f"s_ddot1, and there are {', '.join(channels)}; say seconds, as in "
            f"data.delay.{wanted[0]}=0.019"
        )
    found = delays(mend(raw)[:2] for raw in training if wanted)
    told: dict[str, list[str]] = {}
    for channel in wanted:
        delay = found.get(channel)
        said[channel] = 0.0 if delay is None else _used(delay)
        words = (
            "no estimate: too little is coherent with s_ddot1" if delay is None else _words(delay)
        )
        words += "" if said[channel] else ", not significant: not removed"
        told.setdefault(words, []).append(channel)
    notes = [f"{', '.join(names)} {words}" for words, names in told.items()]
    return {c: float(seconds) for c, seconds in said.items()}, notes
