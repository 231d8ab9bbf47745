"""A fit in which channels and stated priors count as its noise asks.

min Σ_c Σ_t (e_c/σ_c)² + Σ_j ρ_j (θ_j − m_j)²/s_j²

σ_c is the deviation of the residual of channel c; ρ_j the variance of noise with the residual's
spectrum over that of white noise, as parameter j meets it. Once a fit is made, both are estimated,
the fit goes on, and so on until they stay. Before, a bad sensor is told by what its record has at
frequencies to which no motion comes.
                              Aitken (1936), On least squares and linear combination of observations
n channels, T samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import torch

from data.record import Record, singles
from models.composition.composite import Composite
from models.fit.minimise import minimise
from models.fit.problem import FreeRunProblem
from models.uncertainty.laplace import CONTRADICTED, laplace
from models.uncertainty.parameters import free_vector, set_free_vector

ROUNDS, SAME = 5, 0.1  # at most; relative change of weights that ends them
TIMES = 3.0  # an error so much larger than another channel's takes over the fit,
WHITE = 0.5  # if so much of its energy is noise of the sensor: at high frequencies as at low ones
FAINT = 0.01  # of a channel's own size: a smaller error spoils no fit,
BAD, FIRST = 0.1, 0.05  # of all channels: noise that spoils a start; error of a model at first
LEAST = 0.01  # of the median relative error: no channel counts as if it had less
BANDS = 4  # of the upper half of the spectrum
STEPS: dict[str, Any] = {
    **{"iterations": 30, "change": 1e-7, "patience": 3, "scaled": True},
    **{"damping": 1e-4, "decrease": 0.2, "increase": 4.0, "largest": 1e6},
}

Errors = list[tuple[np.ndarray, np.ndarray]]


@torch.no_grad()
def weigh_at_first(model: Composite, batches: Iterable[Record], channels: str | None) -> None:
    """Let channels count by the noise of their sensors, before there is a fit.

    channels: "noise", or None: where one sensor's noise would spoil the start.
    """
    pairs = [(one.a.cpu().numpy(), one.excitation.cpu().numpy()) for one in singles(batches)]
    noise = noise_of_sensors(pairs)
    size = np.sqrt(np.mean([(y**2).mean(axis=0) for y, _ in pairs], axis=0))
    worst = int(noise.argmax())
    spoils = noise[worst] > max(TIMES * noise.min(), BAD * float(np.sqrt((size**2).mean())))
    if channels == "noise" or (channels is None and spoils):
        size = np.where(size > 0.0, size, size.max())
        weights = 1.0 / np.hypot(noise, FIRST * size)
        model.channels.copy_(torch.from_numpy(weights / np.median(weights)))


def noise_of_sensors(pairs: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Deviations (n,) of white noise in records (T, n) under excitations (T, m).

    By the upper half of their spectrum, without what follows the excitation. The least of some
    bands counts: motion that comes so far is more in some of them than in others.
    """
    parts = []
    for y, u in pairs:
        Y, U = (np.fft.rfft(signal, axis=0, norm="ortho") for signal in (y, u))
        upper = np.arange(len(Y) // 2, len(Y))
        powers = []
        for band in np.array_split(upper, BANDS):
            left = Y[band] - U[band] @ np.linalg.lstsq(U[band], Y[band], rcond=None)[0]
            powers.append((np.abs(left) ** 2).sum(axis=0) / max(1, len(band) - U.shape[1]))
        parts.append(powers)
    return np.asarray(np.sqrt(np.mean(parts, axis=0).min(axis=0)))


@torch.no_grad()
def refit(
    model: Composite,
    batch: Record,
    make_problem: Callable[[Record], FreeRunProblem],
    channels: str | None,
    prior: float | None,
    note: Callable[[list[float]], None],
) -> list[str]:
    """Go on from a fit with weights by its residual. Returns what was done unasked, in words.

    channels: "noise" weighs them, "equal" does not, None only where one `takes_over`. prior: the
    weight that the fit ended with, as in `Trainable.pull`.
    """
    errors = errors_of(model, batch)
    if not np.isfinite(deviations(errors)[0]).all():
        return []
    weighed = channels == "noise" or (channels is None and takes_over(errors) is not None)
    at_first = bool((model.channels != 1.0).any())
    if not weighed and not at_first and not model.stated:
        return []
    if not weighed:  # the noise that was seen at first is not what is left
        model.channels.fill_(1.0)
    for done in range(ROUNDS):
        change = _weigh_channels(model, errors) if weighed else 0.0
        change = max(change, _weigh_priors(model, batch, prior))
        if done and change < SAME:
            break
        note(minimise(make_problem(batch), STEPS))
        errors = errors_of(model, batch)
    if model.stated:
        _ask_records_alone(model, batch, make_problem)
    return [_remark_on(errors, batch.dof_numbers)] if weighed and channels is None else []


def _ask_records_alone(
    model: Composite, batch: Record, make_problem: Callable[[Record], FreeRunProblem]
) -> None:
    """Fit without stated priors; where that is likelier by more than they explain, keep the way.

    It begins at the fit, and where all parameters started. The likelihood ratio N log(σ²/σ₀²) is a
    square of as many standard deviations.
    """
    model.away.zero_()
    problem, held, colour = make_problem(batch), free_vector(model), model.colour.clone()
    before = float((problem.errors() ** 2).mean())
    started = held - model._own_pull(False, None)[1].detach().cpu()
    model.colour.zero_()
    ends = []
    for start in (held, started):
        set_free_vector(model, start)
        minimise(problem, STEPS)
        after = float((problem.errors() ** 2).mean())
        if 0.0 < after < before:
            ends.append((after, free_vector(model)))
    set_free_vector(model, held)
    model.colour.copy_(colour)
    size = problem.y.numel() / max(1.0, float(colour.median()))
    if ends:
        after, alone = min(ends, key=lambda end: end[0])
        if size * np.log(before / after) > CONTRADICTED**2:
            model.away.copy_(alone - held)


@torch.no_grad()
def errors_of(model: Composite, batch: Record) -> Errors:
    """Errors of the free run and what was measured (T, n), of every record."""
    found = []
    for record in singles([batch]):
        problem = FreeRunProblem(model, record, None)
        run = model.restarted_run(problem.record, None)[problem.counted]
        found.append(((problem.y - run).cpu().numpy(), problem.y.cpu().numpy()))
    return found


def takes_over(errors: Errors) -> int | None:
    """The channel whose sensor is so noisy that it takes over the fit; None where there is none.

    White noise has half of its energy in the upper half of the spectrum, a structure's motion and
    the error of a model next to none.
    """
    deviation, size = deviations(errors)
    worst = int(deviation.argmax())
    if not deviation[worst] > TIMES * deviation.min():
        return None
    upper, whole = 0.0, 0.0
    for e, _ in errors:
        power = np.abs(np.fft.rfft(e[:, worst], norm="ortho")) ** 2
        upper, whole = upper + float(power[len(power) // 2 :].sum()), whole + float(power.sum())
    white = 2.0 * upper > WHITE * whole
    return worst if white and deviation[worst] > FAINT * size[worst] else None


def deviations(errors: Errors) -> tuple[np.ndarray, np.ndarray]:
    """Root mean squares (n,) of errors and of what was measured."""
    both = (np.concatenate(part) for part in zip(*errors, strict=True))
    deviation, size = (np.sqrt((part**2).mean(axis=0)) for part in both)
    return deviation, size


def _weigh_channels(model: Composite, errors: Errors) -> float:
    """Let each channel count by its error. Returns the largest relative change of a weight."""
    deviation, size = deviations(errors)
    size = np.where(size > 0.0, size, size.max())
    relative = deviation / size
    least = LEAST * float(np.median(relative))
    if not np.isfinite(relative).all() or not least > 0.0:
        return 0.0
    weights = 1.0 / (size * relative.clip(min=least))
    new = torch.from_numpy(weights / np.median(weights)).to(model.channels)
    change = float((new / model.channels - 1.0).abs().max())
    model.channels.copy_(new)
    return change


def _weigh_priors(model: Composite, batch: Record, prior: float | None) -> float:
    """Let stated priors count by the noise's spectrum. Returns the largest relative change."""
    if not model.stated or (found := laplace(model, [batch], prior)) is None:
        return 0.0
    colour = torch.from_numpy(found.colour)[model.numbers_of_stated()].to(model.colour)
    change = float((colour / model.colour - 1.0).abs().max())
    model.colour.copy_(colour)
    return change


def _remark_on(errors: Errors, numbers: Sequence[int]) -> str:
    deviation, size = deviations(errors)
    worst = int(deviation.argmax())
    times = float(deviation[worst] / np.median(np.delete(deviation, worst)))
    return (
        f"channel {numbers[worst]} has noise of {100 * deviation[worst] / size[worst]:.2g} %, "
        f"{times:.2g} times that of others: channels count by their noise (objective.channels)"
    )
