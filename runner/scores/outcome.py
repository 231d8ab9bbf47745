"""The numbers of a run: errors of the model and of the baselines, and how the model was fitted."""

from __future__ import annotations

import math
import platform
import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import lightning
import numpy
import numpy as np
import torch
from torch import Tensor

from data import BenchmarkData
from data.datamodule import Data
from data.public.series import in_band_rms
from data.record import Record, stack
from data.windows import WindowDataset
from models.baselines import NotApplicableError
from models.estimator import Estimator
from models.fit.identification import HELD_BACK, SPLITS, Identification
from models.fit.metrics import FREE_RUNS, free_run_score, score
from models.fit.trainable import Trainable
from models.fit.trained_range import outside, range_of
from models.online.scores import online_scores
from runner.folder.run import Run
from runner.folder.run_folder import settings_of
from runner.scores.conformal import conformal_bands
from runner.scores.grade import Judged, grade_of
from runner.scores.paper_values import paper_values
from runner.scores.verdict import (
    CANNOT,
    NotIdentifiedError,
    lost_on,
    motions_of,
    simulates,
    verdict_of,
)


def compare_baselines(
    baselines: Mapping[str, Estimator | ValueError],
    data: Data,
    known: dict[str, Estimator] | None = None,
) -> dict[str, Any]:
    """Errors of each baseline on the same records, one step ahead and in free run.

    One that cannot be built or identified says why; one that is not applicable is omitted. Those
    that are `known` were identified before, the others are added.
    """
    results: dict[str, Any] = {}
    known = {} if known is None else known
    for name, baseline in baselines.items():
        try:
            if isinstance(baseline, ValueError):
                raise baseline
            if name not in known:
                baseline.identify(data.loader("train"))
                known[name] = baseline
            one_step = {split: score(baseline, data.loader(split)) for split in SPLITS}
            free = {key: free_run_score(baseline, data.loader(s)) for s, key in FREE_RUNS.items()}
            results[name] = {**one_step, **free}
        except NotApplicableError:
            continue
        except CANNOT as error:
            results[name] = {"failed": str(error) or type(error).__name__}
    return results


def each_record(data: Data, split: str) -> dict[str, Record]:
    """The records of a split as batches of one, scored as the whole split is, by their names."""
    windows = WindowDataset(data.records[split], warmup=data.cut["warmup"], whole=True)
    names = data.names.get(split, [])
    if len(set(names)) != len(windows):
        names = [f"{split} {i + 1}" for i in range(len(windows))]
    return {name: stack([windows[i]]) for i, name in enumerate(names)}


def per_record(estimator: Estimator, records: Mapping[str, Record]) -> dict[str, Any]:
    """{name: {"test": scores, "free_run": scores}} of each record by itself."""
    return {name: both_scores(estimator, [record]) for name, record in records.items()}


def both_scores(estimator: Estimator, records: Sequence[Record]) -> dict[str, Any]:
    """Scores of test records together, one step ahead and in free run."""
    free = free_run_score(estimator, records)
    return {"test": score(estimator, records), FREE_RUNS["test"]: free}


def metrics_of(
    run: Run,
    module: Identification,
    data: Data,
    baselines: dict[str, Any],
    opponents: Mapping[str, Estimator | ValueError],
    plain: dict[str, Estimator],
) -> dict[str, Any]:
    """What `metrics.json` holds; errors in percent, times in seconds.

    baselines: their errors; opponents: the baselines themselves, identified; plain: what else was
    identified on the same data, for this run or before it.
    """
    names = {part: str(run.choices[part]["name"]) for part in ("model", "system", "scenario")}
    results = module.results()
    tested = {n: r.to(module.device) for n, r in each_record(data, "test").items()}
    each = per_record(module.estimator, tested) if len(tested) > 1 else {}
    seen = (r.to(module.device) for r in data.records["train"])
    trained = range_of(module.estimator, seen, data.sensors)
    train, motions = list(data.loader("train")), motions_of(data)
    on_base = data.forced == "base"
    verdict = verdict_of(module, results, on_base, opponents, train, motions)
    metrics = {
        **names,
        "scenario_settings": settings_of(run.choices["scenario"]),
        "seed": run.choices["seed"],
        "identity": run.identity,
        "fit_seconds": module.fit_seconds,
        "parameters": module.estimator.identified_parameters,
        "identification": {
            key: value if isinstance(value, str) or math.isfinite(value) else None
            for key, value in module.solution.items()
        },
        "training": module.how_trained(),
        **results,
        "verdict": verdict | _lost(module, results, each, tested, trained),
        "per_record": each,
        "trained_range": trained,
        "outside_trained_range": outside(trained, range_of(module.estimator, tested.values())),
        "uncertainty": _uncertainty(module, data, tested.values()),
        "quantity": data.records["test"][0].quantity,
        **({"numbers": list(numbers)} if (numbers := data.records["test"][0].numbers) else {}),
        "peak": {  # in the unit of the quantity
            split: max(float(r.a.abs().max()) for r in data.records[split]) for split in SPLITS
        },
        "records": data.notes | data.sensors.unread(module.estimator),
        "benchmark": benchmark_scores(data, module),
        "online": online_scores(module, data),
        "simulation_error": data.own_error(),
        "escaped": [vars(escape) for escape in data.escapes],
        "baselines": baselines,
        "paper": {} if data.units or data.forced in ([], "base") else paper_values(**names),
        "versions": {
            "python": platform.python_version(),
            "torch": torch.__version__,
            "numpy": numpy.__version__,
            "lightning": lightning.__version__,
        },
    }
    said, made = metrics["verdict"], module.estimates_made()
    judged = Judged(module.estimator, train, motions, said, metrics, plain, made)
    metrics["verdict"] |= grade_of(judged)
    return metrics


def _lost(
    module: Identification,
    results: Mapping[str, Any],
    each: Mapping[str, Mapping[str, Any]],
    tested: Mapping[str, Record],
    trained: Mapping[str, Any],
) -> dict[str, str]:
    """Of a model that was trained on its free run: the test motions on which that run diverges.

    results: scores of its free runs of all test motions, among others; each: of one at a time.
    """
    together = results[FREE_RUNS["test"]]
    if not simulates(module, results) or not together.get("diverged_after_s"):
        return {}
    runs = {name: scores[FREE_RUNS["test"]] for name, scores in each.items()}
    runs = runs or dict.fromkeys(tested, together)
    moved = {name: range_of(module.estimator, [record]) for name, record in tested.items()}
    beyond = {name: bool(outside(trained, new)) for name, new in moved.items()}
    return {"test_diverges": lost_on(runs, beyond)}


def _uncertainty(module: Identification, data: Data, tested: Iterable[Record]) -> dict[str, Any]:
    """Intervals, criticism and bands of models with an exact Jacobian; or `unavailable`, why not.

    Models without have bands from held-back records (runner/scores/conformal.py).
    """
    found = _intervals(module, data, tested)
    if not found.get("bands"):
        found |= conformal_bands(module.estimator, data, tested, module.device)
    return found


def _intervals(module: Identification, data: Data, tested: Iterable[Record]) -> dict[str, Any]:
    """{} of models that have none. What they are made of stays with the module."""
    if not isinstance(module.estimator, Trainable):
        return {}
    from runner.scores.uncertainty import (  # loads every such model
        drifts_of_hidden,
        minimum_of,
        uncertainty_of,
    )

    begun = time.perf_counter()
    try:
        module.minimum = minimum_of(module.estimator, data, module.how_trained().get("prior"))
        if module.minimum is None:
            return drifts_of_hidden(module.estimator, data, tested)
        content = uncertainty_of(module.estimator, module.minimum, data, tested)
    except (ValueError, MemoryError) as error:
        return {"unavailable": str(error)}
    return content | {"seconds": time.perf_counter() - begun}


def validation_error(metrics: Mapping[str, Any]) -> float:
    """Eq. 21 one step ahead, in percent, on the part of the training motion that was held back.

    Against the measured signal; infinite where it overflowed.

    Raises ValueError for a run that held nothing back.
    """
    if HELD_BACK not in metrics:
        raise ValueError("the run held nothing back to be judged on; set data.validation=0.2")
    error = metrics[HELD_BACK]["relative_rms_percent"]
    return math.inf if error is None else error


def require_identified(metrics: Mapping[str, Any]) -> None:
    """Raise NotIdentifiedError, with the reason, where a run's model is no result.

    So it is, too, where its free run diverges on a test motion, or it is not better than a plain
    one.
    """
    verdict, model = metrics["verdict"], metrics["model"]
    if verdict["identified"] is False:
        raise NotIdentifiedError(f"{model} is not identified: {verdict['reason']}")
    if lost := verdict.get("test_diverges"):
        raise NotIdentifiedError(f"{model} does not model the test motion: {lost}")
    if worse := verdict.get("not_better"):
        raise NotIdentifiedError(f"{model} is not better than a plain model: {worse}")


# Scores that a public benchmark adds to the relative error: its unit, its band, its noise.


def benchmark_scores(data: Data, module: Identification) -> dict[str, Any]:
    """Noise floor, published figures and in-band RMS errors per output; {} for other data.

    In-band errors are of the first test batch: all test series where they are of one length.
    """
    if not isinstance(data, BenchmarkData):
        return {}
    noise = None if data.noise is None else data.noise.tolist()
    found = {"unit": data.unit, "noise_rms": noise, "published_rms": data.published}
    if data.band is None:
        return found
    record, estimates = module.examples["test"]
    runs: dict[str, Tensor] = {"one step": estimates[""]}
    if (example := module.free_runs["test"].example) is not None:
        runs["free run"] = example[1].a
    in_band = {name: _in_band(run, record, data.band) for name, run in runs.items()}
    return {**found, "band_hz": list(data.band), "in_band_rms": in_band}


def _in_band(run: Tensor, record: Record, band: tuple[float, float]) -> list[float] | None:
    """RMS (n,) of the counted samples of a batch; None where the run diverged."""
    errors = record.counted(run - record.a).cpu().numpy()
    if not np.isfinite(errors).all():
        return None
    each = [in_band_rms(e, record.dt, band) for e in errors.reshape(-1, *errors.shape[-2:])]
    return np.sqrt(np.mean(np.square(each), axis=0)).tolist()


def benchmark_lines(scores: dict[str, Any]) -> list[str]:
    """What a run prints of them."""
    lines, unit = [], scores["unit"]
    if scores.get("in_band_rms"):
        low, high = scores["band_hz"]
        parts = [
            f"{name} {_listed(rms)} {unit}" for name, rms in scores["in_band_rms"].items() if rms
        ]
        lines.append(f"of it between {low:g} and {high:g} Hz: {'; '.join(parts) or '–'}")
    if scores["noise_rms"]:
        lines.append(f"noise floor, from repeated periods: {_listed(scores['noise_rms'])} {unit}")
    if scores["published_rms"]:
        of = ", ".join(f"{name} {rms:.3g}" for name, rms in scores["published_rms"].items())
        lines.append(f"published, on the official test signal: {of} {unit}")
    return lines


def _listed(values: list[float]) -> str:
    return ", ".join(f"{value:.3g}" for value in values)
