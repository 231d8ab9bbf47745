"""A picture of a few kilobytes: the free run, the true motion, and a loop of an element."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from data.record import Record
from models.estimator import Estimator, NoFreeRunError, simulate
from models.fit.metrics import left_at
from models.fit.trained_range import loops_of

WIDTH, HEIGHT, POINTS = 540, 180, 110
TOP = 21  # beneath the words
TRUE, OWN = "#222222", "#d1495b"


@torch.no_grad()
def picture_of(model: Estimator, record: Record, colour: str = OWN) -> str:
    """SVG of one test record (T, ·): its last part, where a drift would show."""
    way, estimate = _estimate(model, record)
    part = slice(max(0, record.samples - 4 * POINTS), None)
    dof = int(record.a.abs().amax(dim=0).argmax())
    true, own = record.a[part, dof].numpy(), estimate[part, dof].numpy()
    loops = loops_of(model, record) if way == "free run" else None
    wide = WIDTH if loops is None else WIDTH - HEIGHT
    time = np.arange(len(true))
    box = (0, TOP, wide - 9, HEIGHT - TOP)
    curves = _lines(time, [true, own], [TRUE, colour], box)
    if loops is not None:
        y, r = (loop[part].numpy() for loop in loops)
        most = int((np.abs(np.diff(y, axis=0)) * np.abs(r[1:])).sum(axis=0).argmax())
        curves += _lines(y[:, most], [r[:, most]], [colour], (wide, TOP, HEIGHT, HEIGHT - TOP))
    caption = f"x{record.dof_numbers[dof]}, last {record.dt * len(true):.3g} s: measured, and {way}"
    texts = [_text(2, caption)]
    if loops is not None:
        texts.append(_text(wide, f"force of element {most + 1}"))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        f'width="{WIDTH}" fill="none"><rect width="100%" height="100%" fill="#fff"/>'
        f"{''.join((*texts, *curves))}</svg>\n"
    )


def _text(place: int, words: str) -> str:
    font = 'font-size="13" font-family="sans-serif"'
    return f'<text x="{place}" y="14" {font} fill="{TRUE}">{words}</text>'


def _estimate(model: Estimator, record: Record) -> tuple[str, torch.Tensor]:
    """The free run where it stays, else the estimate one step ahead."""
    try:
        a = simulate(model, record).a
        if not left_at(a, record):
            return "free run", a
    except NoFreeRunError:
        pass
    return "one step ahead (its free run diverges)", model(record.measured())


def _lines(
    x: np.ndarray, curves: Sequence[np.ndarray], colours: Sequence[str], box: Sequence[int]
) -> list[str]:
    """Polylines within a box (left, top, width, height), of some points each."""
    left, top, width, height = box
    low, high = min(c.min() for c in curves), max(c.max() for c in curves)
    kept = np.unique(np.linspace(0, len(x) - 1, POINTS).astype(int))
    across = left + 2 + (width - 4) * (x[kept] - x.min()) / max(np.ptp(x), 1e-300)
    drawn = []
    for curve, colour in zip(curves, colours, strict=True):
        down = top + 2 + (height - 4) * (high - curve[kept]) / max(high - low, 1e-300)
        drawn.append(f'<path d="{_path(across, down)}" stroke="{colour}"/>')
    return drawn


def _path(across: np.ndarray, down: np.ndarray) -> str:
    """Whole steps from point to point, which are short."""
    places = np.rint(np.stack([across, down], axis=1)).astype(int)
    steps = np.diff(places, axis=0)
    first = f"M{places[0, 0]} {places[0, 1]}l"
    return first + "".join(f"{x:+d}{y:+d}" for x, y in steps).replace("+", " ").strip()
