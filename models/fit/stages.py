"""Stages of a fit on a free run: how far each runs, on what, and where it begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

Horizons = Sequence[int | None]


@dataclass(frozen=True)
class Stage:
    """One stage of training.

    horizon: samples between runs that begin anew; None: the whole record. last: the horizon is the
    last one. some: on the first records alone. hurried: it ends sooner, for another goes on from
    it. start: number of the ranked start it begins at; None: where the stage before ended.
    finalist: number of the one that it trains. best: it begins where one of them ended, and no end
    before it counts any more. prior: number of the prior that it tries.
    """

    name: str
    horizon: int | None = None
    last: bool = True
    some: bool = False
    hurried: bool = False
    start: int | None = None
    finalist: int | None = None
    best: bool = False
    prior: int | None = None


def usual(horizons: Horizons, finalists: int, trained: bool, more: bool) -> list[Stage]:
    """All horizons for each finalist; to the end, with all records, for the best of them alone.

    trained: there are several starts, which were trained on the first horizon when they were
    ranked. more: there are more records than the stages before the last take.
    """
    later = horizons[1:] if trained and len(horizons) > 1 else horizons
    in_full, stages = more or finalists > 1, []
    numbered = in_full and trained
    for number in range(finalists):
        own = [_named(h, h == horizons[-1]) for h in later]
        own = [replace(s, some=more or not s.last, hurried=in_full) for s in own]
        if numbered:
            own = [replace(s, finalist=number) for s in own]
        own[0] = replace(own[0], start=number)
        if number > 0:
            own = [replace(s, name=f"{s.name}, start {number + 1}") for s in own]
        stages += own
    if in_full:
        name = "the chosen in full" if finalists > 1 else "in full"
        stages.append(replace(_named(horizons[-1], True), name=name, best=numbered))
    return stages


def by_prior(
    horizons: Horizons, priors: Sequence[float], anew: int, near: int | None, refit: str
) -> list[Stage]:
    """All horizons for each of the first `anew` priors, the path of the others, the refit.

    near: number of the prior whose first runs are of one sample.
    """
    stages = []
    for number, prior in enumerate(priors[:anew]):
        lengths = [1, *horizons[1:]] if number == near else horizons
        own = [_named(h, k + 1 == len(horizons)) for k, h in enumerate(lengths)]
        own[0] = replace(own[0], start=0)
        named = [replace(s, name=f"{s.name}, prior {prior:g}", prior=number) for s in own]
        stages += [replace(stage, some=not stage.last) for stage in named]
    path = [
        Stage(f"from linear, prior {prior:g}", prior=number)
        for number, prior in enumerate(priors[anew:], anew)
    ]
    path[:1] = [replace(stage, start=-1) for stage in path[:1]]
    return [*stages, *path, Stage(refit)]


def _named(horizon: int | None, last: bool) -> Stage:
    return Stage(f"horizon {'whole record' if horizon is None else horizon}", horizon, last)
