"""Scores that a public benchmark adds to the relative error: its unit, its band, its noise."""

from __future__ import annotations

from typing import Any

import numpy as np
from torch import Tensor

from data import BenchmarkData
from data.datamodule import Data
from data.public.series import in_band_rms
from data.record import Record
from models.fit.identification import Identification


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
    errors = (run - record.a)[..., record.warmup :, :].cpu().numpy()
    if not np.isfinite(errors).all():
        return None
    each = [in_band_rms(e, record.dt, band) for e in errors.reshape(-1, *errors.shape[-2:])]
    rms: list[float] = np.sqrt(np.mean(np.square(each), axis=0)).tolist()
    return rms


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
