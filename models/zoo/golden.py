"""A short motion of a published model, kept to the last digit: a change of code that shows in it.

golden.npz: u (T, m) of the excitation as whole numbers, `unit` (m,) of each channel, `hold`, the
number of what it does between samples; at rest before it; `at`, the samples that are kept, and x, v, a (samples, n) of the free run there. A model that
cannot simulate keeps its estimates one step ahead, from a motion at rest, as `a`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from data.record import HOLDS, Drive, Record
from models.estimator import Estimator, NoFreeRunError

SAMPLES, EVERY = 240, 8  # of the motion, and between the samples that are kept
STEPS = 2**14  # whole numbers from zero to the largest excitation
SIGNALS = ("x", "v", "a")


def excitation_of(u: torch.Tensor, hold: str) -> dict[str, np.ndarray]:
    """A part of an excitation (T, m) about its largest value, as whole numbers and their unit."""
    strength = (u.abs() / u.abs().amax(dim=0).clamp_min(1e-300)).amax(dim=1)
    first = max(0, min(int(strength.argmax()) - SAMPLES // 3, len(u) - SAMPLES))
    part = u[first : first + SAMPLES].numpy()
    largest = np.maximum(np.abs(part).max(axis=0), 1e-12)
    unit = 2.0 ** np.ceil(np.log2(largest / STEPS))  # of two, so that products are exact
    whole = np.rint(part / unit).astype(np.int16)
    return {"u": whole, "unit": unit, "hold": np.array(HOLDS.index(hold), dtype=np.int8)}


def run(model: Estimator, golden: dict[str, np.ndarray]) -> dict[str, torch.Tensor]:
    """x, v and a (T, n) of the model under the golden excitation."""
    u = torch.from_numpy(golden["u"].astype(np.float64) * golden["unit"])
    hold, rest = HOLDS[int(golden["hold"])], torch.zeros(model.dofs, dtype=torch.float64)
    try:
        motion = model.free_run(Drive(model.dt, u, rest, rest, hold))
    except NoFreeRunError:
        still = torch.zeros(len(u), model.dofs, dtype=torch.float64)
        record = Record(model.dt, a=still, f=u, x=still, v=still, hold=hold)
        return {"a": model(record)}
    return {name: getattr(motion, name) for name in SIGNALS}


@torch.no_grad()
def golden_of(model: Estimator, u: torch.Tensor, hold: str, bound: float) -> dict[str, np.ndarray]:
    """What golden.npz holds: until the motion exceeds `bound`, where the model diverges."""
    golden = excitation_of(u, hold)
    motion = run(model, golden)
    gone = ~(motion["a"].abs() <= bound).all(dim=1)
    stop = int(gone.int().argmax()) if gone.any() else len(gone)
    golden["u"] = golden["u"][: max(stop, 3)]
    motion = run(model, golden)
    golden["at"] = np.arange(EVERY - 1, len(golden["u"]), EVERY, dtype=np.int16)
    kept = {name: u.numpy()[golden["at"]] for name, u in motion.items() if u.any()}
    return golden | kept


@torch.no_grad()
def difference(model: Estimator, path: Path) -> float:
    """Largest difference from the golden motion, relative to the largest value of each signal."""
    with np.load(path, allow_pickle=False) as file:
        golden = dict(file)
    motion = run(model, golden)
    worst = 0.0
    for name in (name for name in SIGNALS if name in golden):
        kept = golden[name]
        apart = np.abs(motion[name].numpy()[golden["at"]] - kept).max(initial=0.0)
        worst = max(worst, float(apart / np.abs(kept).max(initial=1e-300)))
    return worst
