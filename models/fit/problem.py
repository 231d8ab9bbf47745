"""What a solver minimises: the squared relative error of an estimator over one batch.

e = √N (g(u; θ) − y)/‖ẍ‖, so that mean(e²) is Eq. 21 squared.   Brewick & Masri (2016), Eq. 21
`Problem` takes estimates from measured states, `FreeRunProblem` the simulation. First states that
are not known are fitted along by `UnknownBeginningProblem`: they join the parameters in every step
of Levenberg–Marquardt, and are dropped afterwards, for they belong to the records. With the other
solvers, which know the model's parameters alone, the run itself eliminates them
(models/composition/first_state.py).
N errors, P free parameters θ, B records, T samples, n outputs, S numbers of a first state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.func import functional_call, jacrev, jvp, vmap

from data.memory import empty_array
from data.parallel import in_threads
from data.record import Record
from models.fit.perceptrons import BLOCK_ELEMENTS, Member, Perceptrons
from models.fit.trainable import Trainable
from models.layers.perceptron import Perceptron
from models.uncertainty.parameters import free_vector

MOST_DERIVATIVES = 1 << 26  # of all records together, half a gigabyte
SUMMED = 1024  # samples whose derivatives are multiplied at a time


class Problem:
    """Errors, loss and normal equations of an estimator's free parameters on a batch of windows."""

    steepest = float("inf")
    own: Sequence[Tensor] = ()

    def __init__(self, estimator: Trainable, record: Record) -> None:
        record = record.measured()
        with torch.no_grad():
            self.module, self.u, y = estimator.regression(record)
        self.warmup = record.warmup
        self.y = y[..., record.warmup :, :]
        self.weight = _weight(record)
        self.pointwise = isinstance(self.u, Tensor)
        if self.pointwise:
            self.u = self.u[..., record.warmup :, :].flatten(0, -2)  # (N/n, channels)
            self.y = self.y.flatten(0, -2)
        self.names = [name for name, p in self.module.named_parameters() if p.requires_grad]
        self.closed: Perceptrons | Member | None = None
        self.known: tuple[Tensor, Tensor] | None = None  # θ and the loss there
        trained = all(p.requires_grad for p in self.module.parameters())
        if isinstance(self.module, Perceptron) and trained:
            self.closed = Perceptrons(self.module, self.u, self.y, self.weight)

    def errors(self) -> Tensor:
        """e (N,) at the present parameters."""
        estimate = self.module(self.u)
        if not self.pointwise:
            estimate = estimate[..., self.warmup :, :]
        return ((estimate - self.y) * self.weight).reshape(-1)

    def loss(self) -> Tensor:
        """Mean square of e."""
        if self.closed is None or torch.is_grad_enabled():
            return (self.errors() ** 2).mean()
        theta = free_vector(self.module)
        if self.known is not None and torch.equal(self.known[0], theta):
            return self.known[1]
        return self.closed.losses(theta[None])[0]

    def slopes(self) -> tuple[Tensor, Tensor]:
        """Mean square of e, and its gradient (P,)."""
        if self.closed is not None:
            theta = free_vector(self.module)
            losses, slopes = self.closed.slopes(theta[None])
            self.known = theta, losses[0]
            return losses[0], slopes[0]
        with torch.enable_grad():
            loss = self.loss()
            free = [self.module.get_parameter(name) for name in self.names]
            return loss.detach(), torch.cat([g.flatten() for g in torch.autograd.grad(loss, free)])

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        """JᵀJ (P, P) and Jᵀe (P,) with J = ∂e/∂θ, a block of J at a time.

        JᵀJ is summed over every `every`-th sample (or window, where samples hang together) and
        scaled up: motions are sampled far more densely than they change. Jᵀe is exact.
        """
        vector = 0.5 * self.y.numel() * self.slopes()[1]
        if self.closed is not None:
            return self.closed.squares(free_vector(self.module)[None], every)[0], vector
        theta = {name: self.module.get_parameter(name).detach() for name in self.names}
        count = sum(p.numel() for p in theta.values())
        matrix = self.y.new_zeros(count, count)
        for jacobian in self._blocks(theta, every):
            matrix += _gram(jacobian)
        left_out = self.parts / len(range(0, self.parts, every))
        return left_out * self.weight**2 * matrix, vector

    @property
    def parts(self) -> int:
        """Number of samples, where each stands alone; else number of windows."""
        return self.y.shape[0] if self.pointwise or self.y.ndim == 3 else 1

    def _blocks(self, theta: dict[str, Tensor], every: int) -> Iterator[Tensor]:
        """J/weight of some samples at a time, or of a window where samples hang together."""
        if self.pointwise:
            return self._sample_blocks(theta, every)
        return self._window_blocks(theta, every)

    def _sample_blocks(self, theta: dict[str, Tensor], every: int) -> Iterator[Tensor]:
        """J/weight of some samples at a time, by reverse differentiation: n gradients each."""
        count = sum(p.numel() for p in theta.values())
        rows = max(1, BLOCK_ELEMENTS // (count * self.y.shape[-1]))
        for u in self.u[::every].split(rows):
            by_name = vmap(jacrev(self._estimate), in_dims=(None, 0))(theta, u)
            columns = [j.reshape(*j.shape[:2], -1) for j in by_name.values()]
            yield torch.cat(columns, dim=2).flatten(0, 1)

    def _window_blocks(self, theta: dict[str, Tensor], every: int) -> Iterator[Tensor]:
        """J/weight of one window at a time, by forward differentiation."""
        for i in range(0, self.parts, every):
            window = self.u.map(lambda signal, i=i: signal[i]) if self.y.ndim == 3 else self.u

            def estimate(theta: dict[str, Tensor], window: Record = window) -> Tensor:
                return self._estimate(theta, window)[self.warmup :].reshape(-1)

            yield _forward_jacobian(estimate, theta, self.y.numel() // self.parts)

    def _estimate(self, theta: dict[str, Tensor], u: Tensor | Record) -> Tensor:
        return functional_call(self.module, theta, (u,))


class FreeRunProblem:
    """Errors, loss and normal equations of a simulation that begins again every `horizon` samples.

    horizon: None: the simulation never begins again. prior: weight of the pull instead of the
    estimator's own.
    """

    steepest = 1.0  # a run on the verge of divergence has a gradient without measure
    own: Sequence[Tensor] = ()

    def __init__(
        self,
        estimator: Trainable,
        record: Record,
        horizon: int | None,
        last: bool = True,
        prior: float | None = None,
    ) -> None:
        record = record.measured()
        if record.initial_state == "periodic":
            record = in_steady_state(record)
        self.record = record
        self.estimator, self.horizon, self.last, self.prior = estimator, horizon, last, prior
        self.counted = slice(record.warmup, None)
        self.y = record.a[..., self.counted, :]
        self.weight = _weights(record, estimator.weights_of_channels())
        self.noise: float | None = None  # variance of e where it was first asked for, over N
        self.known: tuple[Tensor, Tensor] | None = None  # θ, e of the last normal equations

    @property
    def free(self) -> Sequence[nn.Parameter]:
        """The parameters that are fitted."""
        return [p for p in self.estimator.parameters() if p.requires_grad]

    def errors(self) -> Tensor:
        """e (N,) at the present parameters."""
        if self.known is not None and not torch.is_grad_enabled():
            theta, errors = self.known
            if torch.equal(theta, free_vector(self.estimator)):
                return errors
        return self._errors(self.estimator.restarted_run(self.record, self.horizon))

    def loss(self) -> Tensor:
        """Mean square of e, and the pull; not finite where the run diverges."""
        square = (self.errors() ** 2).mean()
        if self.noise is None:
            self.noise = float(square.detach()) / self.y.numel()
        prior, deviation = self._pull()
        return square + (prior * deviation**2).sum()

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        """JᵀJ (P, P) and Jᵀe (P,) with J = ∂e/∂θ, and the pull.

        JᵀJ is summed over every `every`-th sample and scaled up; Jᵀe is exact.
        """
        with torch.no_grad():
            parts = self._parts(self.estimator.pull(self.last, self.prior, 0.0)[1].numel())
            sums = [self._normal_equations(record, y, every) for record, y in parts]
            matrix, vector, _ = sums[0]
            for more, other, _ in sums[1:]:
                matrix, vector = matrix + more, vector + other
            self.known = free_vector(self.estimator), torch.cat([errors for *_, errors in sums])
            prior, deviation = self._pull()
            pull = self.y.numel() * prior
            if deviation.numel():
                matrix.diagonal().add_(pull)
                vector = vector + pull * deviation
            return matrix, vector

    def _parts(self, parameters: int) -> list[tuple[Record, Tensor]]:
        """All records together, or one after the other where their derivatives are too many."""
        if self.record.a.ndim < 3 or self.y.numel() * parameters < MOST_DERIVATIVES:
            return [(self.record, self.y)]
        return [(self.record.map(partial(_only, i)), y) for i, y in enumerate(self.y.split(1))]

    def _normal_equations(
        self, record: Record, y: Tensor, every: int
    ) -> tuple[Tensor, Tensor, Tensor]:
        """JᵀJ, Jᵀe and e of some of the records."""
        both = self.estimator.restarted_jacobian(record, self.horizon)
        if both is None:
            errors, weight = self.errors(), torch.ones_like(self.weight)
            jacobian = self._differentiated(errors.numel()).view(*y.shape, -1)
        else:
            run, jacobian = both
            errors = ((run[..., self.counted, :] - y) * self.weight).reshape(-1)
            weight, jacobian = self.weight, jacobian[..., self.counted, :, :]
        each = jacobian.reshape(-1, *jacobian.shape[-3:])  # (B, T, n, P)
        sides = weight * errors.view(each.shape[:-1])
        samples = each.shape[1]
        rows = every * (SUMMED // every)  # of each sum: its threads change no bit

        def sums(place: tuple[int, int]) -> tuple[Tensor, Tensor]:
            i, first = place
            part, side = (signal[i, first : first + rows] for signal in (each, sides))
            some = part[::every]
            some = torch.mul(weight[:, None], some, out=empty_array(*some.shape))
            return _gram(some.flatten(0, 1)), side.flatten() @ part.flatten(0, 1)

        places = [(i, first) for i in range(len(each)) for first in range(0, samples, rows)]
        matrices, vectors = zip(*in_threads(sums, places, steps=0), strict=True)
        matrix = samples / len(range(0, samples, every)) * torch.stack(matrices).sum(dim=0)
        return matrix, torch.stack(vectors).sum(dim=0), errors

    def _pull(self) -> tuple[float | Tensor, Tensor]:
        if self.noise is None:
            self.loss()
        return self.estimator.pull(self.last, self.prior, self.noise or 0.0)

    def _errors(self, run: Tensor) -> Tensor:
        return ((run[..., self.counted, :] - self.y) * self.weight).reshape(-1)

    def _differentiated(self, count: int) -> Tensor:
        """J (N, P) by forward differentiation, all windows at once."""
        module = _RestartedRun(self.estimator)
        theta = {name: p.detach() for name, p in module.named_parameters() if p.requires_grad}

        def errors(theta: dict[str, Tensor]) -> Tensor:
            return self._errors(functional_call(module, theta, (self.record, self.horizon)))

        return _forward_jacobian(errors, theta, count)


class _RestartedRun(nn.Module):
    """`restarted_run` as the `forward` that PyTorch's function transforms call."""

    def __init__(self, estimator: Trainable) -> None:
        super().__init__()
        self.estimator = estimator

    def forward(self, record: Record, horizon: int | None) -> Tensor:
        return self.estimator.restarted_run(record, horizon)


def _only(i: int, signal: Tensor) -> Tensor:
    """Record i of a batch, as a batch."""
    return signal[i : i + 1]


def in_steady_state(record: Record) -> Record:
    """The record from its measured state, or, without one, from rest a period before it counts."""
    if record.x is not None and record.v is not None:
        return replace(record, initial_state="given")
    twice = replace(record, warmup=0).map(lambda u: torch.cat([u, u], dim=-2))
    return replace(twice, warmup=record.samples + record.warmup, initial_state="rest")


def _weight(record: Record) -> float:
    """√N/‖ẍ‖ over the counted samples."""
    return _relative(record.a[..., record.warmup :, :])


def _weights(record: Record, channels: Tensor | None) -> Tensor:
    """√N w/‖w ẍ‖ (n,) over the counted samples, of channels that count by w."""
    measured = record.a[..., record.warmup :, :]
    if channels is None:
        channels = measured.new_ones(measured.shape[-1])
    return _relative(channels * measured) * channels


def _relative(measured: Tensor) -> float:
    size = float(torch.linalg.vector_norm(measured))
    if not size > 0.0:
        raise ValueError("the measured acceleration is zero; there is nothing to fit")
    return measured.numel() ** 0.5 / size


def _forward_jacobian(
    values: Callable[[dict[str, Tensor]], Tensor], theta: dict[str, Tensor], count: int
) -> Tensor:
    """∂values/∂θ (count, P) by forward differentiation, some parameters at a time."""
    flat = torch.cat([p.reshape(-1) for p in theta.values()])
    sizes = [p.numel() for p in theta.values()]

    def of_flat(flat: Tensor) -> Tensor:
        parts = zip(theta.items(), flat.split(sizes), strict=True)
        return values({name: part.view(p.shape) for (name, p), part in parts})

    unit = torch.eye(flat.numel(), dtype=flat.dtype, device=flat.device)
    columns = max(1, BLOCK_ELEMENTS // count)
    return vmap(lambda t: jvp(of_flat, (flat,), (t,))[1], chunk_size=columns)(unit).T


def _gram(jacobian: Tensor) -> Tensor:
    """JᵀJ; on the processor by NumPy, whose BLAS computes one triangle only."""
    if jacobian.device.type == "cpu":
        rows = jacobian.numpy()
        with np.errstate(over="ignore", invalid="ignore"):  # of a run that diverges
            return torch.from_numpy(rows.T @ rows)
    return jacobian.T @ jacobian


def begins_unknown(estimator: Trainable, record: Record) -> bool:
    """Whether the first states of the records are to be estimated, and can be."""
    return record.initial_state == "unknown" and estimator.estimates_beginning


class UnknownBeginningProblem(FreeRunProblem):
    """A free run of whole records from first states of their own, which are in `own`."""

    def __init__(
        self, estimator: Trainable, record: Record, last: bool = True, prior: float | None = None
    ) -> None:
        whole = replace(record, warmup=0)  # no sample is lost to a transient
        super().__init__(estimator, whole, None, last, prior)
        self.own = [estimator.first_states(self.record)]  # (B·S,)

    def errors(self) -> Tensor:
        """e (N,) at the present parameters and first states."""
        if torch.is_grad_enabled():
            return super().errors()
        run, _, _ = self.estimator.run_from(self.record, self.own[0], derivatives=False)
        return self._errors(run)

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        """JᵀJ (P + B·S, P + B·S) and Jᵀe, by the parameters and then by the first states."""
        run, by_theta, by_state = self.estimator.run_from(self.record, self.own[0], True)
        B, P, S = self.own[0].numel() // by_state.shape[-1], by_theta.shape[-1], by_state.shape[-1]
        errors = self._errors(run).reshape(B, -1)
        J = (self.weight[..., None] * by_theta).reshape(B, -1, P)
        J0 = (self.weight[..., None] * by_state).reshape(B, -1, S)
        matrix, vector = J.new_zeros(P + B * S, P + B * S), J.new_zeros(P + B * S)
        prior, deviation = self._pull()
        pull = errors.numel() * prior
        matrix[:P, :P] = torch.einsum("btp,btq->pq", J, J) + torch.eye(P).to(J) * pull
        vector[:P] = torch.einsum("btp,bt->p", J, errors) + pull * deviation
        for b in range(B):
            place = slice(P + b * S, P + (b + 1) * S)
            matrix[place, place] = J0[b].T @ J0[b]
            matrix[:P, place] = J[b].T @ J0[b]
            matrix[place, :P] = matrix[:P, place].T
            vector[place] = J0[b].T @ errors[b]
        return matrix, vector


def run_problem(
    estimator: Trainable,
    record: Record,
    horizon: int | None,
    last: bool = True,
    prior: float | None = None,
) -> FreeRunProblem:
    """The error of a free run, with first states of its own where those are not known."""
    if horizon is None and begins_unknown(estimator, record):
        return UnknownBeginningProblem(estimator, record, last, prior)
    return FreeRunProblem(estimator, record, horizon, last, prior)


class Joint:
    """Problems of one model on records of unequal length, each weighted by its size."""

    steepest = 1.0

    def __init__(self, problems: Sequence[Any]) -> None:
        self.problems = problems
        # of each motion, behind what all share
        self.own: Sequence[Tensor] = [state for p in problems for state in p.own]
        sizes = np.array([float((p.y**2).sum()) for p in problems])
        self.shares = sizes / sizes.sum()
        self.y = torch.cat([p.y.reshape(-1) for p in problems])

    @classmethod
    def of(cls, model: Trainable, records: Sequence[Record]) -> Joint:
        """Of the free runs of whole records."""
        return cls([FreeRunProblem(model, record, None) for record in records])

    @property
    def free(self) -> Sequence[nn.Parameter]:
        return self.problems[0].free

    @torch.no_grad()
    def loss(self) -> Tensor:
        losses = [w * p.loss() for w, p in zip(self.shares, self.problems, strict=True)]
        return torch.stack(losses).sum()

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        both = [p.normal_equations(every) for p in self.problems]
        weights = [
            w * self.y.numel() / p.y.numel()
            for w, p in zip(self.shares, self.problems, strict=True)
        ]
        if not self.own:
            matrix, vector = (
                torch.stack([w * part[i] for w, part in zip(weights, both, strict=True)]).sum(dim=0)
                for i in (0, 1)
            )
            return matrix, vector
        shared = sum(parameter.numel() for parameter in self.free)
        size = shared + sum(state.numel() for state in self.own)
        matrix, vector, end = self.y.new_zeros(size, size), self.y.new_zeros(size), shared
        for w, (own_matrix, own_vector) in zip(weights, both, strict=True):
            begin, end = end, end + len(own_vector) - shared
            place = torch.cat([torch.arange(shared), torch.arange(begin, end)])
            matrix[place[:, None], place] += w * own_matrix
            vector[place] += w * own_vector
        return matrix, vector
