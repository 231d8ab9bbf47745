"""How far a model was moved in training, and where a new motion leaves that range.

What a law does beyond the deformations it was fitted to, nobody measured. Deformations and rates of
elements are those of the model's own free run; all others are measured.

Peaks do not show another frequency content: an excitation no larger than those of training may be
much stronger in a mode that these hardly moved. Therefore its response spectrum S(T) is compared
with the largest in training S₀(T), where the motion has its power: P(T) is the share of a period.
As errors are, the ratio is averaged as a root mean square, and its limit is that of peaks:

Σ P (S/S₀)² > BEYOND²

T samples, E elements, K periods, c channels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from data.record import QUANTITIES, Drive, Record, dof_numbers
from data.sample import Sensors
from models.composition.composite import Composite
from models.estimator import Estimator
from models.fit.response_spectrum import periods_of, power_by_period, spectral_peaks
from models.stored.schema import OTHER, SPECTRUM

BEYOND = 1.05  # times the largest of training: what is called outside
Range = dict[str, dict[str, Any]]


@torch.no_grad()
def range_of(
    estimator: Estimator, records: Iterable[Record], sensors: Sensors | None = None
) -> Range:
    """{kind: {"unit": …, "names": […], "largest": […]}} of all that moves, over records.

    Kinds: excitation, what is estimated, displacement and velocity where they are measured, and
    deformation and rate of each element of a composite model. A run that diverges has none. Other
    inputs, such as a temperature, are no motion about zero: their least is kept, too ("lowest").
    The spectrum of the excitation has a list for each period. sensors: tell the DOFs and the unit
    of an excitation.
    """
    ends: dict[str, list[Tensor]] = {}
    motions: list[tuple[np.ndarray, np.ndarray]] = []
    for record in records:
        motions += _motions_of(record)
        for kind, signal in _signals(estimator, record).items():
            rows = record.counted(signal).flatten(0, -2).cpu()
            ends.setdefault(kind, []).extend(rows.aminmax(dim=0))
        quantity, numbers, dt = record.quantity, record.dof_numbers, record.dt
        inputs = _input_names(record, sensors)
    if not ends:
        return {}
    names = {"excitation": inputs, **dict.fromkeys(("deformation", "rate"), names_of(estimator))}
    units = {"displacement": "m", "velocity": "m/s", "deformation": "m", "rate": "m/s", OTHER: ""}
    driven = {sensors.unit_of(name) for name in inputs} if sensors else {""}
    units |= {quantity: QUANTITIES[quantity][1]}
    units["excitation"] = driven.pop() if len(driven) == 1 else ""
    found = {}
    for kind, both in ends.items():
        values, letter = torch.stack(both), "r" if quantity == "force" else "x"
        numbered = [f"{letter}{i}" for i in dof_numbers(numbers, values.shape[1])]
        if kind == OTHER:
            numbered = [f"u{i + 1}" for i in range(values.shape[1])]
        if torch.isfinite(values).all():
            named = {"unit": units[kind], "names": names.get(kind) or numbered}
            found[kind] = {**named, **_ends_of(kind, values)}
    if inputs:
        spectrum = spectrum_of(motions, dt)
        if np.isfinite(spectrum["power"]).all() and np.isfinite(spectrum["largest"]).all():
            found[SPECTRUM] = {"unit": units["excitation"], "names": inputs, **spectrum}
    return found


def spectrum_of(
    motions: Sequence[tuple[np.ndarray, np.ndarray]], dt: float
) -> dict[str, list[Any]]:
    """Largest spectrum ("largest", K lists of c) of excitations (T, c) at "periods" (K) [s].

    "power" (K): shares of the periods in the power of the motions (T, ·) that belong to them.
    """
    periods = periods_of(max(len(u) for u, _ in motions), dt)
    peaks = np.stack([spectral_peaks(u, dt, periods) for u, _ in motions])
    shares = shares_of([a for _, a in motions], dt, periods)
    listed = {"periods": periods, "largest": peaks.max(axis=0), "power": shares}
    return {name: values.tolist() for name, values in listed.items()}


def shares_of(motions: Sequence[np.ndarray], dt: float, periods: np.ndarray) -> np.ndarray:
    """Share (K,) of each period in the power of motions (T, ·); nil where nothing moves."""
    size = max(float(np.abs(a).max()) for a in motions) or 1.0  # whose square may overflow
    power = np.sum([power_by_period(a / size, dt, periods) for a in motions], axis=0)
    return np.asarray(power / (power.sum() or 1.0))


def _motions_of(record: Record) -> list[tuple[np.ndarray, np.ndarray]]:
    """Excitation (T, c) and measured motion (T, n) of each motion of a record or a batch."""
    signals = (replace(record, e=None).excitation, record.a)
    return _each_motion(*map(record.counted, signals))


def _each_motion(u: Tensor, a: Tensor) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of a motion or a batch, also where nothing drives it."""
    rows = (s.reshape(math.prod(s.shape[:-2]), *s.shape[-2:]).cpu().numpy() for s in (u, a))
    return list(zip(*rows, strict=True))


@torch.no_grad()
def range_of_drive(estimator: Estimator, drive: Drive, trained: Mapping[str, Any]) -> Range:
    """That of a free run, of the kinds that a trained range has, under the names that it has.

    A motion that is nil throughout is one that the model does not know. Raises NoFreeRunError where
    the model cannot simulate.
    """
    motion = estimator.free_run(drive)
    own = next((kind for kind in QUANTITIES if kind in trained), "acceleration")
    signals = {"excitation": drive.u, "displacement": motion.x, "velocity": motion.v, own: motion.a}
    if isinstance(estimator, Composite):
        deformation = estimator.element_loops(drive)[0]
        rate = torch.gradient(deformation, spacing=drive.dt, dim=-2)[0]
        signals |= {"deformation": deformation, "rate": rate}
    if OTHER in trained:
        count = len(trained[OTHER]["largest"])
        signals["excitation"], signals[OTHER] = drive.u[..., :-count], drive.u[..., -count:]
    found: Range = {}
    driving = signals["excitation"]
    if SPECTRUM in trained and len(trained[SPECTRUM]["names"]) == driving.shape[-1]:
        motions = _each_motion(driving, motion.a)
        found[SPECTRUM] = {**trained[SPECTRUM], **spectrum_of(motions, drive.dt)}
    for kind, signal in signals.items():
        rows = signal.flatten(0, -2)
        if len(trained.get(kind, {}).get("largest", ())) != rows.shape[1] or not rows.any():
            continue
        found[kind] = {**trained[kind], **_ends_of(kind, rows)}
    return found


def _ends_of(kind: str, rows: Tensor) -> dict[str, list[float]]:
    """The largest magnitude of each channel of rows (N, c); both ends of other inputs."""
    if kind != OTHER:
        return {"largest": rows.abs().amax(dim=0).tolist()}
    lowest, largest = rows.aminmax(dim=0)
    return {"lowest": lowest.tolist(), "largest": largest.tolist()}


def _signals(estimator: Estimator, record: Record) -> dict[str, Tensor]:
    """What is compared, by kind (…, T, ·)."""
    signals = {} if record.e is None else {OTHER: record.e}
    signals |= {"excitation": replace(record, e=None).excitation, record.quantity: record.a}
    if record.quantity == "acceleration":
        states = {"displacement": record.x, "velocity": record.v}
        signals |= {kind: u for kind, u in states.items() if u is not None}
    if loops := loops_of(estimator, record):
        deformation = loops[0]
        signals["deformation"] = deformation
        signals["rate"] = torch.gradient(deformation, spacing=record.dt, dim=-2)[0]
    return {kind: u for kind, u in signals.items() if u.shape[-1] > 0}


def loops_of(estimator: Estimator, record: Record) -> tuple[Tensor, Tensor] | None:
    """Deformations and forces (…, T, E) in the free run of a record; None where it has none."""
    if not isinstance(estimator, Composite):
        return None
    try:
        return estimator.element_loops(record)
    except ValueError:  # it begins in motion, without its state
        return None


def names_of(estimator: Estimator) -> list[str]:
    """Of a model's elements: the nodes that they join, where it knows them."""
    pairs = getattr(estimator, "elements", None)
    if isinstance(pairs, Sequence):
        return ["–".join(map(str, pair)) for pair in pairs]
    return []


def _input_names(record: Record, sensors: Sensors | None) -> list[str]:
    """Of forces by the DOFs that carry them, where the sensors tell."""
    forced = sensors.forced if sensors and isinstance(sensors.forced, list) else []
    signals = (("f", record.f), ("s", record.s), ("s_dot", record.s_dot))
    sizes = ((name, 0 if u is None else u.shape[-1]) for name, u in signals)
    numbered = ((name, dof_numbers(forced if name == "f" else (), size)) for name, size in sizes)
    return [f"{name}{i}" for name, numbers in numbered for i in numbers]


def outside(trained: Mapping[str, Any], new: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Where a new range leaves the trained one: of each kind the channel that leaves it most.

    `times` the largest of training; None where training had no motion there at all. Kinds and
    channels that either lacks are left out.
    """
    found = []
    for kind in (kind for kind in new if kind in trained):
        if kind == SPECTRUM:
            found += _beyond_spectrum(trained[kind], new[kind])
            continue
        pairs = list(zip(trained[kind]["largest"], new[kind]["largest"], strict=False))
        if not pairs:
            continue
        if "lowest" in trained[kind]:
            pairs, ratios = _beyond_both_ends(trained[kind], new[kind])
        else:
            ratios = [now / then if then > 0.0 else math.inf * now for then, now in pairs]
        ratios = [0.0 if math.isnan(ratio) else ratio for ratio in ratios]
        worst = max(range(len(ratios)), key=ratios.__getitem__)
        if ratios[worst] > BEYOND:
            found.append(
                {
                    "kind": kind,
                    "name": trained[kind]["names"][worst],
                    "times": ratios[worst] if math.isfinite(ratios[worst]) else None,
                    "largest": pairs[worst][1],
                    "trained": pairs[worst][0],
                    "unit": trained[kind]["unit"],
                    "channels": sum(ratio > BEYOND for ratio in ratios),
                }
            )
    return found


def _beyond_spectrum(trained: Mapping[str, Any], new: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The channel whose spectrum leaves that of training most, and the period that says most of it.

    None where all stay inside, and where no period is in both.
    """
    _, old, own = np.intersect1d(trained["periods"], new["periods"], return_indices=True)
    if not len(old):
        return []
    then, now = (np.array(of["largest"])[rows] for of, rows in ((trained, old), (new, own)))
    power = np.array(new["power"])[own]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.nan_to_num(now / then, nan=0.0, posinf=math.inf)
        beyond = np.where(power > 0.0, power * (ratios.T**2 - BEYOND**2), 0.0)  # (c, K)
    excess = beyond.sum(axis=1)
    i = int(excess.argmax())
    if not excess[i] > 0.0:
        return []
    k = int(beyond[i].argmax())
    return [
        {
            "kind": SPECTRUM,
            "name": f"{trained['names'][i]} at {np.array(trained['periods'])[old[k]]:.2g} s",
            "times": float(ratios[k, i]) if math.isfinite(ratios[k, i]) else None,
            "largest": float(now[k, i]),
            "trained": float(then[k, i]),
            "unit": trained["unit"],
            "channels": int((excess > 0.0).sum()),
        }
    ]


def _beyond_both_ends(
    trained: Mapping[str, Any], new: Mapping[str, Any]
) -> tuple[list[tuple[float, float]], list[float]]:
    """The end that is left, in training and now, and how far: in half ranges from the middle."""
    pairs, ratios = [], []
    ends = (trained["lowest"], trained["largest"], new["lowest"], new["largest"])
    for low, high, lowest, highest in zip(*ends, strict=False):
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        below, above = middle - lowest, highest - middle
        pairs.append((low, lowest) if below > above else (high, highest))
        far = max(below, above)
        ratios.append(far / half if half > 0.0 else math.inf * far)
    return pairs, ratios


def warnings_of(found: Iterable[Mapping[str, Any]]) -> list[str]:
    """A line for each kind."""
    lines = []
    for one in found:
        unit = f" {one['unit']}" if one["unit"] else ""
        times = "" if one["times"] is None else f" {one['times']:.3g} ×"
        others = f", and {one['channels'] - 1} more" if one["channels"] > 1 else ""
        if one["kind"] == OTHER:
            reached = (
                f"{one['name']} reaches {one['largest']:.4g}, in training {one['trained']:.4g}"
            )
            lines.append(f"outside the trained range: {reached}{others}")
            continue
        lines.append(
            f"outside the trained range:{times} the largest {what_of(one)} "
            f"({one['largest']:.3g}{unit}, in training {one['trained']:.3g}{unit}){others}"
        )
    return lines


def what_of(one: Mapping[str, Any]) -> str:
    """What leaves the range, in words."""
    grounded = one["unit"] == QUANTITIES["acceleration"][1]  # f1 = −s̈
    if one["kind"] == "excitation" and grounded:
        return "ground acceleration"
    if one["kind"] == SPECTRUM:
        name, _, period = one["name"].rpartition(" at ")
        return f"spectral {'acceleration' if grounded else f'value of {name}'} at {period}"
    return f"{one['kind']} of {one['name']}"


def worst_of(found: Iterable[Mapping[str, Any]]) -> str:
    """For the title of a picture: "2.0 × the trained deformation"; "" inside the range."""
    ranked = sorted(found, key=lambda one: one["times"] or math.inf)
    if not ranked:
        return ""
    times = "beyond" if ranked[-1]["times"] is None else f"{ranked[-1]['times']:.2g} ×"
    return f"{times} the trained {ranked[-1]['kind']}"
