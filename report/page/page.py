"""The page of a run or of a search for one: verdict, record, signals, structure, limits, downloads.

One self-contained file: nothing in it is requested from anywhere, and no text from files is markup.
"""

from __future__ import annotations

import base64
import hashlib
import importlib
import io
import json
import math
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup
from matplotlib.figure import Figure
from rich.table import Table
from rich.text import Text

from data import arguments
from data.record import QUANTITIES
from data.sample import OUTPUTS
from data.terminal import Terminal
from data.whole_file import write_text
from export.modes import modes_of
from export.run import read_exported
from models.estimator import Estimator
from models.fit.metrics import FREE_RUNS
from models.stored.folder import CONFIG, read_values, require_finished
from models.stored.run import StoredRun, read_run
from models.stored.schema import SEARCH_KIND, SPECTRUM
from report.collection.runs import as_typed, collect
from report.describe.description import draw_modes, print_modes, print_parameters, print_rest
from report.output import Section, picture_link, printed
from report.page.signals import (
    TEXT_BYTES,
    Motion,
    charts_of,
    csv_of,
    fit_percent,
    loops_figure,
    motions_of,
    table_of,
)
from report.prediction.interface import Interface
from report.run.building import draw_storeys
from report.run.rescore import record_gone, require_scores
from report.run.summary import print_all_errors
from report.run.table import print_left_open, print_outside
from report.uncertainty.intervals import plain as number
from report.uncertainty.intervals import print_bands, print_criticism, print_intervals
from report.uncertainty.storeys import has_storeys, print_drifts
from report.zoo.publish import command_of
from runner.folder.run import restore
from runner.folder.run_folder import results_folder
from runner.scores.grade import NOTHING, ONE_STEP, SIMULATES
from runner.scores.headline import headline
from runner.scores.result import ERROR
from runner.scores.spread import percent
from runner.scores.verdict import CANNOT
from runner.selection.identified import NAME as SEARCH
from runner.selection.identified import PAGE

ANSWERS = {  # "can I simulate with it?"
    SIMULATES: "Yes: from the excitation alone.",
    ONE_STEP: "No: only an estimate of the next sample from the measured ones before it is of use.",
    NOTHING: "No: no model of this structure was found.",
}
STORED = {  # of what published and older runs lack
    "baselines": {}, "paper": {}, "per_record": {}, "benchmark": {}, "simulation_error": 0.0,
    "quantity": "acceleration",
}  # fmt: skip
DRIVES, ESTIMATED = "drives", "estimated"  # roles of channels
NAMED = 3  # channels that a sentence lists
HERE = Path(__file__).parent
Channels = Sequence[Mapping[str, str]]  # what each is called, its column, unit and role


def write_page(folder: Path) -> Path:
    """Write report.html of a finished run, or of a folder with identify.json; returns its path.

    Raises ValueError for a folder that holds neither.
    """
    search = read_values(folder / SEARCH, SEARCH_KIND) if (folder / SEARCH).is_file() else {}
    chosen = _chosen(search)
    run_folder = folder / chosen["folder"] if chosen.get("folder") else folder
    content: dict[str, Any] = {"search": search, "chosen": chosen}
    if search and not chosen:
        grade = search["verdict"]
        content |= {"title": _files(search), "grade": grade, "not_for": [], "downloads": []}
    else:
        require_finished(run_folder)
        place = folder if search else results_folder(folder)
        place.mkdir(parents=True, exist_ok=True)
        content |= _of_run(read_run(run_folder), search, place)
        folder = place
    page = _rendered("page.html", content, "uPlot.min.css", "uPlot.iife.min.js")
    write_text(folder / PAGE, page)
    return folder / PAGE


def write_runs_page(folders: Sequence[Path], output: Path) -> Path:
    """Write report.html that compares all runs below folders, into output; returns its path.

    Raises ValueError where there are none.
    """
    rows = []
    for run in collect(folders):
        free, one = (run.metrics.get(key, {}) for key in (FREE_RUNS["test"], "test"))
        page = run.folder / PAGE
        rows.append({
            "name": os.path.relpath(run.folder, output), "model": run.model,
            "page": Path(os.path.relpath(page, output)).as_posix() if page.is_file() else None,
            "system": run.system, "scenario": run.scenario, "seed": run.seed,
            "grade": grade_of(run.metrics)["grade"] if run.finished else run.status,
            "free": free.get(ERROR), "one": one.get(ERROR), "why": run.why,
            "parameters": run.metrics.get("parameters"), "seconds": run.metrics.get("fit_seconds"),
        })  # fmt: skip
    rows.sort(
        key=lambda row: (row["system"] or "", row["free"] or math.inf, row["one"] or math.inf)
    )
    output.mkdir(parents=True, exist_ok=True)
    write_text(output / PAGE, _rendered("runs.html", {"title": "Runs compared", "rows": rows}))
    return output / PAGE


def _chosen(search: Mapping[str, Any]) -> dict[str, Any]:
    place = search.get("chosen")
    return {} if place is None else dict(search["candidates"][place])


def _files(search: Mapping[str, Any]) -> str:
    files = search.get("record", {}).get("files", [])
    return _few([file.get("name", "") for file in files]) or "no record"


def _rendered(template: str, content: Mapping[str, Any], *libraries: str) -> str:
    """The file: styles and scripts by their digests, so that nothing else can act in it."""
    styles = [name for name in libraries if name.endswith(".css")]
    scripts = [name for name in libraries if name.endswith(".js")]
    files = [*styles, "page.css"], [*scripts, "page.js"] if scripts else []
    css, js = ("\n".join((HERE / name).read_text("utf-8") for name in names) for names in files)
    if scripts:
        js = f"/*! {(HERE / 'uPlot.LICENSE').read_text('utf-8')}*/\n{js}"
    data = json.dumps(content.get("charts", []), allow_nan=False, separators=(",", ":"))
    for sign in "<>&":
        data = data.replace(sign, f"\\u{ord(sign):04x}")
    environment = Environment(
        loader=FileSystemLoader(HERE), autoescape=True,
        trim_blocks=True, lstrip_blocks=True, finalize=_written,
    )  # fmt: skip
    environment.filters |= {"percent": percent, "number": number, "with_unit": _with_unit}
    environment.globals |= {"answers": ANSWERS}
    embedded = {name: Markup(text) for name, text in (("css", css), ("js", js), ("data", data))}
    hashes = {f"{name}_hash": _digest(embedded[name]) for name in ("css", "js")}
    return environment.get_template(template).render(**content, **embedded, **hashes)


def _written(value: Any) -> Any:
    """Text without control characters and signs that turn the direction of writing."""
    return arguments.plain(value) if type(value) is str else value


def _with_unit(value: Any, unit: str) -> str:
    return f"{percent(value) if unit == '%' else number(value, 3)} {unit}" if value else ""


def _digest(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _link(text: str, kind: str = "text/plain") -> str:
    return f"data:{kind};base64,{base64.b64encode(text.encode()).decode()}"


class Blocks(Terminal):
    """What is printed in a terminal, kept for a page: paragraphs, warnings, tables."""

    def __init__(self) -> None:
        super().__init__(width=10_000, file=io.StringIO())  # all columns of every table
        self.blocks: list[dict[str, Any]] = []

    def print(self, *objects: Any, **options: Any) -> None:
        for one in objects:
            if isinstance(one, Table):
                self.blocks.append(_table(one))
            elif str(one).strip():
                warns = isinstance(one, Text) and str(one.style) in ("yellow", "red", "bold red")
                self.blocks.append({"kind": "warning" if warns else "text", "text": str(one)})

    def picture(self, figure: Figure, words: str) -> None:
        """Add a picture and what it shows in words."""
        self.blocks.append({"kind": "picture", "src": picture_link(figure), "text": words})


def _table(table: Table) -> dict[str, Any]:
    columns = [[str(cell).replace("\n", " ") for cell in column.cells] for column in table.columns]
    return {
        "kind": "table",
        "head": [str(column.header).replace("\n", " ") for column in table.columns],
        "right": [column.justify == "right" for column in table.columns],
        "rows": list(zip(*columns, strict=True)),
        "text": " ".join(str(t) for t in (table.title, table.caption) if t),
    }


def grade_of(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """The grade of a run; of runs that have none, what their verdict says."""
    verdict = metrics.get("verdict", {})
    if "grade" in verdict:
        return dict(verdict["grade"])
    by = verdict.get("by", "one step")
    fault = verdict.get("test_diverges") or verdict.get("not_better") or ""
    if verdict.get("identified") is not True or fault:
        grade, reason = NOTHING, fault or verdict.get("reason") or "nobody judged this run"
    else:
        grade = SIMULATES if by == "free run" else ONE_STEP
        plain = "better than every plain model on unseen motion"
        reason = verdict.get("as_good") or (plain if verdict.get("opponents") else "")
    error = metrics.get(FREE_RUNS["test"] if by == "free run" else "test", {}).get(ERROR)
    return {"grade": grade, "by": by, "error_percent": error, "reason": reason}


def _of_run(run: StoredRun, search: Mapping[str, Any], place: Path) -> dict[str, Any]:
    """What a page tells of a finished run: verdict, charts, sections, downloads."""
    metrics, estimator = run.metrics, restore(run)
    require_scores(metrics, estimator.dofs)
    grade = grade_of(metrics)
    way, driven = grade.get("by") or "one step", Interface.of(estimator, run.sensors).channels
    channels = _inputs_and_outputs(run, driven)
    names = [f"{c['channel']} ({c['column']})" if c["column"] else c["channel"]
             for c in channels if c["why"] == ESTIMATED]  # fmt: skip
    others = metrics.get("verdict", {}).get("opponents", {}).get("test", {})
    plain = min((n for n, e in others.items() if e is not None), key=others.get, default=None)
    content: dict[str, Any] = {
        "title": _files(search) if search else f"{metrics['model']} on {metrics['system']}",
        "grade": grade, "not_for": _not_for(grade, run, estimator, channels), "way": way,
        "charts": [], "why_no_charts": "", "unscored": 0.0, "plain": plain, "others": others,
        "channels": channels,
        "notes": metrics.get("records", {}), "command": search.get("command") or _command(run),
        "run": as_typed(run.folder), "model": metrics["model"],
    }  # fmt: skip
    loops, signals = Blocks(), Blocks()
    config = (run.folder / CONFIG).read_text("utf-8")
    downloads = [{"name": "config.yaml", "href": _link(config), "about": "all settings"}]
    try:
        motions, data = _motions(run, estimator, way, plain)
        content["unscored"] = max(m.record.warmup * m.record.dt for m in motions)
        how = "free run" if way == "free run" else "one step ahead"
        labels = {"own": f"model, {how}", "plain": f"{plain}, the best plain model"}
        content["charts"] = charts_of(motions, names, labels)
        _print_fit(signals, motions, names, metrics, way, plain)
        text, about = csv_of(table_of(motions, names), place)
        downloads.insert(0, {"name": "estimates.csv", "href": _link(text, "text/csv"),
                             "about": about})  # fmt: skip
        if drawn := loops_figure(estimator, data, motions[0], way):
            loops.picture(drawn[0], f"{motions[0].name}; {drawn[1]}")
    except (*CANNOT, OSError) as error:
        content["why_no_charts"] = arguments.reason(ValueError(str(error)))
    print_all_errors(signals, STORED | metrics)
    sections = {"Errors": signals, "Loops": loops}
    for title, tell in SECTIONS.items():
        sections[title] = Blocks()
        tell(sections[title], estimator, metrics)
    sections["Trained range"] = Blocks()
    _print_range(sections["Trained range"], run, channels)
    content["sections"] = {title: own.blocks for title, own in sections.items() if own.blocks}
    content["downloads"] = downloads + _sources(run.folder)
    return content


def _motions(run: StoredRun, estimator: Estimator, way: str, plain: str | None) -> Any:
    """Test motions with estimates, and their data. Raises ValueError where the record is gone."""
    gone = record_gone(run.experiment)
    if gone is not None:
        raise ValueError(f"the record {gone.name} is missing; put it back to see the time history")
    data = run.experiment.set_up_data()
    return motions_of(run, estimator, data, way, plain), data


def _columns(run: StoredRun) -> Mapping[str, Any]:
    """{channel: column} where the run's config names columns."""
    stated = run.experiment.data.values.get("channels")
    return stated if isinstance(stated, Mapping) else {}


def _inputs_and_outputs(run: StoredRun, driven: Sequence[str]) -> Channels:
    """Channels of a run: what each is, in which unit."""
    sensors, columns = run.sensors, _columns(run)
    own = [f"{OUTPUTS.get(sensors.quantity, 'y')}{i}" for i in sensors.numbers]
    units = dict.fromkeys(own, QUANTITIES[sensors.quantity][1])
    units |= {name: "N" for name in driven if name[0] == "f"} | dict(sensors.units)
    roles = dict.fromkeys(driven, DRIVES)
    roles |= dict.fromkeys([c for c in sensors.channels if c not in roles], "read")
    roles |= dict.fromkeys(own, ESTIMATED)
    return [
        {"channel": name, "column": str(columns.get(name, "")),
         "unit": units.get(name, "").replace("^2", "²"), "why": role}
        for name, role in roles.items()
    ]  # fmt: skip


def _not_for(
    grade: Mapping[str, Any], run: StoredRun, estimator: Estimator, channels: Channels
) -> list[str]:
    """What the model must not be used for, the weightiest first."""
    if grade["grade"] == NOTHING:
        return ["Any conclusion about the structure."]
    found = ["Simulation: other loads, earthquakes, design."] * (grade["grade"] == ONE_STEP)
    ranged = _ranged(run, channels)
    first = next((k for k in ("deformation", "displacement") if k in ranged), run.sensors.quantity)
    for kind in [k for k in (first, "excitation") if k in ranged]:
        sizes = [f"{number(value, 3)} {unit}".strip() + f" ({name})"
                 for name, value, unit in ranged[kind]]  # fmt: skip
        found.append(f"{kind.capitalize()} beyond that of training: {_few(sizes)}.")
    driven = [c["channel"] for c in channels if c["why"] == DRIVES]
    if driven and grade["grade"] == SIMULATES:
        found.append(f"Loads other than {_few(driven)}.")
    if estimator.scale_is_open:
        found.append("Masses and forces in kg and N: they are known up to a common factor.")
    return found


def _ranged(run: StoredRun, channels: Channels) -> dict[str, list[tuple[str, float, str]]]:
    """Names, largest values and units of all that moved in training, by kind."""
    roles = {"excitation": DRIVES, run.sensors.quantity: ESTIMATED}
    found = {}
    for kind, own in run.metrics.get("trained_range", {}).items():
        if kind == SPECTRUM:  # of many periods; the excitation is its limit at short ones
            continue
        known = [c for c in channels if c["why"] == roles.get(kind)]
        if len(known) != len(own["names"]):
            known = [{"channel": name, "unit": own["unit"]} for name in own["names"]]
        pairs = zip(known, own["largest"], strict=False)
        found[kind] = [(c["channel"], value, c["unit"]) for c, value in pairs]
    return found


def _few(texts: Sequence[str]) -> str:
    more = f" and {len(texts) - NAMED} more" if len(texts) > NAMED else ""
    return ", ".join(texts[:NAMED]) + more


def _command(run: StoredRun) -> str:
    try:
        return command_of(run.values)
    except ValueError:
        return ""


def _print_fit(
    console: Blocks, motions: Sequence[Motion], names: Sequence[str], metrics: Mapping[str, Any],
    way: str, plain: str | None,
) -> None:  # fmt: skip
    """Per channel: error in percent and in its unit, MATLAB's fit, that of the best plain model."""
    scores = metrics.get(FREE_RUNS["test"] if way == "free run" else "test", {})
    unit = QUANTITIES[metrics.get("quantity", "acceleration")][1]
    nothing = [None] * len(names)
    columns = {
        "error [%]": scores.get("per_dof_percent") or nothing,
        f"RMS error [{unit}]": scores.get("per_dof_rms") or nothing,
        "fit [%]": fit_percent(motions, [m.own for m in motions]),
    }
    others = [m.plain for m in motions if m.plain is not None]
    columns |= {f"fit of {plain} [%]": fit_percent(motions, others)} if others else {}
    rows = [
        [name, *("–" if v is None or not math.isfinite(v) else number(v, 3) for v in values)]
        for name, *values in zip(names, *columns.values(), strict=True)
    ]
    console.print(printed(Section(["channel", *columns], rows, "unseen motion, by channel")))
    console.print("fit: 100 (1 − ‖y − ŷ‖ / ‖y − mean y‖), MATLAB's compare(); 100 is perfect")


def _print_modes(console: Blocks, estimator: Estimator, metrics: Mapping[str, Any]) -> None:
    modes = modes_of(estimator)
    if modes is not None:
        print_modes(console, modes)
        if len(modes.frequencies):
            figure = draw_modes(modes, f"small motions of {metrics['model']}")
            console.picture(figure, "shapes of the modes; the table has their numbers")


def _print_elements(console: Blocks, estimator: Estimator, metrics: Mapping[str, Any]) -> None:
    """With intervals where there are some."""
    parameters, sure = estimator.physical_parameters(), metrics.get("uncertainty", {})
    if headline(sure):
        print_intervals(console, sure)
        print_rest(console, parameters, metrics.get("trained_range", {}))
    else:
        print_parameters(console, parameters, estimator, metrics)


def _print_residual(console: Blocks, estimator: Estimator, metrics: Mapping[str, Any]) -> None:
    """What the tests of the residual find, and how wide the bands are."""
    sure = metrics.get("uncertainty", {})
    print_criticism(console, sure)
    if not console.blocks and "criticism" in sure:
        console.print("the tests find nothing: what is left looks like noise")
    if "uncertainty" in metrics:
        print_bands(console, metrics)


def _print_drifts(console: Blocks, estimator: Estimator, metrics: Mapping[str, Any]) -> None:
    """With a drawing of the building, where there is one, and what is not determined."""
    print_left_open(console, metrics)
    print_drifts(console, metrics.get("uncertainty", {}))
    if has_storeys(rows := metrics.get("uncertainty", {}).get("drifts", [])):
        console.picture(draw_storeys(rows, estimator), "peak drifts; the table has their numbers")


def _print_range(console: Blocks, run: StoredRun, channels: Channels) -> None:
    """The largest of all that moved in training, and where the test motion was larger."""
    rows = [
        [kind, name, number(value, 4), unit]
        for kind, own in _ranged(run, channels).items()
        for name, value, unit in own
    ]
    if rows:
        console.print(printed(Section(("quantity", "channel", "largest", "unit"), rows)))
    print_outside(console, "test motion ", run.metrics.get("outside_trained_range", []))


SECTIONS: Mapping[str, Callable[[Blocks, Estimator, Mapping[str, Any]], None]] = {
    "Modes": _print_modes,
    "Elements": _print_elements,
    "Drifts": _print_drifts,
    "What the residual shows, and 95 % bands": _print_residual,
}


def _sources(folder: Path) -> list[dict[str, str]]:
    """C of the model, file by file; nothing of a model that has none or is too large."""
    with tempfile.TemporaryDirectory() as aside:
        try:
            files = importlib.import_module("export.c").write(read_exported(folder), Path(aside))
        except CANNOT:
            return []
        texts = {path.name: path.read_text("utf-8") for path in files}
    if sum(map(len, texts.values())) > TEXT_BYTES:
        return []
    return [{"name": n, "href": _link(t), "about": "the model in C99"} for n, t in texts.items()]
