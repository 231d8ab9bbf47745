"""A short motion of a published model, kept to the last digit: a change of code that shows in it.

golden.npz: u (T, m) of the excitation as whole numbers; unit (m + 1,), that of each channel and the
number of what the excitation does between samples; motion (k, n·s): x, v and a of the free run,
from rest, at every so-many-th sample, without those that are nil throughout. Of a model that cannot
simulate, its estimates one step ahead from a motion at rest.
"""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from pathlib import Path

import numpy as np
import torch

from data.plain_data import LARGEST
from data.record import HOLDS, Drive, Record
from models.estimator import Estimator, NoFreeRunError

SAMPLES, EVERY = 160, 16  # of the motion, and between the samples that are kept
DIMENSIONS = {"u": 2, "unit": 1, "motion": 2}
ZIP_ERRORS = (  # of zipfile, on damaged archives, and on those that ask for a password
    zipfile.BadZipFile, zlib.error, KeyError, EOFError, NotImplementedError, RuntimeError,
    OverflowError,
)  # fmt: skip
STEPS = 2**14  # whole numbers from zero to the largest excitation


def excitation_of(u: torch.Tensor, hold: str) -> dict[str, np.ndarray]:
    """A part of an excitation (T, m) about its largest value, as whole numbers and their unit."""
    strength = (u.abs() / u.abs().amax(dim=0).clamp_min(1e-300)).amax(dim=1)
    first = max(0, min(int(strength.argmax()) - SAMPLES // 3, len(u) - SAMPLES))
    part = u[first : first + SAMPLES].numpy()
    largest = np.maximum(np.abs(part).max(axis=0), 1e-12)
    unit = 2.0 ** np.ceil(np.log2(largest / STEPS))  # of two, so that products are exact
    whole = np.rint(part / unit).astype(np.int16)
    return {"u": whole, "unit": np.append(unit, float(HOLDS.index(hold)))}


@torch.no_grad()
def run(model: Estimator, golden: dict[str, np.ndarray]) -> np.ndarray:
    """Motion (T, n·s) of the model under the golden excitation: x, v, a, those that are not nil."""
    unit, hold = golden["unit"][:-1], HOLDS[int(golden["unit"][-1])]
    u = torch.from_numpy(golden["u"].astype(np.float64) * unit)
    rest = torch.zeros(model.dofs, dtype=torch.float64)
    try:
        motion = model.free_run(Drive(model.dt, u, rest, rest, hold))
        signals = [s for s in (motion.x, motion.v, motion.a) if s.any()]
    except NoFreeRunError:
        still = torch.zeros(len(u), model.dofs, dtype=torch.float64)
        signals = [model(Record(model.dt, a=still, f=u, x=still, v=still, hold=hold))]
    return torch.cat(signals, dim=-1).numpy()


def golden_of(model: Estimator, u: torch.Tensor, hold: str, bound: float) -> dict[str, np.ndarray]:
    """What golden.npz holds: until the motion exceeds `bound`, where the model diverges."""
    golden = excitation_of(u, hold)
    gone = ~(np.abs(run(model, golden)[:, -model.dofs :]) <= bound).all(axis=1)
    if gone.any():
        golden["u"] = golden["u"][: max(int(gone.argmax()), EVERY)]
    return golden | {"motion": run(model, golden)[EVERY - 1 :: EVERY]}


def read_golden(path: Path) -> dict[str, np.ndarray]:
    """What golden.npz holds. Raises ValueError for another file, OSError for none.

    An array takes the room of its bytes, whatever its header says.
    """
    try:
        with zipfile.ZipFile(path) as file:
            golden = {name: _array(file, name) for name in DIMENSIONS}
        channels = golden["u"].shape[1]
        if len(golden["unit"]) != channels + 1 or golden["unit"][-1] not in range(len(HOLDS)):
            raise ValueError(f"{channels} channels have not as many units and a hold")
    except (*ZIP_ERRORS, ValueError) as error:
        raise ValueError(f"{path} holds no golden motion ({error})") from None
    return golden


def _array(file: zipfile.ZipFile, name: str) -> np.ndarray:
    with file.open(f"{name}.npy") as member:
        content = member.read(LARGEST + 1)
    header = io.BytesIO(content)
    np.lib.format.read_magic(header)
    shape, _, dtype = np.lib.format.read_array_header_1_0(header)
    rest = len(content) - header.tell()
    if dtype.kind not in "if" or len(shape) != DIMENSIONS[name]:
        raise ValueError(f"{name} is {dtype} {shape}")
    if math.prod(shape) * dtype.itemsize != rest or len(content) > LARGEST:
        raise ValueError(f"{name} {shape} has {rest} bytes")
    return np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)


def difference(model: Estimator, path: Path) -> float:
    """Largest difference from the golden motion, relative to the largest value of each column."""
    golden = read_golden(path)
    motion, then = run(model, golden)[EVERY - 1 :: EVERY], golden["motion"]
    if motion.shape != then.shape:
        return float("inf")
    apart = np.abs(motion - then).max(axis=0) / np.abs(then).max(axis=0, initial=1e-300)
    return float(apart.max())
