"""Whether a fit identified anything, and whether plain models do as well.

`identified` is judged on the training motion alone. On test motions, and those that data.validation
holds back, the model is held against no motion at all and plain models of the same training, also
by blocks: what differs by less than two standard errors of their differences is as good. A model
that simulates is judged by its free run; every other one by its estimates one step ahead, for which
the free run is information. A motionless structure is at 100 % by definition of the error (Eq. 21).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from data.datamodule import Data
from data.record import Record
from models import FIR, LinearStateSpace
from models.baselines import FilteredExtrapolation, LastValue, TwoPoint
from models.estimator import Estimator, simulate
from models.fit.blocks import beyond_chance, errors_by_block
from models.fit.extrapolation import BOUND, excess
from models.fit.identification import HELD_BACK, Identification
from models.fit.metrics import FREE_RUNS, STILL, left_at
from models.linear import EquivalentLinear
from models.linear_motion import LinearMotion
from runner.scores.result import ERROR
from runner.scores.spread import percent

CHANCE = 2.0  # standard errors of the blocks' differences, which chance seldom exceeds
EQUAL = 0.999  # of another error: two fits of what is the same
SPARED = 0.98  # of the error of no motion: a small motion fits anything by chance
CLOSE = 0.1  # percent: below it no model is worse for a linear one that is exact
CANNOT = (ValueError, RuntimeError, MemoryError)  # of a baseline that cannot run
EXTRAPOLATIONS = {
    "two_point": TwoPoint,
    "last_value": LastValue,
    "filtered_extrapolation": FilteredExtrapolation,
}
PLAIN: tuple[type[Estimator], ...] = (
    FIR,
    LinearStateSpace,
    LinearMotion,
    EquivalentLinear,
    *EXTRAPOLATIONS.values(),
)
OPPONENTS = {"linear": LinearMotion, "fir": FIR, "linear_state_space": LinearStateSpace}
MOTIONS = {"test": "test", HELD_BACK: "held-back"}


class NotIdentifiedError(ValueError):
    """Raised after a single run whose model is no result; its numbers are written."""

    status = 3  # of the program; 1 says that there are no numbers


def verdict_of(
    module: Identification,
    results: Mapping[str, Any],
    on_base: bool,
    opponents: Mapping[str, Estimator | ValueError],
    train: Sequence[Record],
    motions: Mapping[str, Sequence[Record]],
) -> dict[str, Any]:
    """For `metrics.json`: `identified` (null: nothing to judge), `reason`, and what was compared.

    results: errors of the model, as `metrics.json` has them; opponents: identified baselines.
    """
    if module.estimator.identified_parameters == 0:
        return {"identified": None, "reason": "the estimate has nothing to identify"}
    way = "free run" if simulates(module, results) else "one step"
    key = FREE_RUNS["train"] if way == "free run" else "train"
    verdict = judgement(way, results[key], on_base)
    if verdict["identified"] is None:
        return verdict
    made = module.estimates_made()
    return verdict | compare_with(module.estimator, opponents, train, motions, way, made)


def trained_on_free_run(module: Identification) -> bool:
    """Whether a solver minimised the error of the model's free run."""
    return module.solver is not None and module.objective.simulates


def simulates(module: Identification, results: Mapping[str, Any]) -> bool:
    """Whether the model was trained on its free run, or all that it estimates is one."""
    own, free = (results[key].get(ERROR) for key in ("train", FREE_RUNS["train"]))
    return trained_on_free_run(module) or (own is not None and own == free)


def opponents_of(
    module: Identification, data: Data, baselines: Mapping[str, Estimator | ValueError]
) -> dict[str, Estimator | ValueError]:
    """The baselines, after what a model that simulates is held against whatever they are."""
    always = OPPONENTS if simulates(module, module.results()) and data.inputs else {}
    plain = {name: make(data.dofs, data.inputs, data.dt) for name, make in always.items()}
    return {**plain, **baselines}


def judgement(way: str, scores: Mapping[str, Any], on_base: bool) -> dict[str, Any]:
    """The verdict on errors in percent on the training motion."""
    verdict = {"by": way, "error_percent": scores.get(ERROR)}
    if "no_free_run" in scores:
        return {"identified": None, "reason": scores["no_free_run"], **verdict}
    reason = _fault(way, scores, on_base)
    return {"identified": not reason, "reason": reason, **verdict}


def _fault(way: str, scores: Mapping[str, Any], on_base: bool) -> str:
    """Why a model is no result; "" where it is one."""
    what = f"its {'free run' if way == 'free run' else 'estimate'} of the training motion"
    error, left = scores.get(ERROR), scores.get("diverged_after_s")
    if left:
        return f"{what} diverges after {min(left):.3g} s"
    if error is None:
        return f"{what} overflows"
    if error >= STILL:
        still = "moving rigidly with the base" if on_base else "no motion at all"
        return f"{what} errs by {error:.4g} %, {still} by 100 %"
    return ""


def motions_of(data: Data) -> dict[str, list[Record]]:
    """Records that no fit saw: of test, and those held back, after what was trained on."""
    splits = ("test", *(key for key in (HELD_BACK,) if data.records.get(key)))
    return {split: list(data.loader(split)) for split in splits}


def compare_with(
    model: Estimator,
    opponents: Mapping[str, Estimator | ValueError],
    train: Sequence[Record],
    motions: Mapping[str, Sequence[Record]],
    way: str,
    made: Mapping[tuple[str, str], Tensor] | None = None,
) -> dict[str, Any]:
    """Errors in percent of plain opponents by motion; which are as good, and why a model is none.

    as_good: a sentence on opponents that are not worse; not_better: on one that is better than a
    model that simulates, on no motion, where that is as good (a sensor's offset is none), or on a
    free run that grows beyond bounds under excitations like those of training (`unstable`); worse:
    the same, but on an opponent only where it is better beyond chance. "" where there is nothing
    to say. A plain model is not judged by other plain models. made: estimates of the model that are
    known, as `Identification.estimates_made` has them.
    """
    simulates = way == "free run" and not isinstance(model, PLAIN)
    unstable = _instability(model, train) if simulates else ""
    verdict: dict[str, Any] = {"as_good": "", "opponents": {}}
    verdict["not_better"] = verdict["worse"] = verdict["unstable"] = unstable
    for split, records in motions.items():
        own, others = block_errors(model, records, way, (made or {}).get((split, way))), {}
        if own is None:
            continue  # a run that diverges is told with its motion
        for name, one in opponents.items():
            if isinstance(one, PLAIN) and type(one) is not type(model):
                others[name] = block_errors(one, records, way)
        known = {name: e for name, e in others.items() if e is not None}
        verdict["opponents"][split] = {name: rms_percent(e) for name, e in known.items()}
        still = errors_by_block(records, still_of(records))
        for key, text in _sentences(own, still, known, MOTIONS[split], simulates).items():
            verdict[key] = verdict[key] or text
    return verdict


def _instability(model: Estimator, records: Sequence[Record]) -> str:
    """That free runs under excitations like those of records leave all bounds; "" where not."""
    device = next((t.device for t in model.state_dict().values()), torch.device("cpu"))
    driven = [r.measured().to(device) for r in records if r.excitation.shape[-1] and r.e is None]
    try:
        times = excess(model, driven)
    except CANNOT:
        return ""
    size = f"to {times:.3g} times the motion of training" if math.isfinite(times) else "without end"
    grows = f"its free run grows {size} under excitations of the same spectrum"
    return grows if times > BOUND else ""


def _sentences(
    own: np.ndarray, still: np.ndarray, known: Mapping[str, np.ndarray], motion: str, sim: bool
) -> dict[str, str]:
    error, plain = rms_percent(own), {name: rms_percent(errors) for name, errors in known.items()}
    ranked = sorted(plain, key=plain.__getitem__)
    good = [name for name in ranked if beyond_chance(own, known[name]) <= CHANCE]
    good = good if error > CLOSE else []
    texts: dict[str, str] = {}
    errs = f"it errs by {percent(error)} % on the {motion} motion"
    if beyond_chance(own, still) <= CHANCE or error > SPARED * rms_percent(still):
        still_errs = f"{errs}, no motion at all by {percent(rms_percent(still))} %"
        texts |= {"not_better": still_errs, "worse": still_errs}
    elif good and sim and error > EQUAL * plain[good[0]]:
        texts["not_better"] = f"{errs}, {good[0]} by {percent(plain[good[0]])} %"
    better = [name for name in good if sim and beyond_chance(known[name], own) > CHANCE]
    if better:
        texts.setdefault("worse", f"{errs}, {better[0]} by {percent(plain[better[0]])} %")
    if good:
        listed = ", ".join(f"{name} ({percent(plain[name])} %)" for name in good)
        ahead = [plain[name] < EQUAL * error for name in good]
        word = "better" if all(ahead) else "as good or better" if any(ahead) else "as good"
        texts["as_good"] = f"{errs}; {word}: {listed}"
    return texts


def rms_percent(errors: np.ndarray) -> float:
    """Error in percent over all blocks."""
    return 100.0 * math.sqrt(float(errors.mean()))


def still_of(records: Sequence[Record]) -> list[Tensor]:
    """Estimates (…, T, n) of no motion: a sensor's offset is none."""
    return [r.a.mean(-2, keepdim=True).expand_as(r.a) for r in records]


def block_errors(
    estimator: Estimator, records: Sequence[Record], way: str, made: Tensor | None = None
) -> np.ndarray | None:
    """Squared errors (K,) on blocks; None where there is no run, or one diverges."""
    estimates = estimates_of(estimator, records, way, made)
    try:
        return None if estimates is None else errors_by_block(records, estimates)
    except CANNOT:
        return None


@torch.no_grad()
def estimates_of(
    estimator: Estimator, records: Sequence[Record], way: str, made: Tensor | None = None
) -> list[Tensor] | None:
    """Estimates (…, T, n) of records, in free run or one step ahead; None where one diverges.

    made: the estimate of a single batch, where it is known.
    """
    known = made is not None and [record.a.shape for record in records] == [made.shape]
    device = next((t.device for t in estimator.state_dict().values()), torch.device("cpu"))
    estimates = []
    try:
        for record in records:
            seen = record.measured().to(device)
            if known and made is not None:
                estimates.append(made.to(device))
            else:
                free = way == "free run"
                estimates.append(simulate(estimator, seen).a if free else estimator(seen))
            if left_at(estimates[-1], seen):
                return None
    except CANNOT:
        return None
    return estimates


def divergence(metrics: Mapping[str, Any]) -> str:
    """On which of its own motions a stored run's model diverges, in words; "" where on none."""
    for split, words in (("train", "training"), ("test", "test")):
        left = metrics.get(FREE_RUNS[split], {}).get("diverged_after_s")
        if left:
            return f"the free run of its own {words} motion diverges after {min(left):.3g} s"
    return ""


def lost_on(runs: Mapping[str, Mapping[str, Any]], beyond: Mapping[str, bool]) -> str:
    """The test motions on which a free run diverges, in words; "" where it stays on all.

    runs: scores of the free run of each test motion; beyond: whether that motion leaves the range
    that was trained, where nobody knows what the structure does.
    """
    motions = [
        f"{name} at {min(left):.3g} s" + (", outside the trained range" if beyond[name] else "")
        for name, scores in runs.items()
        if (left := scores.get("diverged_after_s"))
    ]
    return f"its free run diverges on test motions: {'; '.join(motions)}" if motions else ""
