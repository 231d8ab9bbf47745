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
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup
from rich.table import Table
from rich.text import Text

from data import arguments
from data.plain_data import read_json
from data.record import QUANTITIES
from data.terminal import Terminal
from data.whole_file import write_text
from export.modes import modes_of
from export.run import read_exported
from models.estimator import Estimator
from models.fit.metrics import FREE_RUNS
from models.fit.trained_range import OTHER, warnings_of
from models.stored.folder import CONFIG, require_finished
from models.stored.run import StoredRun, read_run
from report.collection.runs import collect
from report.describe.description import draw_modes, print_modes, print_parameters, print_rest
from report.output import picture_link
from report.page.signals import (
    charts_of,
    csv_of,
    fit_percent,
    loops_figure,
    motions_of,
    table_of,
)
from report.prediction.interface import Interface
from report.prediction.peaks import number
from report.run.rescore import record_gone
from report.run.summary import print_all_errors, print_limits
from report.uncertainty.intervals import print_bands, print_drifts, print_intervals, sentences
from report.zoo.publish import command_of
from runner.folder.run import restore
from runner.folder.run_files import results_folder
from runner.scores.headline import headline
from runner.scores.spread import percent
from runner.scores.verdict import CANNOT, ERROR

PAGE, SEARCH = "report.html", "identify.json"
SIMULATES, ONE_STEP, NOTHING = GRADES = (
    "simulates the structure", "estimates one step ahead only", "not identified",
)  # fmt: skip
ANSWERS = {  # "can I simulate with it?"
    SIMULATES: "Yes: from the excitation alone.",
    ONE_STEP: "No: it needs the measured motion up to the last sample.",
    NOTHING: "No: no model of this structure was found.",
}
STORED = {  # of what published and older runs lack
    "baselines": {}, "paper": {}, "per_record": {}, "benchmark": {}, "simulation_error": 0.0,
    "quantity": "acceleration",
}  # fmt: skip
SOURCE_BYTES = 150_000  # of the C source in the page
NAMED = 3  # channels that a sentence lists
HERE = Path(__file__).parent


def write_page(folder: Path) -> Path:
    """Write report.html of a finished run, or of a folder with identify.json; returns its path.

    Raises ValueError for a folder that holds neither.
    """
    search = read_json(folder / SEARCH) if (folder / SEARCH).is_file() else {}
    chosen = _chosen(search)
    run_folder = folder / chosen["folder"] if chosen.get("folder") else folder
    content: dict[str, Any] = {"search": search, "chosen": chosen, "candidates": _tried(search)}
    if search and not chosen:
        grade = {"grade": NOTHING, **(search.get("verdict") or {})}
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
    place, candidates = search.get("chosen"), search.get("candidates") or []
    return dict(candidates[place]) if place is not None else {}


def _tried(search: Mapping[str, Any]) -> list[list[str]]:
    """Rows of the candidates' table."""
    rows = []
    for i, one in enumerate(search.get("candidates") or []):
        held, test = (one.get(f"{key}_percent") for key in ("held_back", "test"))
        errors = ["–" if error is None else f"{percent(error)} %" for error in (held, test)]
        seconds = "–" if one.get("seconds") is None else f"{one['seconds']:.3g} s"
        status = "chosen" if i == search.get("chosen") else one.get("status") or ""
        row = [one.get("name"), status, one.get("way"), *errors, one.get("parameters"), seconds,
               one.get("reason")]  # fmt: skip
        rows.append([str(cell or "–") for cell in row])
    return rows


def _files(search: Mapping[str, Any]) -> str:
    names = [str(file.get("name")) for file in (search.get("record") or {}).get("files") or []]
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return (", ".join(names[:NAMED]) + more) or "no record"


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
    environment.filters |= {"percent": percent, "number": number}
    environment.globals |= {"answers": ANSWERS}
    embedded = {name: Markup(text) for name, text in (("css", css), ("js", js), ("data", data))}
    hashes = {f"{name}_hash": _digest(embedded[name]) for name in ("css", "js")}
    return environment.get_template(template).render(**content, **embedded, **hashes)


def _written(value: Any) -> Any:
    """Text without control characters and signs that turn the direction of writing."""
    return arguments.plain(value) if type(value) is str else value


def _digest(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _link(text: str | bytes, kind: str = "text/plain") -> str:
    content = text.encode() if isinstance(text, str) else text
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


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
                warns = isinstance(one, Text) and ("yellow" in str(one.style) or "red" in
                                                   str(one.style))  # fmt: skip
                self.blocks.append({"kind": "warning" if warns else "text", "text": str(one)})

    def picture(self, svg: str, alt: str) -> None:
        """Add a picture with what it shows in words."""
        self.blocks.append({"kind": "picture", "src": svg, "text": alt})


def _table(table: Table) -> dict[str, Any]:
    columns = [[str(cell).replace("\n", " ") for cell in column.cells] for column in table.columns]
    return {
        "kind": "table",
        "head": [str(column.header).replace("\n", " ") for column in table.columns],
        "right": [column.justify == "right" for column in table.columns],
        "rows": list(zip(*columns, strict=True)),
        "text": " ".join(str(t) for t in (table.title, table.caption) if t),
    }


def _listed(head: Sequence[str], rows: Iterable[Sequence[str]], words: str = "") -> Table:
    table = Table(title=words or None)
    for i, text in enumerate(head):
        table.add_column(text, justify="right" if i else "left")
    for row in rows:
        table.add_row(*map(Text, row))
    return table


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
    grade = grade_of(metrics)
    names, way = _channels(run), grade.get("by") or "one step"
    others = metrics.get("verdict", {}).get("opponents", {}).get("test", {})
    plain = min((n for n, e in others.items() if e is not None), key=others.get, default=None)
    content: dict[str, Any] = {
        "title": _files(search) if search else f"{metrics['model']} on {metrics['system']}",
        "grade": grade, "not_for": _not_for(grade, run, estimator), "way": way,
        "charts": [], "why_no_charts": "", "plain": plain, "others": others,
        "channels": _inputs_and_outputs(run, estimator),
        "notes": metrics.get("records", {}), "command": search.get("command") or _command(run),
        "run": run.folder.name if search else str(run.folder), "model": metrics["model"],
    }  # fmt: skip
    loops, signals = Blocks(), Blocks()
    config = (run.folder / CONFIG).read_text("utf-8")
    downloads = [{"name": "config.yaml", "href": _link(config), "about": "all settings"}]
    try:
        motions, data = _motions(run, estimator, way, plain)
        content["charts"] = charts_of(motions, names, _labels(way, plain))
        _print_fit(signals, motions, names, metrics, way, plain)
        text, about = csv_of(table_of(motions, names), place)
        downloads.insert(0, {"name": "estimates.csv", "href": _link(text, "text/csv"),
                             "about": about})  # fmt: skip
        if drawn := loops_figure(estimator, data, motions[0], way):
            loops.picture(picture_link(drawn[0]), f"{motions[0].name}; {drawn[1]}")
    except (*CANNOT, OSError) as error:
        content["why_no_charts"] = arguments.reason(ValueError(str(error)))
    print_all_errors(signals, STORED | metrics)
    sections = {
        "Errors": signals, "Loops": loops, "Modes": _modes(estimator, metrics),
        "Elements": _elements(estimator, metrics), "Drifts": _drifts(metrics),
        "Does the residual show that something is missing?": _residual(metrics),
        "Trained range": _trained(metrics),
    }  # fmt: skip
    content["sections"] = [
        {"title": title, "blocks": own.blocks} for title, own in sections.items() if own.blocks
    ]
    content["downloads"] = downloads + _sources(run.folder)
    return content


def _motions(run: StoredRun, estimator: Estimator, way: str, plain: str | None) -> Any:
    """Test motions with estimates, and their data. Raises ValueError where the record is gone."""
    gone = record_gone(run.experiment)
    if gone is not None:
        raise ValueError(f"the record {gone.name} is missing; put it back to see the time history")
    data = run.experiment.make_data()
    data.setup()
    return motions_of(run, estimator, data, way, plain), data


def _channels(run: StoredRun) -> list[str]:
    """Names of what is estimated, with those of the columns that they came from."""
    letter = {"acceleration": "a", "velocity": "v", "displacement": "x", "force": "r"}
    symbols = [f"{letter.get(run.sensors.quantity, 'y')}{i + 1}" for i in range(run.sensors.dofs)]
    columns = _columns(run)
    return [f"{s} ({columns[s]})" if s in columns else s for s in symbols]


def _columns(run: StoredRun) -> Mapping[str, Any]:
    """{channel: column} where the run's config names columns."""
    stated = run.experiment.data.values.get("channels")
    return stated if isinstance(stated, Mapping) else {}


def _labels(way: str, plain: str | None) -> dict[str, str]:
    how = "free run" if way == "free run" else "one step ahead"
    return {"own": f"model, {how}", "plain": f"{plain or ''}, the best plain model"}


def _inputs_and_outputs(run: StoredRun, estimator: Estimator) -> list[dict[str, str]]:
    """Channels of a run without a search: what each is, in which unit."""
    columns, known = _columns(run), run.sensors.units
    driven = Interface.of(estimator, run.sensors).channels
    own = [name.partition(" ")[0] for name in _channels(run)]
    units = dict.fromkeys(own, QUANTITIES[run.sensors.quantity][1])
    units |= {name: "N" for name in driven if name[0] == "f"}
    listed = [*driven, *(c for c in run.sensors.channels if c not in (*driven, *own)), *own]
    return [
        {"channel": name, "column": str(columns.get(name, "")),
         "unit": known.get(name) or units.get(name, ""),
         "why": "estimated" if name in own else "drives" if name in driven else "read"}
        for name in listed
    ]  # fmt: skip


def _not_for(grade: Mapping[str, Any], run: StoredRun, estimator: Estimator) -> list[str]:
    """What the model must not be used for, the weightiest first."""
    if grade["grade"] == NOTHING:
        return ["Any conclusion about the structure."]
    found = []
    if grade["grade"] == ONE_STEP:
        found.append("Simulation: other loads, earthquakes, design.")
    trained = run.metrics.get("trained_range", {})
    kinds = [k for k in ("deformation", "displacement", run.sensors.quantity) if k in trained][:1]
    for kind in [*kinds, *({"excitation"} & trained.keys())]:
        own = trained[kind]
        pairs = list(zip(own["names"], own["largest"], strict=False))
        sizes = ", ".join(
            f"{number(v, 3)} {own['unit']}".strip() + f" ({n})" for n, v in pairs[:NAMED]
        )
        more = f" and {len(pairs) - NAMED} more" if len(pairs) > NAMED else ""
        word = {"excitation": "Excitation"}.get(kind, kind.capitalize())
        found.append(f"{word} beyond that of training: {sizes}{more}.")
    driven = Interface.of(estimator, run.sensors).channels
    if len(driven) and grade["grade"] == SIMULATES:
        more = ", …" if len(driven) > NAMED else ""
        found.append(f"Loads other than {', '.join(driven[:NAMED])}{more}.")
    if estimator.scale_is_open:
        found.append("Masses and forces in kg and N: they are known up to a common factor.")
    return found


def _command(run: StoredRun) -> str:
    try:
        return command_of(run.values)
    except ValueError:
        return ""


def _print_fit(
    console: Blocks, motions: Sequence[Any], names: Sequence[str], metrics: Mapping[str, Any],
    way: str, plain: str | None,
) -> None:  # fmt: skip
    """Per channel: error in percent and in its unit, MATLAB's fit, that of the best plain model."""
    parts = [slice(m.record.warmup, None) for m in motions]
    measured = [m.measured[part] for m, part in zip(motions, parts, strict=True)]
    fits = [fit_percent(measured, [m.own[p] for m, p in zip(motions, parts, strict=True)])]
    if plain is not None and all(m.plain is not None for m in motions):
        fits.append(
            fit_percent(measured, [m.plain[p] for m, p in zip(motions, parts, strict=True)])
        )
    scores = metrics.get(FREE_RUNS["test"] if way == "free run" else "test", {})
    unit = QUANTITIES[metrics.get("quantity", "acceleration")][1]
    nothing = [None] * len(names)
    head = ["channel", "error [%]", f"RMS error [{unit}]", "fit [%]", f"fit of {plain} [%]"]
    columns = [
        scores.get("per_dof_percent") or nothing,
        scores.get("per_dof_rms") or nothing,
        *fits,
    ]
    rows = [
        [name, *("–" if v is None or not math.isfinite(v) else number(v, 3) for v in values)]
        for name, *values in zip(names, *columns, strict=True)
    ]
    console.print(_listed(head[: 1 + len(columns)], rows, "unseen motion, by channel"))
    console.print("fit: 100 (1 − ‖y − ŷ‖ / ‖y − mean y‖), MATLAB's compare(); 100 is perfect")


def _modes(estimator: Estimator, metrics: Mapping[str, Any]) -> Blocks:
    console, modes = Blocks(), modes_of(estimator)
    if modes is not None:
        print_modes(console, modes)
        if len(modes.frequencies):
            figure = draw_modes(modes, f"small motions of {metrics['model']}")
            console.picture(
                picture_link(figure), "shapes of the modes; the table has their numbers"
            )
    return console


def _elements(estimator: Estimator, metrics: Mapping[str, Any]) -> Blocks:
    """With intervals where there are some."""
    console, parameters = Blocks(), estimator.physical_parameters()
    sure = metrics.get("uncertainty", {})
    if headline(sure):
        print_intervals(console, sure)
        print_rest(console, parameters, metrics.get("trained_range", {}))
    else:
        print_parameters(console, parameters, estimator, metrics)
    return console


def _drifts(metrics: Mapping[str, Any]) -> Blocks:
    console = Blocks()
    print_drifts(console, metrics.get("uncertainty", {}))
    return console


def _residual(metrics: Mapping[str, Any]) -> Blocks:
    """What the tests of the residual find, and how wide the bands are."""
    console, sure = Blocks(), metrics.get("uncertainty", {})
    found = list(sentences(sure))
    for line in found:
        console.print(Text(line, style="yellow"))
    if not found and "criticism" in sure:
        console.print("the tests find nothing: what is left looks like noise")
    if "uncertainty" in metrics:
        print_bands(console, metrics)
    return console


def _trained(metrics: Mapping[str, Any]) -> Blocks:
    """The largest of all that moved in training, and where the test motion was larger."""
    console = Blocks()
    rows = []
    for kind, own in metrics.get("trained_range", {}).items():
        low = own.get("lowest", [None] * len(own["largest"])) if kind == OTHER else None
        for i, (name, value) in enumerate(zip(own["names"], own["largest"], strict=False)):
            text = number(value) if low is None else f"{number(low[i] or 0.0)} to {number(value)}"
            rows.append([kind, name, text, own["unit"]])
    if rows:
        console.print(_listed(("quantity", "channel", "largest", "unit"), rows))
    for line in warnings_of(metrics.get("outside_trained_range", [])):
        console.print(Text(f"test motion {line}", style="yellow"))
    if "escaped" in metrics and "simulation_error" in metrics:
        print_limits(console, {**metrics, "outside_trained_range": []})
    return console


def _sources(folder: Path) -> list[dict[str, str]]:
    """C of the model, file by file; nothing of a model that has none or is too large."""
    with tempfile.TemporaryDirectory() as aside:
        try:
            files = importlib.import_module("export.c").write(read_exported(folder), Path(aside))
        except CANNOT:
            return []
        texts = {path.name: path.read_text("utf-8") for path in files}
    if sum(map(len, texts.values())) > SOURCE_BYTES:
        return []
    return [
        {"name": name, "href": _link(text), "about": "the model in C99"}
        for name, text in texts.items()
    ]
