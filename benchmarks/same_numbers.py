"""Do two checkouts of the project compute the same numbers, to the last digit?

    python -m benchmarks.same_numbers OLD_TREE                  # and this checkout
    python -m benchmarks.same_numbers OLD_TREE NEW_TREE --quick
    python -m benchmarks.same_numbers OLD_TREE --python-old OLD_TREE/.venv/bin/python

The same command lines run in both trees; every metrics.json is compared except times, `identity`
and `versions`. Prints a line for each run, and exits with 1 where a digit differs, a run is missing
or a command fails. Keys that the new tree alone writes are listed and are no difference.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from data.arguments import Parser
from models.stored.earlier_keys import todays_keys
from runner.config.command_line import command_errors

ROOT = Path(__file__).parent.parent
LEFT_OUT = ("fit_seconds", "identity", "versions")
MISSING = "(missing)"
SIMULATED = {  # name: the words of a command line
    "vwnn": ["model=vwnn", "system=bilinear"],
    "table3": ["-m", "experiment=table3", "seed=0,1"],
    "element_network": ["model=element_network", "system=bouc_wen"],
    "online_vwnn": ["model=online_vwnn"],
}
SECONDS = 10  # of simulated motion with --quick
SAMPLES, QUICK_SAMPLES = 4000, 1000  # of the measured record


def commands(record: Path, quick: bool) -> dict[str, list[str]]:
    """The words of every command line, by name; `record` is the file of the measured one."""
    shorter = [f"data.duration={SECONDS}"] if quick else []
    simulated = {name: [*words, *shorter] for name, words in SIMULATED.items()}
    return simulated | {"measured": ["data=measured", f"data.path={record}", "model=vwnn"]}


def write_record(path: Path, samples: int) -> None:
    """A hardening oscillator, ẍ = (f − c ẋ − k x − k₃ x³) / m, as CSV: time [s], f1 [N], a1 [m/s²].

    By the semi-implicit Euler rule in plain Python, so that neither tree has a part in the record.
    """
    m, c, k, k3, dt = 1.0, 0.8, 60.0, 4000.0, 0.01
    x = v = 0.0
    lines = ["time,f1,a1"]
    for step in range(samples):
        t = step * dt
        f = sum(math.sin(w * t + w * w) for w in (2.1, 4.7, 7.9, 11.3, 17.7))
        a = (f - c * v - k * x - k3 * x**3) / m
        lines.append(f"{t:.2f},{f!r},{a!r}")
        v += dt * a
        x += dt * v
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def run_in(tree: Path, python: Path, words: list[str], folder: Path) -> str | None:
    """Run train.py of a tree with its results in `folder`; the last line printed if it fails."""
    kind = "sweep" if "-m" in words else "run"
    command = [str(python), "train.py", *words, f"hydra.{kind}.dir={folder}"]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        command, cwd=tree, env=environment, capture_output=True, text=True, check=False
    )
    return (done.stderr.strip() or "no message").splitlines()[-1] if done.returncode else None


def results(folder: Path) -> dict[str, Any]:
    """{run: content of its metrics.json, numbers as they are written} below a folder.

    A run of a sweep is named without the hash of its choices, which differs from tree to tree.
    Raises ValueError where two runs have one name then.
    """
    by_run: dict[str, Any] = {}
    for path in sorted(folder.rglob("metrics.json")):
        name = "" if path.parent == folder else path.parent.name.rpartition("-")[0]
        if name in by_run:
            raise ValueError(
                f"{folder} holds several runs {name}; vary model, system or seed alone"
            )
        content = json.loads(path.read_text("utf-8"), parse_float=str, parse_int=str)
        by_run[name] = todays_keys(content)
    return by_run


def differences(old: Any, new: Any, key: str = "") -> Iterator[tuple[str, Any, Any]]:
    """(dotted key, old value, new value) of all that differs; MISSING for no value."""
    if isinstance(old, dict) and isinstance(new, dict):
        for name in (name for name in {**old, **new} if name not in LEFT_OUT):
            inner = f"{key}.{name}" if key else name
            yield from differences(old.get(name, MISSING), new.get(name, MISSING), inner)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for place, pair in enumerate(zip(old, new, strict=True)):
            yield from differences(*pair, f"{key}[{place}]")
    elif old != new:
        yield key, old, new


def compared(old: Any, new: Any) -> tuple[bool, str]:
    """Whether two contents of metrics.json hold the same numbers, and a line that says so."""
    every = list(differences(old, new))
    added = [key for key, before, _ in every if before == MISSING]
    changed = [difference for difference in every if difference[0] not in added]
    news = f"; in the new tree alone: {', '.join(added)}" if added else ""
    if not changed:
        return True, f"identical{news}"
    key, before, after = changed[0]
    more = f" and {len(changed) - 1} more" if len(changed) > 1 else ""
    return False, f"differs in {key}: {before} before, {after} now{more}{news}"


def compare_trees(trees: dict[Path, Path], quick: bool, work: Path) -> bool:
    """Run all commands in both trees {tree: its interpreter}, the old tree first; whether equal."""
    record, equal = work / "record.csv", True
    write_record(record, QUICK_SAMPLES if quick else SAMPLES)
    for name, words in commands(record, quick).items():
        print(f"train.py {' '.join(words)}", flush=True)
        folders = [work / side / name for side in ("old", "new")]
        for folder, (tree, python) in zip(folders, trees.items(), strict=True):
            reason = run_in(tree, python, words, folder)
            if reason is not None:
                equal = False
                print(f"  failed in {tree}: {reason}")
        old, new = map(results, folders)
        for run in sorted({**old, **new}):
            if run in old and run in new:
                same, line = compared(old[run], new[run])
            else:
                same, line = False, f"no result in the {'old' if run in new else 'new'} tree"
            equal = equal and same
            print(f"  {run or name}: {line}", flush=True)
    return equal


def two_trees(parser: Parser) -> tuple[Namespace, dict[Path, Path]]:
    """Options of a command line, and the two checkouts that it names {tree: its interpreter}."""
    parser.add_argument("old", type=Path, metavar="OLD_TREE")
    parser.add_argument("new", type=Path, metavar="NEW_TREE", nargs="?", default=ROOT)
    for side in ("old", "new"):
        parser.add_argument(f"--python-{side}", type=Path, default=Path(sys.executable))
    options = parser.parse_args()
    trees = [tree.resolve() for tree in (options.old, options.new)]
    if trees[0] == trees[1] or not all((tree / "train.py").is_file() for tree in trees):
        parser.error(f"{trees[0]} and {trees[1]} must be two checkouts of the project")
    pythons = (options.python_old.absolute(), options.python_new.absolute())
    return options, dict(zip(trees, pythons, strict=True))


def main() -> int:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="short records")
    options, trees = two_trees(parser)
    with tempfile.TemporaryDirectory(prefix="same_numbers") as work:
        equal = compare_trees(trees, options.quick, Path(work))
    print("identical" if equal else "not identical")
    return int(not equal)


if __name__ == "__main__":
    with command_errors():
        sys.exit(main())
