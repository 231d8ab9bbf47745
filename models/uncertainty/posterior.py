"""What records say of all free parameters of a model, with noise of any spectrum.

ℓ(θ) = −½ Σ_f c_f (e_fᴴ S⁻¹ e_f + log det 2πS)

e_f is the unitary spectrum of the error of the free run, S the spectral density of the fit's
residual (noise.py), c_f how often a frequency of the half spectrum counts. White noise makes it the
usual Gaussian likelihood.   Whittle (1953), Estimation and information in stationary time series

Without data parameters are Normal about their start, `OPEN` units of θ wide, or as stated.
N parameters, P free ones, T samples, n channels, F frequencies.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor

from data.parallel import in_threads, threads
from data.record import Record, singles
from models.composition.composite import Composite
from models.composition.many_runs import ManyRuns, positive_of
from models.fit.problem import FreeRunProblem, begins_unknown
from models.fit.trainable import Trainable
from models.uncertainty.laplace import OPEN, Laplace, stated_widths
from models.uncertainty.noise import MOST_BANDS, transformed
from models.uncertainty.parameters import free_vector, set_free_vector

FLOOR = 1e-6  # of the mean spectral density: less noise no band has


@dataclass(frozen=True)
class Point:
    """−ℓ at some θ, its gradient (P,) and its Gauss–Newton matrix (P, P)."""

    value: float
    gradient: np.ndarray
    matrix: np.ndarray


class Likelihood:
    """ℓ(θ) of the training records of an estimator, whose spectrum a fit has left.

    Raises ValueError where the fit left no noise, and for more channels than lines of a band.
    """

    def __init__(self, estimator: Trainable, batches: Iterable[Record], found: Laplace) -> None:
        self.estimator, self.weight = estimator, found.weight
        self.positive = positive_of(estimator)
        self.problems = [FreeRunProblem(estimator, record, None) for record in singles(batches)]
        self.measured = [self.weight * problem.y.cpu().numpy() for problem in self.problems]
        spectrum = found.noise.spectrum
        level = float(np.einsum("kii->", spectrum).real / (len(spectrum) * spectrum.shape[1]))
        if not level > 0.0 or not np.isfinite(level):
            raise ValueError(
                "the model's free run equals the record: there is no noise that a likelihood "
                "could be measured by"
            )
        self.bands, n = spectrum.shape[:2]
        lines = found.samples / (2.0 * n * self.bands)
        if lines <= n:
            raise ValueError(
                f"{n} channels need more than {2 * n * MOST_BANDS} samples for a likelihood, there "
                f"are {found.samples // n}; give longer records, or fewer channels"
            )
        # the mean of the inverse of a spectrum of so many lines is S⁻¹ (Wishart)
        spectrum = (spectrum + FLOOR * level * np.eye(n)) * lines / (lines - n)
        roots = np.linalg.inv(np.linalg.cholesky(spectrum))
        size = np.linalg.slogdet(2.0 * np.pi * spectrum)[1]
        self.whitening, self.constant = [], 0.0
        for y in self.measured:
            _, counts, place = transformed(y, self.bands)
            self.whitening.append(roots[place] * np.sqrt(counts)[:, None, None])
            self.constant += len(y) * float(np.log(self.weight).sum())
            self.constant -= 0.5 * float(counts @ size[place])
        self.samples = sum(y.size for y in self.measured)
        self.runs: list[ManyRuns] | None = None

    @torch.no_grad()
    def at(self, theta: np.ndarray) -> Point:
        """−ℓ and derivatives at θ (P,); infinite where a run diverges. Leaves the model there."""
        set_free_vector(self.estimator, torch.from_numpy(theta))
        P = len(theta)
        value, gradient, matrix = -self.constant, np.zeros(P), np.zeros((P, P))
        for i, problem in enumerate(self.problems):
            both = self.estimator.restarted_jacobian(problem.record, None)
            assert both is not None
            run, J = (part[problem.counted].cpu().numpy() for part in both)
            if not np.isfinite(run).all() or not np.isfinite(J).all():
                return Point(np.inf, gradient, matrix)
            e = self._whitened(self.weight * run - self.measured[i], i)
            columns = self._whitened(self.weight[:, None] * J, i).reshape(e.size, P)
            value += 0.5 * float((np.abs(e) ** 2).sum())
            gradient += (columns.conj().T @ e.reshape(-1)).real
            matrix += columns.real.T @ columns.real + columns.imag.T @ columns.imag
        return Point(value, gradient, matrix)

    def _whitened(self, signal: np.ndarray, i: int) -> np.ndarray:
        """The half spectrum (F, n, …) of a signal (T, n, …), of unit noise."""
        columns = transformed(signal, self.bands)[0]
        return np.einsum("fij,fj...->fi...", self.whitening[i], columns, optimize=True)

    def many(self, thetas: np.ndarray) -> np.ndarray:
        """ℓ (N,) at θ (N, P) on all cores, or on a GPU; −∞ where a run diverges."""
        if self.runs is None:
            return np.concatenate(in_threads(self._alone, np.array_split(thetas, threads())))
        total = np.full(len(thetas), self.constant)
        for i, runs in enumerate(self.runs):
            total += runs(thetas, partial(self._fit, i))
        return np.where(np.isfinite(total), total, -np.inf)

    def _fit(self, i: int, runs: Tensor) -> Tensor:
        """−½ Σ |e|² (N,) of runs (N, T, n), in units of the noise, where the runs are."""
        weight, measured, whitening = (
            torch.from_numpy(u).to(runs.device)
            for u in (self.weight, self.measured[i], self.whitening[i])
        )
        errors = weight * runs[:, self.problems[i].counted] - measured
        own = torch.einsum("fij,bfj->bfi", whitening, torch.fft.rfft(errors, dim=1, norm="ortho"))
        return -0.5 * torch.view_as_real(own.resolve_conj()).square().sum(dim=(1, 2, 3))

    @torch.no_grad()
    def _alone(self, thetas: np.ndarray) -> np.ndarray:
        """ℓ (N,) of one run after the other of a copy of the model, which no other thread has."""
        model, totals = copy.deepcopy(self.estimator), []
        for theta in thetas:
            set_free_vector(model, torch.from_numpy(theta))
            runs = [model.restarted_run(problem.record, None)[None] for problem in self.problems]
            totals.append(self.constant + sum(float(self._fit(i, u)) for i, u in enumerate(runs)))
        return np.nan_to_num(totals, nan=-np.inf, posinf=-np.inf)

    @torch.no_grad()
    def compile(self) -> bool:
        """Ready `many` for compiled runs, beginning where they do now. Returns whether it can."""
        model = self.estimator
        if not isinstance(model, Composite):
            return False
        runs = []
        try:
            for problem in self.problems:
                begin = None
                if begins_unknown(model, problem.record):
                    begin = model.first_state(problem.record)
                runs.append(ManyRuns(model, problem.record.drive(), begin))
        except ValueError:
            return False
        self.runs = runs
        return True


@dataclass(frozen=True)
class Prior:
    """Independent Normal distributions of free parameters: mean (P,) and standard deviation."""

    mean: np.ndarray
    width: np.ndarray

    @classmethod
    def of(cls, estimator: Trainable) -> Prior:
        """About where the free parameters started, or as stated, as the intervals of a fit are."""
        theta = free_vector(estimator).numpy()
        deviation = estimator.pull(False)[1].detach().cpu().numpy()
        start = theta - deviation if deviation.shape == theta.shape else np.zeros_like(theta)
        width = np.full(len(theta), OPEN)
        for number, own in stated_widths(estimator).items():
            width[number] = own
        return cls(start, width)

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        return self.mean + self.width * rng.standard_normal((count, len(self.mean)))

    def log_density(self, theta: np.ndarray) -> np.ndarray:
        """Of θ (…, P)."""
        own = ((theta - self.mean) / self.width) ** 2 + np.log(2.0 * np.pi * self.width**2)
        return np.asarray(-0.5 * own.sum(axis=-1))

    def only(self, chosen: np.ndarray) -> Prior:
        return Prior(self.mean[chosen], self.width[chosen])


class Posterior:
    """Density of some free parameters, the others held where they are.

    prior: of all; chosen (p,): numbers of those that are free.
    """

    def __init__(self, likelihood: Likelihood, prior: Prior, chosen: np.ndarray) -> None:
        self.likelihood, self.prior, self.chosen = likelihood, prior.only(chosen), chosen
        self.positive = likelihood.positive[chosen]
        self.rest = free_vector(likelihood.estimator).numpy()

    def whole(self, theta: np.ndarray) -> np.ndarray:
        """All free parameters (…, P) of θ (…, p)."""
        full = np.broadcast_to(self.rest, (*theta.shape[:-1], len(self.rest))).copy()
        full[..., self.chosen] = theta
        return full

    def at(self, theta: np.ndarray) -> Point:
        """− log of likelihood times prior at θ (p,), and derivatives."""
        own, prior = self.likelihood.at(self.whole(theta)), self.prior
        precision = prior.width**-2
        return Point(
            own.value - float(prior.log_density(theta)),
            own.gradient[self.chosen] + precision * (theta - prior.mean),
            own.matrix[np.ix_(self.chosen, self.chosen)] + np.diag(precision),
        )

    def log_likelihood(self, theta: np.ndarray) -> np.ndarray:
        """ℓ (N,) of θ (N, p)."""
        return self.likelihood.many(self.whole(theta))
