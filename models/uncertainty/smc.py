"""Sequential Monte Carlo: particles go from what is easy to draw to the posterior, step by step.

p_β(θ) ∝ q(θ)^(1 − β) [p(θ) L(θ)]^β,   β = 0 … 1, so that half of the particles count after a step.

q is a wide t distribution about the fit, or the prior p itself: from there particles go far, and
need to be many, for a prior of a free run has places next to which nothing is better.
Del Moral, Doucet & Jasra (2006), Sequential Monte Carlo samplers; the steps of β and the moves
follow the particles themselves: Ching & Chen (2007), Transitional Markov chain Monte Carlo.

The particles move by Metropolis steps: along the difference of two others (ter Braak 2006, A
Markov chain Monte Carlo version of the genetic algorithm Differential Evolution), and to places
that do not depend on where they are, from a t distribution about all of them. They move until
where they were tells little of where they are. Two runs that know nothing of each other show
whether this was enough.
N particles, p parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from models.uncertainty.posterior import Prior

COUNT = 0.5  # share of the particles that count after a step of the temperature
FREEDOM = 5.0  # of t distributions
WIDER = 2.0  # times the deviations of Laplace's approximation: where particles begin
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
    log_evidence: float
    stages: list[Stage] = field(default_factory=list)
    runs: int = 0

    @property
    def mixed(self) -> bool:
        """Whether the last moves made the particles forget where they were."""
        return self.stages[-1].remembered <= LAST


@dataclass(frozen=True)
class Wide:
    """A t distribution about a centre (p,), with a root (p, p) of its scale matrix."""

    centre: np.ndarray
    root: np.ndarray

    @classmethod
    def about(cls, centre: np.ndarray, covariance: np.ndarray) -> Wide:
        """`WIDER` than a covariance (p, p)."""
        return cls(centre, WIDER * np.linalg.cholesky(covariance))

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        heavy = np.sqrt(FREEDOM / rng.chisquare(FREEDOM, count))[:, None]
        return self.centre + heavy * rng.standard_normal((count, len(self.centre))) @ self.root.T

    def log_density(self, theta: np.ndarray) -> np.ndarray:
        """Of θ (N, p)."""
        from scipy.special import gammaln  # slow to import

        p = len(self.centre)
        own = np.linalg.solve(self.root, (theta - self.centre).T)
        size = gammaln(0.5 * (FREEDOM + p)) - gammaln(0.5 * FREEDOM)
        size -= 0.5 * p * np.log(FREEDOM * np.pi) + np.log(np.abs(self.root.diagonal())).sum()
        return np.asarray(size - 0.5 * (FREEDOM + p) * np.log1p((own**2).sum(axis=0) / FREEDOM))


class _Cloud:
    """Particles, log pL/q and log q of each."""

    def __init__(
        self, likelihood: LogLikelihood, prior: Prior, rng: np.random.Generator, begin: Prior | Wide
    ) -> None:
        self.likelihood, self.prior, self.rng, self.begin = likelihood, prior, rng, begin
        self.runs = 0
        self.scale = WALK / (2.0 * len(prior.mean)) ** 0.5

    def draw(self, count: int) -> float:
        """Draw particles of q whose runs are finite; returns the share of those, as log.

        Raises ValueError where next to none is.
        """
        theta: list[np.ndarray] = []
        level: list[np.ndarray] = []
        tried = 0
        while sum(map(len, theta)) < count:
            if tried >= DRAWS * count:
                raise ValueError(
                    f"of {tried} draws to begin with only {sum(map(len, theta))} have a finite "
                    "free run; sample fewer parameters (parameter=…), or state priors for some"
                )
            new = self.begin.draw(count, self.rng)
            found = self.evaluate(new)
            tried += count
            theta.append(new[np.isfinite(found)])
            level.append(found[np.isfinite(found)])
        finite = sum(map(len, theta))
        self.theta, self.level = np.concatenate(theta)[:count], np.concatenate(level)[:count]
        self.density = self.begin.log_density(self.theta)
        return float(np.log(finite / tried))

    def evaluate(self, theta: np.ndarray) -> np.ndarray:
        """log pL/q (N,)."""
        self.runs += len(theta)
        ratio = self.prior.log_density(theta) - self.begin.log_density(theta)
        return np.asarray(self.likelihood(theta) + ratio)

    @property
    def halves(self) -> tuple[np.ndarray, np.ndarray]:
        first, second = np.array_split(np.arange(len(self.theta)), 2)
        return first, second

    def resample(self, weights: np.ndarray) -> None:
        """Systematically within each half: of N, a share w of weights is there about N w times."""
        kept = []
        for half in self.halves:
            own = np.cumsum(weights[half])
            places = own[-1] * (self.rng.random() + np.arange(len(half))) / len(half)
            kept.append(half[np.searchsorted(own, places).clip(max=len(half) - 1)])
        self.take(np.concatenate(kept))

    def take(self, kept: np.ndarray) -> None:
        self.theta, self.level = self.theta[kept], self.level[kept]
        self.density = self.density[kept]

    def step(
        self, new: np.ndarray, beta: float, ratio: np.ndarray | float, of: np.ndarray
    ) -> float:
        """Accept or refuse `new` (M, p) of some particles; returns the share that is accepted.

        ratio: logarithm of the proposals' densities, of the way back over that of the way there.
        """
        level, density = self.evaluate(new), self.begin.log_density(new)
        with np.errstate(invalid="ignore"):
            gain = beta * (level - self.level[of]) + density - self.density[of] + ratio
        accepted = np.log(self.rng.random(len(new))) < np.nan_to_num(gain, nan=-np.inf)
        taken = of[accepted]
        self.theta[taken], self.level[taken] = new[accepted], level[accepted]
        self.density[taken] = density[accepted]
        return float(accepted.mean())


def tempered(
    likelihood: LogLikelihood,
    prior: Prior,
    particles: int,
    rng: np.random.Generator,
    begin: Wide | None = None,
    note: Note | None = None,
) -> Sampled:
    """Particles of the posterior, and the evidence.

    likelihood: of θ (N, p) the logarithms (N,), −∞ where there is none. begin: where particles come
    from; None: the prior. note: called at every temperature. Raises ValueError where these hardly
    ever have a finite run, and where the temperature does not reach 1.
    """
    from scipy.special import logsumexp  # slow to import

    cloud = _Cloud(likelihood, prior, rng, begin or prior)
    evidence, beta = np.full(2, cloud.draw(particles)), 0.0
    stages: list[Stage] = []
    while beta < 1.0:
        if len(stages) == MOST_STAGES:
            raise ValueError(
                f"after {MOST_STAGES} temperatures the sampler is at {beta:.2g} of 1; sample fewer "
                "parameters (parameter=…), or more particles"
            )
        after = _next(cloud.level, beta)
        logs = (after - beta) * cloud.level
        evidence += [logsumexp(logs[half]) - np.log(len(half)) for half in cloud.halves]
        weights = np.exp(logs - logs.max())
        fits = [_Fit(cloud.theta[half], weights[half]) for half in cloud.halves]
        cloud.resample(weights)
        counting, beta = float(weights.sum() ** 2 / (weights**2).sum()), after
        acceptance, moves, left = _move(cloud, beta, fits)
        stages.append(Stage(beta, counting, acceptance, moves, left))
        if note is not None:
            note(stages[-1])
    whole = float(logsumexp(evidence) - np.log(2.0))
    return Sampled(cloud.theta, whole, stages, cloud.runs)


def _next(level: np.ndarray, beta: float) -> float:
    """The next temperature: that at which a share COUNT of the particles counts."""
    from scipy.special import logsumexp  # slow to import

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


class _Fit:
    """Mean (p,) of weighted particles and a root (p, p) of their covariance."""

    def __init__(self, theta: np.ndarray, weights: np.ndarray) -> None:
        weights = weights / max(weights.sum(), np.finfo(float).tiny)
        self.centre = weights @ theta
        away = (theta - self.centre) * np.sqrt(weights)[:, None]
        covariance = away.T @ away
        size = np.sqrt(covariance.diagonal().clip(min=np.finfo(float).tiny))
        scaled = covariance / np.outer(size, size) + 1e-9 * np.eye(len(size))
        self.root = size[:, None] * np.linalg.cholesky(scaled)
        self.back = np.linalg.inv(self.root).T

    def own(self, theta: np.ndarray) -> np.ndarray:
        """θ (N, p) in coordinates of mean 0 and covariance 1."""
        return np.asarray((theta - self.centre) @ self.back)


def _move(cloud: _Cloud, beta: float, fits: Sequence[_Fit]) -> tuple[float, int, float]:
    """Move particles at a temperature; acceptance, moves, the correlation that is left."""
    before = fits[0].own(cloud.theta)
    until, most = (LAST, MOST_LAST) if beta == 1.0 else (REMEMBERED, MOST_MOVES)
    shares: list[float] = []
    independent, left = 1.0, 1.0
    for move in range(most):
        if move % 3 == 0 and (independent > RARE or move == 0):
            independent = share = _independently(cloud, beta, fits)
        else:
            share = _along_others(cloud, beta)
        shares.append(share)
        left = _correlation(before, fits[0].own(cloud.theta))
        if left <= until:
            break
    return float(np.mean(shares)), len(shares), left


def _along_others(cloud: _Cloud, beta: float) -> float:
    """Each particle goes along the difference of two others, of the half that does not move."""
    N, rng = len(cloud.theta), cloud.rng
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


def _independently(cloud: _Cloud, beta: float, fits: Sequence[_Fit]) -> float:
    """Proposals that do not depend on where a particle is, nor on where its half was."""
    p = cloud.theta.shape[1]

    def density(own: np.ndarray) -> np.ndarray:
        return np.asarray(-0.5 * (FREEDOM + p) * np.log1p((own**2).sum(axis=1) / FREEDOM))

    shares = []
    for half, fit in zip(cloud.halves, fits[::-1], strict=True):
        heavy = np.sqrt(FREEDOM / cloud.rng.chisquare(FREEDOM, len(half)))
        drawn = cloud.rng.standard_normal((len(half), p)) * heavy[:, None]
        ratio = density(fit.own(cloud.theta[half])) - density(drawn)
        shares.append(cloud.step(fit.centre + drawn @ fit.root.T, beta, ratio, half))
    return float(np.mean(shares))


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
