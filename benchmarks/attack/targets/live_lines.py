"""Streams of some hundred lines, damaged in all ways at once, through lines, stamps and guard."""

from __future__ import annotations

import io
import math
import random
from pathlib import Path

import numpy as np
import torch

from benchmarks.attack.attempt import Attempt, WronglyAcceptedError
from data.stream.lines import SampleLines
from models.online.laws.recursive_least_squares import RecursiveLeastSquares
from models.online.vwnn_stream import VWNNStream
from models.vwnn import VWNN

DT, T = 0.01, 1200
HEADERS = ("t,f1,a1,a2", "time;a1;a2;f1", "a1\tf1\ta2\tt", "f1,a1,a2")
GARBAGE: tuple[bytes, ...] = (
    b"",
    b"\x00",
    b"\xff\xfe",
    b"\x1b[31m",
    b"1_0",
    b"0x10",
    b"1e999",
    b"nan",
    b"inf",
    b"'",
)
GARBAGE += (b"t,f1,a1,a2", b"# a comment", b",,,", b"9" * 500, b"[[[[", b"{}", b'{"a":{}}', b"=1+1")
WILD = (1e18, -1.0, -1e300, 1e300, math.nan, math.inf, 0.0)
UNTIMED = ("outlier", "nan", "cut", "garbage", "extra", "crlf")  # without stamps none is missed
KINDS = ("outlier", "nan", "stamp", "cut", "repeat", "garbage", "extra", "swap", "lost", "crlf")


def motion() -> np.ndarray:
    """Force and accelerations (T, 3) of two oscillators."""
    rng, x, v = np.random.default_rng(0), np.zeros(2), np.zeros(2)
    white, table = rng.standard_normal(T + 2), np.empty((T, 3))
    for k, f in enumerate((white[:-2] + white[1:-1] + white[2:]) / 2.0):
        a = f * np.array([1.0, 0.6]) - 0.6 * v - np.array([90.0, 40.0]) * x
        v = v + DT * a
        x = x + DT * v
        table[k] = f, *a
    return table


TABLE = motion()
SIZES = dict(zip(("f1", "a1", "a2"), TABLE.std(axis=0).tolist(), strict=True))


def followed(data: bytes) -> tuple[dict[int, np.ndarray], int]:
    """Estimates by sample number, and how much was named."""
    lines = SampleLines(io.BytesIO(data), DT)
    stream, estimates = VWNNStream(VWNN(2, 1, DT), RecursiveLeastSquares(0.999)), {}
    for _, sample in lines:
        estimate = stream.estimate(sample)
        stream.update(sample.a)
        estimates[round(stream.watch.time / DT)] = estimate.numpy()
    return estimates, lines.bad + lines.mistimed + stream.watch.kinds.total()


def rendered(header: str, draw: random.Random, json: bool) -> tuple[list[bytes], str]:
    """Sound lines in the format of a header, and what separates their cells."""
    cut = next(c for c in ",;\t" if c in header)
    rows = []
    for k, (f, a1, a2) in enumerate(TABLE.tolist()):
        cells = {"t": round(k * DT, 6), "time": round(k * DT, 6), "f1": f, "a1": a1, "a2": a2}
        names = header.split(cut)
        if json:
            pairs = ", ".join(f'"{name}": {cells[name]!r}' for name in names)
            rows.append(f"{{{pairs}}}")
        else:
            rows.append(cut.join(repr(cells[name]) for name in names))
    return [row.encode() for row in ([] if json else [header]) + rows], cut


def damaged(
    rows: list[bytes], k: int, kind: str, header: str, cut: str, draw: random.Random
) -> None:
    """Damage line k in place; `rows` keep their number."""
    names, json = header.split(cut), rows[k][:1] == b"{"
    sep = b", " if json else cut.encode()
    cells = rows[k].strip(b"{}\r\n").split(sep)

    def put(name: str, value: str) -> None:
        i = names.index(name)
        cells[i] = (f'"{name}": {value}' if json else value).encode()
        rows[k] = (b"{%s}" if json else b"%s") % sep.join(cells)

    stamp = "t" if "t" in names else "time"
    if kind == "outlier":
        name = draw.choice(["f1", "a1", "a2"])
        put(name, repr(draw.choice([-1, 1]) * SIZES[name] * draw.choice([25, 100, 1e6, 1e300])))
    elif kind == "nan":
        put(draw.choice(["f1", "a1", "a2"]), "NaN")
    elif kind == "stamp" and stamp in names:
        wild = (*WILD, *(k * DT + DT * draw.choice([-3, -1, 1, 2, 50, 500]) for _ in range(3)))
        put(stamp, repr(draw.choice(wild)).replace("nan", "NaN").replace("inf", "Infinity"))
    elif kind == "cut":
        rows[k] = rows[k][: draw.randrange(len(rows[k]) - 1)]
    elif kind == "repeat":
        rows[k] = rows[k - 1]
    elif kind == "garbage":
        at = draw.randrange(len(rows[k]))
        junk = draw.choice(GARBAGE) or b"?"
        rows[k] = draw.choice([junk, rows[k][:at] + junk + rows[k][at:], draw.randbytes(60)])
        rows[k] = rows[k].replace(b"\n", b" ")
    elif kind == "extra":
        rows[k] += sep + b"1.0" * draw.randrange(1, 9)
    elif kind == "swap":
        rows[k], rows[k - 1] = rows[k - 1], rows[k]
    elif kind == "lost":
        rows[k] = b""
    elif kind == "crlf":
        rows[k] += b"\r"


class Target:
    name = "live_lines"

    def __init__(self) -> None:
        VWNNStream(VWNN(2, 1, DT), RecursiveLeastSquares(0.999))  # compiled once, for all children

    def prepare(self, folder: Path) -> None:
        """Estimates of the sound stream."""
        torch.set_num_threads(1)
        estimates, named = followed(b"\n".join(rendered(HEADERS[0], random.Random(0), False)[0]))
        assert named == 0
        np.save(folder / "sound.npy", np.stack([estimates[k] for k in range(T)]))

    def attempt(self, draw: random.Random, folder: Path) -> Attempt:
        header, json = draw.choice(HEADERS), draw.random() < 0.3
        rows, cut = rendered(header, draw, json)
        step = draw.choice([60, 120, 400])  # at most one damage in so many lines
        places = [k + draw.randrange(step - 40) for k in range(100, len(rows) - step, step)]
        chosen = draw.sample(
            KINDS if header[0] == "t" or "\t" in header else UNTIMED, draw.randint(1, 6)
        )
        done = [(k, draw.choice(chosen)) for k in places]
        for k, kind in done:
            damaged(rows, k, kind, header, cut, draw)
        end = draw.choice([b"\n", b"\r\n"])
        return Attempt(f"{header} {json=} {done}", lambda: judge(end.join(rows), done, folder))


def judge(data: bytes, done: list[tuple[int, str]], folder: Path) -> None:
    """The estimates between the damage must be those of the sound stream, nearly."""
    torch.set_num_threads(1)
    sound = np.load(folder / "sound.npy")
    estimates, named = followed(data)
    silent = ("crlf", "stamp", "garbage", "cut", "repeat", "lost")  # may change nothing that shows
    if named < sum(kind not in silent for _, kind in done):
        raise WronglyAcceptedError(f"{len(done)} lines were damaged and {named} named")
    far = [k for k in range(T // 2, T) if all(not -2 < k - at < 40 for at, _ in done)]
    there = [k for k in far if k in estimates]
    if len(there) < 0.9 * len(far):
        raise WronglyAcceptedError(f"of {len(far)} sound samples {len(there)} were estimated")
    truth = TABLE[there, 1:]
    error, clean = (np.linalg.norm(u - truth) for u in (
        np.stack([estimates[k] for k in there]), sound[there]))  # fmt: skip
    if not error <= 1.2 * clean:
        raise WronglyAcceptedError(
            f"the error is {error / clean:.3g} times that of the sound stream"
        )
