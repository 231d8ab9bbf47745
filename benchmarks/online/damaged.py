"""Do damaged lines hurt a live model? The path of `python -m live`: lines, stamps, guard, VWNN."""

from __future__ import annotations

import io
import random
from collections import Counter
from collections.abc import Callable

import numpy as np

from benchmarks.online.streams import DT, FORGETTING, motion
from data.stream.lines import SampleLines
from models.online.laws.recursive_least_squares import RecursiveLeastSquares
from models.online.vwnn_stream import VWNNStream
from models.vwnn import VWNN

RATE = 10_000  # sound lines to one that is damaged
LEARNING = 5_000  # first lines, none of which is damaged
TAIL = 0.5  # part of the stream at its end whose error is printed
SEEDS = 3

Change = Callable[[list[str], int, random.Random], None]  # of line k: t, forces, accelerations


def put(rows: list[str], k: int, i: int, cell: str) -> None:
    cells = rows[k].split(",")
    cells[i] = cell
    rows[k] = ",".join(cells)


def outlier(times: float, first: int) -> Change:
    """A value of one channel, from three on from `first`, times its usual size."""

    def change(rows: list[str], k: int, draw: random.Random) -> None:
        i = first + draw.randrange(3)
        before = (row.split(",") for row in rows[k - 900 : k])
        values = [abs(float(cells[i])) for cells in before if len(cells) == 7]
        size = float(np.median(values)) / 0.6745  # a deviation that other damage does not change
        put(rows, k, i, repr(draw.choice([-1, 1]) * times * size))

    return change


def missing(rows: list[str], k: int, draw: random.Random) -> None:
    put(rows, k, 1 + draw.randrange(6), "nan")


def wild_stamp(rows: list[str], k: int, draw: random.Random) -> None:
    shifted = repr(DT * (k + draw.choice([500, 50, 1, -1])))
    put(rows, k, 0, draw.choice(["1e18", "-1", "nan", shifted]))


def cut(rows: list[str], k: int, draw: random.Random) -> None:
    rows[k] = ",".join(rows[k].split(",")[: draw.randrange(1, 7)])


def again(rows: list[str], k: int, draw: random.Random) -> None:
    rows[k] = rows[k - 1]


DAMAGE: dict[str, Change] = {
    "acceleration × 20": outlier(20.0, 4),
    "acceleration × 100": outlier(100.0, 4),
    "acceleration × 1e6": outlier(1e6, 4),
    "acceleration × 1e300": outlier(1e300, 4),
    "force × 20": outlier(20.0, 1),
    "force × 1e6": outlier(1e6, 1),
    "NaN": missing,
    "time stamp": wild_stamp,
    "cut line": cut,
    "line repeated": again,
}


def mixture(rows: list[str], k: int, draw: random.Random) -> None:
    DAMAGE[draw.choice(list(DAMAGE))](rows, k, draw)


def followed(rows: list[str], truth: np.ndarray) -> tuple[float, int]:
    """Relative error [%] over the end of the stream against sound accelerations, faults named."""
    text = "\n".join(["t,f1,f2,f3,a1,a2,a3", *rows]).encode()
    lines = SampleLines(io.BytesIO(text), DT)
    stream = VWNNStream(VWNN(3, 3, DT), RecursiveLeastSquares(FORGETTING))
    error = size = 0.0
    for _, sample in lines:
        estimate = stream.step(sample).numpy()
        k = round(stream.watch.time / DT)
        if k >= (1.0 - TAIL) * len(truth):
            error += float(((estimate - truth[k]) ** 2).sum())
            size += float((truth[k] ** 2).sum())
    return 100.0 * (error / size) ** 0.5, lines.bad + lines.mistimed + stream.watch.kinds.total()


def damaged(count: int, seeds: int = SEEDS, every: int = RATE) -> None:
    """Print error and names of streams of `count` lines, one in `every` damaged in one way."""
    a, f = motion(count * DT)
    truth, table = a.numpy(), np.column_stack([f, a])
    sound = [",".join(map(repr, [round(k * DT, 9), *row.tolist()])) for k, row in enumerate(table)]
    clean, alarms = followed(sound, truth)
    print(f"damaged: {count} lines, sound: error {clean:.3f} %, {alarms} false alarms", flush=True)
    print("| one line in", every, "| lines | error [%] | times the sound stream's | not named |")
    print("| --- | --- | --- | --- | --- |")
    for name, change in (*DAMAGE.items(), ("all of these", mixture)):
        totals: Counter[str] = Counter()
        errors = []
        for seed in range(seeds):
            draw, rows = random.Random(seed), list(sound)
            places = [k + draw.randrange(every - 20) for k in range(LEARNING, count - every, every)]
            for k in places:
                change(rows, k, draw)
            error, named = followed(rows, truth)
            errors.append(error)
            totals["lines"] += len(places)
            totals["unnamed"] += max(len(places) - named, 0)
        worst = max(errors)
        print(
            f"| {name} | {totals['lines']} | {worst:.3f} | {worst / clean:.4f} | "
            f"{totals['unnamed']} |",
            flush=True,
        )
