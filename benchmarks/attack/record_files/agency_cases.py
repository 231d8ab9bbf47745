"""Accelerograms and universal files, good and with hostile headers."""

from __future__ import annotations

import random

import numpy as np

from benchmarks.attack.record_files import agencies
from benchmarks.attack.record_files.case import Case, Columns, holding
from benchmarks.attack.record_files.worsened import worsened

DT = 0.02


def agency_file(draw: random.Random) -> Case:
    """A file of a strong-motion agency; a third of them as it should be."""
    return worsened(draw, draw.choice((_csmip_v2, _csmip_v1, _cosmos, _peer))(draw))


def universal_file(draw: random.Random) -> Case:
    """A file of data sets 58."""
    channels = {n: _motion(draw) for n in range(1, draw.choice((2, 3, 4)))}
    binary = draw.random() < 0.4
    raw = agencies.uff58(channels, draw.choice((DT, 0.0, 1e-300, 1e300)), binary)
    mapped = {"s_ddot1": "acc_1X", "a1": "acc_2X"}
    case = Case(f"UFF binary={binary}", draw.choice((".uff", ".unv")), holding(raw), mapped)
    return worsened(draw, (case, raw.decode("latin-1")), ends=1100)


def _motion(draw: random.Random) -> np.ndarray:
    size = 10.0 ** draw.choice((-2, 0, 0, 1))
    generator = np.random.default_rng(draw.randrange(1000))
    return size * generator.standard_normal(draw.choice((0, 1, 2, 150, 400, 400, 400)))


def _channels(draw: random.Random) -> dict[int, tuple[str, np.ndarray]]:
    same = _motion(draw)
    numbers = draw.sample(range(1, 40), draw.choice((1, 2, 2, 2, 5)))
    places = ("N, Ground", "Up, roof \x1b[31m", "E", "", "360 Deg, [red]3rd[/red] floor")
    return {
        n: (draw.choice(places), same if draw.random() < 0.9 else _motion(draw)) for n in numbers
    }


def _mapped(numbers: list[int]) -> dict[str, str]:
    names = ["s_ddot1", *(f"a{k + 1}" for k in range(len(numbers) - 1))]
    return {name: f"acc{n}" for name, n in zip(names, numbers, strict=True)}


def _csmip_v2(draw: random.Random) -> tuple[Case, str]:
    channels = _channels(draw)
    text = agencies.csmip_v2(channels, DT, motions=draw.random() < 0.5)
    truth: Columns | None = {
        f"acc{n}": np.array([float(f"{100.0 * v:10.3f}") for v in a])
        for n, (_, a) in channels.items()
    }
    if len({len(a) for _, a in channels.values()}) > 1:
        truth = None
    mapped = _mapped(list(channels))
    return Case(f"V2 {list(channels)}", ".v2", holding(text.encode()), mapped, truth), text


def _csmip_v1(draw: random.Random) -> tuple[Case, str]:
    channels = _channels(draw)
    text = agencies.csmip_v1(channels, DT)
    mapped = _mapped(list(channels))
    return Case(f"V1 {list(channels)}", ".v1", holding(text.encode()), mapped), text


def _cosmos(draw: random.Random) -> tuple[Case, str]:
    channels, variant = _channels(draw), draw.choice(("usgs", "cgs"))
    text = agencies.cosmos(channels, DT, variant)
    mapped = _mapped(list(channels))
    return Case(f"COSMOS {variant} {list(channels)}", ".v2c", holding(text.encode()), mapped), text


def _peer(draw: random.Random) -> tuple[Case, str]:
    a = _motion(draw)
    text = agencies.peer(a, DT)
    return Case(f"AT2 {len(a)}", ".at2", holding(text.encode()), {"a1": "acc"}), text
