"""Hydra sweeper: settings proposed by Optuna, judged on held-back training motion, over seeds.

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

from hydra_plugins.grid_sweeper.grid_sweeper import GridSweeper, tell_lost

if TYPE_CHECKING:
    from runner.search import Search


class SearchSweeper(GridSweeper):
    def __init__(
        self,
        trials: int,
        tuned: Mapping[str, str],
        final: Mapping[str, str] | None = None,
        sampler_seed: int = 0,
        **grids: Any,
    ) -> None:
        super().__init__(**grids)
        self.trials, self.tuned, self.final = trials, tuned, dict(final or {})
        self.sampler_seed = sampler_seed

    def sweep(self, arguments: list[str]) -> None:
        try:
            from runner.search import print_searches, write_searches  # slow, Optuna is an extra
        except ModuleNotFoundError as error:
            need = "pip install -c constraints.txt -e '.[optuna]'"
            raise ValueError(f"a search needs {error.name}: {need}") from None

        assert self.config is not None
        folder = Path(self.config.hydra.sweep.dir)
        folder.mkdir(parents=True, exist_ok=True)
        searches = self.searches(arguments, folder)
        while unfinished := [search for search in searches if search.left > 0]:
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
        """One for each combination of the words that are not tuned, but for the seeds."""
        from runner.search import Search, distribution, start_of

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
        found = []
        for case, seeds in cases.items():
            start = start_of(self._config([*case, *seeds[:1]]), space)
            settings = (self.trials, self.sampler_seed)
            found.append(Search(case, seeds, space, start, folder, *settings))
        return found

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

    def _config(self, job: list[str]) -> Any:
        assert self.config is not None
        return self.loader.shared(self.config, job)

    def folders(self, jobs: Sequence[list[str]]) -> dict[Path, list[str]]:
        assert self.config is not None
        return {self.loader.folder(self.config, job): job for job in jobs}

    def final_jobs(self, search: Search, more: Sequence[str]) -> list[list[str]]:
        """Runs on the fresh seeds; none where the config names none."""
        if not self.final:
            return []
        parser = OverridesParser.create(config_loader=self.loader)
        words = [f"{key}={value}" for key, value in self.final.items()]
        overrides = parser.parse_overrides([*search.case, *more, *words])
        return [list(job) for job in self.split_arguments(overrides, None)[0]]

    def run(self, jobs: Mapping[Path, list[str]]) -> None:
        """Those that are neither finished nor bound to fail again.

        Raises ValueError where some were lost, by the fault of a disk or a machine: a setting is
        not to be judged by that.
        """
        from runner.run_folder import FAILED, METRICS

        assert self.launcher is not None
        pending = self._pending(jobs)
        for folder in pending:
            for name in (FAILED, METRICS):  # of other code, or of a run that was lost
                (folder / name).unlink(missing_ok=True)
        if pending:
            tell_lost(self.launcher.launch(list(pending.values()), initial_job_idx=0))
        if lost := self._pending(pending):
            raise ValueError(f"{len(lost)} runs of the search were lost; repeat the command")

    @staticmethod
    def _pending(jobs: Mapping[Path, list[str]]) -> dict[Path, list[str]]:
        from runner.progress import is_finished, would_fail_again

        return {f: j for f, j in jobs.items() if not is_finished(f) and not would_fail_again(f)}

    def finish(self, jobs: Mapping[Path, list[str]]) -> bool:
        """The runs on fresh seeds, with progress and a summary; whether all are done."""
        from runner.progress import Watch, is_finished, print_summary

        assert self.launcher is not None
        pending, done = self._pending(jobs), sum(map(is_finished, jobs))
        hopeless = len(jobs) - len(pending) - done
        if pending:
            with Watch(list(pending), len(jobs), hopeless):
                runs = self.launcher.launch(list(pending.values()), initial_job_idx=0)
            tell_lost(runs)
        return print_summary(jobs, done, hopeless)
