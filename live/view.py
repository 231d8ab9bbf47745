"""The display of a live run: a moving table in a terminal, elsewhere a line every few seconds."""

from __future__ import annotations

import math
import sys

import numpy as np
from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from data.arguments import count_of, plain
from data.stream import SampleLines
from data.terminal import Terminal
from live.monitor import LiveMonitor, TimedAlarm
from models.fit.trained_range import warnings_of
from models.online.guard import Event
from models.online.scores import WINDOW

BARS = " ▁▂▃▄▅▆▇█"
WIDTH = 60  # columns of a signal
REFRESH = 8  # a second
SWITCH = 2e-4  # [s]
PRINTED = 10  # faults and events that are printed between two status lines; the rest is counted


class LiveView:
    """Use as a context: `tick` after every sample, `alarm` where one is raised.

    every [s] of the record: between lines, where there is no terminal.
    """

    def __init__(
        self, monitor: LiveMonitor, lines: SampleLines | None, console: Terminal, every: float
    ) -> None:
        self.monitor, self.lines, self.console, self.every = monitor, lines, console, every
        if not every > 0.0:
            raise ValueError(f"--every {every:g} s must be positive")
        self.live: Live | None = None
        self.next_line = every
        self.counted = [0, 0]  # faults of lines, events: printed or counted so far
        if console.is_terminal:
            self.live = Live(
                console=console, get_renderable=self.table, refresh_per_second=REFRESH,
                vertical_overflow="crop",
            )  # fmt: skip

    def __enter__(self) -> LiveView:
        if self.live is not None:
            # a thread of its own draws the table, and must not keep a sample waiting
            sys.setswitchinterval(SWITCH)
            self.live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self.live is not None:
            self.live.stop()

    def tick(self) -> None:
        """Print a status line where one is due and there is no table."""
        if self.live is None and self.monitor.time >= self.next_line:
            self.tell()
            for line in (status_line(self.monitor, self.lines), *motion_lines(self.monitor)):
                self.console.tell(line)
            self.next_line += self.every * (1 + (self.monitor.time - self.next_line) // self.every)

    def tell(self) -> None:
        """Print what was damaged since the last time, the newest by name, all by their number."""
        if self.live is not None:
            return
        watch = self.monitor.stream.watch
        news = [(watch.kinds.total(), [event_words(e) for e in watch.events], "events")]
        if self.lines is not None:
            total = self.lines.bad + self.lines.mistimed
            news.append((total, [plain(fault) for fault in self.lines.faults], "faults of lines"))
        for k, (total, words, what) in enumerate(news):
            new, self.counted[k] = max(total - self.counted[k], 0), total
            if new > PRINTED:
                self.console.print(f"{new - PRINTED:,} more {what}", markup=False, soft_wrap=True)
            for line in words[len(words) - min(new, PRINTED) :]:
                self.console.tell(line)

    def alarm(self, raised: TimedAlarm) -> None:
        """Print an alarm where there is no table."""
        if self.live is None:
            self.console.print(alarm_line(raised), markup=False, soft_wrap=True)

    def table(self) -> Group:
        """Status, the last seconds of each DOF, the last event, fault and alarm."""
        monitor = self.monitor
        measured, estimated = monitor.window()
        _, errors = monitor.running_error()
        table = Table(box=None, pad_edge=False, header_style="bold")
        table.add_column("DOF")
        table.add_column("\\[m/s²]")
        table.add_column(f"the last {WINDOW:g} s")
        table.add_column("now", justify="right", min_width=9)  # so that nothing moves
        table.add_column("error", justify="right")
        numbers = monitor.stream.watch.numbers
        for i, (number, error) in enumerate(zip(numbers, errors, strict=True)):
            both = measured[:, i], estimated[:, i]
            first = monitor.samples - len(measured)
            finite = np.nan_to_num(np.concatenate(both), nan=0.0, posinf=0.0, neginf=0.0)
            size = float(np.abs(finite).max(initial=0.0))
            rows = [bars(u, size, first) for u in both]
            now = [f"{u[-1]:+.3f}" if len(u) else "" for u in both]
            table.add_row(str(number), "measured", Text(rows[0], style="cyan"), now[0], "")
            estimate = Text(rows[1], style="yellow")
            table.add_row("", "estimated", estimate, now[1], f"{error:.1f} %")
        parts: list[Text | Table] = [
            Text("\n".join([status_line(monitor, self.lines), *motion_lines(monitor)])),
            table,
            Text(self._last_troubles()),
        ]
        if monitor.alarms:
            parts.append(Text(alarm_line(monitor.alarms[-1]), style="bold red"))
        return Group(*parts)

    def _last_troubles(self) -> str:
        lines = [event_line(self.monitor)] if self.monitor.last_event else []
        if self.lines is not None and self.lines.faults:
            lines.append(f"last fault: {plain(self.lines.faults[-1])}")
        return "\n".join(lines)


def bars(signal: np.ndarray, size: float, first: int) -> str:
    """The newest WIDTH columns of a signal (T,) between −size and size, as characters.

    first: number of its first sample; columns stay with their samples as the signal moves on.
    """
    step = max(1, math.ceil(len(signal) / WIDTH))
    shown = signal[-first % step :: step]
    if not size > 0.0:
        return "▄" * len(shown)
    levels = np.nan_to_num(0.5 + 0.5 * shown / size, nan=0.0).clip(0.0, 1.0)
    marks = 1 + np.floor(levels * (len(BARS) - 2) + 0.5).astype(int)
    return "".join(
        BARS[mark] if math.isfinite(u) else "?" for mark, u in zip(marks, shown, strict=True)
    )


def status_line(monitor: LiveMonitor, lines: SampleLines | None) -> str:
    """Time, samples, running error [%], overruns, events and bad lines so far."""
    total, by_dof = monitor.running_error()
    bad = "" if lines is None else f", {count_of(lines.bad, 'bad line')}"
    return (
        f"t = {monitor.time:.1f} s, {count_of(monitor.samples, 'sample')}: error {total:.1f} % "
        f"({' '.join(f'{e:.1f}' for e in by_dof)}){_noise(monitor)}, "
        f"{count_of(monitor.overruns, 'overrun')}, "
        f"{count_of(sum(monitor.kinds.values()), 'event')}{bad}"
    )


def _noise(monitor: LiveMonitor) -> str:
    """What the sensors' noise makes of an error: nearly all of it once the motion has ended."""
    alone = monitor.noise_percent()
    return "" if alone is None else f", by noise alone {alone:.1f} %"


def motion_lines(monitor: LiveMonitor) -> list[str]:
    """Drifts of all storeys, now and at most, how far sensors deviate, what training never had."""
    stream, watch, beyond = monitor.stream, "", warnings_of(monitor.outside())
    if stream.drifts is None:
        return beyond
    if stream.numbers["watch"] == 2.0:
        watch = "; the sensors no longer agree with the model: drifts of the model alone"
    elif stream.numbers["watch"]:
        watch = f"; sensors deviate {stream.numbers['innovations']:.1f} times as far as expected"
    now, half, most, half_of_most = 1e3 * stream.drifts
    return [
        f"drifts by storey, from the ground up [mm]: {_with_halves(now, half)}{watch}",
        f"largest so far [mm]: {_with_halves(most, half_of_most)}",
        *beyond,
    ]


def _with_halves(values: np.ndarray, halves: np.ndarray) -> str:
    finite = halves[np.isfinite(halves) & (halves > 0.0)]
    digits = max(1, math.ceil(-math.log10(finite.min(initial=1.0))))  # none is ± 0.0
    return ", ".join(
        f"{u:.{digits}f} ± {w:.{digits}f}" if math.isfinite(w) else f"{u:.{digits}f}"
        for u, w in zip(values.tolist(), halves.tolist(), strict=True)
    )


DONE = {
    "dropped": "bridged by estimates, or restarted at rest",
    "repeated": "left out",
    "not_finite": "replaced",
    "outlier": "replaced",
    "saturated": "replaced",
    "restarted": "the model was worse than none and was restarted",
    "diverged": "from here on drifts are those of the model without the sensors",
}


def event_words(event: Event) -> str:
    """When, what, and what was done, of an event."""
    return f"{event.kind}: {event.channel} at {event.time:.3f} s; {DONE[event.kind]}"


def event_line(monitor: LiveMonitor) -> str:
    """Counts of the events by kind, and the last event. Needs one."""
    event = monitor.last_event
    assert event is not None
    counts = ", ".join(f"{count:,} {kind}" for kind, count in sorted(monitor.kinds.items()))
    return f"events: {counts}; the last: {event.kind}, {event.channel}, at {event.time:.3f} s"


def alarm_line(raised: TimedAlarm) -> str:
    """Time, DOF and size of an alarm."""
    alarm = raised.alarm
    return f"ALARM at {raised.time:.1f} s: DOF {alarm.dof}, {alarm.size:.1f} times the threshold"


def no_sound_sample(monitor: LiveMonitor, lines: SampleLines | None) -> str:
    """What is wrong with a run in which there was nothing to compare an estimate with."""
    if lines is not None and lines.bad:
        found = f"{count_of(lines.bad, 'bad line')}, the last: {plain(lines.faults[-1])}"
    else:
        found = f"{count_of(monitor.samples, 'sample')}"
    if monitor.last_event is not None:
        found += f"; {event_line(monitor)}"
    return (
        f"no valid sample arrived: {found}; send lines of finite numbers, as many as the "
        "header has names"
    )


def summary(monitor: LiveMonitor, lines: SampleLines | None) -> list[str]:
    """The last lines of a live run."""
    total, by_dof = monitor.error()
    last, _ = monitor.running_error()
    middle, most = monitor.latency()
    text = [
        f"{monitor.time:.1f} s, {count_of(monitor.samples, 'sample')}: relative error "
        f"{total:.2f} % (DOFs {', '.join(f'{e:.2f}' for e in by_dof)}), of the last {WINDOW:g} s "
        f"{last:.2f} %{_noise(monitor)}",
        f"time per sample: median {1e6 * middle:.0f} µs, 99.9th percentile {1e6 * most:.0f} µs; "
        f"{count_of(monitor.overruns, 'overrun')} of {1e3 * monitor.period:.4g} ms",
        *motion_lines(monitor),
    ]
    if monitor.last_event is not None:
        text.append(event_line(monitor))
    if lines is not None and lines.mistimed:
        text.append(f"time stamps off the sampling grid: {lines.mistimed:,}")
    if lines is not None and lines.bad:
        text.append(f"bad lines: {lines.bad:,}; the last: {plain(lines.faults[-1])}")
    if monitor.first_alarm is not None:
        more = f"; {monitor.alarm_count} in all" if monitor.alarm_count > 1 else ""
        text.append(alarm_line(monitor.first_alarm) + more)
    return text
