"""Runs whose folder somebody tampered with: scored again, compared, reported, taken live."""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import shutil
import socket
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml

import evaluate
import train
from benchmarks.attack.attempt import EXECUTED, SECRET_NAME, Attempt, WronglyAcceptedError
from live.command_line import run_config
from live.model import stream_of_run
from report.collection.report import report_by, report_collection
from report.collection.runs import read_runs
from report.free_run.rows import leaderboard
from report.online.cases import read_online
from report.paper.cells import study_cells
from report.run.rescore import print_evaluation, require_scores, score_seeds
from report.tuning.cases import read_cases
from runner.command_line import one_line_errors
from runner.identity import EVERY_CLASS, code_version
from runner.job import job_errors
from runner.progress import is_finished, would_fail_again
from runner.run import restore
from runner.run_folder import read_run

QUICK = ("data.duration=2", "figures=false", "trainer.enable_progress_bar=false", "baselines=none")
RUNS = {
    "vwnn": ("model=vwnn", "model.order=1"),
    "online": ("model=online_vwnn",),
    "network": ("model=element_network", "solver.iterations=2"),
    "measured": ("data=measured", "data.path=record.csv", "model=vwnn", "model.order=1"),
}
FILES = ("config.yaml", "metrics.json", "sensors.json", "model.safetensors", "failed.json")
RUN = f"touch {EXECUTED}"
CREATE = f'${{oc.create:{{_target_:torch.utils.collect_env.run,command:"{RUN}"}}}}'
TEXTS = (
    *("", "x", "???", "null", "1e9", "../../x", "a.b", "a b", "\x1b[31mred", "\u202ex", "é" * 200),
    *(f"${{oc.env:{SECRET_NAME}}}", f"\\${{oc.env:{SECRET_NAME}}}", CREATE, f"\\{CREATE}"),
    *("${seed}", "${", "${a:${b}}", "\\\\${seed}", "${oc.decode:'[1,2]'}", "${hydra:runtime.cwd}"),
    *("${run_name:}", "${help:train}", "=cmd|'/c calc'!A1", "[red]x[/red]", "\ud800", "\x00", "\n"),
    *("data.MeasuredData", "models.VWNN", "data.Bilinear", "models.Frozen", "/dev/zero", "/"),
)
ODD: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2, 7, 0.5, -0.0, 1e-300, 1e308, float("nan"), float("inf")),
    *(10**9, 10**30, -(2**63), [], {}, [1], [None], [[[]]], {"a": {}}, {"": None}, [1.5, "x", {}]),
    *TEXTS,
    {"_target_": "os.system", "command": RUN},
    {"_target_": "torch.utils.collect_env.run", "command": RUN},
    {"_target_": "data.MeasuredData", "path": "/dev/zero"},
    {"_target_": "models.VWNN"},
    {"_partial_": True, "_target_": "models.MLP"},
)
BOMBS = (
    "a: &a [x,x,x,x,x,x,x,x,x]\n"
    + "".join(
        f"{c}: &{c} [{','.join(f'*{p}' for _ in range(9))}]\n" for p, c in pairwise("abcdefghi")
    ),
    "a: &a {k: v}\n"
    + "".join(
        f"{c}: &{c} {{<<: [{','.join(f'*{p}' for _ in range(9))}]}}\n"
        for p, c in pairwise("abcdefghi")
    ),
    "a: &a [*a]\n",
    "a: " + "[" * 50_000,
    "".join(f"{' ' * n}a:\n" for n in range(900)),
    "a: " + ":".join(["59"] * 200_000),
    "a: 0x" + "f" * 500_000,
    "a: " + "9" * 50_000,
    f"a: !!python/object/apply:os.system ['{RUN}']\n",
    "a: !!timestamp x\n",
    "a: !!binary x\n",
    "a: !!set {a, b}\n",
    "? [a]\n: b\n",
    "a: 1\na: 2\n",
    "a: 2020-01-01\n",
    "--- a\n--- b\n",
    "%YAML 9.9\n---\na: 1\n",
    "\tx: 1\n",
    "a: *nobody\n",
)
SLOW = ("whole", "compared")  # of USES


class Target:
    name = "run_folders"

    def __init__(self) -> None:
        code_version(EVERY_CLASS)  # the forks inherit what was read

    def prepare(self, folder: Path) -> None:
        """One finished run of each kind of RUNS, and a search."""
        os.chdir(folder)
        lines = [f"{0.01 * k:.2f},{k * k * 7919 % 13},{k * k * 104729 % 11}" for k in range(300)]
        Path("record.csv").write_text("\n".join(["time,f1,a1", *lines]), "utf-8")
        for name, words in RUNS.items():
            sys.argv = ["train.py", *(QUICK if name != "measured" else QUICK[1:])]
            sys.argv += [*words, f"hydra.run.dir={folder / name}"]
            with contextlib.redirect_stdout(io.StringIO()):
                train.cli()
            shutil.rmtree(folder / name / "tensorboard")
        reason = {
            "reason": "the fit failed",
            "own": True,
            "escaped": False,
            "code": "",
            "trace": "",
        }
        (folder / "vwnn" / "failed.json").write_text(json.dumps(reason), "utf-8")

    def attempt(self, draw: random.Random, folder: Path) -> Attempt:
        name, file = draw.choice(tuple(RUNS)), draw.choice(FILES)
        slow = draw.random() < 0.1
        use_name = draw.choice(SLOW if slow else [name for name in USES if name not in SLOW])
        use = USES[use_name]
        if file == "failed.json":
            name = "vwnn"
        what, mutate = mutation(draw, file)

        def act() -> None:
            place = Path("runs").absolute()
            for other in RUNS:
                if other == name or use_name not in ("score", "live", "whole", "altered"):
                    shutil.copytree(folder / other, place / other)
            shutil.copy(folder / "record.csv", ".")
            if file == "failed.json":
                (place / name / "metrics.json").unlink()
            mutate(place / name / file)
            sys.argv = ["evaluate.py"]
            use(place, place / name)

        return Attempt(f"{use_name} {name}/{file}: {what}", act)


def mutation(draw: random.Random, file: str) -> tuple[str, Callable[[Path], None]]:
    """A change of one file, in words and as a function of the file."""
    kinds = [_of_bytes, _of_kind]
    if not file.endswith("safetensors"):
        kinds += [_of_values] * 6 + [_of_syntax]
    return draw.choice(kinds)(draw)


def _of_bytes(draw: random.Random) -> tuple[str, Callable[[Path], None]]:
    where, bit, count = draw.random(), draw.randrange(8), draw.choice((1, 1, 1, 5, 200))
    kind = draw.choice(("flip", "cut", "insert", "repeat", "zero", "random"))

    def mutate(path: Path) -> None:
        content = bytearray(path.read_bytes())
        place = int(where * len(content))
        other = random.Random(place)
        if kind == "flip":
            for _ in range(count):
                content[place] ^= 1 << bit
                place = other.randrange(len(content))
        elif kind == "cut":
            del content[place:]
        elif kind == "insert":
            content[place:place] = bytes(other.randrange(256) for _ in range(count))
        elif kind == "repeat":
            content[place:place] = content[place : place + 50] * count
        elif kind == "zero":
            content[place : place + count] = bytes(count)
        else:
            content = bytearray(other.randbytes(len(content)))
        path.write_bytes(content)

    return f"{kind} {count} from {where:.3f}", mutate


def _of_kind(draw: random.Random) -> tuple[str, Callable[[Path], None]]:
    kinds = ("missing", "empty", "pipe", "folder", "loop", "device", "endless", "huge", "socket")
    kind = draw.choice((*kinds, "link", "nowhere"))

    def mutate(path: Path) -> None:
        kept = path.with_name("kept")
        path.rename(kept)
        if kind == "empty":
            path.touch()
        elif kind == "pipe":
            os.mkfifo(path)
        elif kind == "folder":
            path.mkdir()
        elif kind == "loop":
            path.symlink_to(path)
        elif kind in ("device", "endless", "nowhere"):
            targets = {"device": "/dev/null", "endless": "/dev/zero", "nowhere": "/nowhere"}
            path.symlink_to(targets[kind])
        elif kind == "huge":
            with path.open("wb") as file:
                file.truncate(2**40)
        elif kind == "socket":
            os.chdir(path.parent)
            socket.socket(socket.AF_UNIX).bind(path.name)
            os.chdir("../..")
        elif kind == "link":
            path.symlink_to(kept)

    return kind, mutate


def _of_syntax(draw: random.Random) -> tuple[str, Callable[[Path], None]]:
    text, at_end = draw.choice(BOMBS), draw.random() < 0.5
    deep = "[" * draw.choice((60, 999, 100_000))
    jsons = (deep, '{"a":' * 5000, "[]", "1", '"x"', "null", "NaN", '{"test": Infinity}', "{}{}")
    json_text = draw.choice((*jsons, "1e999", '{"a": "\\ud800"}', "9" * 5000, '{"a": 1e400}'))

    def mutate(path: Path) -> None:
        if path.suffix == ".json":
            path.write_text(json_text, "utf-8")
        else:
            kept = path.read_text("utf-8") if at_end else ""
            path.write_text(kept + text, "utf-8")

    return f"{text[:60]!r} or {json_text[:30]!r}", mutate


def _of_values(draw: random.Random) -> tuple[str, Callable[[Path], None]]:
    """A value, or several, of another type; a key that is gone, new, or another's."""
    changes = [
        (
            draw.random(),
            draw.choice(("set", "set", "set", "drop", "add", "rename", "swap", "scale")),
            draw.choice(ODD),
        )
        for _ in range(draw.choice((1, 1, 1, 2, 5)))
    ]

    def mutate(path: Path) -> None:
        text = path.read_text("utf-8")
        content = json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)
        for where, kind, value in changes:
            places = list(_places(content))
            if not places:
                break
            holder, key = places[int(where * len(places))]
            _change(holder, key, kind, value, places[int(where * 7919) % len(places)])
        with path.open("w", encoding="utf-8", errors="surrogatepass") as file:
            if path.suffix == ".json":
                json.dump(content, file)
            else:
                file.write(yaml.dump(content, sort_keys=False, allow_unicode=True))

    return "; ".join(
        f"{kind} at {where:.3f} {value!r:.80}" for where, kind, value in changes
    ), mutate


def _places(node: Any) -> list[tuple[Any, Any]]:
    keys = (
        list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ()
    )
    found = []
    for key in keys:
        found += [(node, key), *_places(node[key])]
    return found


def _change(holder: Any, key: Any, kind: str, value: Any, other: tuple[Any, Any]) -> None:
    with contextlib.suppress(KeyError, IndexError, TypeError):
        if kind == "set":
            holder[key] = value
        elif kind == "drop":
            del holder[key]
        elif kind == "add" and isinstance(holder, dict):
            holder[str(value)[:20]] = value
        elif kind == "rename" and isinstance(holder, dict):
            holder[f"{key}_"] = holder.pop(key)
        elif kind == "swap":
            holder[key] = json.loads(json.dumps(other[0][other[1]]))
        elif kind == "scale":
            holder[key] = holder[key] * 1000


def score(place: Path, run: Path) -> None:
    """What evaluate.py run= does, without its figures."""
    with one_line_errors("evaluate"), job_errors():
        cfg, metrics = read_run(run)
        estimator = restore(cfg, run)
        require_scores(metrics, estimator.dofs)
        print_evaluation(score_seeds(estimator, cfg, [cfg.seed], True), metrics, False)


def altered(place: Path, run: Path) -> None:
    with one_line_errors("evaluate"), job_errors():
        cfg, metrics = read_run(run)
        estimator = restore(cfg, run)
        require_scores(metrics, estimator.dofs)
        print_evaluation(score_seeds(estimator, cfg, [5, 6], False), metrics, True)


def whole(place: Path, run: Path) -> None:
    sys.argv = ["evaluate.py", f"run={run}"]
    evaluate.cli()


def table(place: Path, run: Path) -> None:
    with one_line_errors("evaluate"), job_errors():
        report_collection([place], Path("results"))
    if not Path("results/results.csv").is_file():
        raise WronglyAcceptedError("one damaged run, and no table of the others")


def compared(place: Path, run: Path) -> None:
    with one_line_errors("evaluate"), job_errors():
        report_by([place], ["model"], "relative_rms_percent", "test", Path("results"))


def reported(place: Path, run: Path) -> None:
    with one_line_errors("train"):
        runs = read_runs(place)
        study_cells(runs)
        leaderboard(runs)


def online(place: Path, run: Path) -> None:
    with one_line_errors("train"):
        read_online(place)


def live(place: Path, run: Path) -> None:
    with one_line_errors("train"):
        stream_of_run(run_config(run, ["seed=1"]), run, new_law=False)


def swept(place: Path, run: Path) -> None:
    is_finished(run)
    would_fail_again(run)


def searched(place: Path, run: Path) -> None:
    """The file's content as a search's, with runs that were tampered with."""
    with one_line_errors("train"):
        search: dict[str, Any] = {
            "case": ["model=vwnn", "system=bilinear"],
            "seeds": ["seed=0"],
            "best": {},
        }
        search |= {"first_percent": 1.0, "best_percent": 1.0}
        final = {"configured": [path.name for path in place.iterdir()], "tuned": [run.name]}
        content = {"vwnn bilinear": {**search, "final": final}}
        (place / "search.json").write_text(json.dumps(content), "utf-8")
        for case in read_cases([place]):
            print(case.errors("configured"), case.free_runs("tuned"), case.better)


USES: dict[str, Callable[[Path, Path], None]] = {
    "score": score,
    "altered": altered,
    "whole": whole,
    "table": table,
    "compared": compared,
    "reported": reported,
    "online": online,
    "live": live,
    "swept": swept,
    "searched": searched,
}
