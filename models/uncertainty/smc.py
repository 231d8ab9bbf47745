"""Sequential Monte Carlo: particles go from the prior to the posterior, temperature by temperature.

p_β(θ) ∝ p(θ) L(θ)^β,   β = 0 … 1, each step such that half of the particles still count.
Del Moral, Doucet & Jasra (2006), Sequential Monte Carlo samplers; the steps of β and the moves
follow the particles themselves: Ching & Chen (2007), Transitional Markov chain Monte Carlo.

The particles move by Metropolis steps: along the difference of two others (ter Braak 2006, A
Markov chain Monte Carlo version of the genetic algorithm Differential Evolution), and to places
that do not depend on where they stand, from a t distribution about all of them. They move until
where they were tells little of where they are. Two runs that know nothing of each other show
whether this was enough.
N particles, p parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import logsumexp

from models.uncertainty.posterior import Prior

COUNT = 0.5  # share of the particles that count after a step of the temperature
FREEDOM = 5.0  # of the t distribution of proposals
WALK, SPREAD = 2.38, 0.5  # over √2p: length of a move, in differences, and how it varies, as log
ACCEPTED = 0.25  # share of moves along differences that their length is adapted to
REMEMBERED, LAST = 0.5, 0.2  # correlation with before: until then particles move; at β = 1
MOST_MOVES, MOST_LAST = 8, 60
MOST_STAGES = 400
DRAWS = 20  # times N: of the prior, until N runs are finite
R_HAT, EVIDENCE = 1.02, 1.5  # of two runs that agree: at most
RARE = 0.05  # acceptance of independent proposals that are not worth their runs

LogLikelihood = Callable[[np.ndarray], np.ndarray]
Note = Callable[["Stage"], None]


@dataclass(frozen=True)
class Stage:
    """What happened at a temperature."""

    temperature: float
    counting: float  # effective number of particles after the step
    acceptance: float
    moves: int
    remembered: float  # largest correlation of a coordinate with where the particles were


@dataclass(frozen=True)
class Sampled:
    """Particles (N, p) of the posterior, equally likely, and the logarithm of the evidence."""

    particles: np.ndarray
    log_likelihood: np.ndarray
    log_evidence: float
    stages: list[Stage] = field(default_factory=list)
    runs: int = 0

    @property
    def mixed(self) -> bool:
        """Whether the last moves made the particles forget where they were."""
        return self.stages[-1].remembered <= LAST


class _Cloud:
    """Particles, their likelihoods and priors."""

    def __init__(self, likelihood: LogLikelihood, prior: Prior, rng: np.random.Generator) -> None:
        self.likelihood, self.prior, self.rng = likelihood, prior, rng
        self.runs = 0
        self.scale = WALK / (2.0 * len(prior.mean)) ** 0.5

    def draw(self, count: int) -> float:
        """Draw particles of the prior whose runs are finite; returns the share of those, as log.

        Raises ValueError where next to none is.
        """
        theta, level, tried = [], [], 0
        p = len(self.prior.mean)
        while sum(map(len, theta)) < count:
            if tried >= DRAWS * count:
                raise ValueError(
                    f"of {tried} draws of the prior only {sum(map(len, theta))} have a finite free "
                    "run; sample fewer parameters (parameter=…), or state priors=… for some"
                )
            new = self.prior.mean + self.prior.width * self.rng.standard_normal((count, p))
            found = self.evaluate(new)
            tried += count
            theta.append(new[np.isfinite(found)])
            level.append(found[np.isfinite(found)])
        finite = sum(map(len, theta))
        self.theta, self.level = np.concatenate(theta)[:count], np.concatenate(level)[:count]
        self.prior_density = self.prior.log_density(self.theta)
        return float(np.log(finite / tried))

    def evaluate(self, theta: np.ndarray) -> np.ndarray:
        self.runs += len(theta)
        return self.likelihood(theta)

    def resample(self, weights: np.ndarray) -> None:
        """Systematically: a particle of weight w is there ⌊N w⌋ or ⌈N w⌉ times."""
        N = len(weights)
        places = (self.rng.random() + np.arange(N)) / N
        kept = np.searchsorted(np.cumsum(weights) / weights.sum(), places).clip(max=N - 1)
        self.take(kept)

    def take(self, kept: np.ndarray) -> None:
        self.theta, self.level = self.theta[kept], self.level[kept]
        self.prior_density = self.prior_density[kept]

    def step(
        self, new: np.ndarray, beta: float, ratio: np.ndarray | float, of: np.ndarray
    ) -> float:
        """Accept or refuse `new` (M, p) of some particles; returns the share that is accepted.

        ratio: logarithm of the proposals' densities, of the way back over that of the way there.
        """
        level, density = self.evaluate(new), self.prior.log_density(new)
        with np.errstate(invalid="ignore"):
            gain = beta * (level - self.level[of]) + density - self.prior_density[of] + ratio
        accepted = np.log(self.rng.random(len(new))) < np.nan_to_num(gain, nan=-np.inf)
        taken = of[accepted]
        self.theta[taken], self.level[taken] = new[accepted], level[accepted]
        self.prior_density[taken] = density[accepted]
        return float(accepted.mean())


def tempered(
    likelihood: LogLikelihood,
    prior: Prior,
    particles: int,
    rng: np.random.Generator,
    note: Note | None = None,
) -> Sampled:
    """Particles of the posterior, and the evidence.

    likelihood: of θ (N, p) the logarithms (N,), −∞ where there is none. note: called at every
    temperature. Raises ValueError where the prior hardly ever has a finite run, and where the
    temperature does not reach 1.
    """
    cloud = _Cloud(likelihood, prior, rng)
    evidence, beta = cloud.draw(particles), 0.0
    stages: list[Stage] = []
    while beta < 1.0:
        if len(stages) == MOST_STAGES:
            raise ValueError(
                f"after {MOST_STAGES} temperatures the sampler is at {beta:.2g} of 1; sample fewer "
                "parameters (parameter=…), or more particles"
            )
        after = _next(cloud.level, beta)
        logs = (after - beta) * cloud.level
        evidence += float(logsumexp(logs) - np.log(particles))
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        centre, root = _fitted(cloud.theta, weights)
        cloud.resample(weights)
        counting, beta = float(1.0 / (weights**2).sum()), after
        acceptance, moves, left = _move(cloud, beta, centre, root)
        stages.append(Stage(beta, counting, acceptance, moves, left))
        if note is not None:
            note(stages[-1])
    return Sampled(cloud.theta, cloud.level, evidence, stages, cloud.runs)


def _next(level: np.ndarray, beta: float) -> float:
    """The next temperature: that at which a share COUNT of the particles counts."""

    def counting(after: float) -> float:
        logs = (after - beta) * (level - level.max())
        return float(np.exp(2.0 * logsumexp(logs) - logsumexp(2.0 * logs))) / len(level)

    if counting(1.0) >= COUNT:
        return 1.0
    low, high = np.log(1e-40), np.log(1.0 - beta)
    for _ in range(100):
        middle = 0.5 * (low + high)
        if counting(beta + np.exp(middle)) >= COUNT:
            low = middle
        else:
            high = middle
    return float(max(beta + np.exp(low), np.nextafter(beta, 1.0)))


def _fitted(theta: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (p,) of weighted particles and a root (p, p) of their covariance."""
    centre = weights @ theta
    away = (theta - centre) * np.sqrt(weights)[:, None]
    covariance = away.T @ away
    size = np.sqrt(covariance.diagonal().clip(min=np.finfo(float).tiny))
    scaled = covariance / np.outer(size, size) + 1e-9 * np.eye(len(size))
    return centre, size[:, None] * np.linalg.cholesky(scaled)


def _move(
    cloud: _Cloud, beta: float, centre: np.ndarray, root: np.ndarray
) -> tuple[float, int, float]:
    """Move particles at a temperature; acceptance, moves, the correlation that is left."""
    whiten = np.linalg.inv(root).T
    before = (cloud.theta - centre) @ whiten
    until, most = (LAST, MOST_LAST) if beta == 1.0 else (REMEMBERED, MOST_MOVES)
    shares, independent, left = [], 1.0, 1.0
    for move in range(most):
        if move % 3 == 0 and (independent > RARE or move == 0):
            independent = share = _independently(cloud, beta, centre, root, whiten)
        else:
            share = _along_others(cloud, beta)
        shares.append(share)
        left = _correlation(before, (cloud.theta - centre) @ whiten)
        if left <= until:
            break
    return float(np.mean(shares)), len(shares), left


def _along_others(cloud: _Cloud, beta: float) -> float:
    """Each particle goes along the difference of two others, of the half that stands still."""
    (N, p), rng = cloud.theta.shape, cloud.rng
    shuffled = rng.permutation(N)
    halves = (shuffled[: N // 2], shuffled[N // 2 :])
    shares = []
    for moving, others in (halves, halves[::-1]):
        one = rng.integers(len(others), size=len(moving))
        other = (one + rng.integers(1, len(others), size=len(moving))) % len(others)
        way = cloud.theta[others[one]] - cloud.theta[others[other]]
        length = cloud.scale * np.exp(SPREAD * rng.standard_normal(len(moving)))
        shares.append(cloud.step(cloud.theta[moving] + length[:, None] * way, beta, 0.0, moving))
    share = float(np.mean(shares))
    cloud.scale *= float(np.exp(share - ACCEPTED))
    return share


def _independently(
    cloud: _Cloud, beta: float, centre: np.ndarray, root: np.ndarray, whiten: np.ndarray
) -> float:
    """A proposal for each particle that does not depend on where it stands."""
    N, p = cloud.theta.shape
    heavy = np.sqrt(FREEDOM / cloud.rng.chisquare(FREEDOM, N))
    drawn = cloud.rng.standard_normal((N, p)) * heavy[:, None]

    def density(own: np.ndarray) -> np.ndarray:
        return np.asarray(-0.5 * (FREEDOM + p) * np.log1p((own**2).sum(axis=1) / FREEDOM))

    ratio = density((cloud.theta - centre) @ whiten) - density(drawn)
    return cloud.step(centre + drawn @ root.T, beta, ratio, np.arange(N))


def _correlation(before: np.ndarray, now: np.ndarray) -> float:
    """The largest correlation of a coordinate (N, p) with itself before."""
    one, other = before - before.mean(axis=0), now - now.mean(axis=0)
    size = np.sqrt((one**2).sum(axis=0) * (other**2).sum(axis=0))
    return float(((one * other).sum(axis=0) / np.maximum(size, np.finfo(float).tiny)).max())


@dataclass(frozen=True)
class Agreement:
    """How well two runs agree that know nothing of each other.

    r_hat: of Gelman & Rubin (1992), the worst parameter's; apart: the largest difference of means
    in standard deviations; evidence: the difference of logarithms.
    """

    r_hat: float
    apart: float
    evidence: float
    mixed: bool

    def require(self) -> None:
        """Raise ValueError where the particles are no samples of the posterior."""
        why = []
        if not self.r_hat <= R_HAT:
            why.append(f"means of two runs are {self.apart:.2g} standard deviations apart")
        if not self.evidence <= EVIDENCE:
            why.append(f"their log evidences differ by {self.evidence:.3g}")
        if not self.mixed:
            why.append("the last moves did not let the particles forget where they were")
        if why:
            raise ValueError(
                f"sequential Monte Carlo did not converge, and there is no result: "
                f"{', '.join(why)}; take more particles (particles=4000) or fewer parameters "
                "(parameter=…)"
            )


def agreement_of(runs: Sequence[Sampled]) -> Agreement:
    """Of two runs."""
    one, other = runs
    within = 0.5 * (one.particles.var(axis=0) + other.particles.var(axis=0))
    between = (one.particles.mean(axis=0) - other.particles.mean(axis=0)) ** 2 / within
    worst = float(between.max())
    return Agreement(
        (1.0 + 0.5 * worst) ** 0.5,
        worst**0.5,
        abs(one.log_evidence - other.log_evidence),
        one.mixed and other.mixed,
    )
