"""What a run's model may be used for, in one of three grades, with a number and a reason.

simulates the structure: the free run of unseen motion stays within a tolerance of all that is no
    noise, is better than no motion in every channel, and no plain model is better
estimates one step ahead only: the model is better than no motion, and needs the excitation for it,
    but does not simulate
not identified: none of both

Squared errors are relative to the measured motion. Noise is what is white in the residual and in
the motion and does not follow the excitation, by the upper half of their spectra; all else is the
model's. Coloured noise counts as the model's, too: the grade is then too strict.
T samples, n channels, K blocks.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from data.record import Record
from models.estimator import Estimator
from models.fit.blocks import BLOCKS, beyond_chance, each_by_block, errors_by_block
from models.fit.identification import HELD_BACK
from models.fit.metrics import FREE_RUNS
from models.fit.noise_weights import noise_of_sensors
from models.fit.trained_range import worst_of
from models.uncertainty.conformal import LEVEL
from runner.scores.spread import percent
from runner.scores.verdict import (
    CANNOT,
    CHANCE,
    EXTRAPOLATIONS,
    OPPONENTS,
    SPARED,
    block_errors,
    compare_with,
    estimates_of,
    rms_percent,
    still_of,
)

SIMULATES, ONE_STEP = "simulates the structure", "estimates one step ahead only"
NOTHING = "not identified"
BY_FREE_RUN = "a model that is trained on its free run, such as model=element_network"
UNDRIVEN = "and by no more with the excitation of another time: it does not depend on it"
WITHOUT = "a zero response or an unrestrained mass"
HALF = 0.5  # of a power: a motion is noise, or missed, that is so for the greater part
UNEXPLAINED = 0.1  # of the power of a motion without its noise: what its model may leave
TOLERANCE = 100.0 * math.sqrt(UNEXPLAINED)  # percent


@dataclass(frozen=True)
class Errors:
    """Squared relative errors of estimates: on blocks (K,), and how much of their mean is noise.

    weak: numbers of the channels in which the estimate is not better than without a structure.
    """

    blocks: np.ndarray
    noise: float
    weak: Sequence[int]

    @property
    def error(self) -> float:
        """In percent."""
        return rms_percent(self.blocks)

    @property
    def own(self) -> float:
        """In percent of the motion that is no noise: what the model misses of it."""
        missed = max(float(self.blocks.mean()) - self.noise, 0.0)
        return 100.0 * math.sqrt(missed / (1.0 - self.noise)) if self.noise < 1.0 else math.inf

    @property
    def interval(self) -> list[float]:
        """That of the error in percent by the scatter of its blocks, taken of their logarithm."""
        from scipy.special import stdtrit  # slow to import

        mean, K = float(self.blocks.mean()), len(self.blocks)
        spread = float(self.blocks.std(ddof=1)) / math.sqrt(K) / mean if mean > 0.0 else 0.0
        half = 0.5 * float(stdtrit(K - 1, 0.5 + 0.5 * LEVEL)) * spread
        return [self.error * math.exp(-half), self.error * math.exp(half)]


def errors_of(
    model: Estimator, records: Sequence[Record], way: str, made: Tensor | None = None
) -> Errors | None:
    """Those of a model; None where it has no such estimates, or they diverge."""
    estimates = estimates_of(model, records, way, made)
    if estimates is None:
        return None
    try:
        blocks, noise = errors_by_block(records, estimates), noise_share(records, estimates)
    except CANNOT:
        return None
    numbered = enumerate(records[0].dof_numbers)
    weak = [number for c, number in numbered if not _moves(records, estimates, c)]
    return Errors(blocks, noise, weak)


def _moves(records: Sequence[Record], estimates: Sequence[Tensor], c: int) -> bool:
    """Whether a channel's estimates are better than without a structure, beyond chance."""
    own = [replace(r, a=r.a[..., [c]], x=None, v=None, truth=None, numbers=()) for r in records]
    every = [[estimate[..., [c]] for estimate in estimates], still_of(own), loose_of(own)]
    try:
        errors, *others = each_by_block(own, every)
    except ValueError:  # a few samples hold all its power: the sum over all channels judges it
        return True
    return all(
        beyond_chance(errors, other) > CHANCE and errors.mean() < SPARED**2 * other.mean()
        for other in others
    )


def loose_of(records: Sequence[Record]) -> list[Tensor]:
    """Estimates (…, T, n) of masses that nothing holds: accelerations go with the forces alone.

    Of a base that shakes, a mass that stays where it is moves by as much, the other way: without
    this, sensors of something else would be simulated where they show less motion than the base.
    """
    first = records[0]
    if not first.excitation.shape[-1] or first.quantity != "acceleration":
        return still_of(records)
    u, a = (
        torch.cat([v.reshape(-1, v.shape[-1]) for v in rows])
        for rows in ([r.excitation for r in records], [r.a for r in records])
    )
    gains = torch.linalg.lstsq(u, a, driver="gelsd").solution
    return [r.excitation @ gains for r in records]


def noise_share(records: Sequence[Record], estimates: Sequence[Tensor]) -> float:
    """Share of the measured power that is white noise, in the residual and in the motion."""
    pairs, power = [], np.zeros(2)  # sum of squares, samples
    for record, estimate in zip(records, estimates, strict=True):
        seen = torch.cat([record.a.cpu(), estimate.cpu(), record.excitation.cpu()], dim=-1)
        for one in seen.reshape(-1, *seen.shape[-2:])[:, record.warmup :].numpy():
            y, own, u = np.split(one, [record.dofs, 2 * record.dofs], axis=1)
            pairs.append((y, y - own, u))
            power += np.square(y).sum(), len(y)
    white = [noise_of_sensors([(pair[i], pair[2]) for pair in pairs]) for i in (0, 1)]
    return float(min(np.square(noise).sum() for noise in white) * power[1] / power[0])


@dataclass(frozen=True)
class Judged:
    """A fitted model, its training motions, those that no fit saw, and what was said of it.

    verdict: as `verdict_of` has it; facts: other parts of `metrics.json`; plain: models that were
    identified on the same motion, to which those are added that are needed; made: estimates of the
    model that are known, as `Identification.estimates_made` has them.
    """

    model: Estimator
    train: Sequence[Record]
    motions: Mapping[str, Sequence[Record]]
    verdict: Mapping[str, Any]
    facts: Mapping[str, Any]
    plain: dict[str, Estimator] = field(default_factory=dict)
    made: Mapping[tuple[str, str], Tensor] = field(default_factory=dict)


def grade_of(run: Judged) -> dict[str, Any]:
    """For `verdict` in `metrics.json`: `grade`, and squared errors of the model on `blocks`.

    held_back: the same of held-back motion by way, in free run and one step ahead, with the noise
    in it, for who chooses among models.
    """
    model, test, held = run.model, run.motions["test"], run.motions.get(HELD_BACK)
    free = errors_of(model, test, "free run", run.made.get(("test", "free run")))
    grade, way, found, why = SIMULATES, "free run", free, _fault(run, free)
    if why:
        found = errors_of(model, test, "one step", run.made.get(("test", "one step")))
        if free and found and np.allclose(free.blocks, found.blocks):
            found = free  # all that it estimates is a free run
        way = "free run" if found is free else "one step"
        grade, reason = _of_one_step(run, found, why, way)
    elif found:
        reason = _praise(run, found)
    by_run = run.verdict.get("by") == "free run"
    ways = ("free run", *(() if by_run else ("one step",))) if held else ()
    late = {one: errors_of(model, held or (), one) for one in ways}
    return {
        "grade": {
            "grade": grade,
            "by": way,
            "error_percent": found and found.error,
            "interval_percent": found and found.interval,
            "noise_percent": found and 100.0 * math.sqrt(found.noise),
            "tolerance_percent": TOLERANCE,
            "reason": reason,
            "advice": list(_advice(run, grade, free or found, reason)),
        },
        "blocks": {"test": found and found.blocks.tolist()},
        "held_back": {
            one: {"blocks": e.blocks.tolist(), "noise_percent": 100.0 * math.sqrt(e.noise)}
            for one, e in late.items()
            if e is not None
        },
    }


def _fault(run: Judged, free: Errors | None) -> str:
    """Why the free run is no simulation of the structure; "" where it is one."""
    if run.model.identified_parameters == 0:
        return "the estimate has nothing to identify"
    verdict, by_run, test = run.verdict, run.verdict.get("by") == "free run", run.motions["test"]
    try:
        errors_by_block(test, still_of(test))
    except ValueError as error:
        return f"the test motion tells no error: {error}"
    if free is None:
        scores = run.facts.get(FREE_RUNS["test"], {})
        left = "its simulation of unseen motion diverges"
        left += "".join(f" after {min(at):.3g} s" for at in [scores.get("diverged_after_s")] if at)
        said = verdict.get("test_diverges") or (verdict.get("reason") if by_run else "")
        return said or scores.get("no_free_run", left)
    errs = f"its simulation of unseen motion errs by {percent(free.error)} %"
    if free.noise > HALF:
        return f"{errs}, and the motion is noise for the greater part"
    if free.own > TOLERANCE:
        return f"{errs}{_noise(free)}, more than the tolerance of {TOLERANCE:.1f} %"
    if free.weak:
        return f"{errs}, but in channel {free.weak[0]} is no better than {WITHOUT}"
    trained = errors_of(run.model, run.train, "free run", run.made.get(("train", "free run")))
    if trained is None or trained.own > TOLERANCE:
        there = "diverges" if trained is None else f"errs by {percent(trained.error)} %"
        return f"{errs}, but that of the training motion {there}"
    if not by_run:
        linear, motions = _linear(run), run.motions
        verdict = compare_with(run.model, linear, run.train, motions, "free run", run.made)
    return str(verdict.get("worse", ""))


def _linear(run: Judged) -> dict[str, Estimator | ValueError]:
    """Linear models of the training motion; one that cannot be identified estimates nothing."""
    model, found = run.model, dict[str, Estimator | ValueError]()
    for name, make in OPPONENTS.items() if model.inputs else ():
        if known := [one for one in run.plain.values() if isinstance(one, make)]:
            found[name] = known[0]
            continue
        found[name] = run.plain[make.__name__] = one = make(model.dofs, model.inputs, model.dt)
        with suppress(*CANNOT):
            one.identify(run.train)
    return found


def needs_excitation(model: Estimator, records: Sequence[Record], own: Errors) -> bool:
    """Whether the estimates are better than under the excitation of any other block of the motion.

    What follows from the response's own past, as that of any smooth signal does, is no structure.
    Where nothing drives the motion, they have to be better than extrapolations of it.
    """
    if model.inputs:
        shifts = [[k * r.samples // BLOCKS for r in records] for k in range(1, BLOCKS)]
        moved = ([*map(_driven_later, records, samples)] for samples in shifts)
        late = (estimates_of(model, one, "one step") for one in moved)
        others = [*each_by_block(records, [one for one in late if one is not None])]
    else:
        others = [*_extrapolated(model, records).values()]
    tiny = np.finfo(float).tiny  # has a logarithm: ratios count
    sizes = [np.log(np.maximum(squares, tiny)) for squares in (own.blocks, *others)]
    return all(beyond_chance(sizes[0], other) > CHANCE for other in sizes[1:])


def _driven_later(record: Record, samples: int) -> Record:
    """The record with its excitation moved in a circle by some samples."""
    driven = {k: u.roll(samples, -2) for k, u in record.signals().items() if k not in "axvo"}
    return replace(record.measured(), **driven)  # type: ignore[arg-type]


def _extrapolated(model: Estimator, records: Sequence[Record]) -> dict[str, np.ndarray]:
    """Squared errors (K,) of extrapolations; of none whose filter is too fast for the samples."""
    found = {}
    for name, make in EXTRAPOLATIONS.items():
        try:
            one = make(model.dofs, model.inputs, model.dt)
        except ValueError:
            continue
        if (errors := block_errors(one, records, "one step")) is not None:
            found[name] = errors
    return found


def _of_one_step(run: Judged, found: Errors | None, why: str, way: str) -> tuple[str, str]:
    """Grade and reason of a model that does not simulate the structure."""
    if found is None or run.model.identified_parameters == 0:
        return NOTHING, why
    ahead = "" if way == "free run" else f"; one step ahead it errs by {percent(found.error)} %"
    errs, test = f"{why}{ahead}", run.motions["test"]
    for plain in each_by_block(test, [still_of(test), loose_of(test)]):
        if beyond_chance(found.blocks, plain) <= CHANCE:
            return NOTHING, f"{errs}, no better than {WITHOUT}"
    if found.own > 100.0 * math.sqrt(HALF):
        return NOTHING, f"{errs}, and misses the greater part of the motion"
    if not needs_excitation(run.model, test, found):
        return NOTHING, f"{errs}, {UNDRIVEN}"
    best, error = _best({n: rms_percent(e) for n, e in _extrapolated(run.model, test).items()})
    beside = f", an extrapolation ({best}) by {percent(error)} %" if error < found.error else ""
    return ONE_STEP, f"{errs}{beside}"


def _praise(run: Judged, free: Errors) -> str:
    """Of a model that simulates the structure: its error, and that of the best plain model."""
    low, high = free.interval
    errs = f"its simulation of unseen motion errs by {percent(free.error)} %"
    best, error = _best(run.verdict.get("opponents", {}).get("test", {}))
    beside = f"; the best plain model ({best}) by {percent(error)} %" if best else ""
    return f"{errs} (95 % interval: {percent(low)} to {percent(high)} %){_noise(free)}{beside}"


def _best(others: Mapping[str, float]) -> tuple[str, float]:
    """Name and error in percent of the best of some models; "" and infinite of none."""
    return min(others.items(), key=lambda item: item[1], default=("", math.inf))


def _noise(errors: Errors) -> str:
    """In words, where it matters."""
    counts = errors.noise >= UNEXPLAINED * errors.blocks.mean()
    return f", with {percent(100.0 * math.sqrt(errors.noise))} % of noise" if counts else ""


def _advice(run: Judged, grade: str, found: Errors | None, reason: str) -> Iterator[str]:
    """What would help, each for a fact of the run."""
    short = grade != SIMULATES and run.model.identified_parameters > 0
    by_run = run.verdict.get("by") == "free run"
    if reason.endswith(UNDRIVEN):
        yield "check that the excitation is what drives this structure: its column, clock and sign"
    if short and not by_run and run.model.inputs:
        yield BY_FREE_RUN
    name, error = _best(run.verdict.get("opponents", {}).get("test", {}))
    if by_run and found is not None and error < found.error:
        yield f"{name} in its place: it errs by {percent(error)} %"
    if short and (left := worst_of(run.facts.get("outside_trained_range", []))):
        yield f"train on such motion: the test motion reaches {left}"
    if short and found is not None:
        for number in found.weak if len(found.weak) < run.model.dofs else ():
            yield f"look at channel {number}: the model is no better than no motion there"
        if found.noise > HALF * found.blocks.mean():
            yield "quieter sensors or larger motion: most of the error is noise"
    low, high = found.interval if found is not None else (0.0, 0.0)
    if high > 2.0 * low and percent(high) != percent(low):  # as it is printed
        yield "a longer record: the interval of its error is wider than a factor of two"
    if short and sum(r.a.shape[:-2].numel() for r in run.train) == 1:
        yield "a second event to train on"
    if run.facts.get("uncertainty", {}).get("model_lacks_terms"):
        yield "other elements or laws: what it does not explain is more than noise"
    if run.model.scale_is_open:
        yield "the masses (model.masses=[…]): without them forces are known up to a common factor"
