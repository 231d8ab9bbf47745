"""Good records, and such with something the matter."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from benchmarks.attack.library.arguments import DT, IMPOSED, STRANGE, changed
from data.record import Drive, Record


def motion(draw: random.Random, n: int, m: int, samples: int = 300) -> Record:
    """A good record: a damped oscillator's motion, near enough."""
    generator = torch.Generator().manual_seed(draw.randrange(1000))
    noise = torch.randn(samples, m, generator=generator, dtype=torch.float64)
    f = torch.cumsum(noise, 0) * 0.1
    f = f - f.mean(dim=0)
    first = f[:, :1] if m else torch.randn(samples, 1, generator=generator, dtype=torch.float64)
    x = torch.cumsum(torch.cumsum(0.01 * first, 0), 0) * DT
    x = x - torch.linspace(0, 1, samples, dtype=torch.float64)[:, None] * x[-1:]
    x = x.repeat(1, n) * torch.linspace(1.0, 2.0, n, dtype=torch.float64)
    x = x + 0.01 * torch.randn(samples, n, generator=generator, dtype=torch.float64)
    v = torch.gradient(x, spacing=DT, dim=0)[0]
    pushed = f.repeat(1, n)[:, :n] if m else torch.zeros(samples, n, dtype=torch.float64)
    return Record(DT, pushed - 30.0 * x - 0.5 * v, f, x, v)


def imposed(draw: random.Random, samples: int = 300) -> Record:
    """A good test of one element."""
    t = DT * torch.arange(samples, dtype=torch.float64)[:, None]
    s = torch.sin(draw.uniform(1.0, 9.0) * t) * t
    rate = torch.gradient(s, spacing=DT, dim=0)[0]
    return Record(DT, 3.0 * s + 0.1 * rate + s**3, s[:, :0], s=s, s_dot=rate, quantity="force")


def spoilt_signal(draw: random.Random, u: Tensor) -> Any:
    """A signal with something the matter."""
    k = draw.randrange(u.shape[-2])
    wild = draw.choice([math.nan, math.inf, -math.inf, 1e300, 1e30, 1e9])
    ways: list[Callable[[], Any]] = [
        lambda: u.float(),
        lambda: u.half(),
        lambda: u.long(),
        lambda: u.bool(),
        lambda: u.to(torch.complex128),
        lambda: u.numpy(),
        lambda: u.tolist(),
        lambda: u.to("meta"),
        lambda: u.clone().requires_grad_(),
        lambda: u.T.contiguous().T,
        lambda: torch.stack([u, u], dim=-1)[..., 0],
        lambda: u.expand(2, *u.shape),
        lambda: u[:0],
        lambda: u[:1],
        lambda: u[:2],
        lambda: u[..., :0],
        lambda: u[:, :1].flatten(),
        lambda: u[None],
        lambda: u[None][:0],
        lambda: u[:-1],
        lambda: torch.cat([u, u], dim=-1),
        lambda: u * 0.0,
        lambda: u * 1e-300,
        lambda: u * 1e150,
        lambda: u.index_fill(-2, torch.tensor([k]), wild),
        lambda: u.to_sparse(),
        lambda: None,
        lambda: draw.choice(STRANGE),
    ]
    return draw.choice(ways)()


def spoilt(draw: random.Random, record: Record) -> Record:
    """A record some signals of which, or all, have something the matter."""
    way = draw.randrange(6)
    if way == 0:
        return record
    if way == 1:
        return replace(record, **changed(draw, {"dt": DT, "warmup": 0, "hold": "linear"}))
    if way == 2:
        kind = draw.choice(["periodic", "given", "rest", "unknown", "unknown", "never"])
        hold = draw.choice(["linear", "zero_order", "band_limited"])
        warmup = draw.choice([0, 0, 20, record.samples, -1])
        return replace(record, initial_state=kind, hold=hold, warmup=warmup)
    if way == 3:
        state = draw.getstate()

        def alike(u: Tensor) -> Any:
            draw.setstate(state)
            return spoilt_signal(draw, u)

        return record.map(alike)
    names = draw.sample(sorted(record.signals()), draw.randint(1, 2))
    return replace(record, **{name: spoilt_signal(draw, getattr(record, name)) for name in names})


def sizes_of(draw: random.Random, name: str) -> tuple[int, int, Record]:
    if name in IMPOSED:
        return 1, 2, imposed(draw)
    n = draw.randint(1, 3)
    m = n if name == "ModalPolynomial" else draw.choice([n, n, 1, 0 if name != "VWNN" else 1])
    record = motion(draw, n, m, draw.choice([300, 300, 40]))
    if m > 1 and name != "ModalPolynomial" and draw.random() < 0.3:  # the last is no force
        record = replace(record, f=record.f[:, :-1], e=record.f[:, -1:])
    return n, m, record


def drive_of(draw: random.Random, record: Record) -> Any:
    whole = record.drive()
    names = draw.sample(["u", "x0", "v0", "dt", "hold"], draw.randint(1, 2))
    new: dict[str, Any] = {}
    for name in names:
        value = getattr(whole, name)
        spoil = isinstance(value, Tensor) and draw.random() < 0.7
        new[name] = spoilt_signal(draw, value if value.ndim > 1 else value[None]) if spoil else (
            draw.choice(STRANGE)
        )  # fmt: skip
    return Drive(**{**vars(whole), **new})
