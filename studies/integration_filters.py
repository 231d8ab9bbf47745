"""The choice of the integration's high-pass filters, which the paper leaves open (Sect. 4.1).

    python -m studies.integration_filters            some minutes on two cores

The polynomial system under the excitation of conf/system. Prints, for every filter of a grid, the
errors of the polynomial methods over search seeds, how many of their six cells in Table 7 lie
inside the range over these seeds, and the distance of the medians from the paper's values. Then, on
fresh seeds, the best strictly causal filter, the best zero-phase one (by cells inside, then by
distance), and the filter of conf/scenario. The Chebyshev polynomials have the errors of the power
series on the restoring force, and are not printed.
"""

from __future__ import annotations

import math
from itertools import product
from statistics import median

from joblib import Parallel, delayed
from rich.table import Table

from data.arguments import Parser
from data.terminal import Terminal
from models.training.assemble import changed
from runner.config.command_line import command_errors
from runner.scores.paper_values import paper_values
from studies.excitation import Cell, Draws, configs_of, inside, run_seeds

SEARCH_SEEDS, FRESH_SEEDS = range(1000, 1020), range(3000, 3020)
METHODS = (
    "power_series_residual",
    "power_series_restoring_force",
    "chebyshev_restoring_force",
)
CUTOFFS = (0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2)  # [Hz]
ORDERS = (1, 2, 4)


def printed() -> dict[Cell, float]:
    """The paper's cells of Table 7."""
    return {
        ("integrated", method, split): values["relative_rms_percent"]
        for method in METHODS
        for split, values in paper_values(method, "polynomial", "integrated").items()
    }


def hits(draws: Draws) -> int:
    """How many of the paper's cells lie inside the range over the seeds."""
    return sum(inside(draws.errors[cell], value) for cell, value in printed().items())


def distance(draws: Draws) -> float:
    """Root mean square of ln(our median / the paper's value)."""
    ratios = [median(draws.errors[cell]) / value for cell, value in printed().items()]
    return math.sqrt(sum(math.log(ratio) ** 2 for ratio in ratios) / len(ratios))


def row(name: str, draws: Draws) -> tuple[str, ...]:
    """A filter's line of the table."""
    cells = []
    for method in METHODS[:2]:
        for split in ("train", "test"):
            errors = draws.errors["integrated", method, split]
            cells.append(f"{median(errors):.1f} ({min(errors):.1f}–{max(errors):.1f})")
    return name, *cells, f"{hits(draws)}/6", f"{distance(draws):.3f}"


def main() -> None:
    Parser(description=__doc__).parse_args()
    base, models, scenarios = configs_of("polynomial")
    models = {method: models[method] for method in METHODS}

    def drawn(setting: tuple[bool, int, float], seeds: range) -> Draws:
        causal, order, cutoff = setting
        filters = {"causal": causal, "order": order, "cutoff": cutoff}
        changed_scenario = changed(scenarios["integrated"], filters)
        return run_seeds(base, models, {"integrated": changed_scenario}, seeds)

    grid = list(product((True, False), ORDERS, CUTOFFS))
    searched = Parallel(n_jobs=-1)(delayed(drawn)(setting, SEARCH_SEEDS) for setting in grid)
    table = Table(title=f"search seeds {SEARCH_SEEDS}, then {FRESH_SEEDS}", title_justify="left")
    for name in ("filter", *(f"{m} {s} %" for m in METHODS[:2] for s in ("train", "test"))):
        table.add_column(name)
    table.add_column("inside")
    table.add_column("distance")
    named = {s: f"{'causal' if s[0] else 'zero-phase'}, order {s[1]}, {s[2]:g} Hz" for s in grid}
    for setting, draws in zip(grid, searched, strict=True):
        table.add_row(*row(named[setting], draws))
    for causal in (True, False):
        ranked = [
            (-hits(draws), distance(draws), setting)
            for setting, draws in zip(grid, searched, strict=True)
            if setting[0] is causal
        ]
        best = min(ranked)[2]
        draws = drawn(best, FRESH_SEEDS)
        table.add_row(*row(f"fresh: {named[best]}", draws))
    own = scenarios["integrated"]
    setting = (own.causal, own.order, own.cutoff)
    table.add_row(*row(f"conf, fresh: {named[setting]}", drawn(setting, FRESH_SEEDS)))
    Terminal(width=150).print(table)


if __name__ == "__main__":
    with command_errors():
        main()
