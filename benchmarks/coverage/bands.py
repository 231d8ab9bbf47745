"""Do bands from held-back records hold unseen motion, whatever the estimator and the structure?

    python -m benchmarks.coverage.bands                     # 22 cases, 3 seeds, some 6 minutes
    python -m benchmarks.coverage.bands --seeds 1 --cases vwnn

Each case is a run as train.py does it: its bands come from `data.calibration_records=5` motions.
What they hold is counted on 20 further motions of the same kind that nothing saw, of random streams
(of earthquakes: events) of their own. Structures, excitations and seeds took no part in choosing
how bands are made, but for the paper's three structures under their own forces.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig

from data.arguments import Parser
from data.simulation.datamodule import SimulatedData
from models.training.assemble import data_from
from runner.config.command_line import command_errors
from runner.config.compose import CONF, prepare_hydra
from runner.folder.run import restore
from runner.folder.run_folder import read_run
from runner.job import identify
from runner.scores.conformal import FREE_RUN, ONE_STEP, covered

MOTIONS, FIRST_SEED, OTHER_STREAMS = 20, 10, 1000
QUIET = ("baselines=none", "figures=false", "trainer.enable_progress_bar=false")
SHORT = ("data.duration=20", "data.train_records=4")
RIDGE = "model.ridge=1e-8"  # where masses move nearly alike
QUAKES = ("excitation=earthquake", RIDGE, "data.train_records=4", "data.duration=60")
CASES: Mapping[str, Sequence[str]] = {
    "vwnn, bilinear": ("model=vwnn", "system=bilinear"),
    "vwnn, bilinear, noisy": ("model=vwnn", "system=bilinear", "scenario=noisy"),
    "vwnn, bouc_wen, integrated": ("model=vwnn", "system=bouc_wen", "scenario=integrated"),
    "vwnn, timber_house": ("model=vwnn", "system=timber_house"),
    "vwnn, self_centering_frame, sweep": (
        *("model=vwnn", "system=self_centering_frame", "excitation=sine_sweep", RIDGE),
    ),
    "vwnn, bilinear, earthquakes": ("model=vwnn", "system=bilinear", *QUAKES),
    "vwnn, bilinear, moving supports": (
        *("model=vwnn", "system=bilinear", "excitation=support_motion"),
    ),
    "vwnn_third_order, polynomial": ("model=vwnn_third_order", "system=polynomial"),
    "linear, polynomial": ("model=linear", "system=polynomial"),
    "linear, shear_frame": ("model=linear", "system=shear_frame"),
    "linear, bouc_wen, earthquakes": ("model=linear", "system=bouc_wen", *QUAKES),
    "linear, slack_braced_frame, multisine": (
        *("model=linear", "system=slack_braced_frame", "excitation=multisine"),
    ),
    "power_series_residual, polynomial": ("model=power_series_residual", "system=polynomial"),
    "chebyshev_restoring_force, bilinear": ("model=chebyshev_restoring_force", "system=bilinear"),
    "residual_mlp, single_oscillator": ("model=residual_mlp", "system=single_oscillator", *SHORT),
    "residual_mlp, bouc_wen": ("model=residual_mlp", "system=bouc_wen", *SHORT),
    "global_mlp, bilinear": ("model=global_mlp", "system=bilinear", *SHORT),
    "gru, bilinear": ("model=gru", "system=bilinear", *SHORT, "trainer.max_epochs=20"),
    "lstm, polynomial": ("model=lstm", "system=polynomial", *SHORT, "trainer.max_epochs=20"),
    "vwnn_forward, polynomial": ("model=vwnn_forward", "system=polynomial", *SHORT),
    "vwnn_forward, bouc_wen, noisy": (
        *("model=vwnn_forward", "system=bouc_wen", "scenario=noisy", *SHORT),
    ),
    "online_vwnn, bilinear": ("model=online_vwnn", "system=bilinear"),
}


def run_case(words: Sequence[str], seed: int) -> dict[str, list[dict[str, Any]] | str]:
    """What the bands of a run hold of each of MOTIONS unseen motions, by way; or why none."""
    with initialize_config_dir(str(CONF), version_base="1.3"):
        cfg = compose("train", [*words, *QUIET, f"seed={seed}"])
    with tempfile.TemporaryDirectory() as folder:
        sure = identify(cfg, Path(folder))["uncertainty"]
        estimator = restore(read_run(Path(folder))[0], Path(folder)).requires_grad_(False)
    found: dict[str, list[dict[str, Any]] | str] = {
        key: sure.get(key, {}).get("none", "") for key in (ONE_STEP, FREE_RUN)
    }
    for motion in unseen(cfg, seed):
        for key, shares in covered(estimator, sure, [motion]).items():
            size = float(motion.a[motion.warmup :].square().mean().sqrt())
            held = found[key] if isinstance(found[key], list) else []
            found[key] = [*held, shares | {"size": size}]
    return found


def unseen(cfg: DictConfig, seed: int) -> list[Any]:
    """Motions after those of the run; those of structures that escape are left out."""
    data = data_from(cfg)
    assert isinstance(data, SimulatedData)
    first = data.train_records + data.test_records + data.calibration_records
    wanted = (MOTIONS, seed + OTHER_STREAMS, first)
    count = data.simulation.drawable("test", *wanted)
    return data.simulation.records("test", count, seed + OTHER_STREAMS, first)[0]


def row_of(name: str, results: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """A row for each way: mean share, spread over motions, half width over the motion's RMS."""
    for key, way in ((ONE_STEP, "one step"), (FREE_RUN, "free run")):
        motions = [motion for r in results if isinstance(r[key], list) for motion in r[key]]
        if not motions:
            reasons = {str(r[key]) for r in results}
            short = "diverges" if any("diverges" in reason for reason in reasons) else "none"
            yield f"| {name} | {way} | {short} | | |"
            continue
        shares = [motion["covered_percent"] for motion in motions]
        low, high = np.quantile(shares, (0.05, 0.95))
        width = median((m["mean_half_width"] or np.inf) / m["size"] for m in motions)
        lost = sum(not isinstance(r[key], list) for r in results)
        told = f" ({lost} of {len(results)} runs: none)" if lost else ""
        yield (
            f"| {name} | {way} | {np.mean(shares):.1f} %{told} | {low:.1f} to {high:.1f} % | "
            f"{100.0 * width:.3g} % |"
        )


def main(given: list[str] | None = None) -> None:
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--cases", default="", help="those whose name has these letters")
    options = parser.parse_args(given)
    prepare_hydra()
    with command_errors():
        print("| run | estimate | held | 5 to 95 % of motions | half width |")
        print("| --- | --- | ---: | ---: | ---: |")
        every: list[float] = []
        for name, words in CASES.items():
            if options.cases not in name:
                continue
            seeds = range(FIRST_SEED, FIRST_SEED + options.seeds)
            results = [run_case(words, seed) for seed in seeds]
            for row in row_of(name, results):
                print(row, flush=True)
            every += [
                float(np.mean([m["covered_percent"] for m in told]))
                for r in results
                for told in r.values()
                if isinstance(told, list)
            ]
        inside = sum(92.0 <= share <= 97.0 for share in every)
        print(f"\n{inside} of {len(every)} bands hold from 92 to 97 % of all unseen samples")


if __name__ == "__main__":
    main()
