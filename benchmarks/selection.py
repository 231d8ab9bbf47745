"""Is the grade of identify.py right, and its choice? Records of known answers, as people have them.

    python -m benchmarks.selection                        # 210 records, a minute each on two cores
    python -m benchmarks.selection --quick                # one of each kind, nearly
    python -m benchmarks.selection --seed 5               # held back until the rules were settled
    python -m benchmarks.selection --write                # the records alone

The records are those of benchmarks/planted.py. Right is

- simulates, where a law was planted and strained to 2.5 to 6 times its yield point, noise up to
  10 %, where the structure is linear, or stayed so (its linear model simulates what is asked);
- what the truth says at 20 and 50 % of noise, for swapped floors and for wrong masses: `simulates`
  if the model chosen errs by less than the tolerance of its own grade on an event without noise
  that nobody saw, measured by the same channels (swapped floors still are a function of the
  excitation; wrong masses of a moving base may matter little), else not. Within a quarter of the
  tolerance either is right;
- not identified for white noise, and all but `simulates` for other channels that do not follow
  from the excitation, or only in training: these have a past, from which a step may be estimated.
  A channel that is left out does not count. Where no excitation is known, a question is right, too.

A refusal is right where `simulates` is wrong. Prints the grades by kind; what must never be; the
test error of the model chosen over that of the best candidate; and the records that went wrong. A
record in the output folder is not run again.
"""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import asdict, dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import planted
from benchmarks.planted import KINDS, SURE, Case, make
from benchmarks.table import show
from data.arguments import Parser
from models.fit.metrics import STILL
from runner.config.command_line import command_errors
from runner.folder.run_folder import write_json
from runner.scores.grade import ONE_STEP, SIMULATES

NONE, ASKED = "not identified", "asks or refuses"
GRADES = _, *FALSE = SIMULATES, ONE_STEP, NONE, ASKED
LEFT_OUT = "left out"
BY_TRUTH = (planted.LOUDER, planted.SWAPPED, planted.MASSES)
TRUE = (SURE, planted.LOUD, planted.LINEAR, planted.SMALL, *planted.TESTS)
UNRELATED = (planted.WHITE, planted.OTHER, planted.ELSEWHERE, planted.EARLIER)
CLOSE = 1.25  # of the tolerance, or its inverse: either grade is right


@dataclass
class Outcome(Case):
    """What came of it."""

    given: str = ""
    right: bool = False
    said: str = ""  # reason of the grade, or the question
    error: float | None = None  # percent, of test motions
    tolerance: float | None = None  # percent
    unseen: float | None = None  # percent, of the event without noise
    over_best: float | None = None  # test error, over that of the best candidate
    model: str = ""
    best: str = ""
    seconds: float = 0.0


def outcome(
    folder: Path, seed: int, i: int, budget: float, end: float, cores: int
) -> Outcome | None:
    """Case i, made and identified on so many cores unless it was; None after the instant `end`."""
    place = folder / f"{i:03d}"
    stored, written = place / "outcome.json", place / "run" / "identify.json"
    if stored.is_file():
        return Outcome(**json.loads(stored.read_text("utf-8")))
    if time.time() > end:
        return None

    from data.parallel import take_threads
    from runner.selection.search import identify_records

    take_threads(1)  # cases are side by side
    case = Outcome(**asdict(make(place, seed, i)))
    begin = time.monotonic()
    with redirect_stdout(StringIO()):
        try:
            if not written.is_file():
                records = sorted((place / "records").iterdir())
                identify_records(records, place / "run", budget, case.words, processes=cores)
            judge(case, place, json.loads(written.read_text("utf-8")))
        except ValueError as error:
            case.given, case.said = ASKED, str(error)
    case.seconds = round(time.monotonic() - begin, 1)
    case.right = case.given in right_of(case) or case.spoilt == LEFT_OUT
    write_json(stored, asdict(case))
    return case


def judge(case: Outcome, place: Path, found: Mapping[str, Any]) -> None:
    """What identify.json says, and the error of the model chosen on the fresh event."""
    from models.fit.metrics import FREE_RUNS
    from report.run.evaluation import evaluate
    from runner.config.settings import Conditions

    grade, chosen = found.get("verdict") or {}, found.get("chosen")
    asked = [question["text"] for question in found.get("questions") or []]
    case.given = grade.get("grade") or (ASKED if asked or chosen is None else NONE)
    case.said = "; ".join(asked) or grade.get("reason", "")
    case.error, case.tolerance = grade.get("error_percent"), grade.get("tolerance_percent")
    files = (found.get("record") or {}).get("files") or []
    used = {c["channel"] for file in files for c in file["channels"]}
    if case.spoilt and case.spoilt not in used:
        case.spoilt = LEFT_OUT
    if chosen is None:
        return
    own = found["candidates"][chosen]
    case.model = own["name"]
    rivals = {
        one["name"]: one["test_percent"]
        for one in found["candidates"]
        if one.get("test_percent") is not None and one.get("way") == own.get("way")
    }
    if own.get("test_percent") is not None and own["way"] == "free run":
        case.best = min(rivals, key=rivals.__getitem__)
        case.over_best = own["test_percent"] / max(rivals[case.best], 1e-9)
    fresh = Conditions(None, {"path": str(place / "fresh.csv")}, False)
    try:
        scores = evaluate(place / "run" / own["folder"], "fresh", fresh)["all_records"]
        case.unseen = scores[FREE_RUNS["test"]].get("relative_rms_percent")
    except (ValueError, RuntimeError) as error:
        case.said += f"; fresh: {error}"


def right_of(case: Outcome) -> Sequence[str]:
    """The grades that are right."""
    if case.kind not in BY_TRUTH:
        false = (NONE, ASKED) if case.kind == planted.WHITE else FALSE
        return (SIMULATES,) if case.kind in TRUE else false
    share = np.inf if case.unseen is None else case.unseen / (case.tolerance or STILL)
    return (SIMULATES,) if share < 1.0 / CLOSE else FALSE if share > CLOSE else GRADES


# Tables


def report(cases: Sequence[Outcome], wanted: int) -> None:
    """Print all tables."""
    print(f"\n{len(cases)} of {wanted} records")
    if not cases:
        return
    names = [name for name in KINDS if any(case.kind == name for case in cases)]
    head = ("record", "right", "simulates", "one step", "none", "asks")
    show("Grades", head, [row(name, cases) for name in (*names, "all")])
    foreign = [case for case in cases if case.kind in UNRELATED]
    sure = [case for case in cases if case.kind == SURE]
    print(f"\nsimulated though unrelated: {sum(c.given == SIMULATES for c in foreign)}"
          f" of {len(foreign)}; planted, noise up to 2 %, and not identified or refused: "
          f"{sum(c.given in (NONE, ASKED) for c in sure)} of {len(sure)}")  # fmt: skip
    rows = []
    for name in (*names, "all"):
        over = [c.over_best for c in cases if c.over_best and c.kind in TRUE and _is(c, name)]
        if over:
            rows.append((name, len(over), *(f"{np.quantile(over, q):.2f}" for q in (0.5, 0.9, 1))))
    columns = ("record", "records", "median", "90 %", "most")
    show("Test error of a simulator chosen, over that of the best candidate", columns, rows)
    print("\nwrong")
    for case in cases:
        if not case.right:
            errors = [f"{e:.3g}" if e is not None else "–" for e in (case.error, case.unseen)]
            print(f"{case.number:03d} {case.kind}: {case.law}, {case.dofs} DOF, {case.drive}, "
                  f"{case.measured}, {case.files} files, noise {case.noise:g} %: {case.given} by "
                  f"{case.model or 'none'}, {errors[0]} % (unseen {errors[1]}, best {case.best}). "
                  f"{case.said[:200]}")  # fmt: skip


def _is(case: Outcome, name: str) -> bool:
    return name in (case.kind, "all")


def row(name: str, cases: Sequence[Outcome]) -> tuple[object, ...]:
    some = [case for case in cases if _is(case, name)]
    given, right = Counter(case.given for case in some), sum(case.right for case in some)
    return name, f"{right}/{len(some)}", *(given[grade] for grade in GRADES)


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", type=int, default=210)
    parser.add_argument("--quick", action="store_true", help="42 records")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--seed", type=int, default=0, help="0 served the development")
    parser.add_argument("--budget", type=float, default=60.0, help="seconds of each")
    parser.add_argument("--cores", type=int, default=2, help="of each")
    parser.add_argument("--processes", type=int, default=1, help="records side by side")
    parser.add_argument("--limit", type=float, default=np.inf, help="seconds; none begins later")
    parser.add_argument("--output", type=Path, default=Path("runs/selection"))
    parser.add_argument("--write", action="store_true", help="the records, and nothing more")
    options = parser.parse_args()
    folder = options.output / f"seed{options.seed}"
    count = 42 if options.quick else options.cases
    numbers = range(options.first, options.first + count)
    if options.write:
        for i in numbers:
            print(f"{i:03d}", make(folder / f"{i:03d}", options.seed, i), flush=True)
        return
    from joblib import Parallel, delayed

    folder.mkdir(parents=True, exist_ok=True)

    end = time.time() + options.limit
    pool = Parallel(options.processes, return_as="generator_unordered")
    each = delayed(outcome)
    work = (each(folder, options.seed, i, options.budget, end, options.cores) for i in numbers)
    done: list[Outcome] = []
    try:
        for case in pool(work):
            if case is not None:
                done.append(case)
                mark = "" if case.right else " WRONG"
                print(f"{case.number:03d} {case.kind}, {case.law}: {case.given} by {case.model}, "
                      f"{case.seconds:g} s{mark}", flush=True)  # fmt: skip
    finally:
        done.sort(key=lambda case: case.number)
        write_json(folder / "outcomes.json", {"records": [asdict(case) for case in done]})
        report(done, len(numbers))


if __name__ == "__main__":
    with command_errors():
        main()
