"""Causal FIR filter: the response as a weighted sum of the excitation's last samples.

y[k] = Σ_l h_l u[k − l],   l = 0 … L − 1,  h by ridge regression            Ljung (1999), Sect. 10.1

Whatever is linear and forgets within L samples is such a filter: a plain opponent of every model
that simulates.   B records, T samples, n DOFs, m inputs, q outputs, L taps.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Annotated

import numpy as np
import torch
from torch import Tensor, nn

from data.annotations import MOST, Range
from data.record import Record
from models.fit.blocks import (
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

FEWEST = 8  # taps, the shortest filter that is tried; the others are twice as long each
RIDGE = 1e-3  # on taps of unit power, which keeps an excitation of few frequencies from deciding


class FIR(FromExcitation):
    """Causal FIR filter of the excitation.

    features: of an output, inputs × taps at most. The length is chosen by blocks of
    the records that are held back in turn, the shortest within one standard error of the best.
    """

    taps: Tensor  # (): how many are used

    def __init__(
        self, dofs: int, inputs: int, dt: float, features: Annotated[int, Range(1, MOST)] = 600
    ) -> None:
        super().__init__(dofs, inputs, dt)
        most = max(1, features // max(1, inputs))
        empty = torch.full((most, inputs, 3 * dofs), torch.nan, dtype=torch.float64)
        self.weights = nn.Parameter(empty, requires_grad=False)  # of [a, x, v]
        self.register_buffer("taps", torch.tensor(0))

    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        motions = motions_of(batches)
        scale = scales_of([motion.u for motion in motions])
        scaled = [Motion(m.u / scale, m.y, m.first) for m in motions]
        blocks = blocks_of(scaled, self.dofs)
        longest = min(len(self.weights), max(len(motion.u) for motion in motions) // 2)
        grams = grams_of(scaled, blocks, longest, self.dofs)
        lengths = [longest]
        while lengths[0] > FEWEST:
            lengths.insert(0, lengths[0] // 2)
        cut = [grams.first(taps * self.inputs) for taps in lengths]
        errors = np.array(
            [[g.held_back_error(RIDGE, k) for k in range(len(blocks))] for g in cut]
        )  # (lengths, blocks)
        chosen = fewest(errors)
        taps = lengths[chosen]
        h = grams.first(taps * self.inputs).weights(RIDGE).reshape(taps, self.inputs, -1)
        self.weights.data.zero_()[:taps, :, : h.shape[-1]] = torch.from_numpy(h / scale[:, None])
        self.taps.fill_(taps)
        error = 100.0 * float(np.sqrt(errors[chosen].mean()))
        return {"taps": taps, "held_out_error_percent": error}

    @property
    def identified_parameters(self) -> int:
        return int(self.taps) * self.inputs * self.dofs

    def outputs(self, u: Tensor) -> Tensor:
        """[a, x, v] (…, T, 3n), lag by lag: no sample sees what comes after it, to the last bit."""
        self.require_identified(self.weights)
        y = u @ self.weights[0]
        for lag in range(1, min(int(self.taps), u.shape[-2])):
            y[..., lag:, :] += u[..., :-lag, :] @ self.weights[lag]
        return y


def grams_of(
    motions: Sequence[Motion], blocks: Sequence[Sequence[Piece]], taps: int, dofs: int
) -> Grams:
    """Gram matrices of the features u[k − l], those of the shortest lag first."""
    pairs = [[_gram(motions[p.motion], p, taps) for p in block] for block in blocks]
    features, targets = (np.array([sum(pair[i] for pair in own) for own in pairs]) for i in (0, 1))
    return Grams(features, targets, sizes_of(motions, blocks, dofs), dofs)


def _gram(motion: Motion, piece: Piece, taps: int) -> tuple[np.ndarray, np.ndarray]:
    """Σ_k φ[k] φ[k]ᵀ (mL, mL) and Σ_k φ[k] y[k]ᵀ (mL, q) of the samples k of a piece.

    Products of two lags are those of both lags less one, but for a sample at either end.
    """
    m, start, stop = motion.u.shape[1], piece.start, piece.stop
    past = np.concatenate([np.zeros((taps, m)), motion.u])  # u[k] in row k + L
    now = np.concatenate([motion.u, motion.y], axis=1)[start:stop]
    late = (past[taps + start - lag : taps + stop - lag] for lag in range(taps))
    products = np.array([u.T @ now for u in late])  # (L, m, m + q)
    gram = np.empty((taps, m, taps, m))
    gram[:, :, 0], gram[0] = products[..., :m], products[..., :m].transpose(2, 0, 1)
    head, tail = (past[k + 1 : k + taps][::-1] for k in (start, stop))  # (L − 1, m)
    for lag in range(taps - 1):
        gram[lag + 1, :, 1:] = gram[lag, :, :-1]
        gram[lag + 1, :, 1:] += head[lag][:, None, None] * head
        gram[lag + 1, :, 1:] -= tail[lag][:, None, None] * tail
    return gram.reshape(taps * m, -1), products[..., m:].reshape(taps * m, -1)
