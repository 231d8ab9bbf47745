"""Large arrays for results: where they lie decides how soon they are filled."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

LINE = 64  # bytes that a processor fetches at once


def room(*shape: int) -> Tensor:
    """An array of float64 without values yet.

    NumPy asks for huge pages, PyTorch does not: large arrays are filled much sooner. The first
    number lies where a line of the cache begins, so that BLAS sums in the same order in any array.
    """
    size = math.prod(shape)
    raw = np.empty(size + LINE // 8)
    begin = -raw.ctypes.data % LINE // 8
    return torch.from_numpy(raw[begin : begin + size]).view(shape)
