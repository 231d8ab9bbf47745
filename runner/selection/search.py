"""From files to the model that fits them best: inspect, fit side by side, choose, test, write."""

from __future__ import annotations

import math
import re
import shlex
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import OmegaConf

from data.annotations import shown
from data.inspect.command import advice_on_floors, floors_without_sensor, for_hydra
from data.inspect.inspection import Inspection, step_of
from data.inspect.proposal import OPTION, Proposal, proposal
from data.measured.channels import signal_of
from data.measured.plausible import REVERSED
from data.measured.signal_faults import OFFSET
from data.public.benchmarks import benchmark_in
from models.fit.held_back import HELD_BACK
from runner.config.compose import composed, keys_of
from runner.folder.lock import hold, release
from runner.folder.run_folder import write_json
from runner.scores.grade import BY_FREE_RUN, NOTHING, SIMULATES
from runner.selection.candidates import Candidate, candidates
from runner.selection.fits import Fits, Job
from runner.selection.identified import (
    MODELS,
    NAME,
    PAGE,
    Identified,
    choose,
    leaves_noise,
    lines_of,
    outcome_of,
)

READER = ("skip_rows", "delimiter", "decimal", "group", "header", "align")
BUDGET = 300.0  # s
PAGE_TAKES = 5.0  # s
NO_TIME, SPENT, INTERRUPTED = "no time was left", "the budget was spent", "interrupted"
QUESTIONS = 3  # shown at a time: the rest follows once these are answered
OF_MODELS = ("model.", "objective.", "solver.", "model/")


class Watch:
    """Who follows a selection: a terminal shows what these are called with, a notebook nothing."""

    def understood(self, about: Mapping[str, Any]) -> None:
        """The record, as identify.json has it, before anything is fitted."""

    def running(self, seconds: Mapping[str, tuple[float, Path]], left: float) -> None:
        """The seconds that each model's run has taken, its folder; the seconds that are left."""

    def ended(self, outcome: Mapping[str, Any]) -> None:
        """A model's run ended."""


@dataclass
class Asked:
    """What a person said: files, settings of data, settings of models."""

    paths: list[str]
    words: list[str] = field(default_factory=list)
    config: Path | None = None  # a config of data, in a folder data/

    @property
    def data(self) -> list[str]:
        """Words about the record."""
        return [word for word in self.words if not word.startswith((*OF_MODELS, "model="))]

    @property
    def base(self) -> list[str]:
        """The words that choose the data's config."""
        if self.config is None:
            return []
        folder = self.config.resolve().parent.parent
        return [f"hydra.searchpath=[file://{folder}]", f"data={self.config.stem}"]

    def of(self, candidate: Candidate) -> list[str]:
        """Words about models that this one understands."""
        wanted = [word for word in self.words if word.startswith(OF_MODELS)]
        own = [word for word in candidate.words if not word.startswith("data.")]
        known = keys_of("train", *own) if wanted else []
        return [word for word in wanted if word.partition("=")[0].replace("/", ".") in known]


def identify_records(
    paths: str | Path | Sequence[str | Path],
    folder: str | Path | None = None,
    budget: float | None = BUDGET,
    words: Iterable[str] = (),
    processes: int | None = None,
    config: Path | None = None,
    watch: Watch | None = None,
    fits: Fits | None = None,
) -> Identified:
    """The model that fits records best, chosen on held-back motion and tested on the rest.

    paths: files, folders, archives, patterns. folder: where runs, identify.json and report.html go;
    None: a new one below runs/. budget [s]: of all of it. words: settings as typed, such as
    `data.units.a=g`, `model.masses=[2,2]`. processes: side by side; None: all cores; fits: such as
    were begun before. Where something is missing that only a person knows, nothing is fitted and
    the result has `questions`. Raises ValueError and FileError for files that cannot be read and
    settings that do not fit them.
    """
    begun, watch = time.monotonic(), watch or Watch()
    wanted = [paths] if isinstance(paths, str | Path) else paths
    asked = Asked([str(path) for path in wanted], list(words), config)
    folder = Path(folder or new_folder(asked.paths[0]))
    fits = fits or Fits(processes)
    try:
        about, data_words = _understood(asked)
        watch.understood(about)
        if about["questions"]:
            _hold(folder)
            return _written(folder, _unanswered(about), [], None, begun, budget)
        data_words += [f"data.validation={HELD_BACK}"]
        data = _data_of([*data_words, "model=linear_state_space"])
        about["record"]["split"] = _split(data)
        channels = list(data.sensors.channels)
        training = data.records["train"]
        states = "".join(s for s in "xv" if all(getattr(r, s) is not None for r in training))
        rates = any(r.s_dot is not None and bool(r.s_dot.any()) for r in training)
        tried = candidates(channels, data.dt, states, rates)
        outcomes = [_blank(one, asked) for one in tried]
        _require_understood(asked, outcomes)
        fixed = [*data_words, "figures=false"]
        jobs = [
            Job(i, [*fixed, *own["words"]], str(folder / own["folder"]), one.quick, one.seldom)
            for i, (one, own) in enumerate(zip(tried, outcomes, strict=True))
        ]
        end = begun + (math.inf if budget is None else max(budget - PAGE_TAKES, 0.5 * budget))
        _hold(folder)
        _fit(fits, jobs, end, outcomes, watch, folder)
        return _written(folder, about, outcomes, data_words, begun, budget)
    finally:
        fits.close()
        release(folder)


def _hold(folder: Path) -> None:
    """Have a folder for all that is written, without the result of an earlier search.

    Raises ValueError where it cannot be, or is in use.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        hold(folder)
        for name in (NAME, PAGE):
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise ValueError(
            f"hydra.run.dir={shown(folder)} cannot be written: {error.strerror}; choose another"
        ) from None


def new_folder(record: str) -> str:
    """Where the result of a record goes if nobody says."""
    name = re.sub(r"\W+", "_", Path(record).stem)[:60]
    return f"runs/{datetime.now():%Y-%m-%d/%H-%M-%S}-identify-{name}"


def _understood(asked: Asked) -> tuple[dict[str, Any], list[str]]:
    """The record as identify.json has it, with its questions; the words that read it."""
    name = next((b for p in asked.paths if Path(p).is_dir() and (b := benchmark_in(Path(p)))), "")
    if name:
        folder = f"data.folder={for_hydra(asked.paths[0])}"
        words = ["data=benchmark", f"data.name={name}", folder, *asked.words]
        none = {"files": [], "split": "", "benchmark": name}
        return {"record": none, "questions": []}, words
    said = composed(*(asked.base or ["data=measured"]), *asked.data, "data.path=x").data
    values: Any = OmegaConf.to_container(said)
    units = {signal: unit for signal, unit in values["units"].items() if unit}
    reader = {key: values[key] for key in READER}
    with np.errstate(all="ignore"):  # absurd values show in the statistics
        found = proposal(asked.paths, values["channels"] or {}, units, **reader)
    answered = {word.partition("=")[0] for word in asked.data}

    def is_open(*texts: str) -> bool:
        """Whether no word answers one of the options that texts name."""
        options = {one.partition("=")[0] for text in texts for one in OPTION.findall(text)}
        return not answered & (options | {signal_of(option) for option in options})

    questions = [
        {"text": text, "option": option}
        for text, option in found.questions
        if is_open(option, text)
    ]
    read_in = found.settings.get("units", {}) | units
    files = [_file(one, found, read_in) for one in found.records]
    record = {"files": files, "left_out": found.left_out, "repairs": found.mends, "split": ""}
    about = {"record": record, "questions": questions[:QUESTIONS]}
    for file in files:
        file["findings"] = [f for f in file["findings"] if not f["blocks"] or is_open(f["text"])]
    own = [word for word in found.words[1:] if word.partition("=")[0] not in answered]
    words = [*(asked.base or ["data=measured"]), *own, *asked.data]
    run_in = [] if "data.run_in" in answered else ["data.run_in=true"]
    return about, [*words, *run_in]


def _file(record: Inspection, found: Proposal, units: Mapping[str, str]) -> dict[str, Any]:
    """A record as identify.json has it. units: that a person said, of channels or signals."""
    raw, channel_of = record.raw, {column: c for c, column in found.columns.items()}
    longest = max(raw.channels, key=lambda channel: len(raw.channels[channel]))
    dt = step_of(raw, longest) if raw.dt or raw.clocks or raw.time is not None else None
    samples = len(raw.channels[longest])
    columns = [
        {
            "channel": (own := name if name in found.columns else channel_of.get(name)),
            "column": found.columns.get(name, name),
            "unit": (own and (units.get(own) or units.get(signal_of(own))))
            or raw.units.get(name)
            or record.units.get(name),
            "why": found.why.get(own or "", ""),
        }
        for name in raw.channels
    ]
    faults = [
        {"what": f.what, "channel": f.channel, "text": f.message, "blocks": f.blocks}
        for f in record.findings
    ]
    if least := floors_without_sensor(found.columns):
        text = f"{least} at least, by the names; some floors have no sensor"
        text = "; ".join(filter(None, (text, advice_on_floors(found.columns))))
        faults.append({"what": "storeys", "channel": "", "text": text, "blocks": False})
    seconds = None if dt is None else dt * samples
    return {"name": raw.name, "samples": samples, "dt": dt, "seconds": seconds,
            "notes": list(raw.notes), "channels": columns, "findings": faults}  # fmt: skip


def _data_of(words: Sequence[str]) -> Any:
    """The records that every model is fitted to. Raises ValueError for what cannot be."""
    from models.experiment import Experiment
    from runner.config.choices import plain
    from runner.config.settings import check_files, check_settings

    cfg = composed(*words)
    check_settings(cfg)
    check_files(cfg)
    return Experiment.of(plain(cfg)).set_up_data()


def _split(data: Any) -> str:
    """Which motion trains, chooses and tests, in words."""

    def listed(split: str) -> str:
        names, records = data.names.get(split, []), data.records[split]
        seconds = sum((r.samples - r.warmup) * r.dt for r in records)
        shown = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
        return f"{shown or split}, {seconds:.4g} s"

    return (
        f"trained on {listed('train')}, the last fifth of its power chooses the model; "
        f"tested on {listed('test')}"
    )


def _blank(candidate: Candidate, asked: Asked) -> dict[str, Any]:
    words = [*candidate.words, *asked.of(candidate)]
    return {"name": candidate.name, "words": words, "folder": f"{MODELS}/{candidate.folder}",
            "status": "not tried", "reason": NO_TIME, "seconds": None}  # fmt: skip


def _require_understood(asked: Asked, outcomes: Sequence[Mapping[str, Any]]) -> None:
    """Raise ValueError for a word about models that none of them has, or that chooses one."""
    taken = {word for one in outcomes for word in one["words"]}
    names = ", ".join(one["name"] for one in outcomes)
    for word in asked.words:
        one = word.startswith(("model=", "model.laws=", "model/laws="))
        what = " is one model of several" if one else " is a setting of none of the models"
        if one or (word.startswith(OF_MODELS) and word not in taken):
            raise ValueError(
                f"{word}{what} that are tried ({names}); leave it out, or train one model with "
                "train.py"
            )


def _fit(
    fits: Fits,
    jobs: Sequence[Job],
    end: float,
    outcomes: list[dict[str, Any]],
    watch: Watch,
    folder: Path,
) -> None:
    """Fit all candidates until the time `end`, or Ctrl-C; what comes of them into `outcomes`."""
    settled: list[str] = []  # models that leave nothing but noise

    def is_wanted(number: int) -> bool:
        if settled:
            outcomes[number]["reason"] = f"{settled[0]} leaves nothing but noise"
        return not settled

    try:
        for look in fits.run(jobs, end, is_wanted):
            for number in look.begun:
                outcomes[number] |= {"status": "given up", "reason": SPENT}
            for number, result in look.ended.items():
                one = outcomes[number]
                one["seconds"] = result["seconds"]
                if "metrics" in result:
                    one |= {"status": "fitted"} | outcome_of(result["metrics"])
                    settled.extend([one["name"]] if leaves_noise(one) else [])
                else:
                    one |= {"status": "failed", "reason": result["failed"]}
                watch.ended(one)
            running = [(outcomes[number], seconds) for number, seconds in look.running.items()]
            places = {one["name"]: (seconds, folder / one["folder"]) for one, seconds in running}
            watch.running(places, end - time.monotonic())
    except KeyboardInterrupt:
        for one in outcomes:
            if one["status"] in ("given up", "not tried"):
                one["reason"] = INTERRUPTED


def _unanswered(about: dict[str, Any]) -> dict[str, Any]:
    options = ", ".join(question["option"] for question in about["questions"])
    reason = f"nothing was fitted, for the record does not tell enough; say {options}"
    return about | {"verdict": {"grade": NOTHING, "reason": reason, "advice": []}}


def _written(
    folder: Path,
    about: dict[str, Any],
    outcomes: list[dict[str, Any]],
    data_words: Sequence[str] | None,
    begun: float,
    budget: float | None,
) -> Identified:
    """The result, and its files."""
    chosen = choose(outcomes)
    verdict = about.pop("verdict", None) or _verdict(outcomes, chosen)
    if verdict["grade"] != SIMULATES and not about["questions"]:
        verdict["advice"] = [*_doubts(about["record"]["files"]), *_others(outcomes, verdict)]
    command = None
    if chosen is not None and data_words is not None:
        command = f"python train.py {shlex.join([*data_words, *outcomes[chosen]['words']])}"
    cut = any(one["reason"] == INTERRUPTED for one in outcomes)
    ended = INTERRUPTED if cut else "ended by the budget"
    names = {
        what: [one["name"] for one in outcomes if one["status"] == status]
        for what, status in (("not tried", "not tried"), (ended, "given up"))
    }
    left = [f"{what}: {'; '.join(some)}" for what, some in names.items() if some]
    others = f" ({', '.join(left)})" if left else ""
    lines = lines_of(verdict, None if chosen is None else outcomes[chosen], others)
    for question in about["questions"]:
        lines += [f"missing: {question['option']}", f"  {question['text']}"]
    found = {
        "version": 1, **about, "candidates": outcomes, "chosen": chosen, "command": command,
        "budget_seconds": budget, "seconds": time.monotonic() - begun, "verdict": verdict,
        "lines": lines,
    }  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / NAME, found)
    return Identified(folder, found)


def _doubts(files: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Faults of channels in use that were neither repaired nor asked about."""
    found: dict[str, list[str]] = {}
    for file in files:
        used = {c[key] for c in file["channels"] if c["channel"] for key in ("channel", "column")}
        for fault in file["findings"]:
            channels = [c for c in fault["channel"].split(", ") if c in used]
            if channels and not fault["blocks"] and fault["what"] not in (OFFSET, REVERSED):
                found.setdefault(fault["what"], []).extend(channels)
    for what, channels in found.items():
        yield f"look at the {what} in {', '.join(dict.fromkeys(channels))}, see above"


def _others(outcomes: Sequence[Mapping[str, Any]], verdict: Mapping[str, Any]) -> Iterator[str]:
    """What else would help: time for models that had none; not a model that was tried."""
    if any(one["reason"] in (NO_TIME, SPENT) for one in outcomes):
        yield "more time: a larger budget="
    yield from (advice for advice in verdict["advice"] if advice != BY_FREE_RUN)


def _verdict(outcomes: Sequence[Mapping[str, Any]], chosen: int | None) -> dict[str, Any]:
    """The grade of the chosen model; where there is none, why."""
    if chosen is not None and outcomes[chosen].get("grade"):
        return dict(outcomes[chosen]["grade"])
    why = dict.fromkeys(one["reason"] for one in outcomes if one["status"] == "failed")
    reason = next(iter(why), "no model could be fitted in this time")
    return {"grade": NOTHING, "reason": reason, "advice": []}
