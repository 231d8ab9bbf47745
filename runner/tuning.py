"""A sweep that tunes settings: Optuna proposes, held-back training motion judges, over seeds.

hydra:
  sweeper:
    params: {model: vwnn, system: "bilinear,bouc_wen", seed: "range(80,83)"}
    tuned: {model.cutoff: "tag(log,interval(5,314))", model.order: "choice(1,2)"}
    trials: 30                                # for each model and system
    final: {seed: "range(60,80)"}             # then as configured and as tuned, on fresh seeds

Hydra's own plugin, hydra-optuna-sweeper 1.3, asks for Optuna before 3.0, whose storage does not run
with today's SQLAlchemy; it knows one run per trial, and no run that is finished already.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override

from runner.composed_once import has_own_name
from runner.folder.run_folder import FAILED, METRICS
from runner.grids import GridSweeper, print_lost, unfinished
from runner.progress import would_fail_again

if TYPE_CHECKING:
    from runner.search import Search


class TuningSweeper(GridSweeper):
    """Searches, one for each model and system; then runs on fresh seeds."""

    def __init__(
        self,
        trials: int,
        tuned: Mapping[str, Any],
        final: Mapping[str, Any] | None = None,
        sampler_seed: int = 0,
        **grids: Any,
    ) -> None:
        super().__init__(**grids)
        if trials < 1:
            raise ValueError(f"hydra.sweeper.trials={trials} must be 1 or more")
        self.trials, self.tuned, self.final = trials, tuned, dict(final or {})
        self.sampler_seed = sampler_seed

    def sweep(self, arguments: list[str]) -> None:
        try:
            # inside, because Optuna is an extra and Hydra imports every sweeper at every start
            import runner.search  # noqa: F401
        except ModuleNotFoundError as error:
            need = "pip install -c constraints.txt -e '.[optuna]'"
            raise ValueError(f"a search needs {error.name}: {need}") from None

        super().sweep(arguments)

    def work(self, arguments: list[str], folder: Path) -> None:
        from runner.search import print_searches, write_searches

        assert self.config is not None
        if not has_own_name(self.config):
            raise ValueError(
                "hydra.sweep.subdir: the runs of a search are named after their choices; leave it "
                "out"
            )
        searches = self.searches(arguments, folder)
        while unfinished := [search for search in searches if search.remaining > 0]:
            trials = [search.ask() for search in unfinished]  # one of each: they fill the cores
            folders = [self.folders(trial.jobs) for trial in trials]
            self.run({f: job for of_trial in folders for f, job in of_trial.items()})
            for trial, of_trial in zip(trials, folders, strict=True):
                trial.tell(list(of_trial))
        print_searches(searches)
        chosen: dict[str, dict[str, list[str]]] = {}
        jobs: list[list[str]] = []
        for search in searches:
            words = {"configured": [], "tuned": search.best_words}
            both = {name: self.final_jobs(search, more) for name, more in words.items()}
            chosen[search.name] = {n: [f.name for f in self.folders(j)] for n, j in both.items()}
            jobs += [job for of_one in both.values() for job in of_one]
        write_searches(folder, searches, chosen)
        if jobs and not self.finish(self.folders(jobs)):
            sys.exit(1)

    def searches(self, arguments: list[str], folder: Path) -> list[Search]:
        """One search for each combination of the words that are not tuned, except the seeds."""
        from runner.search import Search, distribution, start_of  # Optuna, as in `sweep`

        assert self.config is not None
        parser = OverridesParser.create(config_loader=self.loader)
        typed = parser.parse_overrides(arguments)
        tuned = {o.get_key_element(): o for o in self._tuned(parser, typed)}
        rest = [o.input_line or "" for o in typed if o.get_key_element() not in tuned]
        space = {key: distribution(override) for key, override in tuned.items()}
        cases: dict[tuple[str, ...], list[str]] = {}
        for job in self.jobs(rest).values():
            seeds = [word for word in job if word.startswith("seed=")]
            case = tuple(word for word in job if word not in seeds)
            cases.setdefault(case, []).extend(seeds)
        searches = []
        for case, seeds in cases.items():
            cfg = self.loader.shared(self.config, [*case, *seeds[:1]])
            start = start_of(cfg, space)
            settings = (self.trials, self.sampler_seed)
            searches.append(Search(case, seeds, space, start, folder, *settings))
        return searches

    def _tuned(self, parser: OverridesParser, typed: Sequence[Override]) -> list[Override]:
        """Of the config, then of the command line; a value typed there is not tuned any more."""
        mine = parser.parse_overrides([f"{key}={value}" for key, value in self.tuned.items()])
        fixed = {o.get_key_element() for o in typed}
        more = [
            o
            for o in typed
            if o.is_sweep_override()
            and (not o.is_discrete_sweep() or o.get_key_element() in self.tuned)
        ]
        return [o for o in mine if o.get_key_element() not in fixed] + more

    def final_jobs(self, search: Search, more: Sequence[str]) -> list[list[str]]:
        """Runs on the fresh seeds; none where the config names none."""
        if not self.final:
            return []
        parser = OverridesParser.create(config_loader=self.loader)
        words = [f"{key}={value}" for key, value in self.final.items()]
        overrides = parser.parse_overrides([*search.case, *more, *words])
        return [list(job) for job in self.split_arguments(overrides, None)[0]]

    def run(self, jobs: Mapping[Path, list[str]]) -> None:
        """Do the runs of some trials, as far as they are not done.

        Raises ValueError where some were lost, by the fault of a disk or a machine: a setting is
        not to be judged by that.
        """
        pending = self.hopeful(unfinished(jobs))
        for folder in pending:
            for name in (FAILED, METRICS):  # of another results version, or of a run that was lost
                (folder / name).unlink(missing_ok=True)
        if pending:
            print_lost(self.launch(pending))
        if lost := [f for f in unfinished(pending) if not would_fail_again(f)]:
            raise ValueError(f"{len(lost)} runs of the search were lost; repeat the command")
