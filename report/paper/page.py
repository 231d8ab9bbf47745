"""The page of results: report/paper/page.md with every figure filled in from the runs.

A placeholder of the template is `$name` or `${name}`; each is computed here, so none of our errors
is written by hand. Where a comparison could turn out either way, the sentence holds counts.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import median, quantiles
from string import Template

from report.collection.runs import other_version, read_runs, stated
from report.output import code, markdown
from report.paper.cells import OWN, SETTINGS, Cell, as_configured, error_of, of
from report.paper.changes import COLUMNS, rows_of
from report.paper.tables import NOT_PAIRED, by_label, cells_markdown, hits
from report.usual import CLOSE_FIT, OUTSIDE, STUDY
from runner.folder.run_folder import write_text
from runner.scores.result import Result, spread_of
from runner.scores.spread import ESCAPED, FAILED, percent

TEMPLATE = Path(__file__).with_name("page.md")
FEEDTHROUGH = Path("runs/studies/feedthrough.json")
NEEDS = {  # of the page: what makes it
    STUDY: "python train.py -m experiment=paper",
    OUTSIDE: "python train.py -m experiment=outside",
    CLOSE_FIT: "python train.py -m experiment=close_fit",
    FEEDTHROUGH: "python -m studies.feedthrough",
}
POLYNOMIAL = (
    "power_series_residual",
    "power_series_restoring_force",
    "chebyshev_restoring_force",
)
SIX = ("vwnn", *POLYNOMIAL, "residual_mlp", "global_mlp")
CLAIMS: dict[str, Callable[[dict[str, float]], bool]] = {  # on the test errors of one seed
    "vwnn_best_own": lambda e: e["vwnn"] < min(e[m] for m in (*POLYNOMIAL, "global_mlp", OWN)),
    "vwnn_best_measured": lambda e: e["vwnn"] == min(e[m] for m in SIX),
    "two_point_beats_vwnn": lambda e: e["two_point"] < e["vwnn"],
    "first_beats_second": lambda e: e["vwnn_first_order"] < e["vwnn"],
    "linear_beats_polynomial": lambda e: e["linear"] < min(e[m] for m in POLYNOMIAL),
    "all_above_100": lambda e: min(e[m] for m in (*POLYNOMIAL, "global_mlp", OWN)) > 100.0,
}


def write_page(
    page: Path,
    runs: Sequence[Result],
    cells: Sequence[Cell],
    drawn: Path,
    outside: Path,
    close_fit: Path,
    feedthrough: Path = FEEDTHROUGH,
) -> None:
    """Fill the template and copy the PNG figures beside it. Raises ValueError for what is missing.

    drawn: folder of the figures; outside, close_fit: folders of runs; feedthrough: file of a study.
    """
    facts = dict(_facts(runs, cells)) | dict(_of_feedthrough(feedthrough))
    if outside.is_dir():
        lines = [row.texts() for row in rows_of(read_runs(outside))]
        coded = [[code(changed), *rest] for changed, *rest in lines]
        facts["outside_experiments"] = markdown(COLUMNS, coded, left=None)
    if close_fit.is_dir():
        facts |= dict(_of_training(read_runs(close_fit), "close"))
    try:
        text = Template(TEMPLATE.read_text("utf-8")).substitute(facts)
    except KeyError as error:
        raise ValueError(
            f"the page needs {error}, which these runs do not tell; "
            "make them all: python train.py -m experiment=paper, then outside and close_fit"
        ) from None
    figures = page.parent / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    for path in sorted(drawn.glob("*.png")):
        shutil.copyfile(path, figures / path.name)
    write_text(page, text)


def _facts(runs: Sequence[Result], cells: Sequence[Cell]) -> Iterator[tuple[str, str]]:
    usual = as_configured(runs)
    yield from _of_cells(cells)
    yield from _of_seeds(usual)
    yield from _of_training(usual, "study")
    seeds = {run.seed for run in usual}
    yield "seeds", f"{min(seeds)} … {max(seeds)}"
    yield "runs", str(len(runs))
    yield "earlier", stated(other_version(runs))
    for lost in (FAILED, ESCAPED):
        yield lost, str(sum(run.status == lost for run in runs))


def _of_cells(cells: Sequence[Cell]) -> Iterator[tuple[str, str]]:
    """t3_vwnn_test, t3_vwnn_test_range, t3_vwnn_test_paper …, table3 …, counts of hits."""
    for cell in cells:
        if cell.dof == "total":
            name = f"t{cell.table}_{cell.method}_{cell.split}"
            yield name, cell.ours.words(cell.ours.median)
            yield f"{name}_range", cell.ours.between(cell.ours.range)
            yield f"{name}_paper", percent(cell.paper_percent)
    for table in {cell.table for cell in cells}:
        mine = [cell for cell in cells if cell.table == table]
        yield f"table{table}", cells_markdown(mine)
        judged = [c for c in mine if c.inside is not None]
        judged = [c for c in judged if (c.method, c.split) not in NOT_PAIRED]
        yield f"hits{table}", f"{sum(bool(c.inside) for c in judged)} of {len(judged)}"
    yield "hits", hits(cells).replace("\n", ";\n  ")
    yield "outside", outside_table(cells)


def outside_table(cells: Sequence[Cell]) -> str:
    """The paper's values that our range over the seeds does not hold."""
    lines = []
    for cell in cells:
        if cell.inside is False and (cell.method, cell.split) not in NOT_PAIRED:
            label = next(iter(by_label([cell])))
            ours = cell.ours.between(cell.ours.range)
            lines.append([str(cell.table), label, cell.split, percent(cell.paper_percent), ours])
    head = ("table", "method", "split", "paper", "ours: min – max")
    return markdown(head, lines, left=(1, 2))


def _of_seeds(runs: Sequence[Result]) -> Iterator[tuple[str, str]]:
    """What holds seed by seed: counts such as "18 of 20"."""
    for table, (system, scenario) in SETTINGS.items():
        errors = _errors(runs, system, scenario)
        seeds = sorted(set.intersection(*(set(by_seed) for by_seed in errors.values())))

        def counted(
            holds: Callable[[dict[str, float]], bool], errors: dict = errors, seeds: list = seeds
        ) -> str:
            true = sum(holds({m: by[seed] for m, by in errors.items()}) for seed in seeds)
            return f"{true} of {len(seeds)}"

        for name, holds in CLAIMS.items():
            yield f"{name}_{table}", counted(holds)
    yield "bases_differ", f"{_largest_difference_of_bases(runs):.0e}"
    full = _errors(runs, "polynomial", "full_state")
    for scenario in ("integrated", "noisy"):
        changed = _errors(runs, "polynomial", scenario)
        for method in SIX:
            both = sorted(changed[method].keys() & full[method].keys())
            pairs = [(changed[method][s], full[method][s]) for s in both]
            pairs = [pair for pair in pairs if math.isfinite(pair[1])]  # else there is no ratio
            # 10 % of noise on the acceleration, nothing else
            alone = (math.hypot(b, 10.0) for _, b in pairs)
            yield f"{scenario}_quadrature_{method}", f"{median(alone):.2f}"
            low, middle, high = quantiles((a / b for a, b in pairs), n=4)
            yield f"{scenario}_ratio_{method}", f"{middle:.2f} ({low:.2f} – {high:.2f})"
            yield f"{scenario}_rise_{method}", f"{median(a - b for a, b in pairs):.2f}"


def _errors(runs: Sequence[Result], system: str, scenario: str) -> dict[str, dict[int, float]]:
    """{method: {seed: test error}} of all methods that have runs."""
    methods = (*SIX, OWN, "linear", "vwnn_first_order", "two_point")
    found: dict[str, dict[int, float]] = {}
    for method in methods:
        for run in of(runs, method, system, scenario):
            if (error := error_of(run, method, "test")) is not None:
                found.setdefault(method, {})[run.seed] = error
    missing = [method for method in methods if method not in found]
    if missing:
        raise ValueError(
            f"the page needs runs of {', '.join(missing)} on {system}, {scenario}; "
            "make them: python train.py -m experiment=paper"
        )
    return found


def _largest_difference_of_bases(runs: Sequence[Result]) -> float:
    """Largest relative difference of the errors of power series and Chebyshev polynomials."""
    differences = []
    for system, scenario in SETTINGS.values():
        powers, chebyshev = (
            {run.seed: error_of(run, method, "test") for run in of(runs, method, system, scenario)}
            for method in POLYNOMIAL[1:]
        )
        for seed, error in powers.items():
            other = chebyshev.get(seed)
            if error and other and math.isfinite(error):
                differences.append(abs(error - other) / error)
    return max(differences)


def _of_training(runs: Sequence[Result], prefix: str) -> Iterator[tuple[str, str]]:
    """Median iterations, seconds and training errors of the networks, full state."""
    for table in (3, 4, 5):
        for method in ("residual_mlp", "global_mlp"):
            same = of(runs, method, *SETTINGS[table])
            done = [run.metrics for run in same if run.finished]
            if done:
                name = f"{table}_{method}"
                iterations = median(m["training"]["iterations"] for m in done)
                yield f"{prefix}_iterations_{name}", f"{iterations:.0f}"
                yield f"{prefix}_seconds_{name}", f"{median(m['fit_seconds'] for m in done):.1f}"
                ours = spread_of(same, lambda run: run.error("train"))
                yield f"{prefix}_train_{name}", ours.words(ours.median)


def _of_feedthrough(path: Path) -> Iterator[tuple[str, str]]:
    """Medians of studies/feedthrough.py, from the file that it wrote."""
    if not path.is_file():
        raise ValueError(f"the page needs {path}; make it: python -m studies.feedthrough")
    for system, errors in json.loads(path.read_text("utf-8")).items():
        for name, values in errors.items():
            yield f"{name.replace(' ', '_')}_{system}", percent(median(values))
