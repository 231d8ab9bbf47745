"""Linear state-space model: its poles by subspace identification, the rest by least squares.

z[k+1] = A z[k] + B u[k],   y[k] = C z[k] + D u[k]

Future outputs are projected orthogonally to future inputs onto past data; what is left spans the
observability matrix, whose shift has the poles of A.
                              Verhaegen (1994), Automatica 30 (PO-MOESP); Ljung (1999), Sect. 10.6
Given the poles, every entry of the transfer function is a sum of first-order terms, whose sizes are
linear in the response.   B records, T samples, n DOFs, m inputs, q outputs, N poles.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Annotated

import numpy as np
import torch
from torch import Tensor, nn

from data.annotations import Range
from data.record import Record
from models.fit.blocks import (
    PATIENCE,
    FromExcitation,
    Grams,
    Motion,
    Piece,
    blocks_of,
    fewest,
    motions_of,
    scales_of,
    sizes_of,
)

ORDERS = (1, 2, 3, 4, 6, 8, 10, 12, 16, 20, 24, 30, 36)  # numbers of poles that are tried
ROWS = 13  # block rows of future data, at most: each output can tell of six modes
INPUTS = 240  # values of future inputs, at most: QR costs their square
WINDOWS = 20  # times the values of a window: so many windows are taken, at most
SLOW = 0.95  # share of the outputs' power below the Nyquist frequency of the block rows
RIDGE = 1e-11  # on columns of unit length: above the rounding of normal equations

Order = Annotated[int, Range(1, ORDERS[-1])]


class LinearStateSpace(FromExcitation):
    """Linear state-space model that is driven by the excitation.

    order: poles that are tried, at most. Their number is chosen by blocks of the records that are
    held back in turn, the least within one standard error of the best. Poles that would grow are
    made to decay.
    """

    poles: Tensor  # (order, 2), real and imaginary parts, both of a pair
    order: Tensor  # (): how many there are

    def __init__(self, dofs: int, inputs: int, dt: float, order: Order = ORDERS[-1]) -> None:
        super().__init__(dofs, inputs, dt)
        empty = torch.full((1 + order, inputs, 3 * dofs), torch.nan, dtype=torch.float64)
        self.weights = nn.Parameter(empty, requires_grad=False)  # of [a, x, v]: D, then each pole
        self.register_buffer("poles", torch.zeros(order, 2, dtype=torch.float64))
        self.register_buffer("order", torch.tensor(0))

    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        motions = motions_of(batches)
        blocks = blocks_of(motions, self.dofs)
        subspaces = Subspaces(motions, blocks, self.dofs)
        most = min(subspaces.most_poles, len(self.poles))
        tried: list[np.ndarray] = []
        for n in (n for n in ORDERS if n <= most):
            each = (subspaces.poles(n, without=k) for k in range(len(blocks)))
            grams = (self._grams(motions, blocks, poles) for poles in each)
            tried.append(np.array([g.held_back_error(RIDGE, k) for k, g in enumerate(grams)]))
            best = int(np.mean(tried, axis=1).argmin())
            if n > 2 * self.dofs and len(tried) - best > PATIENCE:
                break
        chosen = fewest(np.array(tried))
        poles = subspaces.poles(ORDERS[chosen])
        w = self._grams(motions, blocks, poles).weights(RIDGE)
        w = w.reshape(1 + len(poles), self.inputs, -1)
        self.weights.data.zero_()[: len(w), :, : w.shape[-1]] = torch.from_numpy(w)
        self.poles.zero_()[: len(poles)] = torch.from_numpy(poles)
        self.order.fill_(len(poles))
        error = 100.0 * float(np.sqrt(tried[chosen].mean()))
        return {"poles": len(poles), "held_out_error_percent": error}

    def _grams(
        self, motions: Sequence[Motion], blocks: Sequence[Sequence[Piece]], poles: np.ndarray
    ) -> Grams:
        features = [terms(motion.u, poles) for motion in motions]
        products = []
        for block in blocks:
            phi = np.concatenate([features[p.motion][p.start : p.stop] for p in block])
            y = np.concatenate([motions[p.motion].y[p.start : p.stop] for p in block])
            products.append((phi.T @ phi, phi.T @ y))
        grams, targets = (np.array(of_blocks) for of_blocks in zip(*products, strict=True))
        return Grams(grams, targets, sizes_of(motions, blocks, self.dofs), self.dofs)

    @property
    def identified_parameters(self) -> int:
        n = int(self.order)
        return n + (1 + n) * self.inputs * self.dofs

    def outputs(self, u: Tensor) -> Tensor:
        """[a, x, v] (…, T, 3n)."""
        self.require_identified(self.weights)
        phi = terms(u.detach().cpu().numpy(), self.poles[: int(self.order)].cpu().numpy())
        weights = self.weights[: 1 + int(self.order)].flatten(0, 1)
        return torch.from_numpy(phi).to(u.device) @ weights


def terms(u: np.ndarray, poles: np.ndarray) -> np.ndarray:
    """u (…, T, m), and what first-order systems with poles (N, 2) make of it: (…, T, (1 + N) m).

    Of a pair of poles the first term is the real part, the second the imaginary part.
    """
    from scipy.signal import lfilter  # slow to import

    parts, pair = [u], u
    for real, imaginary in poles:
        if imaginary < 0.0:  # the second of the pair before
            parts.append(pair.imag)
            continue
        pole = complex(real, imaginary) if imaginary else real
        pair = lfilter([0.0, 1.0], [1.0, -pole], u, axis=-2)
        parts.append(pair.real)
    return np.concatenate(parts, axis=-1)


class Subspaces:
    """Poles from the windows of all blocks but one.

    A window has a past and a future of `rows` block rows each, `stride` samples apart: a slow
    motion hardly changes in a sample. No window lies across two blocks, or two records. Of inputs
    the future has every sample, for the outputs depend on them all.
    """

    def __init__(
        self, motions: Sequence[Motion], blocks: Sequence[Sequence[Piece]], dofs: int
    ) -> None:
        u_size, y_size = (scales_of(s) for s in ([m.u for m in motions], [m.y for m in motions]))
        self.dofs, self.inputs = dofs, motions[0].u.shape[1]
        self.longest = max(len(motion.u) for motion in motions)
        pieces = [piece for block in blocks for piece in block]
        self.stride, self.rows = stride_of(motions, dofs), ROWS
        self.stride = max(1, min(self.stride, INPUTS // (ROWS * self.inputs)))
        while self.rows > 1 and self._windows(pieces) < self._values:
            self.stride, self.rows = max(1, self.stride // 2), self.rows - (self.stride == 1)
        if self.rows == 1:
            raise ValueError("the records are too short for a linear state-space model")
        every = max(1, self._windows(pieces) // (WINDOWS * self._values))
        scaled = [(m.u / u_size, m.y[:, :dofs] / y_size[:dofs]) for m in motions]
        data = ([self._data(*scaled[p.motion], p, every) for p in block] for block in blocks)
        self.triangles = [np.linalg.qr(np.concatenate(parts), mode="r") for parts in data]
        self.known: dict[int | None, np.ndarray] = {}

    @property
    def most_poles(self) -> int:
        return (self.rows - 1) * self.dofs

    @property
    def _values(self) -> int:
        """Of a window."""
        return self.rows * (self.inputs * (self.stride + 1) + 2 * self.dofs)

    def _windows(self, pieces: Sequence[Piece]) -> int:
        length = 2 * self.rows * self.stride
        return sum(max(0, p.stop - p.start - length + 1) for p in pieces)

    def _data(self, u: np.ndarray, y: np.ndarray, piece: Piece, every: int) -> np.ndarray:
        """Future inputs, the past, future outputs of every so many windows (W, values)."""
        half = self.rows * self.stride
        if piece.stop - piece.start < 2 * half:
            return np.zeros((0, self._values))
        windows = [
            np.lib.stride_tricks.sliding_window_view(s[piece.start : piece.stop], 2 * half, axis=0)
            [::every] for s in (u, y)
        ]  # fmt: skip
        ahead, past_u = windows[0][..., half:], windows[0][..., : half : self.stride]
        past_y, future = (windows[1][..., k : k + half : self.stride] for k in (0, half))
        parts = (ahead, past_u, past_y, np.swapaxes(future, 1, 2))  # block rows of all outputs
        return np.concatenate([part.reshape(len(ahead), -1) for part in parts], axis=1)

    def poles(self, count: int, without: int | None = None) -> np.ndarray:
        """So many poles (N, 2), or one less or more where a pair would be cut, without a block."""
        if without not in self.known:
            own = [R for k, R in enumerate(self.triangles) if k != without]
            R = np.asarray(np.linalg.qr(np.concatenate(own), mode="r"))
            ahead, outputs = self.rows * self.stride * self.inputs, self.rows * self.dofs
            projected = R[ahead : self._values - outputs, -outputs:]
            self.known[without] = np.linalg.svd(projected)[2].T
        observed = self.known[without][:, :count]
        above, below = observed[: -self.dofs], observed[self.dofs :]
        shifted = np.linalg.eigvals(np.linalg.lstsq(above, below)[0])
        shifted = shifted[(shifted.imag > 0.0) | ((shifted.imag == 0.0) & (shifted.real > 0.0))]
        size, angle = np.abs(shifted) ** (1.0 / self.stride), np.angle(shifted) / self.stride
        size = np.minimum(size, np.exp(-1.0 / self.longest))  # none grows, or outlasts a record
        found = size * np.exp(1j * angle)
        return np.array([[pole.real, imaginary] for pole in found
                         for imaginary in ([pole.imag, -pole.imag] if pole.imag else [0.0])]
                        ).reshape(-1, 2)  # fmt: skip


def stride_of(motions: Sequence[Motion], dofs: int) -> int:
    """Samples between block rows whose Nyquist frequency is above most of the outputs' power."""
    strides = []
    for motion in motions:
        y = motion.y[motion.first :, :dofs]
        power = np.square(np.abs(np.fft.rfft(y - y.mean(axis=0), axis=0))).sum(axis=1).cumsum()
        strides.append(len(power) / (1.0 + np.searchsorted(power, SLOW * power[-1])))
    return max(1, int(np.median(strides)))
