"""The error of a simulation, stage by stage.

A free run of a start far from the truth drifts apart, and its error tells nothing: so the run is
begun anew from measured states, at first often, then seldom, at last never (multiple shooting, as
Ribeiro et al. 2020, On the smoothness of nonlinear system identification). On measured records
models of elements go along a path of their own (stages.py).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Literal

import torch

from data.annotations import Count, NotNegative, Range
from data.checked import checked
from data.record import SHORTEST, Record
from models.composition.composite import Composite
from models.fit.extrapolation import End, end_of, middle, stays_in_bounds
from models.fit.growing import grow, lack_states
from models.fit.held_back import grows, held_back, onset, without_held_back
from models.fit.noise_weights import refit, weigh_at_first
from models.fit.objective import MakeSolver, Note, Objective, mean_loss, restore, state_of
from models.fit.problem import FreeRunProblem, run_problem
from models.fit.solvers.solver import Solver
from models.fit.stages import (
    FEW,
    LONGER,
    PATH,
    PRIORS,
    WORSE,
    Stage,
    best_of,
    by_prior,
    fit_linear,
    held_back_percent,
    horizons_of,
    usual,
)
from models.fit.trainable import Trainable

PARTS = (0.125, 0.25, 0.5)  # of the motion, in stages, where runs cannot begin anew
RUNAWAY = 1e4  # loss of a law that does not stand another motion, beside its own: it comes last
ASTRAY = 0.5  # error of a free run: another start may do better
LEAST_RAISED = 1e-8  # of a prior that is raised


@checked
class FreeRun(Objective):
    """The error of a simulation that begins anew every so many samples, a horizon a stage.

    horizons: in samples, rising; None for the whole record. restart: False takes the first samples
    of each record instead, from its own initial state, where x and v are not to be trusted; so it
    is, over growing parts of the motion, where there is no x and v. A quiet start is no part of
    such a horizon.
    records: number of records that the stages before the last are trained on, None for all.
    starts: random starts, drawn from
    `seed`, each trained for `start_iterations` calls of the solver on the first horizon. finalists:
    number of starts, those with the lowest training losses, that go through the horizons after it,
    hurried; one of them goes on to the end, with all records: of those that fit alike the one in
    the middle (extrapolation.py). Where all of them leave half of the motion, as where a start was
    near in a few samples only, the start that comes next goes, too.
    select: weights of the prior that are tried on all but the last `held_back` of the motion, and
    after them the path from the linear structure; the one with the least error of the free run on
    what is held back goes on, on the whole. The first part is held back in place of the last where
    that holds the strongest motion and runs can begin anew. None: some where records were
    measured, the first also from runs of single samples; []: none. It takes the place of
    finalists.
    channels: "noise": once the fit is made, it goes on with errors in units of each channel's
    noise (noise_weights.py). "equal": all count alike. None: "noise" only where a noisy sensor
    takes over.
    """

    simulates = True

    kept = ("ranked", "extra", "judged", "ends", "shorter", "raised", "present", "remarks", "limit")

    def __init__(
        self,
        horizons: Sequence[Count | None] = (50, 500, None),
        restart: bool = True,
        records: Count | None = None,
        starts: Count = 1,
        start_iterations: Count = 10,
        finalists: Count = 1,
        seed: int = 0,
        select: Sequence[NotNegative] | None = None,
        held_back: Annotated[float, Range(0, 1, above=True, below=True)] = 0.2,
        channels: Literal["equal", "noise"] | None = None,
    ) -> None:
        lengths = [math.inf if h is None else h for h in horizons]
        if not lengths or sorted(lengths) != lengths:
            raise ValueError(
                f"objective.horizons={list(horizons)}: expected numbers of samples that rise, "
                "null at the end for the whole record"
            )
        if finalists > starts:
            raise ValueError(
                f"objective.finalists={finalists} must be objective.starts={starts} at most"
            )
        self.horizons = list(horizons)
        self.restart, self.records = restart, records
        self.starts, self.start_iterations, self.seed = starts, start_iterations, seed
        self.finalists, self.select, self.held_back = finalists, select, held_back
        self.channels = channels
        self.priors: list[float] = []  # that are tried, the first `anew` of them from the starts
        self.anew = 0
        self.single: int | None = None  # number of the one whose first runs are of one sample
        self.linear: list[int | None] = []  # horizons of the linear fit before it
        self.judged_first = False  # on the first part of the motion
        self.ranked: list[list[torch.Tensor]] = []  # states of the finalists, the best first
        self.judged: list[list[float]] = []  # number of a prior, loss on held-back motion
        self.limit = math.inf  # least loss on that motion since the last stage began
        self.ends: dict[int, End] = {}  # the best of each finalist so far
        self.present = -1  # the stage, −1 before the first
        self.remarks: list[str] = []
        self.more = False  # records than the stages before the last are trained on
        self.extra = 0  # starts that go through the horizons beside the finalists

    @property
    def extra(self) -> int:
        return self._extra

    @extra.setter
    def extra(self, count: int) -> None:
        self._extra = count
        self._plan()

    def _plan(self) -> None:
        if self.priors:
            self.plan = by_prior(self.horizons, self.priors, self.anew, self.single)
            self.first = self.plan[0]
        else:
            finalists = self.finalists + self.extra
            self.plan = usual(self.horizons, finalists, self.starts > 1, self.more)
            self.first = usual(self.horizons, 1, False, self.more)[0]
        self.stages: Sequence[str] = [stage.name for stage in self.plan]

    def prepare(self, estimator: Trainable, batches: Iterable[Record], measured: bool) -> None:
        records = list(batches)
        if self.channels == "noise" and not isinstance(estimator, Composite):
            raise ValueError(
                f"objective.channels=noise: {type(estimator).__name__} counts all channels alike; "
                "leave it out, or choose a network of elements"
            )
        if self.channels != "equal" and isinstance(estimator, Composite):
            weigh_at_first(estimator, records, self.channels)
        anew = all(estimator.begins_anew(record) for record in records)
        if self.restart and self.horizons != [None] and not anew:
            self._grow(min(record.samples - onset(record) for record in records))
        if anew and not all(estimator.has_states(record) for record in records):
            self.remarks = ["runs in training restart from x and v reconstructed from the motion"]
        _, deviation = estimator.pull(True)
        if deviation.numel() and (self.select or (self.select is None and measured)):
            self.priors = [float(p) for p in self.select or PRIORS]
            self.linear = self.horizons
            if anew and self.horizons != [None]:
                shortest = min(records, key=lambda record: record.samples)
                self.linear = horizons_of(shortest, LONGER)
                self.horizons, self.restart = horizons_of(shortest, FEW), True
                if self.select is None:
                    self.single = len(self.priors)
                    self.priors += PRIORS[:1]
            self.anew = len(self.priors)
            if estimator.begins_linear:
                self.priors += PATH
            known = all(record.initial_state != "unknown" for record in records)
            self.judged_first = anew and known and grows(records, self.held_back)
            if self.judged_first:
                told = "the strongest motion comes last: the first part is held back"
                self.remarks = [*self.remarks, told]
        self.more = self._more(records)
        self._plan()

    def _more(self, records: Sequence[Record]) -> bool:
        several = [len(record.a) for record in records if record.a.ndim == 3]
        return self.records is not None and max(several, default=1) > self.records

    def _grow(self, samples: int) -> None:
        """Parts of a motion of so many samples, where runs cannot begin anew."""
        self.restart = False
        lengths = dict.fromkeys(max(SHORTEST, round(part * samples)) for part in PARTS)
        self.horizons = [*(length for length in lengths if length < samples), None]
        parts = _listed(self.horizons)
        self.remarks = [f"without x and v no run restarts; stages take the first {parts}"]

    @property
    def refits(self) -> bool:
        last = self.present + 1 == len(self.stages)
        return last and (bool(self.priors) or (bool(self.ends) and self.plan[-1].best))

    @property
    def goes_back(self) -> bool:
        stage = self.plan[self.present]
        on_path = stage.prior is not None and stage.prior > self.anew
        return (self.refits and not self.ends) or (on_path and self._led_astray())

    @property
    def hurries(self) -> bool:
        return self.plan[self.present].hurried

    def _led_astray(self) -> bool:
        """The last step of the path led away from the best of its steps."""
        losses = [loss for tried, loss in self.judged if tried >= self.anew]
        return bool(losses) and not losses[-1] <= WORSE * min(losses)

    @property
    def held_back_loss(self) -> float | None:
        return min((loss for _, loss in self.judged), default=None)

    def facts(self) -> dict[str, Any]:
        if not self.judged:
            return super().facts()
        names = [f"{p:g}" for p in self.priors]
        if self.single is not None:
            names[self.single] += " from single steps"
        names[self.anew :] = [f"{name} from linear" for name in names[self.anew :]]
        percent = held_back_percent(names, self.judged)
        best = best_of(self.judged)
        return {
            **super().facts(),
            "prior": self.priors[best],
            "chosen": names[best],
            "held_out_error_percent": percent,
        }

    @property
    def judges(self) -> bool:
        """The present stage is judged on motion that was held back."""
        return bool(self.priors) and not self.refits

    def _prior(self, stage: Stage) -> float | None:
        """The weight of the prior in a stage; None for the model's own."""
        if not self.priors:
            return self.firm
        return self.priors[best_of(self.judged) if stage.prior is None else stage.prior]

    def problem(self, estimator: Trainable, record: Record, stage: int) -> FreeRunProblem:
        return self._problem(estimator, record, self.plan[stage])

    def _problem(self, estimator: Trainable, record: Record, stage: Stage) -> FreeRunProblem:
        prior, horizon, last = self._prior(stage), stage.horizon, stage.last
        if self.raised > 1.0:
            own = torch.as_tensor(estimator.pull(True)[0]).max() if prior is None else prior
            prior = self.raised * max(LEAST_RAISED, float(own))
        if stage.prior is not None:
            record = without_held_back(record, self.held_back, self.judged_first)
        if stage.some and record.a.ndim == 3:
            record = record.map(lambda u: u[: self.records])
        quiet = 0 if self.restart else onset(record)
        if self.shorter:
            last = False
            length = record.samples - quiet if horizon is None else min(horizon, record.samples)
            horizon = max(SHORTEST if not self.restart else 1, length >> self.shorter)
        if not self.restart and record.initial_state == "periodic":
            horizon = None  # there is no shorter part that begins in the steady state
        elif horizon is not None and not (self.restart and estimator.begins_anew(record)):
            length = horizon + (quiet if 2 * quiet > horizon else 0)
            record, horizon = record.window(0, min(length, record.samples), record.warmup), None
        return run_problem(estimator, record, horizon, last, prior)

    def begin(
        self, estimator: Trainable, batches: Iterable[Record], make_solver: MakeSolver, note: Note
    ) -> None:
        """Rank the starts, the first of them the estimator's own; fit the linear structure.

        Without x and v another state is fitted from rest over a growing part of the motion.
        """
        self.present = 0
        if estimator.begins_linear and lack_states(estimator, list(batches)):
            start = state_of(estimator)
            seen = [
                without_held_back(r, self.held_back, self.judged_first) if self.priors else r
                for r in batches
            ]
            if math.isfinite(grow(estimator, seen)):
                self.near = state_of(estimator)
            restore(estimator, start)
        self.ranked = self._ranked(estimator, batches, make_solver, note)
        if len(self.priors) > self.anew:
            restore(estimator, self.ranked[-1])  # the estimator's own start
            fit_linear(estimator, list(batches), self.linear, make_solver, note)
            self.ranked[-1] = state_of(estimator)
        restore(estimator, self.ranked[0])

    def _ranked(
        self, estimator: Trainable, batches: Iterable[Record], make_solver: MakeSolver, note: Note
    ) -> list[list[torch.Tensor]]:
        """States of the starts after their first steps, the best first; last, the own start."""
        identified = state_of(estimator)
        if self.starts == 1:
            return [identified, identified]
        generator = torch.Generator().manual_seed(self.seed)
        free = [p for p in estimator.parameters() if p.requires_grad]
        ends: list[tuple[float, list[torch.Tensor]]] = []
        for start in range(self.starts):
            if start > 0:
                restore(estimator, identified)
                estimator.restart(generator)
                estimator.forget()
            self._first_steps(estimator, batches, make_solver(free), note)
            loss = mean_loss([self._problem(estimator, record, self.first) for record in batches])
            ends.append((loss, state_of(estimator)))
        ends.sort(key=lambda end: end[0])
        return [state for _, state in ends] + [identified]

    def enter(self, estimator: Trainable, stage: int) -> None:
        """Take the next finalist, or prior, where one has been through all horizons."""
        self.present, self.shorter, self.raised = stage, 0, 1.0
        if self.plan[stage].best and self._are_astray():
            self.extra += 1
            told = "the finalists left half of the motion: the next start went, too"
            self.remarks = [*self.remarks, told]
        start = self.plan[stage].start
        if self.plan[stage].best and self.ends:
            restore(estimator, middle(list(self.ends.values())))
        elif start is not None:
            restore(estimator, self.ranked[start])

    def _are_astray(self) -> bool:
        """No finalist ended near the motion, and there is another start."""
        near = any(loss < ASTRAY**2 for loss, *_ in self.ends.values())
        return not near and self.finalists + self.extra < self.starts

    def _first_steps(
        self, estimator: Trainable, batches: Iterable[Record], solver: Solver, note: Note
    ) -> None:
        done = 0
        while True:
            for record in batches:
                note(solver.solve(self._problem(estimator, record, self.first)))
                done += 1
                if solver.finished or done == self.start_iterations:
                    return

    def require_one_batch(self, estimator: Trainable) -> None:
        stated = isinstance(estimator, Composite) and estimator.stated
        if stated or self.channels == "noise":
            asked = "model.priors" if stated else "objective.channels=noise"
            raise ValueError(f"{asked} needs all windows in one batch; set data.batch=null")

    def refine(self, estimator: Trainable, batches: Iterable[Record], note: Note) -> None:
        """Weigh channels and stated priors by the noise that the fit left."""
        if not isinstance(estimator, Composite):
            return
        whole = list(batches)
        if len(whole) > 1:  # windows, some at a time
            return
        self.shorter, self.raised, last = 0, 1.0, len(self.stages) - 1
        told = refit(
            estimator,
            whole[0],
            lambda record: self.problem(estimator, record, last),
            self.channels,
            self.facts().get("prior"),
            note,
        )
        self.remarks = [*self.remarks, *told]

    def final_loss(self, estimator: Trainable, batches: Iterable[Record]) -> float:
        """Mean loss of the plain free run, without restarts; on held-back motion along a path."""
        if not self.priors:
            records = list(batches)
            loss = mean_loss([FreeRunProblem(estimator, record, None) for record in records])
            finalist = self.plan[self.present].finalist
            if finalist is not None and loss < self.ends.get(finalist, (math.inf,))[0]:
                self.ends = {**self.ends, finalist: end_of(estimator, loss, records)}
            return loss
        part = [held_back(record, self.held_back, self.judged_first) for record in batches]
        unseen = self._loss_of(estimator, part)
        stood = all(stays_in_bounds(estimator, record.measured()) for record in batches)
        loss = unseen if self.judges else self._loss_of(estimator, batches)
        loss += 0.0 if stood else RUNAWAY
        if self.judges:
            tried = self.plan[self.present].prior
            self.judged = [*self.judged, [-1 if tried is None else tried, loss]]
        elif unseen > self.limit:  # it fits the rest better, and this worse than before it saw it
            remark = "the last stage raised the error on held-back motion: its start is kept"
            self.remarks = [*self.remarks, remark]
            return math.inf
        else:
            self.limit = unseen
        return loss

    def _loss_of(self, estimator: Trainable, records: Iterable[Record]) -> float:
        """Mean loss of plain free runs, without a prior."""
        return mean_loss([FreeRunProblem(estimator, r, None, prior=0.0) for r in records])


def _listed(horizons: Sequence[int | None]) -> str:
    return ", ".join("the whole record" if h is None else str(h) for h in horizons) + " samples"
