"""The page of the published packages: page.md filled in from the results, no number by hand."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median
from string import Template

from benchmarks.published import narx, sindy, subnet
from benchmarks.published.measure import ESCAPE, PACKAGES, Result
from benchmarks.published.table import COLUMNS, as_markdown, error, percent, rows
from data.whole_file import write_text

TEMPLATE = Path(__file__).with_name("page.md")
PRINTED = {"bouc_wen": "Bouc–Wen"}
TRUTH = {"element_network": ("bilinear", "polynomial", "bouc_wen"), "sindy": ("polynomial",)}
ZOO = "zoo"  # the version of its estimators

Cases = dict[tuple[str, int], dict[str, float]]  # (system, records) → model → median error


def write_page(page: Path, results: Sequence[Result], planned: Sequence[int]) -> None:
    """Fill the template. planned: the seeds that the command takes when none are named."""
    template = Template(TEMPLATE.read_text("utf-8"))
    facts = dict(_of_runs(results, planned)) | dict(_of_tables(results)) | dict(_of_settings())
    write_text(page, template.substitute(facts))


def _of_runs(results: Sequence[Result], planned: Sequence[int]) -> Iterator[tuple[str, str]]:
    """How they were made, and what of the plan is not there."""
    seeds = sorted({r["seed"] for r in results})
    names = " ".join(map(str, seeds))
    yield "seeds_asked", "" if seeds == list(planned) else f" --seeds {names}"
    yield "seeds", ", ".join(map(str, seeds))
    yield "models", " ".join(_models(results, zoo=True))
    yield "missing", _missing(results, planned)
    yield "duration", f"{results[0]['duration']:g}"
    yield "escape", f"{ESCAPE:g}"
    limits = {r["seconds"] for r in results if r["seconds"] is not None}
    yield "limit", " or ".join(f"{limit:g} s" for limit in sorted(limits)) or "none"
    hours = sum(r["fit_seconds"] or 0.0 for r in results) / 3600.0
    yield "hours", f"{hours:.1f} hours"
    versions = {r["model"]: r["version"] for r in results}
    for name, package in PACKAGES.items():
        yield f"version_{name}", versions.get(name, f"{package.PACKAGE}, not run")


def _models(results: Sequence[Result], zoo: bool) -> list[str]:
    return list(dict.fromkeys(r["model"] for r in results if (r["version"] == ZOO) == zoo))


def _missing(results: Sequence[Result], planned: Sequence[int]) -> str:
    lacking = sorted(set(planned) - {r["seed"] for r in results})
    if not lacking:
        return ""
    names = ", ".join(map(str, lacking))
    return f"\n**Incomplete:** planned are seeds {names} too, which were not run for this page.\n"


def _of_tables(results: Sequence[Result]) -> Iterator[tuple[str, str]]:
    cases = _medians(results)
    yield "overview", as_markdown(list(_overview(cases)))
    yield "ahead", _ahead(cases, _models(results, zoo=True))
    yield "wins", as_markdown(list(_wins(results)))
    yield "table", as_markdown([COLUMNS, *rows(list(results))])
    yield "lost", _lost(results)


def _medians(results: Sequence[Result]) -> Cases:
    """For each system and number of records, more of them first, the models' medians."""
    cases: dict[tuple[str, int], dict[str, list[float]]] = {}
    for r in sorted(results, key=lambda r: -r["records"]):
        case = cases.setdefault((r["system"], r["records"]), {})
        case.setdefault(r["model"], []).append(error(r))
    return {key: {m: median(errors) for m, errors in c.items()} for key, c in cases.items()}


def _name(system: str, records: int) -> str:
    return f"{PRINTED.get(system, system)}, {records} record{'s' * (records > 1)}"


def _overview(cases: Cases) -> Iterator[Sequence[str]]:
    """A column for each system and number of records, the best model of all columns first."""
    yield "model", *(_name(*key) for key in cases)
    models = dict.fromkeys(model for case in cases.values() for model in case)
    for model in sorted(models, key=lambda m: median(c.get(m, math.inf) for c in cases.values())):
        cells = []
        for (system, _), case in cases.items():
            mark = " †" if system in TRUTH.get(model, ()) else ""
            cells.append(percent(case[model]) + mark if model in case else "")
        yield f"`{model}`", *cells


def _ahead(cases: Cases, zoo: Sequence[str]) -> str:
    """Where a package has the smallest median of all, and where none has."""
    best = {key: min(case, key=lambda m: case[m]) for key, case in cases.items()}
    packages = [f"`{m}` on {_name(*key)}" for key, m in best.items() if m not in zoo]
    ours = [f"`{m}` on {_name(*key)}" for key, m in best.items() if m in zoo]
    return (
        f"A package has the smallest median of all: {'; '.join(packages) or 'nowhere'}. "
        f"An estimator of the zoo has it: {'; '.join(ours) or 'nowhere'}."
    )


def _wins(results: Sequence[Result]) -> Iterator[Sequence[str]]:
    """For each package and system, how often it is better than an estimator of the zoo."""
    errors = {(r["model"], r["system"], r["records"], r["seed"]): error(r) for r in results}
    zoo = _models(results, zoo=True)
    yield "package", "system", *(f"better than `{model}`" for model in zoo)
    for name in _models(results, zoo=False):
        for system in dict.fromkeys(r["system"] for r in results):
            mine = {key[2:]: e for key, e in errors.items() if key[:2] == (name, system)}
            cells = []
            for model in zoo:
                pairs = [(e, errors.get((model, system, *key))) for key, e in mine.items()]
                both = [(e, other) for e, other in pairs if other is not None]
                cells.append(f"{sum(e < other for e, other in both)} of {len(both)}")
            yield f"`{name}`", PRINTED.get(system, system), *cells


def _lost(results: Sequence[Result]) -> str:
    """Each run without an error, and why."""
    mine = [r for r in results if r["error"] is None]
    if not mine:
        return "Every fit ended and no free run diverged."
    grouped: dict[tuple[str, ...], list[int]] = {}
    for r in mine:
        system, records = PRINTED.get(r["system"], r["system"]), str(r["records"])
        grouped.setdefault((f"`{r['model']}`", str(system), records, r["remark"]), []).append(
            r["seed"]
        )
    lines = [(*key, ", ".join(map(str, sorted(seeds)))) for key, seeds in grouped.items()]
    return as_markdown([("model", "system", "records", "why", "seeds"), *lines])


def _of_settings() -> Iterator[tuple[str, str]]:
    """As they stand at the top of each package's file."""
    assert subnet.HELD_BACK == sindy.HELD_BACK  # the page says it once
    yield "held_back", f"{100.0 * sindy.HELD_BACK:g}"
    yield "subnet_past", str(subnet.PAST)
    yield "subnet_section", str(subnet.SECTION)
    yield "subnet_states", str(subnet.STATES)
    yield "subnet_batch", str(subnet.BATCH)
    yield "subnet_check", str(subnet.CHECK)
    yield "narx_terms", str(narx.TERMS)
    yield "narx_degree", str(narx.DEGREE)
    yield "narx_lags", ", ".join(map(str, narx.LAGS))
    yield "sindy_degree", str(sindy.DEGREE)
    yield "sindy_thresholds", ", ".join(map(str, sindy.THRESHOLDS))
