"""Parameters in one list, whose parts have names and shapes."""

from __future__ import annotations

from functools import cached_property

import numpy as np


class NamedParts:
    """Base of layouts: `shapes` says what parts a list of parameters (size,) has, in order."""

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        raise NotImplementedError

    @cached_property
    def size(self) -> int:
        return sum(int(np.prod(shape)) for shape in self.shapes.values())

    def split(self, values: np.ndarray) -> dict[str, np.ndarray]:
        """The parts of a list of parameters (size,), each in its shape; views of it."""
        parts, start = {}, 0
        for name, shape in self.shapes.items():
            count = int(np.prod(shape))
            parts[name] = values[start : start + count].reshape(shape)
            start += count
        return parts

    def join(self, parts: dict[str, np.ndarray]) -> np.ndarray:
        return np.concatenate([np.asarray(parts[name]).ravel() for name in self.shapes])
