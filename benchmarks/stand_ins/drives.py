"""Simulated drives that stand-ins are made of: a positioner with friction, two coupled drives.

Equations of their own, and no model's code: friction that falls with the speed and then rises as a
power of it, by small steps; a belt between motors and a pulley, by Runge–Kutta.   T samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data.numba_cache import compilers

compiled, inlined = compilers(Path(__file__))

STEPS, FINE = 120, 100  # a sample, of coupled drives and of a positioner
KP, KV, LARGEST = 160.0, 243.0, 10.0  # of the controller [1/s], [V s/m], [V]


@dataclass(frozen=True)
class Positioner:
    """A mass on a screw, driven by a voltage, against friction that differs by direction."""

    mass: float = 95.0  # kg
    gain: float = 35.0  # N/V
    offset: float = -3.2  # N
    sliding: tuple[float, float] = (19.0, 21.0)  # N, dry friction: forwards, backwards
    breaking: tuple[float, float] = (22.0, 25.0)  # N, until it moves
    stribeck: float = 4e-3  # m/s, over which the one becomes the other
    viscous: float = 150.0  # N/(m/s)^exponent
    exponent: float = 0.85


@inlined
def _acceleration(force, v, side, law):
    mass, forwards, backwards, up, down, stribeck, viscous, exponent = law
    low, high = (forwards, up) if side > 0.0 else (backwards, down)
    dry = low + (high - low) * np.exp(-((v / stribeck) ** 2))
    return (force - side * (dry + viscous * abs(v) ** exponent)) / mass


@compiled
def _controlled(wanted, pushes, dt, gain, offset, law, u, q):
    """Fills voltages u and positions q (T,) of a mass that is to follow `wanted` (T,)."""
    h, x, v, before = dt / FINE, 0.0, 0.0, 0.0
    for t in range(q.size):
        q[t], speed, before = x, (x - before) / dt, x
        asked = KV * (KP * (wanted[t] - x) - speed)
        u[t] = min(max(asked, -LARGEST), LARGEST) + pushes[t]
        force = gain * u[t] - offset
        for _ in range(FINE):
            if v == 0.0 and -law[4] <= force <= law[3]:
                continue
            side = np.sign(v) if v != 0.0 else np.sign(force)
            middle = v + 0.5 * h * _acceleration(force, v, side, law)
            middle = middle if middle * side > 0.0 else 0.0
            end = v + h * _acceleration(force, middle, side, law)
            end = end if end * side > 0.0 else 0.0  # it comes to rest, and sees whether it stays
            x, v = x + 0.5 * h * (v + end), end


def moves(samples: int, dt: float, rng: np.random.Generator) -> np.ndarray:
    """Wanted positions (T,) [m]: moves to and fro at many speeds, ends smooth, pauses between."""
    parts, here = [np.zeros(300)], 0.0
    while sum(map(len, parts)) < samples:
        there = rng.uniform(0.0, 0.25)
        there = there if abs(there - here) > 0.05 else here + 0.1 * (1.0 if here < 0.12 else -1.0)
        speed = rng.uniform(0.03, 0.13)
        count = int(1.5 * abs(there - here) / speed / dt)
        s = np.linspace(0.0, 1.0, count)
        parts += [here + (there - here) * s * s * (3.0 - 2.0 * s), np.full(200, there)]
        here = there
    return np.concatenate(parts)[:samples]


def positioned(
    system: Positioner, wanted: np.ndarray, pushes: np.ndarray, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """Voltages and positions (T,) from rest; pushes (T,) [V] are added to the controller's own."""
    s, u, q = system, np.empty(len(wanted)), np.empty(len(wanted))
    law = (s.mass, *s.sliding, *s.breaking, s.stribeck, s.viscous, s.exponent)
    _controlled(wanted, pushes, dt, s.gain, s.offset, law, u, q)
    return u, q


@dataclass(frozen=True)
class Coupled:
    """Two motors that turn one pulley by a belt; what counts its turns knows no direction."""

    gain: float = 27.0  # (ticks/s²)/V, of both motors
    inertia: float = 0.6  # of the pulley, that of the motors being 1
    belt: float = 190.0  # 1/s²
    damping: tuple[float, float] = (8.0, 6.0)  # 1/s, of the motors and of the pulley
    dry: float = 0.6  # ticks/s², friction of the pulley
    corner: float = 0.03  # ticks/s, within which the counter does not see the speed
    filter: float = 60.0  # rad/s, of what is counted


@inlined
def _turned(u, state, law, slopes):
    gain, inertia, belt, c1, c2, dry, corner, low_pass = law
    one, stretch, two, read = state
    slopes[0] = gain * u - c1 * one - belt * stretch
    slopes[1] = one - two
    slopes[2] = (belt * stretch - c2 * two - dry * np.tanh(two / 0.05)) / inertia
    slopes[3] = low_pass * (np.sqrt(two * two + corner * corner) - corner - read)


@compiled
def _counted(u, dt, law, y):
    h, state, tried = dt / STEPS, np.zeros(4), np.zeros(4)
    s1, s2, s3, s4 = np.zeros((4, 4))
    for t in range(y.size):
        y[t] = state[3]
        for _ in range(STEPS):
            _turned(u[t], state, law, s1)
            tried[:] = state + 0.5 * h * s1
            _turned(u[t], tried, law, s2)
            tried[:] = state + 0.5 * h * s2
            _turned(u[t], tried, law, s3)
            tried[:] = state + h * s3
            _turned(u[t], tried, law, s4)
            state += h / 6.0 * (s1 + 2.0 * s2 + 2.0 * s3 + s4)


def counted(system: Coupled, u: np.ndarray, dt: float) -> np.ndarray:
    """Speeds without direction (T,) under a voltage that is held, from rest [ticks/s]."""
    s, y = system, np.empty(len(u))
    law = (s.gain, s.inertia, s.belt, *s.damping, s.dry, s.corner, s.filter)
    _counted(u, dt, law, y)
    return y
