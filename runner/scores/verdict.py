"""Whether a fit identified anything: the model against nothing, a rigid body and a linear one.

Judged on the training motion alone. A test motion on which the free run diverges has no error and
is reported with the verdict. A model that was trained on its free run is judged by its free run;
every other one by its estimates one step ahead, for which the free run is information. A
motionless structure is at 100 % by definition of the error (Eq. 21).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from data.datamodule import Data
from data.record import Record
from models.estimator import Estimator
from models.fit.identification import Identification
from models.fit.metrics import FREE_RUNS, free_run_score
from models.linear_motion import LinearMotion

STILL = 100.0  # percent, of no motion
WORSE = 1.05  # times the linear system's error: a model that contains it may miss it by rounding
CLOSE = 0.1  # percent: below it no model is worse for a linear one that is exact
ERROR = "relative_rms_percent"
CANNOT = (ValueError, RuntimeError, MemoryError)  # of a baseline that cannot run


class NotIdentifiedError(ValueError):
    """Raised after a single run whose model identified nothing; its numbers are written."""


def verdict_of(
    module: Identification,
    results: Mapping[str, Any],
    data: Data,
    baselines: Mapping[str, Mapping[str, Any]],
) -> dict[str, Any]:
    """For `metrics.json`: `identified` (null: nothing to judge), `reason`, and what was compared.

    results, baselines: errors of the model and of the baselines, as `metrics.json` has them.
    """
    if judged_by_free_run(module):
        scores = results[FREE_RUNS["train"]]
        linear = linear_percent(data, baselines)
        return judgement("free run", scores, data.forced == "base", linear)
    if module.estimator.identified_parameters == 0:
        return {"identified": None, "reason": "the estimate has nothing to identify"}
    return judgement("one step", results["train"], data.forced == "base", None)


def judged_by_free_run(module: Identification) -> bool:
    """Whether the model was trained on its free run."""
    return module.solver is not None and module.objective.simulates


def judgement(
    way: str, scores: Mapping[str, Any], on_base: bool, linear: float | None
) -> dict[str, Any]:
    """The verdict on errors in percent on the training motion. linear: None where there is none."""
    verdict = {"by": way, "error_percent": scores.get(ERROR), "linear_percent": linear}
    if "no_free_run" in scores:
        return {"identified": None, "reason": scores["no_free_run"], **verdict}
    reason = _fault(way, scores, on_base, linear)
    return {"identified": not reason, "reason": reason, **verdict}


def _fault(way: str, scores: Mapping[str, Any], on_base: bool, linear: float | None) -> str:
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
    if linear is not None and error > max(WORSE * linear, CLOSE):
        return f"{what} errs by {error:.4g} %, that of the equivalent linear system by {linear:.4g}"
    return ""


def lost_on(runs: Mapping[str, Mapping[str, Any]], beyond: Mapping[str, bool]) -> str:
    """The test motions on which a free run diverges, in words; "" where it stays on all.

    runs: scores of the free run of each test motion; beyond: whether that motion leaves the range
    that was trained, where nobody knows what the structure does.
    """
    lost = {name: scores["diverged_after_s"] for name, scores in runs.items() if _diverges(scores)}
    motions = [
        f"{name} at {min(left):.3g} s" + (", outside the trained range" if beyond[name] else "")
        for name, left in lost.items()
    ]
    return f"its free run diverges on test motions: {'; '.join(motions)}" if motions else ""


def _diverges(scores: Mapping[str, Any]) -> bool:
    return bool(scores.get("diverged_after_s"))


def linear_percent(data: Data, baselines: Mapping[str, Mapping[str, Any]]) -> float | None:
    """Error of an equivalent linear system's free run of the training motion, in percent.

    That of the baseline `linear`; where it has none, that of `models.LinearMotion`. None where no
    linear system follows the motion.
    """
    error = baselines.get("linear", {}).get(FREE_RUNS["train"], {}).get(ERROR)
    if error is None:
        error = _scored(LinearMotion(data.dofs, data.inputs, data.dt), list(data.loader("train")))
    return error


def _scored(linear: Estimator, records: list[Record]) -> float | None:
    try:
        linear.identify(records)
        error: float | None = free_run_score(linear, records).get(ERROR)
    except CANNOT:
        return None
    return error
