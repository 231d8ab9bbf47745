"""Do bands from held-back records hold unseen motion, whatever the estimator and the structure?

    python -m benchmarks.coverage.bands                     # 22 cases, 3 seeds, some 10 minutes
    python -m benchmarks.coverage.bands --seeds 1 --cases vwnn

Each case is a run as train.py does it, whose bands come from `data.calibration_records` motions.
What they hold is counted on 20 further motions of the same kind that nothing saw, of random streams
(of earthquakes: events) of their own. Structures, excitations and seeds took no part in choosing
how bands are made, but for the paper's three structures under their own forces.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from statistics import median

import numpy as np
import torch
from hydra import compose, initialize_config_dir
from torch import Tensor

from data.arguments import Parser
from data.record import Record
from data.simulation.datamodule import SimulatedData
from data.simulation.motion import EscapedMotionError
from models.training.assemble import data_from
from models.uncertainty.conformal import LEVEL, Band
from runner.config.command_line import command_errors
from runner.config.compose import CONF, prepare_hydra
from runner.folder.run import restore
from runner.folder.run_folder import read_run
from runner.job import identify
from runner.scores.conformal import FREE_RUN, ONE_STEP, WAYS, estimates_of, stored_band

Case = dict[str, list[dict[str, float]] | str]

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


def run_case(words: Sequence[str], seed: int, records: int) -> Case:
    """What the bands of a run hold of each of MOTIONS unseen motions, by way; or why none.

    Raises EscapedMotionError where the structure's own training motion escapes.
    """
    with initialize_config_dir(str(CONF), version_base="1.3"):
        given = [*words, *QUIET, f"seed={seed}", f"data.calibration_records={records}"]
        cfg = compose("train", given)
    with tempfile.TemporaryDirectory() as folder:
        sure = identify(cfg, Path(folder))["uncertainty"]
        estimator = restore(read_run(Path(folder))[0], Path(folder)).requires_grad_(False)
    data = data_from(cfg)
    assert isinstance(data, SimulatedData)
    held, motions = data.make_calibration(), unseen(data, seed)
    found: Case = {}
    for key, way in WAYS.items():
        band = stored_band(sure, key)
        if band is None:
            found[key] = sure[key]["none"]
            continue
        with torch.no_grad():
            before = estimates_of(estimator, held, way)
            after = estimates_of(estimator, motions, way)
        errors = [(r.a - e).abs() for r, e in zip(held, before, strict=True)]
        constant = torch.from_numpy(np.quantile(torch.cat(errors).numpy(), LEVEL, axis=0))
        found[key] = [counted(r, e, band, constant) for r, e in zip(motions, after, strict=True)]
    return found


def unseen(data: SimulatedData, seed: int) -> list[Record]:
    """Motions after those of the run; those of structures that escape are left out."""
    first = data.train_records + data.test_records + data.calibration_records
    wanted = (MOTIONS, seed + OTHER_STREAMS, first)
    count = data.simulation.drawable("test", *wanted)
    return data.simulation.records("test", count, seed + OTHER_STREAMS, first)[0]


def counted(record: Record, estimate: Tensor, band: Band, constant: Tensor) -> dict[str, float]:
    """Share [%] of a motion within its band, half width over the RMS, and interval scores.

    The score of a band is its width and 2/0.05 times what samples lie outside by (Gneiting &
    Raftery 2007, Eq. 43): the smaller the better. constant (n,): half widths that do not vary.
    """
    error, size = (record.a - estimate).abs(), record.a.square().mean().sqrt()
    half = band.half_widths(estimate, record.dt)
    scores = [2.0 * w + 2.0 / (1.0 - LEVEL) * (error - w).clamp_min(0.0) for w in (half, constant)]
    return {
        "held": 100.0 * float((error <= half).double().mean()),
        "width": 100.0 * float(half.mean() / size),
        **{name: float(s.mean()) for name, s in zip(("score", "constant"), scores, strict=True)},
    }


def row_of(name: str, results: Sequence[Case]) -> Iterator[str]:
    """A row for each way: mean share, spread over motions, half width, score beside a constant."""
    for key, way in ((ONE_STEP, "one step"), (FREE_RUN, "free run")):
        told = [r[key] for r in results]
        motions = [motion for of_run in told if isinstance(of_run, list) for motion in of_run]
        without = [why for why in told if isinstance(why, str)]
        if not motions:
            yield f"| {name} | {way} | {_short(without)} | | | |"
            continue
        shares = [motion["held"] for motion in motions]
        low, high = np.quantile(shares, (0.05, 0.95))
        width = median(motion["width"] for motion in motions)
        ours, plain = (sum(motion[n] for motion in motions) for n in ("score", "constant"))
        lost = f" ({len(without)} of {len(told)} runs: {_short(without)})" if without else ""
        yield (
            f"| {name} | {way} | {np.mean(shares):.1f} %{lost} | {low:.1f} to {high:.1f} % | "
            f"{width:.3g} % | {ours / plain:.2f} |"
        )


def _short(reasons: Sequence[str]) -> str:
    return "diverges" if any("diverges" in reason for reason in reasons) else "none"


def main(given: list[str] | None = None) -> None:
    parser = Parser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--records", type=int, default=5, help="that bands are made from")
    parser.add_argument("--cases", default="", help="those whose name has these letters")
    options = parser.parse_args(given)
    prepare_hydra()
    with command_errors():
        print("| run | estimate | held | 5 to 95 % of motions | half width | score, of constant |")
        print("| --- | --- | ---: | ---: | ---: | ---: |")
        every: list[float] = []
        for name, words in CASES.items():
            if options.cases not in name:
                continue
            results = []
            for seed in range(FIRST_SEED, FIRST_SEED + options.seeds):
                with suppress(EscapedMotionError):  # no model was fitted
                    results.append(run_case(words, seed, options.records))
            for row in row_of(name, results):
                print(row, flush=True)
            every += [
                float(np.mean([motion["held"] for motion in told]))
                for case in results
                for told in case.values()
                if isinstance(told, list)
            ]
        inside = sum(92.0 <= share <= 97.0 for share in every)
        print(f"\n{inside} of {len(every)} bands hold from 92 to 97 % of all unseen samples")


if __name__ == "__main__":
    main()
