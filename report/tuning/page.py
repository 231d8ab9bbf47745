"""The page of tuning: report/tuning/page.md filled in from finished runs. No training."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from report.about import colour_of
from report.collection.figure import scale
from report.collection.runs import collect, other_version, stated
from report.free_run.rows import SYSTEMS
from report.tuning.cases import WAYS, Case
from report.tuning.onset import onsets
from report.tuning.tables import (
    PRINTED,
    as_markdown,
    error_rows,
    free_run_rows,
    onset_rows,
    setting_rows,
    warmup_rows,
)
from report.usual import SEARCHES
from runner.folder.run_folder import write_text

MARKS: dict[str, dict[str, Any]] = {  # of a seed
    "configured": {"color": "#888888", "marker": "|", "linestyle": "", "markersize": 9},
    "tuned": {"marker": "o", "linestyle": "", "markersize": 4, "markerfacecolor": "none"},
}
TEMPLATE = Path(__file__).with_name("page.md")
WARMUP = Path("runs/tune_warmup")  # runs of experiment=tune_warmup
NEEDS = {  # of the page: what makes it
    folder: f"python train.py -m experiment={folder.name}" for folder in (*SEARCHES, WARMUP)
}
MAKES = {  # a model of each
    "tune_vwnn": "vwnn",
    "tune_polynomial": "power_series_residual",
    "tune_networks": "residual_mlp",
}


def write_tuning_page(page: Path, cases: Sequence[Case], warmup: Path = WARMUP) -> None:
    """Fill the template; the figure goes beside the page. Raises ValueError for missing runs."""
    facts = dict(_facts(cases, warmup))
    figure = page.parent / "figures" / "tuning.png"
    figure.parent.mkdir(parents=True, exist_ok=True)
    draw(cases).savefig(figure, dpi=150)
    write_text(page, Template(TEMPLATE.read_text("utf-8")).substitute(facts))


def _facts(cases: Sequence[Case], warmup: Path) -> Iterator[tuple[str, str]]:
    results = (run for case in cases for of_way in case.results.values() for run in of_way.values())
    yield "earlier", stated(other_version(results))
    yield "errors", as_markdown(error_rows(cases))
    yield "settings", as_markdown(setting_rows(cases))
    if any(len(onsets(c, way)) < len(c.metrics[way]) for c in cases for way in WAYS):
        raise ValueError(
            "runs are not scored without the first second: python -m report.tuning.onset"
        )
    yield "onset", as_markdown(onset_rows(cases))
    yield "free_runs", as_markdown(free_run_rows(cases))
    if not warmup.is_dir():
        raise ValueError(f"no runs in {warmup}; python train.py -m experiment=tune_warmup")
    runs = [run for run in collect([warmup]) if run.finished]
    yield "warmup", as_markdown(warmup_rows(runs))
    for name in ("cutoff", "stages"):
        values = [c.settings.get(f"model.{name}", "–") for c in cases if c.model == "vwnn"]
        yield name, ", ".join(values) or "–"
    yield "trials", "; ".join(_trials(cases))
    lost = sum(len(c.folders[w]) - len(c.metrics[w]) for c in cases for w in WAYS)
    yield "runs", str(sum(len(c.folders[way]) for c in cases for way in WAYS))
    yield "lost", str(lost)
    models = {case.model for case in cases}
    missing = [f"`{search}`" for search, model in MAKES.items() if model not in models]
    yield "missing", f" Not run for this page: {', '.join(missing)}." if missing else ""


def _trials(cases: Sequence[Case]) -> Iterator[str]:
    counts = {case.model: (len(case.search["trials"]), len(case.search["seeds"])) for case in cases}
    for model, (trials, seeds) in counts.items():
        yield f"`{model}` {trials} of {seeds} runs"


def draw(cases: Sequence[Case]) -> Figure:
    """Test error of every seed: as configured above, in grey; tuned below, in colour."""
    models = list(dict.fromkeys(case.model for case in cases))
    systems = [s for s in SYSTEMS if any(case.system == s for case in cases)]
    size = (2.2 + 2.9 * len(systems), 1.2 + 0.75 * len(models))
    figure = Figure(figsize=size, layout="constrained")
    for axes, system in zip(
        figure.subplots(1, len(systems), sharey=True, squeeze=False)[0], systems, strict=True
    ):
        values: list[float] = []
        for case in (case for case in cases if case.system == system):
            place = models.index(case.model)
            for offset, way in zip((-0.2, 0.2), WAYS, strict=True):
                errors = list(case.errors(way).values())
                style = MARKS[way] | ({"color": colour_of(case.model)} if way == "tuned" else {})
                axes.plot(errors, [place + offset] * len(errors), **style)
                values += errors
        scale(axes, "x", values)
        axes.set_title(PRINTED.get(system, system), fontsize="medium")
        axes.set_xlabel("test error [%]")
        axes.grid(axis="x", alpha=0.3)
        axes.set_yticks(range(len(models)), models, fontsize="small")
        axes.set_ylim(len(models) - 0.5, -0.5)
        for line in np.arange(1, len(models)) - 0.5:
            axes.axhline(line, color="#dddddd", linewidth=0.8)
    marks = [Line2D([], [], **({"color": "#222222"} | MARKS[way])) for way in WAYS]
    words = ["as configured, a seed each", "tuned, a seed each"]
    figure.legend(marks, words, loc="outside upper right", ncols=2, frameon=False)
    return figure
