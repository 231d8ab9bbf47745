"""One bad sensor of three: what weights of channels by their noise make of it.

    python -m benchmarks.bad_sensor --cases 12        # some 20 s a fit, three fits a case

A case is a chain of three masses that yield (coverage/cases.py), drawn at random; all channels have
noise of 5 % of their standard deviation, but for one drawn at random, which has 50 %. It is fitted
with all channels alike, with channels by their noise, and where no sensor is bad.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from joblib import Parallel, delayed

from benchmarks.coverage.cases import TRAINING, WORDS, drawn, records
from benchmarks.unplanted.fits import error, fitted
from data.arguments import Parser
from data.record import Record, stack
from models.element_network import ElementNetwork
from models.physical.truth import truth_of
from models.uncertainty.intervals import DETERMINED, intervals_of
from models.uncertainty.laplace import laplace
from runner.config.command_line import command_errors
from runner.config.compose import prepare_hydra

GOOD, BAD = 0.05, 0.5  # noise over a channel's standard deviation
FITS = {  # in words, noise of the bad sensor, what is asked for
    "equal": ("all channels alike", BAD, "equal"),
    "noise": ("by their noise (default)", BAD, "null"),
    "good": ("no bad sensor (default)", GOOD, "null"),
    "good_equal": ("no bad sensor, all alike", GOOD, "equal"),
}


def run_case(number: int) -> dict[str, Any]:
    """Errors of the determined parameters and of the free run on clean unseen motion, in percent.

    covered: of the intervals of stiffnesses, masses and dampers that hold the truth.
    """
    torch.set_num_threads(1)
    prepare_hydra()
    rng = np.random.default_rng(np.random.SeedSequence(number, spawn_key=(9,)))
    structure, _ = drawn(rng, 3, braced=False)
    clean = records(structure, number)
    bad, seed = int(rng.integers(3)), int(rng.integers(2**31))
    words = [*WORDS, f"seed={number}",
             "model.elements=[[ground,x1],[x1,x2],[x2,x3]]"]  # fmt: skip
    result: dict[str, Any] = {"number": number, "bad": bad}
    for name, (_, level, channels) in FITS.items():
        batch = stack(noisy(clean[:TRAINING], bad, level, seed))
        model, _ = fitted([*words, f"objective.channels={channels}"], batch)
        assert isinstance(model, ElementNetwork)
        result[name] = _scores(model, batch, clean[TRAINING:], truth_of(structure, model))
    return result


def noisy(clean: Sequence[Record], bad: int, level: float, seed: int) -> list[Record]:
    """Accelerations alone, with white noise; the bad channel has its own level."""
    rng = np.random.default_rng(seed)
    made = []
    for record in clean:
        levels = torch.full((record.dofs,), GOOD, dtype=torch.float64)
        levels[bad] = level
        noise = torch.from_numpy(rng.standard_normal(tuple(record.a.shape)))
        a = record.a + levels * record.a.std(dim=0) * noise
        made.append(replace(record, a=a, x=None, v=None, truth=None))
    return made


def _scores(
    model: ElementNetwork, batch: Record, unseen: Sequence[Record], known: Mapping[str, float]
) -> dict[str, Any]:
    found = laplace(model, [batch])
    assert found is not None
    told = [
        i
        for i in intervals_of(model, found)
        if i.status == DETERMINED and i.name.partition(".")[2] in ("mass", "stiffness", "damping")
    ]
    off = {i.name: 100.0 * abs(i.value / known[i.name] - 1.0) for i in told}
    return {
        "stiffness": [v for name, v in off.items() if name.endswith("stiffness")],
        "mass": [v for name, v in off.items() if name.endswith("mass")],
        "covered": [abs(i.value - known[i.name]) <= i.half for i in told],
        "half_percent": [100.0 * i.half / i.value for i in told if not i.name.endswith("damping")],
        "free_run": error(model, unseen),
        "weights": model.channels.tolist(),
    }


def table_of(results: Sequence[Mapping[str, Any]]) -> str:
    """Medians over all parameters, and over cases."""
    lines = [f"{'':<28}{'mass %':>9}{'stiffness %':>13}{'± 95 % %':>10}{'covered %':>11}"
             f"{'free run %':>12}{'  range':<16}"]  # fmt: skip
    for name, (words, *_) in FITS.items():
        own = [r[name] for r in results]
        pooled = {
            key: np.concatenate([r[key] for r in own])
            for key in ("mass", "stiffness", "half_percent", "covered")
        }
        runs = np.array([r["free_run"] for r in own])
        lines.append(
            f"{words:<28}{np.median(pooled['mass']):>9.2f}{np.median(pooled['stiffness']):>13.2f}"
            f"{np.median(pooled['half_percent']):>10.2f}{100 * pooled['covered'].mean():>11.1f}"
            f"{np.median(runs):>12.2f}  {runs.min():.2f} – {runs.max():.2f}"
        )
    return "\n".join(lines)


def main(given: list[str] | None = None) -> None:
    parser = Parser(description=__doc__)
    parser.add_argument("--cases", type=int, default=12)
    parser.add_argument("--quick", action="store_true", help="one case")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--output", type=Path, help="file of all results, JSON")
    options = parser.parse_args(given)
    with command_errors():
        cases = 1 if options.quick else options.cases
        work = (delayed(run_case)(number) for number in range(cases))
        results = list(Parallel(n_jobs=options.jobs)(work))
        print(table_of(results))
        if options.output is not None:
            options.output.write_text(json.dumps(results, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
