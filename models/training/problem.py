"""What a solver minimises: the squared relative error of an estimator over one batch.

e = √N (g(u; θ) − y)/‖ẍ‖, so that mean(e²) is Eq. 21 squared.   Brewick & Masri (2016), Eq. 21
N errors, P free parameters θ.
"""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor
from torch.func import functional_call, jacrev, jvp, vmap

from data.record import Record
from models.estimator import Estimator

BLOCK_ELEMENTS = 1 << 22  # of the Jacobian that are held in memory at a time (32 MiB)


class Problem:
    """Errors, loss and normal equations of an estimator's free parameters on a batch of windows."""

    def __init__(self, estimator: Estimator, record: Record) -> None:
        record = record.measured()
        with torch.no_grad():
            self.module, self.u, y = estimator.regression(record)
        self.warmup = record.warmup
        self.y = y[..., record.warmup :, :]
        size = torch.linalg.vector_norm(record.a[..., record.warmup :, :])
        if not float(size) > 0.0:
            raise ValueError("the measured acceleration is zero; there is nothing to fit")
        self.weight = float(self.y.numel() ** 0.5 / size)
        self.pointwise = isinstance(self.u, Tensor)
        if self.pointwise:
            self.u = self.u[..., record.warmup :, :].flatten(0, -2)  # (N/n, channels)
            self.y = self.y.flatten(0, -2)
        self.names = [name for name, p in self.module.named_parameters() if p.requires_grad]

    def errors(self) -> Tensor:
        """e (N,) at the present parameters."""
        return self._error(self.module(self.u), self.y)

    def loss(self) -> Tensor:
        """Mean square of e."""
        return (self.errors() ** 2).mean()

    def normal_equations(self) -> tuple[Tensor, Tensor]:
        """JᵀJ (P, P) and Jᵀe (P,) with J = ∂e/∂θ, a block of J at a time."""
        theta = {name: self.module.get_parameter(name).detach() for name in self.names}
        count = sum(p.numel() for p in theta.values())
        matrix, vector = self.y.new_zeros(count, count), self.y.new_zeros(count)
        for jacobian, errors in self._blocks(theta):
            matrix += _gram(jacobian)
            vector += jacobian.T @ errors
        return self.weight**2 * matrix, self.weight * vector

    def _error(self, estimate: Tensor, y: Tensor) -> Tensor:
        if not self.pointwise:
            estimate = estimate[..., self.warmup :, :]
        return ((estimate - y) * self.weight).reshape(-1)

    def _blocks(self, theta: dict[str, Tensor]) -> Iterator[tuple[Tensor, Tensor]]:
        """(J/weight, e) of some samples at a time, or of a window where samples hang together."""
        if self.pointwise:
            return self._sample_blocks(theta)
        return self._window_blocks(theta)

    def _sample_blocks(self, theta: dict[str, Tensor]) -> Iterator[tuple[Tensor, Tensor]]:
        """By reverse differentiation of every sample: n gradients each."""
        count = sum(p.numel() for p in theta.values())
        rows = max(1, BLOCK_ELEMENTS // (count * self.y.shape[-1]))
        for u, y in zip(self.u.split(rows), self.y.split(rows), strict=True):
            by_name = vmap(jacrev(self._estimate), in_dims=(None, 0))(theta, u)
            jacobian = torch.cat([j.flatten(2) for j in by_name.values()], dim=2).flatten(0, 1)
            yield jacobian, self._error(self.module(u).detach(), y)

    def _window_blocks(self, theta: dict[str, Tensor]) -> Iterator[tuple[Tensor, Tensor]]:
        """By forward differentiation of every window, some parameters at a time."""
        flat = torch.cat([p.reshape(-1) for p in theta.values()])
        unit = torch.eye(flat.numel(), dtype=flat.dtype, device=flat.device)
        sizes = [p.numel() for p in theta.values()]
        windows = range(self.y.shape[0]) if self.y.ndim == 3 else [slice(None)]
        for i in windows:
            window, y = self.u.map(lambda signal, i=i: signal[i]), self.y[i]

            def errors(flat: Tensor, window: Record = window, y: Tensor = y) -> Tensor:
                parts = zip(theta.items(), flat.split(sizes), strict=True)
                named = {name: part.view(p.shape) for (name, p), part in parts}
                return self._error(self._estimate(named, window), y)

            columns = max(1, BLOCK_ELEMENTS // y.numel())
            along = vmap(lambda t, f=errors: jvp(f, (flat,), (t,))[1], chunk_size=columns)
            yield along(unit).T / self.weight, errors(flat)

    def _estimate(self, theta: dict[str, Tensor], u: Tensor | Record) -> Tensor:
        return functional_call(self.module, theta, (u,))


def _gram(jacobian: Tensor) -> Tensor:
    """JᵀJ; on the processor by NumPy, whose BLAS computes one triangle only."""
    if jacobian.device.type == "cpu":
        rows = jacobian.numpy()
        return torch.from_numpy(rows.T @ rows)
    return jacobian.T @ jacobian
