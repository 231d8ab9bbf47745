"""A finished run becomes an entry of the zoo; nothing that is published is ever written again."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from jinja2 import Template

from data.plain_data import read_yaml
from data.record import Record
from data.whole_file import digest_of, write_text
from models.estimator import Estimator, NoFreeRunError, simulate
from models.fit.metrics import LEFT, left_at
from models.fit.trained_range import loops_of
from models.stored.run import StoredRun, read_run
from models.zoo.golden import golden_of
from models.zoo.index import FORMAT, INDEX, NAME, ROOT, Entry, entries
from report.about import colour_of, prior_knowledge
from report.output import markdown
from report.zoo.card import Card, Licence, over_seeds, tested
from runner.config.choices import dotted, plain
from runner.config.compose import CONF, composed, word_of
from runner.config.identity import INERT, with_class_of_laws
from runner.folder.run import restore

TRAINING = ("solver", "iterations", "stopped")  # what is kept of it; stages are a log


def publish(
    folder: Path, name: str | None, licence: Licence, command: str | None = None, root: Path = ROOT
) -> str:
    """Add a finished run to the zoo; returns the name MODEL/SYSTEM.vN that it got.

    Without a version the next free one is taken. command: of train.py, which makes the run again;
    None: found from its config. Raises ValueError for a folder without a finished run, a model that
    identified nothing, a version that is published, weights that are, and measured records without
    a licence.
    """
    run = read_run(folder)
    verdict, experiment = run.metrics.get("verdict", {}), run.experiment
    if verdict.get("identified") is False:
        raise ValueError(f"{folder} identified nothing: {verdict['reason']}")
    if not experiment.simulated and licence.data == Licence.data:
        raise ValueError(f"{folder} is of measured records: say data_licence=… and source=…")
    full = _versioned(name or f"{experiment.model.name}/{experiment.system.name}", folder, root)
    values = entry_config(run.values)
    command = command or command_of(values)
    require_command(command, values)
    model = restore(run).requires_grad_(False)
    records = tested(experiment).records["test"]
    aside = root / full.replace(full.rpartition("/")[2], f".part-{os.getpid()}")
    aside.mkdir(parents=True)
    try:
        _write(aside, full, run, values, model, records, licence, command)
        aside.rename(root / full)
    except BaseException:
        shutil.rmtree(aside, ignore_errors=True)
        raise
    write_index(root, {full: facts_of(root / full, licence)})
    return full


def _versioned(name: str, run: Path, root: Path) -> str:
    """The name with a version that is free."""
    plain = f"{name}.v1" if ".v" not in name else name
    if not NAME.fullmatch(plain):
        raise ValueError(f"{name}: expected MODEL/SYSTEM or MODEL/SYSTEM.vN, in letters and digits")
    known = {entry.name: entry for entry in entries(root)}
    if ".v" in name:
        if name in known or (root / name).exists():
            raise ValueError(f"{name} is published, and never changes; leave the version out")
        return name
    same = [entry for entry in known.values() if f"{entry.model}/{entry.system}" == name]
    own = digest_of(run / "model.safetensors")
    for entry in same:
        if entry.facts["files"]["model.safetensors"]["sha256"] == own:
            raise ValueError(f"{entry.name} has these weights; there is nothing new to publish")
    return f"{name}.v{max((entry.version for entry in same), default=0) + 1}"


def _write(
    folder: Path,
    name: str,
    run: StoredRun,
    values: dict[str, Any],
    model: Estimator,
    records: list[Record],
    licence: Licence,
    command: str,
) -> None:
    """All files of an entry."""
    shutil.copyfile(run.folder / "model.safetensors", folder / "model.safetensors")
    text = yaml.safe_dump(
        values, sort_keys=False, allow_unicode=True, width=1000, default_flow_style=None
    )
    if read_yaml(text) != values:
        raise ValueError(f"the config of {name} cannot be read back as it would be written")
    (folder / "config.yaml").write_text(text, encoding="utf-8")
    experiment, metrics = run.experiment, run.metrics
    kept = {key: value for key, value in metrics.items() if value not in ({}, [])}
    kept["training"] = {k: v for k, v in metrics.get("training", {}).items() if k in TRAINING}
    if experiment.simulated:
        kept["over_seeds"] = over_seeds(model, experiment)
    kept = without_folders(kept, folders_of(run.values))
    write_compact(folder / "metrics.json", kept)
    write_compact(folder / "sensors.json", vars(run.sensors))
    record = records[0]
    bound = LEFT * float(record.a.abs().max()) / 10.0
    golden = golden_of(model, record.excitation, record.hold, bound)
    np.savez_compressed(folder / "golden.npz", allow_pickle=False, **golden)
    picture = picture_of(model, record, colour_of(experiment.model.name))
    (folder / "picture.svg").write_text(picture, encoding="utf-8")
    kind = type(model).__name__
    card = Card(name, experiment, kept, run.sensors, kind, licence, command, record)
    (folder / "card.md").write_text(card.text(), encoding="utf-8")


def write_compact(path: Path, content: Mapping[str, Any]) -> None:
    """JSON without spaces: an entry is small."""
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    write_text(path, text + "\n")


def facts_of(folder: Path, licence: Licence) -> dict[str, Any]:
    """What the index says of an entry."""
    metrics = json.loads((folder / "metrics.json").read_text("utf-8"))
    free = metrics["free_run"]
    free_percent = free.get("relative_rms_percent")
    return {
        "free_run_percent": "none" if "no_free_run" in free else free_percent or "diverges",
        "one_step_percent": metrics["test"]["relative_rms_percent"],
        "parameters": metrics["parameters"],
        "quantity": metrics["quantity"],
        "licence": licence.weights,
        "data_licence": licence.data,
        "files": {
            path.name: {"sha256": digest_of(path), "bytes": path.stat().st_size}
            for path in sorted(folder.iterdir())
        },
    }


def write_index(root: Path, new: Mapping[str, Any]) -> None:
    """The index with new entries added."""
    known = {entry.name: dict(entry.facts) for entry in entries(root)}
    found = dict(sorted((known | dict(new)).items()))
    models = dict.fromkeys(name.partition("/")[0] for name in found)
    content = {
        "format": FORMAT,
        "told": {model: " ".join(prior_knowledge(model).split()) for model in models},
        "entries": found,
    }
    write_compact(root / INDEX, content)


# picture.svg, a few kilobytes: the free run, the true motion, and a loop of an element.

WIDTH, HEIGHT, POINTS = 540, 180, 110
TOP = 21  # beneath the words
TRUE = "#222222"


@torch.no_grad()
def picture_of(model: Estimator, record: Record, colour: str) -> str:
    """SVG of one test record (T, ·): its last part, where a drift would show."""
    way, estimate = _estimate(model, record)
    part = slice(max(0, record.samples - 4 * POINTS), None)
    dof = int(record.a.abs().amax(dim=0).argmax())
    true, own = record.a[part, dof].numpy(), estimate[part, dof].numpy()
    loops = loops_of(model, record) if way == "free run" else None
    wide = WIDTH if loops is None else WIDTH - HEIGHT
    time = np.arange(len(true))
    box = (0, TOP, wide - 9, HEIGHT - TOP)
    curves = _lines(time, [true, own], [TRUE, colour], box)
    if loops is not None:
        y, r = (loop[part].numpy() for loop in loops)
        most = int((np.abs(np.diff(y, axis=0)) * np.abs(r[1:])).sum(axis=0).argmax())
        curves += _lines(y[:, most], [r[:, most]], [colour], (wide, TOP, HEIGHT, HEIGHT - TOP))
    caption = f"x{record.dof_numbers[dof]}, last {record.dt * len(true):.3g} s: measured, and {way}"
    texts = [_text(2, caption)]
    if loops is not None:
        texts.append(_text(wide, f"force of element {most + 1}"))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        f'width="{WIDTH}" fill="none"><rect width="100%" height="100%" fill="#fff"/>'
        f"{''.join((*texts, *curves))}</svg>\n"
    )


def _text(place: int, words: str) -> str:
    font = 'font-size="13" font-family="sans-serif"'
    return f'<text x="{place}" y="14" {font} fill="{TRUE}">{words}</text>'


def _estimate(model: Estimator, record: Record) -> tuple[str, torch.Tensor]:
    """The free run where it stays, else the estimate one step ahead."""
    try:
        a = simulate(model, record).a
        if not left_at(a, record):
            return "free run", a
    except NoFreeRunError:
        pass
    return "one step ahead (its free run diverges)", model(record.measured())


def _lines(
    x: np.ndarray, curves: Sequence[np.ndarray], colours: Sequence[str], box: Sequence[int]
) -> list[str]:
    """Polylines within a box (left, top, width, height), of some points each."""
    left, top, width, height = box
    low, high = min(c.min() for c in curves), max(c.max() for c in curves)
    kept = np.unique(np.linspace(0, len(x) - 1, POINTS).astype(int))
    across = left + 2 + (width - 4) * (x[kept] - x.min()) / max(np.ptp(x), 1e-300)
    drawn = []
    for curve, colour in zip(curves, colours, strict=True):
        down = top + 2 + (height - 4) * (high - curve[kept]) / max(high - low, 1e-300)
        drawn.append(f'<path d="{_path(across, down)}" stroke="{colour}"/>')
    return drawn


def _path(across: np.ndarray, down: np.ndarray) -> str:
    """Whole steps from point to point, which are short."""
    places = np.rint(np.stack([across, down], axis=1)).astype(int)
    steps = np.diff(places, axis=0)
    first = f"M{places[0, 0]} {places[0, 1]}l"
    return first + "".join(f"{x:+d}{y:+d}" for x, y in steps).replace("+", " ").strip()


# A run's config as an entry keeps it: without folders of a machine; and the command it is of.

RECORDS = "RECORDS"  # in place of the folder that holds the folders of measured records
ABSOLUTE = re.compile(r"""(?:^|[\s"'=:(,\[])(~?/[\w.-]+/|[A-Za-z]:\\|\.\./)""")
NO_NUMBER = (*INERT, "records", "threads")  # settings that a command need not say
TRIED = ("baselines", "solver", "objective", "scenario", "excitation", "damage")


def with_texts(values: Any, change: Callable[[str], str]) -> Any:
    """Plain values with each text changed."""
    if isinstance(values, dict):
        return {key: with_texts(value, change) for key, value in values.items()}
    if isinstance(values, list):
        return [with_texts(value, change) for value in values]
    return change(values) if isinstance(values, str) else values


def without_folders(values: Any, folders: Mapping[str, str]) -> Any:
    """The same with each of these folders replaced. Raises ValueError for a remaining path."""

    def scrubbed(text: str) -> str:
        for folder, word in folders.items():
            text = text.replace(folder, word)
        if ABSOLUTE.search(text):
            raise ValueError(f"{text!r} names a folder of this machine; say records=FOLDER")
        return text

    return with_texts(values, scrubbed)


def folders_of(values: Mapping[str, Any]) -> dict[str, str]:
    """{folder: word} of a run's records: RECORDS/name of the folder that held them."""
    named = [values.get("records"), values["data"].get("folder")]
    return {str(one): f"{RECORDS}/{Path(one).name}" for one in named if one}


def entry_config(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values of a run's config without folders and without what only a terminal sees."""
    content = deepcopy(dict(values)) | {"figures": False, "grid": None}
    content["model"].get("about", {}).pop("told", None)  # which conf/model has, and the card
    return without_folders(content, folders_of(values))


def with_records(values: Mapping[str, Any], records: Path) -> dict[str, Any]:
    """An entry's choices with its records where they are."""
    return with_texts(dict(values), lambda text: text.replace(RECORDS, str(records)))


def command_of(values: Mapping[str, Any]) -> str:
    """The command of train.py that gives these values.

    Raises ValueError where no choices of conf/ and settings do.
    """
    words = [f"model={values['model']['name']}", f"system={values['system']['name']}"]
    for group in TRIED:
        if any(key.startswith(f"{group}.") for key in _differing(words, values)):
            words = min(
                _with_choice(words, group), key=lambda tried: len(_differing(tried, values))
            )
    wanted = dotted(values)
    for key in _differing(words, values):
        if key not in wanted:
            raise ValueError(f"no command gives this config: {key} is not in it; say command=…")
        words += word_of(key, wanted[key])
    return " ".join(["python train.py", *words])


def require_command(command: str, values: Mapping[str, Any]) -> None:
    """Raise ValueError unless a command of train.py gives these values."""
    words = [word.strip("'\"") for word in command.removeprefix("python train.py ").split()]
    if left := _differing(words, values):
        raise ValueError(f"{command} gives other values of {', '.join(left[:5])}")


def _with_choice(words: list[str], group: str) -> Iterator[list[str]]:
    yield words
    for path in sorted((CONF / group).glob("*.yaml")):
        yield [*words, f"{group}={path.stem}"]


def _differing(words: list[str], values: Mapping[str, Any]) -> list[str]:
    """Dotted settings in which a command and these values differ, of those that change a number."""
    try:
        own, wanted = (
            dotted({**of, "model": with_class_of_laws(of["model"])})
            for of in (plain(composed(*words)), values)
        )
    except Exception:  # a choice that needs further settings
        return ["?"] * 1000
    keys = dict.fromkeys([*wanted, *own])
    return [
        key
        for key in keys
        if key.partition(".")[0] not in (*NO_NUMBER, "trainer")
        and own.get(key) != wanted.get(key)  # null where older code had no such setting
    ]


# docs/zoo.md: a gallery of what is published, from zoo/index.json alone.

TEMPLATE = Path(__file__).parent / "page.md"
PAGE = ROOT.parent / "docs" / "zoo.md"


def write_page() -> Path:
    """Write the page; returns where it is."""
    write_text(PAGE, page_of())
    return PAGE


def page_of() -> str:
    """The page's text."""
    found = entries(ROOT)
    systems = dict.fromkeys(entry.system for entry in found)
    facts = {
        "found": found,
        "kilobytes": sum(path.stat().st_size for path in ROOT.rglob("*") if path.is_file()) / 1e3,
        "systems": {s: sorted((e for e in found if e.system == s), key=_rank) for s in systems},
        "told": _prior_table(found),
        "number": lambda value: f"{value:.3g}" if isinstance(value, float) else str(value),
    }
    text = TEMPLATE.read_text("utf-8")
    return Template(text, trim_blocks=True, keep_trailing_newline=True).render(facts)


def _rank(entry: Entry) -> tuple[bool, float]:
    free = entry.facts["free_run_percent"]
    return isinstance(free, str), entry.facts["one_step_percent"] if isinstance(free, str) else free


def _prior_table(found: list[Entry]) -> str:
    """Prior knowledge of the structure, by kind of model."""
    known = {entry.model: " ".join(entry.told.split()) for entry in reversed(found)}
    rows: dict[str, list[str]] = {}
    for model in dict.fromkeys(entry.model for entry in found):
        rows.setdefault(known[model] or "–", []).append(f"`{model}`")
    cells = [(", ".join(models), told) for told, models in rows.items()]
    return markdown(("model", "given beforehand"), cells, None)
