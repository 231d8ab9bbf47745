"""Sequential Monte Carlo beside a published sampler on the same posterior, and what both cost.

    python -m benchmarks.sampling [--particles 1000] [--steps 4000] [--seed 0] [--threads N]

Two masses whose springs stiffen at a gap, 10 s of accelerations with 5 % noise, 10 parameters:
masses, springs, dampers, gaps and what is beyond them. The peer is emcee (Foreman-Mackey et al.
2013), the affine-invariant ensemble sampler of Goodman and Weare: pip install emcee.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import torch
from scipy.signal import lfilter

from data.arguments import Parser
from data.record import Drive, Record
from models.element_network import ElementNetwork
from models.uncertainty.laplace import laplace
from models.uncertainty.parameters import free_vector, set_free_vector
from models.uncertainty.posterior import Likelihood, Posterior, Prior
from models.uncertainty.profile import most_likely
from models.uncertainty.smc import Wide, agreement_of, tempered
from runner.config.command_line import command_errors

DT, SAMPLES, NOISE, FORCE = 0.01, 1000, 0.05, 6.0  # s, –, of the motion, N
WALKERS, BURNT = 40, 0.25  # of emcee; share of its steps that is dropped
CLOSE = 0.2  # posterior standard deviations


def planted(seed: int) -> tuple[ElementNetwork, Record]:
    """A model and a noisy record of its own motion."""
    rng = np.random.default_rng(seed)
    chain = [["ground", "x1"], ["x1", "x2"]]
    model = ElementNetwork(2, 2, DT, chain, hinges=1, units=0, cubic=False)
    stiffness = torch.tensor([80.0, 50.0], dtype=torch.float64)
    model.mass.start(torch.tensor([1.0, 1.5], dtype=torch.float64))
    model.laws.start(stiffness, 0.01 * stiffness, torch.full_like(stiffness, 0.1), (0.5, 0.5))
    model.laws.hinge_stiffness.theta.data.fill_(1.5)
    model.identified.fill_(1.0)
    f = lfilter([1.0], [1.0, -1.8, 0.85], rng.standard_normal((SAMPLES, 2)), axis=0)
    rest = torch.zeros(2, dtype=torch.float64)
    drive = Drive(DT, torch.from_numpy(FORCE * f / f.std()), rest, rest)
    with torch.no_grad():
        run = model.free_run(drive)
    noise = NOISE * run.a.std() * torch.from_numpy(rng.standard_normal(run.a.shape))
    return model, replace(Record(dt=DT, a=run.a, f=drive.u), a=run.a + noise)


def posterior_of(model: ElementNetwork, record: Record) -> tuple[Posterior, np.ndarray]:
    """Of all parameters, at their mode (P,)."""
    theta = free_vector(model)
    for _ in range(3):  # to the fit, which is near
        found = laplace(model, [record])
        assert found is not None
        set_free_vector(model, free_vector(model) + torch.from_numpy(found.step))
    found = laplace(model, [record])
    assert found is not None
    likelihood = Likelihood(model, [record], found)
    posterior = Posterior(likelihood, Prior.of(model), np.arange(len(theta)))
    best, _ = most_likely(posterior, free_vector(model).numpy())
    set_free_vector(model, torch.from_numpy(best))
    likelihood.compile()
    return posterior, best


def by_emcee(
    posterior: Posterior, best: np.ndarray, steps: int, threads: int, seed: int
) -> tuple[np.ndarray, float]:
    """Samples (M, P) and the longest autocorrelation time in steps."""
    try:
        import emcee  # type: ignore[import-not-found,unused-ignore]
    except ImportError:
        raise SystemExit("error: the peer is missing; pip install emcee") from None
    rng = np.random.default_rng(seed)
    deviation = np.sqrt(np.linalg.inv(posterior.at(best).matrix).diagonal())
    start = best + deviation * rng.standard_normal((WALKERS, len(best)))

    def density(theta: np.ndarray) -> np.ndarray:
        return posterior.log_likelihood(theta, threads) + posterior.prior.log_density(theta)

    sampler = emcee.EnsembleSampler(WALKERS, len(best), density, vectorize=True)
    sampler.random_state = np.random.RandomState(seed).get_state()
    sampler.run_mcmc(start, steps)
    slowest = float(np.max(sampler.get_autocorr_time(tol=0)))
    return sampler.get_chain(discard=int(BURNT * steps), flat=True), slowest


def main() -> None:
    parser = Parser(description=__doc__.split("\n")[0])
    for name, default in (("particles", 1000), ("steps", 4000), ("seed", 0), ("threads", 2)):
        parser.add_argument(f"--{name}", type=int, default=default)
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    model, record = planted(chosen.seed)
    posterior, best = posterior_of(model, record)
    begin = Wide.about(best, np.linalg.inv(posterior.at(best).matrix))
    begun, used = time.perf_counter(), time.process_time()
    seeds = np.random.SeedSequence(chosen.seed).spawn(2)
    runs = [
        tempered(
            lambda theta: posterior.log_likelihood(theta, chosen.threads),
            posterior.prior, chosen.particles, np.random.default_rng(own), begin,
        )
        for own in seeds
    ]  # fmt: skip
    wall, cpu = time.perf_counter() - begun, time.process_time() - used
    total, agreement = sum(run.runs for run in runs), agreement_of(runs)
    print(
        f"two runs of {chosen.particles} particles, {len(best)} parameters, {SAMPLES} samples: "
        f"{total} free runs, {wall:.0f} s ({cpu:.0f} s of processors) on {chosen.threads} threads"
    )
    print(
        f"log evidence {runs[0].log_evidence:.2f} and {runs[1].log_evidence:.2f}; R-hat "
        f"{agreement.r_hat:.3f}",
        flush=True,
    )
    begun, used = time.perf_counter(), time.process_time()
    chain, slowest = by_emcee(posterior, best, chosen.steps, chosen.threads, chosen.seed)
    wall, cpu = time.perf_counter() - begun, time.process_time() - used
    print(
        f"emcee: {WALKERS} walkers of {chosen.steps} steps, {wall:.0f} s ({cpu:.0f} s of "
        f"processors), autocorrelation {slowest:.0f} steps"
    )
    own = np.concatenate([run.particles for run in runs])
    deviation, worst = chain.std(axis=0), 0.0
    print(f"{'θ':<28}{'SMC':>18}{'emcee':>18}{'apart [sd]':>12}")
    for j, name in enumerate(_names(model)):
        apart = abs(own[:, j].mean() - chain[:, j].mean()) / deviation[j]
        worst = max(worst, apart)
        pair = [f"{s[:, j].mean():.4f} ± {s[:, j].std():.4f}" for s in (own, chain)]
        print(f"{name:<28}{pair[0]:>18}{pair[1]:>18}{apart:>12.2f}")
    print(f"means are {worst:.2f} posterior standard deviations apart at most; asked: {CLOSE}")


def _names(model: ElementNetwork) -> list[str]:
    return [
        f"{name.removesuffix('.theta')} {i + 1}"
        for name, p in model.named_parameters()
        if p.requires_grad
        for i in range(p.numel())
    ]


if __name__ == "__main__":
    with command_errors():
        main()
