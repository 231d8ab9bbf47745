"""A structure has changed: how much sooner does a published model fit it than one from nothing?

python -m benchmarks.fine_tuning                      all runs, in runs/fine_tuning; goes on there
python -m benchmarks.fine_tuning --systems bouc_wen --seeds 3
python -m benchmarks.fine_tuning --page docs/fine_tuning.md

Every stiffness of the structure is 1.2 times that of the published one. One record of 20 s, with
white noise of 10 % on x, v and a; an element network is trained on it by the usual command, from
nothing and with start=zoo:element_network/SYSTEM. Both are then simulated on another motion of the
changed structure, and compared with the true one.
"""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Iterator, Sequence
from pathlib import Path
from string import Template
from typing import Any

from omegaconf import DictConfig

from data.arguments import Parser
from models.training.assemble import changed
from runner.config.command_line import command_errors
from runner.config.compose import composed
from runner.folder.run_files import METRICS
from runner.job import identify, job_errors

SYSTEMS = ("bilinear", "polynomial", "bouc_wen")
SEEDS = 10
STIFFER = 1.2
STIFFNESSES = ("stiffness", "post_yield_stiffness", "gap_stiffness")
WORDS = (
    "model=element_network scenario=noisy data.duration=20 baselines=none figures=false "
    "trainer.enable_progress_bar=false"
)
WAYS = {"nothing": "", "published": "start=zoo:element_network/"}
RUNS, TEMPLATE = Path("runs/fine_tuning"), Path(__file__).parent / "page.md"


def config(system: str, seed: int, way: str) -> DictConfig:
    """The config of one run on the stiffer structure."""
    start = [WAYS[way] + system] if WAYS[way] else []
    cfg = composed(*WORDS.split(), f"system={system}", f"seed={seed}", *start)
    elements = cfg.system.structure.elements
    stiffer = {
        name: {key: STIFFER * element[key] for key in STIFFNESSES if key in element}
        for name, element in elements.items()
    }
    return changed(cfg, {"system": {"structure": {"elements": stiffer}}})


def run(system: str, seed: int, way: str) -> dict[str, Any]:
    """Seconds of training and errors in free run [%], against the true motion; inf: diverged."""
    folder = RUNS / f"{system}-{way}-seed{seed}"
    if not (folder / METRICS).is_file():
        with job_errors():
            identify(config(system, seed, way), folder)
    metrics = json.loads((folder / METRICS).read_text("utf-8"))
    error = metrics["free_run"]["relative_rms_percent_true"]
    seconds = metrics["fit_seconds"]
    return {"seconds": seconds, "percent": math.inf if error is None else error}


def pairs(systems: Sequence[str], seeds: int) -> dict[str, list[dict[str, dict[str, Any]]]]:
    """{system: [{way: seconds and error} of each seed]}; a line is printed for each pair."""
    found: dict[str, list[dict[str, dict[str, Any]]]] = {}
    for system in systems:
        for seed in range(seeds):
            pair = {way: run(system, seed, way) for way in WAYS}
            found.setdefault(system, []).append(pair)
            told = [f"{w} {p['seconds']:.2f} s, {_percent(p['percent'])}" for w, p in pair.items()]
            print(f"{system} seed {seed}: {'; '.join(told)}", flush=True)
    return found


def table(found: dict[str, list[dict[str, dict[str, Any]]]]) -> str:
    """Medians over the seeds, in Markdown."""
    return "\n".join(_lines(found))


def _lines(found: dict[str, list[dict[str, dict[str, Any]]]]) -> Iterator[str]:
    yield (
        "| structure | seeds | seconds, from nothing | from the published | share of the time | "
        "free run [%], from nothing | from the published | seeds where the published is as good |"
    )
    yield "| --- " + "| ---: " * 7 + "|"
    for system, of_seeds in found.items():
        seconds = {w: statistics.median(p[w]["seconds"] for p in of_seeds) for w in WAYS}
        percent = {w: statistics.median(p[w]["percent"] for p in of_seeds) for w in WAYS}
        share = statistics.median(
            p["published"]["seconds"] / p["nothing"]["seconds"] for p in of_seeds
        )
        better = sum(p["published"]["percent"] <= p["nothing"]["percent"] for p in of_seeds)
        cells = (
            system,
            len(of_seeds),
            f"{seconds['nothing']:.2f}",
            f"{seconds['published']:.2f}",
            f"{share:.2f}",
            _percent(percent["nothing"]),
            _percent(percent["published"]),
            f"{better} of {len(of_seeds)}",
        )
        yield "| " + " | ".join(map(str, cells)) + " |"


def _percent(error: float) -> str:
    return "diverged" if math.isinf(error) else f"{error:.2f}"


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    add, known = parser.add_argument, ", ".join(SYSTEMS)
    add("--systems", nargs="+", metavar="SYSTEM", default=SYSTEMS, choices=SYSTEMS, help=known)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--page", type=Path, metavar="FILE", help="written from all runs")
    with command_errors():
        options = parser.parse_args()
        text = table(pairs(options.systems, options.seeds))
        print(text)
        if options.page is not None:
            page = Template(TEMPLATE.read_text("utf-8")).substitute(table=text)
            options.page.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
