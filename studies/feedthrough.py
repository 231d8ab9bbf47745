"""The error that the VWNN would seem to have if its filters saw the sample to be estimated.

    python -m studies.feedthrough            half a minute on one core

A filter with feedthrough (bilinear transform, first-order hold, matched) hands ẍ[k] to the estimate
of ẍ[k]. Here the acceleration is advanced by a sample before the same causal filters, which is what
y[k] = α y[k−1] + (1−α) u[k] does. No model of the zoo does this. Prints medians over the seeds, and
writes every error to --output, from which docs/results.md takes the medians.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from statistics import median

import torch
from rich.table import Table
from torch import Tensor

from data.arguments import Parser
from data.record import Record
from data.simulation.motion import EscapedMotionError
from data.terminal import Terminal
from models.linear_in_weights import weighted
from models.training.assemble import changed, data_from, estimator_from
from models.training.metrics import score
from models.vwnn import VWNN
from runner.config.command_line import command_errors
from runner.config.compose import composed
from runner.folder.run_folder import write_json

OUTPUT = Path("runs/studies/feedthrough.json")
SEEDS = range(20, 40)  # the study's
SYSTEMS = ("bilinear", "polynomial", "bouc_wen")


class SeesTheSample(VWNN):
    """The VWNN on filtered accelerations that hold the present sample: a leak, to show its size."""

    def features(self, record: Record) -> Iterator[tuple[slice, Tensor]]:
        ahead = torch.cat([record.a[..., 1:, :], record.a[..., -1:, :]], dim=-2)
        return super().features(replace(record, a=ahead))

    def forward(self, record: Record) -> Tensor:  # compiled runs make features of their own
        return torch.cat([weighted(phi, self.weights) for _, phi in self.features(record)], dim=-2)


def feedthrough_errors(seeds: range = SEEDS) -> dict[str, dict[str, list[float]]]:
    """{system: {"causal train", "causal test", "leaky train", "leaky test": errors in %}}."""
    errors: dict[str, dict[str, list[float]]] = {}
    for system in SYSTEMS:
        cfg = composed(f"system={system}")
        for seed in seeds:
            data = data_from(changed(cfg, {"seed": seed}))
            try:
                data.setup()
            except EscapedMotionError:
                continue  # as in the study, which counts it
            causal = estimator_from(cfg.model, data)
            leaky = SeesTheSample(
                data.dofs,
                data.inputs,
                data.dt,
                sigmoid_weight=cfg.model.sigmoid_weight,
            )
            for name, estimator in (("causal", causal), ("leaky", leaky)):
                estimator.identify(data.loader("train"))
                for split in ("train", "test"):
                    percent = score(estimator, data.loader(split))["relative_rms_percent"]
                    errors.setdefault(system, {}).setdefault(f"{name} {split}", []).append(percent)
    return errors


def main() -> None:
    parser = Parser(description=__doc__)
    parser.add_argument("--output", type=Path, default=OUTPUT, help=f"default: {OUTPUT}")
    output = parser.parse_args().output
    errors = feedthrough_errors()
    output.parent.mkdir(parents=True, exist_ok=True)
    write_json(output, errors)
    table = Table(title=f"VWNN, medians over seeds {SEEDS}, %", title_justify="left")
    for name in ("system", "causal train", "causal test", "leaky train", "leaky test"):
        table.add_column(name, justify="left" if name == "system" else "right")
    for system, by_name in errors.items():
        table.add_row(system, *(f"{median(values):.2f}" for values in by_name.values()))
    Terminal(width=100).print(table, f"errors in {output}")


if __name__ == "__main__":
    with command_errors():
        main()
