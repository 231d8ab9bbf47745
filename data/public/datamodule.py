"""Public benchmarks of nonlinearbenchmark.org as training and test records, and their measures.

`python train.py data=benchmark data.name=silverbox data.folder=…`: data/public/splits.py has
the benchmarks by name, data/public/files.py how their files get here.  T samples, n outputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from data.datamodule import Data
from data.public.files import Files, cache, download
from data.public.splits import BENCHMARKS, Benchmark, Series
from data.record import Record
from data.simulation.scenario import FullState, Scenario
from data.windows import WindowDataset


class BenchmarkData(Data):
    """The official training and test series of one benchmark.

    `train` and `test` name the series, as in a shell, where others than the usual are wanted.
    `folder` is where the files are, the package's own cache by default; only with `download` is
    anything fetched. `hold` says what the input does between samples, None: the benchmark's own.
    The official state-initialisation window is the records' warm-up; `warmup` may lengthen it.

    Besides what all data have: `unit` of the output, `band` [Hz] of the excitation where it is
    known, `noise` (RMS, by output) where periods repeat, `published` RMSE by method.
    """

    def __init__(
        self,
        benchmark: str,
        scenario: Scenario,
        seed: int = 0,  # nothing here is random
        name: str | None = None,
        folder: str | None = None,
        download: bool = False,
        train: str | Sequence[str] | None = None,
        test: str | Sequence[str] | None = None,
        hold: str | None = None,
        window: int | None = None,
        stride: int | None = None,
        warmup: int = 0,
        batch: int | None = None,
        validation: float = 0.0,
    ) -> None:
        super().__init__(window, stride, warmup, batch, validation)
        about = benchmark_called(benchmark, scenario)
        self.about, self.hold = about, hold or about.hold
        self.unit, self.band, self.published = about.unit, about.band, dict(about.published)
        self.files = files_of(benchmark, cache() if folder is None else Path(folder), download)
        known = about.read(self.files)
        usual = next(g for g in (*about.usual_test, "*") if chosen(known[1], [g]))
        self.series = {
            "train": choose("train", known[0], train or about.usual_train),
            "test": choose("test", known[1], test or usual),
        }
        require_held_out(**self.series)
        first = self.series["train"][0]
        self.name, self.dt = name or benchmark, first.dt
        self.dofs, self.inputs = first.y.shape[1], first.u.shape[1]
        self.forced = [1]  # where the input acts, or is taken to act
        self.quantity = about.quantity
        self.units = {f"u{i}": about.input_unit for i in range(1, self.inputs + 1)}
        self.units |= {f"y{i}": about.unit for i in range(1, self.dofs + 1)}
        same = [s.y for s in known[0] if s.initial_state == "periodic" and s.warmup == 0]
        self.noise = noise_floor(np.stack(same)) if same else None
        self.made: dict[str, list[Record]] = {}
        for split, some in self.series.items():
            self.made[split] = [self._record(series) for series in some]
            self.notes.update({f"{split}: {s.name}": self._remarks(split, s) for s in some})

    def _record(self, series: Series) -> Record:
        try:
            record = Record(
                dt=series.dt,
                a=torch.from_numpy(series.y.copy()),
                f=torch.from_numpy(series.u.copy()),
                warmup=series.warmup,
                initial_state=series.initial_state,
                hold=self.hold,
                quantity=self.about.quantity,
            )
        except ValueError as error:
            raise ValueError(f"{self.name}, series {series.name}: {error}") from None
        record.require_finite()
        return record

    def _remarks(self, split: str, series: Series) -> list[str]:
        """What whoever reads the scores of a series should know."""
        remarks = [f"{len(series.u)} samples, {series.warmup} of them not counted"]
        if split == "test" and any(np.array_equal(s.u, series.u) for s in self.series["train"]):
            remarks.append("its excitation was trained on, so this is how well the model fits")
        return remarks

    def make_records(self) -> dict[str, list[Record]]:
        return {split: list(records) for split, records in self.made.items()}

    def setup(self, stage: str | None = None) -> None:
        super().setup(stage)
        if self.validation > 0.0:  # what is left of a period does not repeat itself
            for split in ("train", "validation"):
                self.records[split] = [from_rest(record) for record in self.records[split]]

    def windows(self, split: str) -> WindowDataset:
        return WindowsFromRest(self.records[split], **self.cut)


def from_rest(record: Record) -> Record:
    """A record whose first state nobody measured; its warm-up is there to forget that."""
    return replace(record, initial_state="rest")


class WindowsFromRest(WindowDataset):
    """Windows of such records: those that are not whole begin at rest, too.

    All have the official warm-up, where a window is longer than that; else the samples that it
    covers are left out. Raises ValueError where no window is left.
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


def benchmark_called(name: str, scenario: Scenario) -> Benchmark:
    """What is known of a benchmark. Raises ValueError for another name, or sensors of one's own."""
    if name not in BENCHMARKS:
        raise ValueError(f"data.name={name}: choose {', '.join(BENCHMARKS)}")
    if not isinstance(scenario, FullState):
        raise ValueError(
            "benchmarks are taken as they were measured; leave scenario=full_state, not "
            f"{type(scenario).__name__}"
        )
    return BENCHMARKS[name]


def files_of(name: str, folder: Path, fetch: bool = False) -> Files:
    """The files of a benchmark, all that it needs. Raises ValueError naming what is missing."""
    about, files = BENCHMARKS[name], Files(folder)
    if fetch and files.missing([*about.files, *about.optional]):
        download(about.loader, folder)
    missing = files.missing(about.files)
    if missing:
        raise ValueError(_how_to_get(name, about, folder, missing))
    return files


def _how_to_get(name: str, about: Benchmark, folder: Path, missing: list[str]) -> str:
    named = ", ".join(Path(path).name for path in missing)
    remedy = (
        f"or let the package nonlinear-benchmarks fetch {'it' if len(missing) == 1 else 'them'} "
        "with data.download=true"
        if about.loadable
        else "the package nonlinear-benchmarks brings only the test signals"
    )
    return (
        f"{name}: {named} {'is' if len(missing) == 1 else 'are'} not in {folder}; get "
        f"{'it' if len(missing) == 1 else 'them'} from {about.page} and put as {missing[0]} or "
        f"without its folders into data.folder={folder}; {remedy}"
    )


def chosen(series: Sequence[Series], names: Sequence[str]) -> list[Series]:
    """The series that one of the names means."""
    return [s for s in series if any(fnmatchcase(s.name, name) for name in names)]


def choose(split: str, series: Sequence[Series], names: str | Sequence[str]) -> list[Series]:
    """The same. Raises ValueError for a name that means none."""
    names = [names] if isinstance(names, str) else names
    for name in names:
        if not chosen(series, [name]):
            raise ValueError(f"data.{split} holds {name!r}; choose {_names(series)}")
    return chosen(series, names)


def _names(series: Sequence[Series]) -> str:
    return ", ".join(s.name for s in series)


def require_held_out(train: Sequence[Series], test: Sequence[Series]) -> None:
    """Raise ValueError where a test series was trained on: the same samples of the same file."""
    for held in test:
        counted = held.y[held.warmup :]
        for seen in train:
            if np.shares_memory(seen.y[seen.warmup :], counted):
                raise ValueError(
                    f"test series {held.name} has samples of training series {seen.name}; "
                    "change data.train or data.test"
                )


def noise_floor(periods: np.ndarray) -> np.ndarray | None:
    """RMS (n,) of what differs between repeated periods (P, T, n) in the steady state, its noise.

    Unbiased: Σ (y − ȳ)² / (P − 1). None for a single period.
    """
    if len(periods) < 2:
        return None
    square: np.ndarray = periods.var(axis=0, ddof=1).mean(axis=0)
    return np.sqrt(square)


def in_band_rms(error: np.ndarray, dt: float, band: tuple[float, float]) -> np.ndarray:
    """RMS (n,) of the part of `error` (T, n) between the frequencies of `band` [Hz], both counted.

    By Parseval's theorem, Σ e² = Σ |E|² / T, without a window: exact for whole periods, elsewhere
    what leaks over the edges of the band is lost or gained.
    """
    low, high = band
    if not 0.0 <= low < high:
        raise ValueError(f"band={band} Hz must rise from 0 or more")
    T = len(error)
    frequencies = np.fft.rfftfreq(T, dt)
    power = np.abs(np.fft.rfft(error, axis=0)) ** 2
    mirrored = (frequencies > 0.0) & (2 * np.arange(len(frequencies)) < T)
    power[mirrored] *= 2.0  # the negative frequencies
    slack = 1e-9 / dt
    inside = (frequencies >= low - slack) & (frequencies <= high + slack)
    rms: np.ndarray = np.sqrt(power[inside].sum(axis=0)) / T
    return rms


def official_rmse(estimate: Tensor, record: Record) -> np.ndarray:
    """Root-mean-square error (n,) of an estimate (T, n) of one record, in the output's unit.

    The benchmarks' metric: the state-initialisation window is not counted.
    """
    error = (estimate - record.a)[record.warmup :]
    return error.square().mean(dim=0).sqrt().numpy(force=True)
