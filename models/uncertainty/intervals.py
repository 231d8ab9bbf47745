"""95 % intervals of physical parameters, and what the data say of each.

*determined*: its interval is narrow. *only in a combination*: it would be, were the others known;
the record tells it together with those named. *not excited*: not even then; the motion did not
move the parameter. *given*: it was not learned.
P free parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from models.estimator import Parameter
from models.fit.trainable import Trainable
from models.uncertainty.laplace import CONTRADICTED, Laplace
from models.uncertainty.parameters import slopes, values_of

ONE_SIDED, FAR = 1.645, 6.0  # the same of one side, where an error is so far off that it counts
MOST_OPEN = 0.25  # standard deviation of a determined parameter, in units of θ
ALIKE = 0.5  # correlation of parameters that are told together
MOST_NAMED = 2
ONE = 1e-9  # of a correlation: parameters that are one
DETERMINED, COMBINATION, UNEXCITED, GIVEN = (
    "determined",
    "only in a combination",
    "not excited",
    "given",
)
NAN = float("nan")


@dataclass(frozen=True)
class Interval:
    """Half widths of 95 % intervals about the value of a parameter, in its own unit.

    half: noise with the spectrum of the residual, the way that the solver left to the minimum, and
    what the integrator errs by. white: as if the noise were white. model_error: from
    blocks of the records, whatever the residual may be. NaN of a parameter that was given.
    """

    name: str
    value: float
    half: float
    white: float
    model_error: float
    status: str
    combined_with: tuple[str, ...] = ()


def intervals_of(estimator: Trainable, found: Laplace) -> list[Interval]:
    """Intervals of all physical parameters of an identified estimator, in the order of the list."""
    parameters = estimator.physical_parameters()
    values = partial(values_of, estimator, [p.name for p in parameters])
    return _intervals(parameters, slopes(estimator, values).numpy(), found, estimator.scale_is_open)


def _intervals(
    parameters: Sequence[Parameter], gradients: np.ndarray, found: Laplace, open_scale: bool
) -> list[Interval]:
    """Of parameters with gradients (Q, P) by θ."""
    gradients = np.nan_to_num(gradients)
    size = np.linalg.norm(gradients, axis=1)
    white, deviation = (np.sqrt(along(gradients, c)) for c in (found.white, found.coloured))
    # the way to the minimum that the solver did not go, and how far the integrator moved that,
    # or from the fit to what the records say without a stated prior that they contradict
    left = np.abs(gradients @ found.step) + np.abs(gradients @ found.numerical)
    denied = np.abs(found.tension) > CONTRADICTED
    left += np.abs(found.without[denied] @ gradients.T).max(axis=0, initial=0.0)
    between = between_blocks(found.blocks @ gradients.T)
    coloured = np.maximum(deviation / np.maximum(white, np.finfo(float).tiny), 1.0)
    alone = _alone(gradients, size, found.information) * coloured
    covariance = gradients @ found.coloured @ gradients.T
    centred, result = off_centre(deviation, left), []
    most = np.where(between + left > centred, between + left, centred)
    widths = np.stack([centred, off_centre(white, left), most], axis=1).tolist()
    for i, p in enumerate(parameters):
        if size[i] == 0.0:
            result.append(Interval(p.name, p.value, NAN, NAN, NAN, GIVEN))
            continue
        shared = open_scale and p.unit.startswith(("kg", "N"))
        status, others = DETERMINED, tuple[str, ...]()
        if shared or not deviation[i] + left[i] <= MOST_OPEN * size[i]:
            status = COMBINATION if shared or alone[i] <= MOST_OPEN * size[i] else UNEXCITED
        if status == COMBINATION:
            others = _partners(i, parameters, gradients, covariance, deviation)
        half, narrow, wide = widths[i]
        result.append(Interval(p.name, p.value, half, narrow, wide, status, others))
    return result


def along(G: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Variances (Q,) of what has slopes G (Q, P), by covariance C (P, P)."""
    return np.asarray(np.einsum("qi,ij,qj->q", G, C, G).clip(min=0.0))


def off_centre(deviation: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """Half widths that hold 95 % of normal errors whose means are off by known amounts."""
    from scipy.stats import ncx2  # slow to import

    far = bias >= FAR * deviation
    share = np.divide(bias, deviation, out=np.zeros_like(bias), where=~far)
    near = deviation * ncx2.ppf(0.95, 1, share**2) ** 0.5
    return np.where(far, bias + ONE_SIDED * deviation, near)


def between_blocks(steps: np.ndarray) -> np.ndarray:
    """Half widths (Q,) of a sum of contributions (m, Q) of m blocks, by their spread."""
    from scipy.stats import t as student  # slow to import

    m = len(steps)
    spread = np.sqrt(m / (m - 1.0) * ((steps - steps.mean(axis=0)) ** 2).sum(axis=0))
    return np.asarray(student.ppf(0.975, m - 1) * spread)


def _alone(gradients: np.ndarray, size: np.ndarray, information: np.ndarray) -> np.ndarray:
    """Standard deviations (Q,) along each gradient, were all that is across it known."""
    told = along(gradients, information)
    return size**2 / np.sqrt(np.maximum(told, np.finfo(float).tiny))


def _partners(
    i: int,
    parameters: Sequence[Parameter],
    gradients: np.ndarray,
    covariance: np.ndarray,
    deviation: np.ndarray,
) -> tuple[str, ...]:
    """Parameters of their own, not tied to parameter i, that go with it, the most alike first."""
    shared = np.abs(gradients @ gradients[i])
    size = np.linalg.norm(gradients, axis=1) * np.linalg.norm(gradients[i])
    one = {i, *np.flatnonzero((size > 0.0) & (shared >= (1.0 - ONE) * size)).tolist()}
    with np.errstate(divide="ignore", invalid="ignore"):
        alike = np.nan_to_num(np.abs(covariance[i]) / (deviation[i] * deviation))
    own = [j for j, p in enumerate(parameters) if j not in one and not p.derived]
    own = [j for j in own if alike[j] >= ALIKE]
    own.sort(key=lambda j: -alike[j])
    return tuple(parameters[j].name for j in own[:MOST_NAMED])
