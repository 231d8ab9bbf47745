"""How soon a loss of stiffness is found, and how often an alarm is false.

    python -m studies.detection                                  all systems, 50 seeds
    python -m studies.detection --systems shear_frame --seeds 10
    python -m studies.detection --figures docs/figures

Prints, for every system and watch, the false alarms with their interval, the damages found and
missed, the quartiles of the delays, and how often the alarm names the right DOF and element. The
settings of the study: studies/detection/motions.py.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from rich.table import Table
from scipy.stats import beta, binomtest
from torch import Tensor

from data.arguments import Parser
from data.terminal import Terminal
from models.detection.detector import conformal_rank, first_alarm
from report.output import save_figure
from runner.config.command_line import command_errors
from studies.detection.figures import delays_figure, levels_figure
from studies.detection.motions import (
    BLOCK,
    DURATION,
    FIRST_SEED,
    FRACTION,
    HELD,
    RATE,
    SEEDS,
    SETTLE,
    SYSTEMS,
    TIME,
    WATCHES,
    Motions,
    Outcome,
    delays_of,
    joins,
    motions_of,
    pointed_at,
    watched,
)

WAIT = 10.0  # [s] after the alarm, when the element is named


@dataclass(frozen=True)
class Score:
    """Alarms of one watch on one system."""

    sound: int  # motions
    false: int  # of them with an alarm
    early: int  # damaged motions with an alarm before the damage
    delays: list[float]  # [s] of the others, infinite where the damage was missed
    right_dof: int  # alarms after the damage that point to a DOF of the damaged element
    right_element: int  # of them whose element is the right one, WAIT later

    @property
    def found(self) -> int:
        return sum(map(math.isfinite, self.delays))

    def false_alarms(self) -> tuple[float, float]:
        """95 % interval of the share of sound motions with an alarm (Clopper & Pearson 1934)."""
        interval = binomtest(self.false, self.sound).proportion_ci(0.95, method="exact")
        return interval.low, interval.high

    def quartiles(self) -> list[float]:
        """Quartiles of the delays [s], a missed damage counting as infinite."""
        if not self.delays:
            return [math.nan] * 3
        return [float(q) for q in np.quantile(self.delays, [0.25, 0.5, 0.75], method="higher")]


def false_of(sound: Tensor) -> int:
    """How many records of levels (B, K, n) have an alarm."""
    return int((sound.amax(dim=(1, 2)) > 1.0).sum())


def score(motions: Motions, outcome: Outcome) -> Score:
    """Count the alarms of a watch."""
    false = false_of(outcome.sound)
    early, delays, right_dof, right_element = 0, [], 0, 0
    all_delays = delays_of(outcome.damaged)
    for levels, element, delay in zip(outcome.damaged, motions.lost, all_delays, strict=True):
        if delay <= 0.0:
            early += 1
            continue
        delays.append(delay)
        alarm, truth = first_alarm(levels), joins(motions.structure, element)
        if alarm is not None:
            later = min(alarm.block + round(WAIT / BLOCK), len(levels) - 1)
            right_dof += alarm.dof in truth
            right_element += pointed_at(motions.structure, levels[later]) == truth
    return Score(len(outcome.sound), false, early, delays, right_dof, right_element)


def rate_of_thresholds() -> tuple[float, float]:
    """The shares of false alarms between which 95 of 100 thresholds lie, for any distribution.

    With the j-th smallest of m peaks for threshold, the share is Beta(m + 1 − j, j).
    """
    j = conformal_rank(HELD, RATE)
    low, high = beta.ppf([0.025, 0.975], HELD + 1 - j, j)
    return float(low), float(high)


def table_of(system: str, motions: Motions, outcomes: dict[str, Outcome]) -> Table:
    """A row for each watch."""
    escaped = f"; {len(motions.escaped)} seeds escaped" if motions.escaped else ""
    title = f"{system}: {len(motions.sound)} motions{escaped}"
    table = Table(title=title, title_justify="left", pad_edge=False)
    heads = ("false", "95 % interval", "early", "found", "delay s: 1/4", "median", "3/4")
    for name in ("watch", *heads, "right DOF", "right element"):
        table.add_column(name, justify="left" if name == "watch" else "right", no_wrap=True)
    for name, outcome in outcomes.items():
        s = score(motions, outcome)
        low, high = (100.0 * share for share in s.false_alarms())
        right = [f"{count} of {s.found}" for count in (s.right_dof, s.right_element)]
        table.add_row(
            *(name, f"{s.false}", f"{low:.0f}–{high:.0f} %", f"{s.early}"),
            f"{s.found} of {len(s.delays)}",
            *(f"{q:.0f}" if math.isfinite(q) else "–" for q in s.quartiles()),
            *(right if s.found else ("–", "–")),
        )
    return table


def heading() -> str:
    """The lines above the tables: the damage, the thresholds, the columns."""
    low, high = (100.0 * share for share in rate_of_thresholds())
    return "\n".join(
        (
            f"Loss of {100 * FRACTION:.0f} % of the stiffness of one element at {TIME:.0f} s of "
            f"{DURATION:.0f} s.",
            f"Thresholds for one false alarm an hour: in {100 * RATE:.1f} % of sound motions, on "
            f"average over calibrations; each motion is watched for {DURATION - SETTLE:.0f} s.",
            f"A single calibration, on {HELD} motions, keeps to {low:.1f}–{high:.1f} % in 95 of "
            "100 cases.",
            "false: sound motions with an alarm; early: damaged ones with an alarm before the "
            "damage; the others are found or missed.",
            f"A missed damage counts as an infinite delay (–). The element is named {WAIT:.0f} s "
            "after the alarm.",
        )
    )


def total(outcomes: dict[str, dict[str, Outcome]]) -> str:
    """False alarms of all systems and watches together."""
    levels = [o.sound for by_watch in outcomes.values() for o in by_watch.values()]
    sound, false = (sum(map(count, levels)) for count in (len, false_of))
    return f"All together: {false} of {sound} watched sound motions with an alarm, " + (
        f"{100 * false / sound:.1f} %."
    )


def detect(systems: Sequence[str], seeds: int, figures: Path | None, console: Console) -> None:
    """Study some systems, printing each system's table when it is done."""
    console.print(heading())
    outcomes = {}
    for system in systems:
        motions = motions_of(system, range(FIRST_SEED, FIRST_SEED + seeds))
        outcomes[system] = {w.name: watched(w, system, motions) for w in WATCHES}
        console.print(table_of(system, motions, outcomes[system]))
    console.print(total(outcomes))
    if figures is not None:
        save_figure(delays_figure(outcomes), figures, "detection_delays")
        save_figure(levels_figure(outcomes), figures, "detection_levels")


def main() -> None:
    parser = Parser(description=__doc__)
    parser.add_argument("--systems", nargs="+", default=SYSTEMS)
    parser.add_argument("--seeds", type=int, default=SEEDS, help="test motions of each system")
    parser.add_argument("--figures", type=Path, help="folder for two figures")
    choice = parser.parse_args()
    torch.set_num_threads(1)
    detect(choice.systems, choice.seeds, choice.figures, Terminal(width=136))


if __name__ == "__main__":
    with command_errors():
        main()
