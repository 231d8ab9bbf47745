"""Step of sliders in series with nonlinear springs.

r = r₀ + k s + c ṡ + Σ_j f_j(z_j),   z_j = min(max(z_j + ds, −l_j), l_j)

Sliders move with the deformation at the samples, so z moves in `observe`, into `new`, which
`advance` takes over.   J sliders, K nodes of each spring's curve.
"""

from __future__ import annotations

import numpy as np

from data.record import HOLDS
from export.step import Step
from export.steps.static import IMPOSED
from models.prandtl_ishlinskii import LINEAR, PrandtlIshlinskii


def begin(u, z, before, scale):
    """Sliders without stretch."""
    z[:] = 0.0
    before[0] = u[0] / scale[0]


def _curve(f, x):
    """A piecewise linear function on even nodes over [−1, 1]; beyond them it keeps its values."""
    K = f.size
    place = 0.5 * (min(max(x, -1.0), 1.0) + 1.0) * (K - 1)
    k = max(min(int(place), K - 2), 0)
    return f[k] + (place - k) * (f[k + 1] - f[k])


def observe(u, z, new, s, before, r, line, curves, widths, scale):
    """The force, by the deformation u[0] and its rate u[1]."""
    s[0] = u[0] / scale[0]
    force = line[0] + line[1] * s[0] + line[2] * u[1] / scale[1]
    for j in range(widths.size):
        new[j] = min(max(z[j] + (s[0] - before[0]), -widths[j]), widths[j])
        force += _curve(curves[j], new[j] / widths[j])
    r[0] = scale[2] * force


def advance(z, new, s, before):
    """The sliders keep their positions."""
    z[:] = new
    before[:] = s


def step_of(model: PrandtlIshlinskii) -> Step:
    """The step of an element of sliders. Raises ValueError for one that is not identified."""
    model.require_identified(model.weights)
    widths = model.widths.numpy()
    widths = widths[widths > 0.0]
    J, weights = len(widths), model.weights.detach().numpy()
    numbers = {
        "line": weights[:LINEAR].copy(),
        "curves": weights[LINEAR : LINEAR + J * model.nodes].reshape(J, -1).copy(),
        "widths": widths,
        "scale": model.scale.numpy().copy(),
    }
    state = {"z": np.zeros(J), "new": np.zeros(J)}
    state |= {name: np.zeros(1) for name in ("s", "before", "r")}
    return Step(
        begin, observe, advance, model.dt, state, numbers, IMPOSED, [("r", ["r1"], "N")],
        holds=HOLDS,
    )  # fmt: skip
