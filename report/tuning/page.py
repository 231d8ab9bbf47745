"""The page of tuning: report/tuning/page.md filled in from the runs of the searches."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from string import Template

from matplotlib.figure import Figure

from models.training.assemble import data_from, estimator_from
from models.training.metrics import score
from report.collection.figure import scale
from report.free_run.rows import SYSTEMS
from report.paper.signals import COLOURS
from report.paper.tables import percent
from report.tuning.cases import ONSET, WAYS, Case, after_onset, spread
from runner.command_line import composed
from runner.run_folder import write_text

TEMPLATE = Path(__file__).with_name("page.md")
PRINTED = {"bouc_wen": "Bouc–Wen"}
FAST = 200.0  # rad/s: filters that follow the motion closely
SEARCHES = {  # a model of each
    "tune_vwnn": "vwnn",
    "tune_polynomial": "power_series_residual",
    "tune_networks": "residual_mlp",
}


def write_tuning_page(page: Path, cases: Sequence[Case]) -> None:
    """Fill the template; the figure goes beside it."""
    figure = page.parent / "figures" / "tuning.png"
    figure.parent.mkdir(parents=True, exist_ok=True)
    draw(cases).savefig(figure, dpi=150)
    template = Template(TEMPLATE.read_text("utf-8"))
    write_text(page, template.substitute(dict(_facts(cases))))


def _facts(cases: Sequence[Case]) -> Iterator[tuple[str, str]]:
    onset = {(c.model, c.system, way): _onset(c, way) for c in cases for way in WAYS}
    yield "errors", as_rows(_errors(cases))
    yield "settings", as_rows(_settings(cases))
    yield "onset", as_rows(_onsets(cases, onset))
    yield "free_runs", as_rows(_free_runs(cases))
    yield "warmup", as_rows(_warmup())
    for name in ("cutoff", "stages"):
        found = [c.settings.get(f"model.{name}", "–") for c in cases if c.model == "vwnn"]
        yield name, ", ".join(found) or "–"
    yield "trials", "; ".join(_trials(cases))
    lost = sum(len(c.folders[w]) - len(c.metrics[w]) for c in cases for w in WAYS)
    yield "runs", str(sum(len(c.folders[way]) for c in cases for way in WAYS))
    yield "lost", str(lost)
    models = {case.model for case in cases}
    missing = [f"`{search}`" for search, model in SEARCHES.items() if model not in models]
    yield "missing", f" Not run for this page: {', '.join(missing)}." if missing else ""


def _head(case: Case) -> tuple[str, str]:
    return f"`{case.model}`", PRINTED.get(case.system, case.system)


def _errors(cases: Sequence[Case]) -> Iterator[Sequence[str]]:
    yield "model", "system", "paper's settings", "tuned", "tuned is better"
    for case in cases:
        yield (*_head(case), *(spread(case.errors(way)) for way in WAYS), case.better)


def _settings(cases: Sequence[Case]) -> Iterator[Sequence[str]]:
    yield "model", "system", "validation, first trial", "best trial", "settings"
    for case in cases:
        told = (percent(case.told[f"{which}_percent"]) for which in ("first", "best"))
        settings = ", ".join(
            f"{key.removeprefix('model.')} {value}" for key, value in case.settings.items()
        )
        yield (*_head(case), *told, settings)


def _onset(case: Case, way: str) -> dict[int, tuple[float, float]]:
    return {seed: after_onset(case.folders[way][seed]) for seed in case.metrics[way]}


def _onsets(
    cases: Sequence[Case], onset: Mapping[tuple[str, str, str], dict[int, tuple[float, float]]]
) -> Iterator[Sequence[str]]:
    yield "model", "system", "paper's settings", "tuned", "line through two values"
    for case in cases:
        pairs = [onset[case.model, case.system, way] for way in WAYS]
        own = (spread({seed: pair[0] for seed, pair in found.items()}) for found in pairs)
        line = spread({seed: pair[1] for seed, pair in pairs[0].items()})
        yield (*_head(case), *own, line)


def _free_runs(cases: Sequence[Case]) -> Iterator[Sequence[str]]:
    yield "model", "system", "paper's settings", "tuned"
    for case in cases:
        yield (*_head(case), *(spread(case.free_runs(way)) for way in WAYS))


def _warmup() -> Iterator[Sequence[str]]:
    """Validation error of the VWNN, whose filters start at rest: all counted, or not the start."""
    yield "system", "cutoff", "all counted", "first second not"
    for system in SYSTEMS:
        for cutoff in (50.0, FAST):
            words = (f"model.cutoff={cutoff}", "data.validation=0.2", "seed=80")
            yield (
                PRINTED.get(system, system),
                f"{cutoff:g} rad/s",
                *(_held_back(f"system={system}", *words, f"data.warmup={w}") for w in (0, ONSET)),
            )


def _held_back(*words: str) -> str:
    cfg = composed("model=vwnn", *words)
    data = data_from(cfg)
    data.setup()
    vwnn = estimator_from(cfg.model, data)
    vwnn.identify(data.loader("train"))
    return percent(score(vwnn, data.loader("validation"))["relative_rms_percent"])


def _trials(cases: Sequence[Case]) -> Iterator[str]:
    counts = {case.model: (len(case.told["trials"]), len(case.told["seeds"])) for case in cases}
    for model, (trials, seeds) in counts.items():
        yield f"`{model}` {trials} of {seeds} runs"


def as_rows(rows: Iterator[Sequence[str]]) -> str:
    head, *lines = rows
    return "\n".join(f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *lines))


def draw(cases: Sequence[Case]) -> Figure:
    """Test error of every seed, as configured in grey above, tuned in colour below."""
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
                colour = COLOURS[case.model] if way == "tuned" else "#999999"
                axes.plot(errors, [place + offset] * len(errors), "|", color=colour, markersize=9)
                values += errors
        scale(axes, "x", values)
        axes.set_title(PRINTED.get(system, system), fontsize="medium")
        axes.set_xlabel("test error [%]")
        axes.grid(axis="x", alpha=0.3)
        axes.set_yticks(range(len(models)), models, fontsize="small")
        axes.set_ylim(len(models) - 0.5, -0.5)
    return figure
