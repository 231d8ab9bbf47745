"""Recorded earthquakes as motions of the supports: accelerograms → displacement and velocity.

Of each record, in this order:

1. The time step. Where `data.dt` is coarser than the record's, what lies above 0.8 of its Nyquist
   frequency is filtered away, both ways, hence without delay.  A cubic spline is laid through the
   accelerations and integrated exactly: displacement and velocity belong together at any step.
2. The baseline. Integrated twice, the smallest offset of an accelerogram grows with t².  The one
   straight line is taken off the acceleration that leaves the ground at rest, where it was, when
   the record ends: offsets and linear drifts of the instrument vanish.  Records already processed,
   as all of FEMA P695's and PEER's, end so by themselves and stay as they are; they would not under
   a polynomial fitted to all of the displacement (up to 0.2 m in the far-field set), and a
   high-pass filter shifts phases or wants long pads.  Raw records, whose noise wanders or whose
   baseline jumps, need such a filter before.  A permanent offset of the ground is taken away, too.
3. The size: times `scale`, or with the factor that makes the largest acceleration `peak`.
4. The length. After a record's end the ground rests until `data.duration` is over.  A longer record
   is cut, as long as 5 % of its Arias intensity ∫a² dt are lost at most.

The wave reaches each further support `lag` later than the one before.  Without it all supports
move alike; models that read each support as a channel of its own then find the channels dependent,
and those that solve least squares want a ridge (model.ridge=1e-10).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from data.annotations import MOST, Count, Fraction, Positive, Whole
from data.checked import checked
from data.measured.units import GRAVITY
from data.simulation.accelerograms import Accelerogram, check_event, earthquake_of, read_event
from data.simulation.excitation import Signal, Waveform

LOST = 0.05  # of the Arias intensity, at most


@checked
@dataclass(frozen=True)
class RecordedEarthquake(Waveform):
    """Ground motions of recorded events; an earthquake is trained on or tested, never both.

    `events` are components of the FEMA P695 far-field set ("1a" … "22b") or paths of .AT2 or .csv
    files (data/simulation/accelerograms.py). `seed` deals them out: in its order the first
    `train_records` are trained on, and of the others, those of other earthquakes are tested;
    so seeds repeat the identification with other events, until all ways to deal are used up.
    None: in the order written. `test_events` are tested whatever the seed, and their earthquakes
    are not trained on. `train_records` is that of the data. A file counts as an earthquake of its
    own.
    """

    events: Sequence[Any]  # str; what is wrong with others, check_event says
    train_records: Count
    test_events: Sequence[str] | None = None
    seed: Whole | None = None
    peak: Positive | None = None  # [g]
    scale: Positive | None = None  # times as recorded
    lag: Fraction = 0.0  # [s] from a support to the next

    def __post_init__(self) -> None:
        for name, events in (("events", self.events), ("test_events", self.test_events or ())):
            if isinstance(events, str):
                raise ValueError(f"{name}={events!r} must be a list, for example [{events}]")
            if len(events) > MOST:
                raise ValueError(f"{name} lists {len(events)} events; {MOST} are possible")
            listed = [check_event(event) for event in events]
            if len(set(listed)) < len(listed):
                raise ValueError(f"{name}={listed} names an event twice")
        if self.peak is not None and self.scale is not None:
            raise ValueError(f"give peak={self.peak} g or scale={self.scale}, not both")

    def split(self) -> tuple[list[str], list[str]]:
        """The events trained on, and those that may be tested, in their order."""
        tested = {earthquake_of(event) for event in self.test_events or ()}
        order = list(range(len(self.events)))
        if self.seed is not None:
            order = np.random.default_rng(self.seed).permutation(order).tolist()
        dealt = [self.events[i] for i in order]
        train = [event for event in dealt if earthquake_of(event) not in tested]
        if len(train) < self.train_records:
            raise ValueError(
                f"data.train_records={self.train_records}, but only {len(train)} of the events of "
                f"the excitation are left to train on; list more or train on fewer"
            )
        train = train[: self.train_records]
        trained = {earthquake_of(event) for event in train}
        test = [event for event in dealt if earthquake_of(event) not in trained]
        return train, list(test if self.test_events is None else self.test_events)

    def check(self, train_records: int) -> None:
        """Raise ValueError unless the events were dealt out for as many training records."""
        if train_records != self.train_records:
            raise ValueError(
                f"data.train_records={train_records}, but the events were dealt out for "
                f"{self.train_records}: an event would be trained on and tested; leave it so"
            )

    def draw(
        self, samples: int, dt: float, channels: int, record: int, rng: np.random.Generator
    ) -> Signal:
        """Displacement [m] and velocity [m/s] of one record, (T, c) each; `rng` is not used."""
        train, test = self.split()
        number = record - len(train)
        if number >= len(test):
            raise ValueError(
                f"test record {number + 1} has no event: the earthquakes that are "
                f"not trained on are {len(test)}; list more, or lower data.test_records"
            )
        event = train[record] if number < 0 else test[number]
        arrivals = self.lag * np.arange(channels)
        return ground_motion(read_event(event), samples, dt, self.peak, self.scale, arrivals)


def ground_motion(
    recorded: Accelerogram,
    samples: int,
    dt: float,
    peak: float | None = None,
    scale: float | None = None,
    arrivals: Sequence[float] | np.ndarray = (0.0,),
) -> Signal:
    """Displacement [m] and velocity [m/s] of an accelerogram, (T, c) each, every `dt` [s].

    The motion begins at the c `arrivals` [s].  Raises ValueError where `dt` or `samples` would
    lose more than 5 % of the Arias intensity.
    """
    from scipy.interpolate import CubicSpline  # slow to import, seldom needed

    a = without_drift(_fine_enough(recorded, dt))  # [g]
    _long_enough(a, samples * dt, max(arrivals))
    size = peak / np.abs(a.a).max() if peak is not None else 1.0 if scale is None else scale
    acceleration = CubicSpline(_times(a), size * GRAVITY * a.a)
    t = dt * np.arange(samples)[:, None] - np.asarray(arrivals)  # (T, c)
    shaking = (t >= 0.0) & (t <= _times(a)[-1])
    motion = np.zeros((2, *t.shape))
    for row, order in zip(motion, (2, 1), strict=True):
        row[shaking] = acceleration.antiderivative(order)(t[shaking])
    return motion[0], motion[1]


def without_drift(recorded: Accelerogram) -> Accelerogram:
    """The accelerogram less the line b + c t that leaves v(T) = d(T) = 0 at its end T."""
    from scipy.interpolate import CubicSpline

    t = _times(recorded)
    T = t[-1]
    spline = CubicSpline(t, recorded.a)
    v, d = (float(spline.antiderivative(order)(T)) for order in (1, 2))
    # b T + c T²/2 = v(T),  b T²/2 + c T³/6 = d(T)
    b, c = np.linalg.solve([[T, T**2 / 2.0], [T**2 / 2.0, T**3 / 6.0]], [v, d])
    return Accelerogram(recorded.name, recorded.dt, recorded.a - b - c * t)


def _times(a: Accelerogram) -> np.ndarray:
    return a.dt * np.arange(a.a.size)


def _fine_enough(a: Accelerogram, dt: float) -> Accelerogram:
    """The accelerogram without what samples every `dt` [s] cannot carry."""
    from scipy.signal import butter, sosfiltfilt

    if dt <= a.dt * (1.0 + 1e-9):
        return a
    kept = sosfiltfilt(butter(4, 0.8 * 0.5 / dt, fs=1.0 / a.dt, output="sos"), a.a)
    lost = 1.0 - (kept**2).sum() / (a.a**2).sum()
    if lost > LOST:
        raise ValueError(
            f"data.dt={dt:g} s is too coarse for the earthquake {a.name}, recorded every "
            f"{a.dt:g} s: {100.0 * lost:.0f} % of its Arias intensity lie above "
            f"{0.4 / dt:g} Hz; lower data.dt"
        )
    return Accelerogram(a.name, a.dt, kept)


def _long_enough(a: Accelerogram, duration: float, arrival: float) -> None:
    arias = np.cumsum(a.a**2) / (a.a**2).sum()
    inside = np.flatnonzero(arrival + _times(a) < duration * (1.0 + 1e-9))
    lost = 1.0 - arias[inside[-1]] if inside.size else 1.0
    if lost > LOST:
        enough = arrival + _times(a)[np.searchsorted(arias, 1.0 - LOST)] + a.dt
        raise ValueError(
            f"data.duration={duration:g} s cuts {100.0 * lost:.0f} % of the Arias intensity of the "
            f"earthquake {a.name} off; data.duration={np.ceil(enough):g} keeps "
            f"{100.0 * (1.0 - LOST):.0f} %"
        )
