"""Public benchmarks of nonlinearbenchmark.org as training and test records.

`python train.py data=benchmark data.name=silverbox data.folder=…`: data/public/benchmarks.py has
the benchmarks by name, data/public/files.py how their files get here.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from data.datamodule import Data, matching
from data.public.benchmarks import benchmark_called, files_of
from data.public.files import cache
from data.public.series import noise_floor, require_held_out, stretch
from data.record import Record
from data.simulation.scenario import Scenario
from data.windows import WindowDataset


class BenchmarkData(Data):
    """The official training and test series of one benchmark.

    `train` and `test` name series by patterns as in a shell; None takes the usual series.
    `calibration` names official series of either kind that nothing but bands is made from.
    `folder` holds the files, by default the cache of the package nonlinear-benchmarks, which
    fetches missing files only with `download`. `samples` trains on a stretch of that length at a
    random place, which begins in an unknown motion. `hold`: the input between samples,
    None: the benchmark's own. The official state-initialisation window is the warm-up of the
    records; `warmup` may lengthen it.

    Attributes in addition to `Data`: `unit` of the output, `band` [Hz] of the excitation where
    it is known, `noise` (RMS, by output) where periods repeat, `published` RMSE by method.
    Raises ValueError for an unknown benchmark or series, files that are missing or damaged, and a
    test series that was trained on.
    """

    def __init__(
        self,
        benchmark: str,
        scenario: Scenario,
        seed: int = 0,  # of the place of a stretch; nothing else here is random
        name: str | None = None,
        folder: str | None = None,
        download: bool = False,
        train: str | Sequence[str] | None = None,
        test: str | Sequence[str] | None = None,
        hold: str | None = None,
        samples: int | None = None,
        window: int | None = None,
        stride: int | None = None,
        warmup: int = 0,
        batch: int | None = None,
        validation: float = 0.0,
        calibration: str | Sequence[str] | None = None,
    ) -> None:
        super().__init__(window, stride, warmup, batch, validation)
        about = benchmark_called(benchmark, scenario)
        self.about, self.hold = about, hold or about.hold
        self.unit, self.band, self.published = about.unit, about.band, dict(about.published)
        said = {"train": train or about.usual_train, "test": test or about.usual_test}
        wanted = {k: [v] if isinstance(v, str) else list(v) for k, v in said.items()}
        for patterns in wanted.values():
            patterns += [calibration] if isinstance(calibration, str) else calibration or []
        place = cache() if folder is None else Path(folder)
        self.files = files_of(benchmark, place, download, wanted)
        try:
            train_series, test_series = about.read(self.files)
        except ValueError as error:
            raise ValueError(f"{benchmark}: {error}") from None
        usual = next(g for g in (*about.usual_test, "*") if fnmatch.filter(test_series, g))
        splits = {
            "train": (train_series, train or about.usual_train),
            "test": (test_series, test or usual),
            "calibration": (train_series | test_series, calibration),
        }
        self.series = {
            split: {name: series[name] for name in matching(list(series), wanted, split)}
            for split, (series, wanted) in splits.items()
            if wanted is not None
        }
        require_held_out(self.series)
        if samples is not None:
            self.series["train"] = stretch(self.series["train"], samples, seed)
        for split, chosen in self.series.items():
            self.series[split] = {name: self._own(r) for name, r in chosen.items()}
            self.names[split] = list(chosen)
            self.notes |= {f"{split}: {n}": self._remarks(split, r) for n, r in chosen.items()}
        first = next(iter(self.series["train"].values()))
        self.name, self.dt = name or benchmark, first.dt
        self.dofs, self.inputs = first.dofs, first.f.shape[1]
        self.forced = [1]  # where the input acts, or is taken to act
        self.quantity = about.quantity
        self.units = {f"u{i}": about.input_unit for i in range(1, self.inputs + 1)}
        self.units |= {f"y{i}": about.unit for i in range(1, self.dofs + 1)}
        periods = [r for r in train_series.values() if r.initial_state == "periodic"]
        same = [r.a.numpy() for r in periods if r.warmup == 0]
        self.noise = noise_floor(np.stack(same)) if same else None

    def _own(self, record: Record) -> Record:
        """A record with what the benchmark says of all of them, apart in memory."""
        record.require_finite()
        apart = record.map(lambda u: u.clone(memory_format=torch.contiguous_format))
        return replace(apart, hold=self.hold, quantity=self.about.quantity)

    def _remarks(self, split: str, record: Record) -> list[str]:
        """Remarks on a record for readers of its scores."""
        remarks = [f"{record.samples} samples, {record.warmup} of them not counted"]
        trained = self.series["train"].values()
        if split == "test" and any(torch.equal(r.f, record.f) for r in trained):
            remarks.append("its excitation was trained on, so this is how well the model fits")
        return remarks

    def make_records(self) -> dict[str, list[Record]]:
        return {split: list(records.values()) for split, records in self.series.items()}

    def make_calibration(self) -> list[Record]:
        raise ValueError(
            "name official series that are neither trained on nor tested: data.calibration=[…]"
        )

    def setup(self, stage: str | None = None) -> None:
        super().setup(stage)
        if self.validation > 0.0:  # a part of a period does not repeat itself
            for split in ("train", "validation"):
                self.records[split] = [from_rest(record) for record in self.records[split]]

    def windows(self, split: str) -> WindowDataset:
        return WindowsFromRest(self.records[split], **self.cut)


def from_rest(record: Record) -> Record:
    """The record, taken to begin at rest: its first state is unknown, and warm-up forgets it.

    One that is known to begin in an unknown motion stays as it is.
    """
    return record if record.initial_state == "unknown" else replace(record, initial_state="rest")


class WindowsFromRest(WindowDataset):
    """Windows of records whose first state was not measured: parts of a record begin at rest.

    All windows have the official warm-up if they are longer than that; else windows that end
    within the official warm-up are omitted. Raises ValueError where no window remains.
    """

    def __init__(
        self, records: Sequence[Record], length: int | None, stride: int | None, warmup: int
    ) -> None:
        official = max(record.warmup for record in records)
        if official < (length or min(record.samples for record in records)):
            warmup = max(warmup, official)
        super().__init__(records, length, stride, warmup)
        self.places = [p for p in self.places if p[1] + warmup >= records[p[0]].warmup]
        if not self.places:
            raise ValueError(
                f"no data.window of {self.length} samples begins after the first {official}, which "
                "do not count; shorten data.stride"
            )

    def __getitem__(self, index: int) -> Record:
        i, start, length = self.places[index]
        record = self.records[i]
        if length == record.samples:
            return super().__getitem__(index)
        return from_rest(record.window(start, length, self.warmup))
