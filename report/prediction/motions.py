"""Motions that a model is put under: of files, of the FEMA P695 set by name, or generated.

A file is read, converted, cut and mended as a measured record is (data/measured). T samples.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from data.measured.assembly import with_rates
from data.measured.clocks import require_common_time
from data.measured.datamodule import whole_records
from data.measured.mend import Mending
from data.measured.places import record_places
from data.measured.raw_record import RawRecord, between
from data.measured.reading import NoColumnError
from data.measured.units import GRAVITY
from data.memory import require_memory
from data.record import require_bearable
from data.simulation.accelerograms import EARTHQUAKES, FAR_FIELD, read_event
from data.simulation.excitation import (
    BandLimitedGaussian,
    Excitation,
    Multisine,
    SineSweep,
    Waveform,
)
from models.experiment import Experiment
from report.prediction.interface import BASE, FORCES, GROUND, IMPOSED, Interface
from report.run.evaluation import read_as_the_run, said_alone
from runner.config.command_line import absolute
from runner.config.settings import Wanted

WAVES: Mapping[str, Callable[[float, list[float]], Waveform]] = {
    "gaussian": BandLimitedGaussian,
    "multisine": Multisine,
    "sine_sweep": SineSweep,
}
COMPONENTS = [f"{pair}{side}" for pair in range(1, 23) for side in "ab"]
QUIET = 10.0  # [s] of rest after a motion of the ground, for residual displacements
READER = (  # settings by which files are read, beside channels
    *("skip_rows", "delimiter", "decimal", "group", "header", "units", "align"),
    *("dt", "start", "stop", "onset", "quasi_static"),
)
OF_DATA = re.compile(  # keys of records, which here are those of the excitation
    r"\bdata\.(?=(path|channels|units|mend|delay|dt|start|stop|align|group|header"
    r"|skip_rows|delimiter|decimal|duration)\b)"
)


@dataclass(frozen=True)
class Motion:
    """What drives a model: the channels (T,) of its interface, or the ground's, in SI units."""

    name: str
    dt: float  # [s]
    channels: Mapping[str, np.ndarray]
    notes: list[str] = field(default_factory=list)

    @property
    def samples(self) -> int:
        return len(next(iter(self.channels.values())))


@contextmanager
def _words_of_excitation() -> Iterator[None]:
    """Let errors about records name the keys of this command: excitation.mend for data.mend."""
    try:
        yield
    except ValueError as error:
        raise ValueError(OF_DATA.sub("excitation.", str(error))) from None


@_words_of_excitation()
def motions_of(
    wanted: Wanted, run: Experiment, interface: Interface, model_dt: float, any_step: bool
) -> list[Motion]:
    """The motions that a command asks for, with a time step that the model takes.

    run: choices of the run. Raises ValueError for what cannot be read, lacks a channel or has
    faults that `mend` does not repair.
    """
    ways = [key for key in ("path", "events", "kind") if getattr(wanted, key) is not None]
    if len(ways) > 1:
        raise ValueError(f"excitation.{ways[0]} and excitation.{ways[1]}: give one of both")
    if wanted.path is not None:
        said = {key: getattr(wanted, key, None) for key in ("channels", "mend", "delay", *READER)}
        settings = read_as_the_run(run, said_alone(said)).data.arguments()
        raws = _of_files(wanted, settings, interface)
        mending, delay = settings.get("mend", Mending()), settings.get("delay") or {}
        if isinstance(delay, str) or any(isinstance(s, str) for s in delay.values()):
            raise ValueError("data.delay: estimate is of training records; say seconds")
    elif wanted.events is not None:
        raws = list(_of_events(wanted.events))
        if not interface.takes_ground:
            raise ValueError(
                f"an earthquake is an acceleration of the ground, and the model is driven by "
                f"{interface.requirement}; give a file (excitation.path)"
            )
    else:
        raws = _generated(wanted, run, interface, model_dt)
    if wanted.path is None:
        raws = [between(raw, wanted.start or 0.0, wanted.stop) for raw in raws]
        mending, delay = Mending(**dict(wanted.mend or {})), {}
    found = [_mended(raw, wanted, interface, mending, delay, model_dt, any_step) for raw in raws]
    names = [motion.name for motion in found]
    if double := next((n for n in names if names.count(n) > 1), None):
        raise ValueError(f"two motions are called {double}; rename a file, or give one of them")
    return found


def _mended(
    raw: RawRecord,
    wanted: Wanted,
    interface: Interface,
    mending: Mending,
    delay: Mapping[str, float],
    model_dt: float,
    any_step: bool,
) -> Motion:
    """A record as a motion of the model's time step, or the record's where the model takes any."""
    raw = replace(raw, channels=interface.driving_channels(raw.name, raw.channels))
    for channel, u in raw.channels.items():
        require_bearable(f"{raw.name}: {channel}", u)
    raw = replace(raw, clocks={c: t for c, t in raw.clocks.items() if c in raw.channels})
    require_common_time(raw)
    dt, channels, done = mending(raw, delay)
    coarse = GROUND in channels and interface.kind not in (BASE, FORCES)
    other = abs(dt / model_dt - 1.0) > 1e-6
    if other and (not any_step or (coarse and dt > model_dt)):
        if mending.resample is not None:
            raise ValueError(
                f"data.mend.resample={mending.resample:g} Hz: the model steps every "
                f"{model_dt:g} s; leave it out, or say {1.0 / model_dt:g}"
            )
        was, (dt, channels, done) = dt, replace(mending, resample=1.0 / model_dt)(raw, delay)
        done = [f"from steps of {was:.4g} s to the model's {dt:.4g} s", *done]
    elif other:
        done.append(f"its steps of {dt:.4g} s are kept; the model was trained at {model_dt:.4g} s")
    dt = model_dt if abs(dt / model_dt - 1.0) <= 1e-6 else dt
    channels = with_rates(channels, dt, done)
    if wanted.peak is not None:
        if GROUND not in channels:
            raise ValueError(
                f"excitation.peak={wanted.peak} g is of ground accelerations, and {raw.name} holds "
                f"{', '.join(channels)}; use excitation.scale"
            )
        largest = float(np.abs(channels[GROUND]).max())
        if not largest > 0.0:
            at_rest = f"the ground of {raw.name} is at rest"
            raise ValueError(f"excitation.peak={wanted.peak} g: {at_rest}")
        size = wanted.peak * GRAVITY / largest
        channels = {**channels, GROUND: size * channels[GROUND]}
        done.append(f"times {size:.4g}, to a peak of {wanted.peak:g} g")
    quiet = wanted.quiet if wanted.quiet is not None else QUIET if GROUND in channels else 0.0
    samples = quiet / dt
    require_memory(100.0 * samples * len(channels), f"excitation.quiet={quiet:g} s", "shorten it")
    rest = np.zeros(round(samples))
    channels = {c: np.concatenate([u, _after(c, u, rest)]) for c, u in channels.items()}
    return Motion(raw.name, dt, channels, [*raw.notes, *done])


def _after(channel: str, u: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """How a channel continues after its end: a position stays, forces and accelerations are nil."""
    stays = re.fullmatch(r"(s|u)\d+", channel)
    return rest + u[-1] if stays else rest


def _of_files(wanted: Wanted, settings: Mapping[str, Any], interface: Interface) -> list[RawRecord]:
    patterns = [wanted.path] if isinstance(wanted.path, str) else list(wanted.path or [])
    raws: list[RawRecord] = []
    for place in record_places([str(absolute(p)) for p in patterns], settings.get("channels")):
        found, left_out = _read(place, settings, interface)
        if left_out:
            raise ValueError(next(iter(left_out.values())))
        for name, raw in found.items():
            taken = any(raw.name == name for raw in raws)
            raws.append(replace(raw, name=place.name if taken else name))
    return raws


def _read(
    place: Path, settings: Mapping[str, Any], interface: Interface
) -> tuple[dict[str, RawRecord], dict[str, str]]:
    """A file's records: with all channels of the run, or those that drive, or by its own names.

    Raises ValueError for a file that has neither.
    """
    named, reader = settings.get("channels"), {k: settings[k] for k in READER if k in settings}
    if named is None and place.suffix.lower() == ".at2":
        named = {GROUND: "acc"}
    own = (*interface.channels, GROUND, "time")
    driving = {channel: column for channel, column in (named or {}).items() if channel in own}
    ways = [named, driving, None] if named else [None]
    errors = []
    for channels in ways:
        try:
            return whole_records(str(place), channels, **reader)
        except NoColumnError as error:
            errors.append(error)
    raise errors[0]


def _of_events(asked: str | int | Sequence[str | int]) -> Iterator[RawRecord]:
    """Components of the far-field set: "7a", both of a pair: 7, or all 44 of them: "all"."""
    listed = [asked] if isinstance(asked, str | int) else list(asked)
    events: list[str] = []
    for event in map(str, listed):
        if event == "all":
            events += COMPONENTS
        elif FAR_FIELD.fullmatch(f"{event}a"):
            events += [f"{event}a", f"{event}b"]
        elif FAR_FIELD.fullmatch(event):
            events.append(event)
        else:
            raise ValueError(_unknown_event(event))
    for event in dict.fromkeys(events):
        a = read_event(event)
        yield RawRecord(event, None, a.dt, {GROUND: GRAVITY * a.a})


def _unknown_event(event: str) -> str:
    """The nearest events, by number, or by the earthquake's name."""
    by_name: dict[str, list[str]] = {}
    for number, name in enumerate(EARTHQUAKES, start=1):
        by_name.setdefault(name.lower(), []).append(str(number))
    like = difflib.get_close_matches(event.lower(), by_name, n=1, cutoff=0.6)
    near = by_name[like[0]] if like else difflib.get_close_matches(event, COMPONENTS, n=2, cutoff=0)
    pairs = f"{like[0].title()} is {'pairs' if len(near) > 1 else 'pair'}" if like else "nearest:"
    return (
        f"excitation.events={event} is not in the far-field set of FEMA P695; {pairs} "
        f"{', '.join(near)} (1a, 1b … 22b; 7 for both of a pair; all for all 44 components)"
    )


def _generated(wanted: Wanted, run: Experiment, interface: Interface, dt: float) -> list[RawRecord]:
    """One motion of a kind, or of the run's own excitation, from a seed."""
    duration = wanted.duration or run.data.values.get("duration") or 50.0
    samples, rng = round(duration / dt), np.random.default_rng(wanted.seed)
    if samples < 4:
        raise ValueError(f"excitation.duration={duration:g} s holds {samples} steps of {dt:g} s")
    count = len(interface.forces) or interface.supports or 1
    room = f"excitation.duration={duration:g} s in steps of {dt:g} s"
    require_memory(100.0 * samples * count, room, "shorten it")
    if wanted.kind is None:
        return [_as_the_run(run, interface, dt, samples, rng, wanted.seed)]
    if interface.others:
        raise ValueError(
            f"the model reads {', '.join(interface.others)} too, which is not generated; give "
            "excitation.path"
        )
    wave = _waveform(wanted)
    try:
        values, rates = wave.draw(samples, dt, count, 0, rng)
    except ValueError as error:
        raise ValueError(f"excitation.{error}".replace(" or data.dt", "")) from None
    channels = {GROUND: values[:, 0]}
    if interface.kind == FORCES:
        channels = dict(zip(interface.forces, values.T, strict=True))
    elif interface.kind != BASE:
        both = _from_rest(Excitation(wave, ramp=1.0), dt, values, rates)
        none = np.zeros((len(interface.forces), samples))
        names = (*interface.forces, *interface.motions)
        channels = dict(zip(names, [*none, *both[:, _motions(interface, count)].T], strict=True))
    return [RawRecord(f"{wanted.kind}_seed{wanted.seed}", None, dt, channels)]


def _from_rest(own: Excitation, dt: float, s: np.ndarray, s_dot: np.ndarray) -> np.ndarray:
    """Displacements and their rates (T, 2 c) that grow from rest as an excitation does."""
    grow, growth = own._growth(dt * np.arange(len(s))[:, None])
    return np.hstack([grow * s, grow * s_dot + growth * s])


def _motions(interface: Interface, count: int) -> list[int]:
    """Columns of displacements and rates; `count` of each were drawn."""
    p = interface.supports
    return [*(i % count for i in range(p)), *(count + i % count for i in range(p))]


def _waveform(wanted: Wanted) -> Waveform:
    std = wanted.std
    if std is None:
        raise ValueError(
            f"excitation.kind={wanted.kind} needs excitation.std: N of forces, m of supports and "
            "imposed deformations, m/s² of a base"
        )
    band = list(wanted.band) if wanted.band is not None else [0.1, 3.0]
    make = WAVES.get(str(wanted.kind))
    if make is None:
        raise ValueError(f"excitation.kind={wanted.kind}: choose {', '.join(WAVES)}")
    return make(std, band)


def _as_the_run(
    run: Experiment, interface: Interface, dt: float, samples: int, rng: Any, seed: int
) -> RawRecord:
    """A motion as those that the run was identified with, from another seed."""
    if run.excitation is None or not run.excitation.target:
        raise ValueError(
            "which motion? give excitation.path=FILE, excitation.events=7a (FEMA P695), or "
            "excitation.kind=gaussian and excitation.std"
        )
    own = run.excitation.build(Excitation)
    if interface.kind == IMPOSED or (own.support and not hasattr(own.support, "std")):
        raise ValueError("the run's excitation is no process; give excitation.events or .path")
    grow, _ = own._growth(dt * np.arange(samples)[:, None])
    channels: dict[str, np.ndarray] = {}
    if own.force is not None:
        drawn = grow * own.force.draw(samples, dt, len(interface.forces), 0, rng)[0]
        channels |= dict(zip(interface.forces, drawn.T, strict=True))
    if own.support is not None:
        s, s_dot = own.support.draw(samples, dt, interface.supports, 0, rng)
        channels |= dict(zip(interface.motions, _from_rest(own, dt, s, s_dot).T, strict=True))
    return RawRecord(f"as_the_run_seed{seed}", None, dt, channels)


def stem(name: str) -> str:
    """A motion's name as one of a file."""
    return re.sub(r"[^\w.+-]", "_", Path(name).name)[:80]
