"""Tables of the coverage study, and its page: page.md filled in, no number by hand."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median
from string import Template
from typing import Any

from benchmarks.coverage.cases import BANDS
from data.whole_file import write_text
from models.uncertainty.intervals import COMBINATION, DETERMINED, UNEXCITED

TEMPLATE = Path(__file__).with_name("page.md")
SHOWN = "shown"
WIDTHS = (SHOWN, "half", "white", "model_error")
NOTHING, STATUSES = "nothing", (UNEXCITED, COMBINATION, DETERMINED)
YIELD = "yield_displacement"
Result = dict[str, Any]


def write_page(page: Path, results: Sequence[Result]) -> None:
    write_text(page, Template(TEMPLATE.read_text("utf-8")).substitute(facts_of(results)))


def table_of(results: Sequence[Result]) -> str:
    return "\n\n".join(str(part) for part in facts_of(results).values())


def facts_of(results: Sequence[Result]) -> dict[str, str]:
    fine = [r for r in results if "failed" not in r]
    failed = Counter(r["kind"] for r in results if "failed" in r)
    chains = [r for r in fine if r["kind"] != "brace"]
    seconds = [r["seconds"] for r in fine] or [{"fit": 0.0, "after": 0.0}]
    return {
        "counts": ", ".join(f"{n} of {k}" for k, n in Counter(r["kind"] for r in fine).items()),
        "failed": ", ".join(f"{n} of {k}" for k, n in failed.items()) or "none",
        "coverage": "\n".join(coverage(chains)),
        "bands": "\n".join(of_bands(chains)),
        "excited": "\n".join(excited([r for r in chains if r["kind"] != "hardening"])),
        "missing": "\n".join(missing(fine)),
        "seconds": f"{median(s['fit'] for s in seconds):.1f} s of the processor a fit, "
        f"{median(s['after'] for s in seconds):.2f} s all of the above",
    }


def coverage(results: Sequence[Result]) -> Iterator[str]:
    """Share of 95 % intervals that hold the truth, by kind of noise and of parameter."""
    yield (
        "| noise | parameter | intervals | shown | noise alone | as if white | model error "
        "| half width |"
    )
    yield "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |"
    for kind in dict.fromkeys(r["kind"] for r in results):
        told = [p for r in results if r["kind"] == kind for p in scored(r)]
        sound = [r for r in results if r["kind"] == kind and not asks_for_more(r)]
        yield _row(kind, f"all, of {len(sound)} fits whose residual asks for nothing",
                   [p for r in sound for p in scored(r)])  # fmt: skip
        for quantity in (*dict.fromkeys(p["name"].partition(".")[2] for p in told), "all"):
            some = [p for p in told if quantity in ("all", p["name"].partition(".")[2])]
            yield _row(kind, quantity.replace("_", " "), some)


def _row(kind: str, name: str, some: Sequence[Result]) -> str:
    shares = [_percent(_holds(p, width) for p in some) for width in WIDTHS]
    size = median(100.0 * p[SHOWN] / abs(p["value"]) for p in some) if some else 0.0
    return f"| {kind} | {name} | {len(some)} | {' | '.join(shares)} | {size:.2g} % |"


def asks_for_more(result: Result) -> bool:
    """The residual asks for an element, or for more of a law: the fit ended in a poor minimum."""
    return any(f["significant"] for f in (*result["missing"], *result["laws"]))


def scored(result: Result) -> list[Result]:
    """Determined parameters; of what comes after yielding, where the element was seen to yield."""
    half = "model_error" if asks_for_more(result) else "half"  # as in runner/scores/uncertainty.py
    listed = [p | {SHOWN: p[half]} for p in result["parameters"]]
    told = [p for p in listed if p["status"] == DETERMINED and p["truth"]]
    yields = {p["name"].partition(".")[0] for p in told if p["name"].endswith(f".{YIELD}")}
    return [
        p for p in told if "post_yield" not in p["name"] or p["name"].partition(".")[0] in yields
    ]


def _holds(p: Result, width: str) -> bool:
    return bool(abs(p["value"] - p["truth"]) <= p[width])


def of_bands(results: Sequence[Result]) -> Iterator[str]:
    """Mean share of the samples of unseen motion within 95 % bands, and quartiles over cases."""
    yield "| noise | fits | true acceleration | measured | displacement | force of an element |"
    yield "| --- | ---: | ---: | ---: | ---: | ---: |"
    for kind in dict.fromkeys(r["kind"] for r in results):
        own = [r for r in results if r["kind"] == kind]
        sound = [r for r in own if not asks_for_more(r)]
        for words, some in (("", own), (", residual asks for nothing", sound)):
            cells = [_quartiles(some, name) for name in BANDS]
            yield f"| {kind}{words} | {len(some)} | {' | '.join(cells)} |"


def _quartiles(results: Sequence[Result], band: str) -> str:
    """Of results by older code, which have no such band, none."""
    key = f"{band}_percent"
    values = sorted(r["bands"][key] for r in results if key in r["bands"])
    if not values:
        return "–"
    n, mean = len(values), sum(values) / len(values)
    return f"{mean:.1f} % ({values[n // 4]:.1f} to {values[(3 * n) // 4]:.1f})"


def excited(results: Sequence[Result]) -> Iterator[str]:
    """What is said of the yield displacements of elements that yield, and of those that do not."""
    heads = ("no yielding told", *STATUSES)
    yield f"| noise | the element | number | {' | '.join(heads)} |"
    yield "| --- | --- | ---: | ---: | ---: | ---: | ---: |"
    for kind in dict.fromkeys(r["kind"] for r in results):
        for name, rests in (("never yields", True), ("yields", False)):
            own = [
                said_of(r, e)
                for r in results
                if r["kind"] == kind
                for e in range(1, r["dofs"] + 1)
                if (e in r["resting"]) == rests
            ]
            shares = [_percent(s == said for s in own) for said in (NOTHING, *STATUSES)]
            yield f"| {kind} | {name} | {len(own)} | {' | '.join(shares)} |"


def said_of(result: Result, element: int) -> str:
    """The status of an element's yield displacement; NOTHING where it is told to have none."""
    named = {p["name"]: p["status"] for p in result["parameters"]}
    return str(named.get(f"r{element}.{YIELD}", NOTHING))


def missing(results: Sequence[Result]) -> Iterator[str]:
    """How often the residual asks for the brace that was planted, or for one that is not there."""
    yield "| cases | number | the right brace | another | none |"
    yield "| --- | ---: | ---: | ---: | ---: |"
    for kind in dict.fromkeys(r["kind"] for r in results):
        own = [r for r in results if r["kind"] == kind and (r["missing"] or r["brace"])]
        named = [next((f["name"] for f in r["missing"] if f["significant"]), None) for r in own]
        pairs = list(zip(own, named, strict=True))
        right = _percent(n is not None and n == r["brace"] for r, n in pairs)
        other = _percent(n is not None and n != r["brace"] for r, n in pairs)
        words = "brace that the model lacks" if kind == "brace" else f"true chain, {kind} noise"
        shown = right if kind == "brace" else "–"
        yield f"| {words} | {len(own)} | {shown} | {other} | {_percent(n is None for n in named)} |"


def _percent(hits: Any) -> str:
    told = list(hits)
    return f"{100.0 * sum(told) / len(told):.1f} %" if told else "–"
