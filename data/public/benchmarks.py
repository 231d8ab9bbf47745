"""The public benchmarks of nonlinearbenchmark.org by name: source, files, units, usual series."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import torch

from data.public.files import Files, download
from data.public.series import Records
from data.record import Record
from data.simulation.scenario import FullState, Scenario

# Files of the public benchmarks → their official training and test series.
#
# Splits and state-initialisation windows are those of the package `nonlinear-benchmarks` 1.0.1,
# and tests compare them. Training series get the same window, for they too begin in an unknown
# state: models that can estimate a state take it from the window, for all others the motion
# begins at rest.

Splits = tuple[Records, Records]  # training, test


def _record(dt: float, u: np.ndarray, y: np.ndarray, initial_state: str = "rest") -> Record:
    """A record of an input, a row or a column, and outputs (T, n)."""
    a, f = torch.from_numpy(y), torch.from_numpy(u.reshape(-1, 1))
    return Record(dt, a, f, initial_state=initial_state)


def _positive(name: str, value: np.ndarray) -> float:
    """The first of some numbers. Raises ValueError unless it is positive."""
    number = float(value.flat[0]) if value.size else 0.0
    if not 0.0 < number < np.inf:
        raise ValueError(
            f"{name}={number:g} must be positive; is the file the benchmark's own? fetch it again"
        )
    return number


SILVERBOX = "Silverbox/SilverboxFiles/SNLS80mV.mat"
F16 = tuple(
    f"F16/F16GVT_Files/BenchmarkData/F16Data_{kind}_Level{level}{end}.mat"
    for kind in ("FullMSine", "SineSw")
    for level, end in zip(range(1, 8), ["", "_Validation"] * 4, strict=False)
)
BOUC_WEN = ("BoucWen/uest_multisine.mat", "BoucWen/yest_multisine.mat")
BOUC_WEN_TESTS = tuple(
    f"BoucWen/BoucWenFiles/Test signals/Validation signals/{letter}val_{signal}.mat"
    for signal in ("multisine", "sinesweep")
    for letter in "uy"
)
BOUC_WEN_DT, BOUC_WEN_PERIOD = 1.0 / 750.0, 8192
BOUC_WEN_DECAY = 1500  # samples until the initial state is forgotten, to 1 % by the damping alone


def silverbox(files: Files) -> Splits:
    """Three quarters of the multisine train; its rest and the arrow, whole and cut, test."""
    u, y = files.load(SILVERBOX, "V1", "V2")
    whole = _record(1.0 / 610.35, u, y.reshape(-1, 1), "unknown")
    first, length, inner, uncounted = 40650, 86750, 32000, 50
    seen = int(0.75 * length)
    return {"multisine": whole.window(first, seen, uncounted)}, {
        "multisine": whole.window(first + seen, length - seen, uncounted),
        "arrow_full": whole.window(100, 40475, uncounted),
        "arrow_no_extrapolation": whole.window(100, inner, uncounted),
    }


def series_of_f16(path: str) -> tuple[str, str]:
    """Split and name of the series in a file of the F-16."""
    name = path.rpartition("F16Data_")[2].removesuffix(".mat")
    return ("test" if "Validation" in name else "train"), name.removesuffix("_Validation")


def f16(files: Files) -> Splits:
    """All three accelerations, at the shaker, on the wing and on the payload side: files there."""
    splits: dict[str, Records] = {"train": {}, "test": {}}
    for path in (path for path in F16 if not files.missing([path])):
        u, y, rate = files.load(path, "Force", "Acceleration", "Fs")
        split, name = series_of_f16(path)
        y = y if len(y) == u.size else y.T  # a table has its samples in rows
        record = _record(1.0 / _positive("Fs", rate), u, y, "unknown")
        splits[split][name] = replace(record, warmup=50)
    return splits["train"], splits["test"]


def bouc_wen(files: Files) -> Splits:
    """Four periods of one multisine and, where they are there, the two official test signals.

    All periods are in the steady state, the first too: they differ from each other by noise alone
    (1.04e-5 m between any two). They share their excitation, so a held-out one shows how well a
    model fits, not what it does with another excitation. `start_1` … and `end_1` … are for that:
    the first three quarters, less what the unknown initial state may touch, and the last quarter.
    """
    u, y = files.load(BOUC_WEN[0], "u")[0], files.load(BOUC_WEN[1], "y")[0]
    whole = _record(BOUC_WEN_DT, u, y.reshape(-1, 1))
    T, seen = BOUC_WEN_PERIOD, 3 * BOUC_WEN_PERIOD // 4
    if whole.samples != 4 * T or not np.allclose(whole.f[T:], whole.f[:-T]):
        raise ValueError(f"{BOUC_WEN[0]} is not 4 equal periods of {T} samples")
    records: Records = {}
    for i in range(4):
        period = replace(whole.window(i * T, T), initial_state="periodic")
        start = replace(period.window(0, seen, BOUC_WEN_DECAY), initial_state="rest")
        records |= {f"period_{i + 1}": period, f"start_{i + 1}": start}
        records[f"end_{i + 1}"] = replace(period, warmup=seen)
    return records, _bouc_wen_tests(files) | records


def _bouc_wen_tests(files: Files) -> Records:
    """One period of a multisine in its steady state, and a sine sweep from rest; without noise."""
    tests: Records = {}
    for k, name, begins in ((0, "multisine", "periodic"), (2, "sinesweep", "rest")):
        paths = BOUC_WEN_TESTS[k : k + 2]
        if not files.missing(paths):
            u, y = (files.load(path, Path(path).stem)[0] for path in paths)
            tests[name] = _record(BOUC_WEN_DT, u, y.reshape(-1, 1), begins)
    return tests


PAGES = "https://www.nonlinearbenchmark.org/benchmarks"


@dataclass(frozen=True)
class Benchmark:
    """A benchmark as known before its files are opened: source, files, units, usual series."""

    loader: str  # function of the package that downloads it
    page: str
    files: tuple[str, ...]  # as in the package's cache
    read: Callable[[Files], Splits]
    hold: str  # what the input does between samples, see data/record.py
    quantity: str = "output"
    unit: str = "V"  # of the output
    input_unit: str = "V"
    band: tuple[float, float] | None = None  # of the excitation [Hz]
    usual_train: str = "*"  # names of series, as in a shell
    usual_test: tuple[str, ...] = ("*",)  # the first of them that is there
    optional: tuple[str, ...] = ()  # files
    series_of: Callable[[str], tuple[str, str]] | None = None  # split and name, of a file for each
    loadable: bool = True  # the package brings `files`
    published: Mapping[str, float] = field(default_factory=dict)  # RMSE on the usual test [unit]


BENCHMARKS = {
    # J. P. Noël & M. Schoukens, Hysteretic benchmark with a dynamic nonlinearity, 2016
    "bouc_wen": Benchmark(
        loader="not_splitted_benchmarks.BoucWen",
        page="https://github.com/JanHHoekstra/Model-Augmentation-Public",  # or make them in MATLAB
        files=BOUC_WEN,
        read=bouc_wen,
        quantity="displacement",
        unit="m",
        input_unit="N",
        hold="band_limited",
        band=(5.0, 150.0),
        usual_train="period_[1-3]",
        usual_test=("multisine", "period_4"),
        optional=BOUC_WEN_TESTS,
        loadable=False,
        # on the official multisine, as quoted with the data
        published={"linear": 1.6e-4, "PNLSS": 1.3e-5, "neural state space": 7.5e-6},
    ),
    # T. Wigren & J. Schoukens, ECC 2013; odd multisines up to 200 Hz, then an arrow of noise
    "silverbox": Benchmark(
        loader="Silverbox",
        page=f"{PAGES}/silverbox",
        files=(SILVERBOX,),
        read=silverbox,
        hold="band_limited",
        band=(0.0, 200.0),
        usual_test=("multisine",),
    ),
    # J. P. Noël & M. Schoukens, F-16 aircraft benchmark, 2017
    "f16": Benchmark(
        loader="F16",
        page=f"{PAGES}/f-16-gvt",
        files=F16,
        read=f16,
        quantity="acceleration",
        unit="m/s²",
        input_unit="N",
        hold="band_limited",
        band=(2.0, 15.0),
        series_of=series_of_f16,
    ),
}


def benchmark_called(name: str, scenario: Scenario) -> Benchmark:
    """A benchmark by name. Raises ValueError for an unknown name, or sensors of one's own."""
    if name not in BENCHMARKS:
        raise ValueError(f"data.name={name}: choose {', '.join(BENCHMARKS)}")
    if not isinstance(scenario, FullState):
        raise ValueError(
            "benchmarks are taken as they were measured; leave scenario=full_state, not "
            f"{type(scenario).__name__}"
        )
    return BENCHMARKS[name]


def benchmark_in(folder: Path) -> str | None:
    """The benchmark that lies in a folder by the names of its files, or None."""
    return next((n for n, b in BENCHMARKS.items() if not Files(folder).missing(b.files)), None)


def files_of(
    name: str, folder: Path, fetch: bool = False, wanted: Mapping[str, Sequence[str]] | None = None
) -> Files:
    """The files of a benchmark, fetched where asked for. Raises ValueError naming missing files.

    wanted: patterns of series by split, None for all; files of other series need not be there.
    """
    about, files = BENCHMARKS[name], Files(folder)
    if fetch and files.missing([*about.files, *about.optional]):
        download(about.loader, folder)
    missing = files.missing(about.files)
    if wanted is not None and about.series_of is not None:
        named = {path: about.series_of(path) for path in missing}
        missing = [
            path for path, (split, series) in named.items()
            if any(fnmatchcase(series, pattern) for pattern in wanted.get(split, ["*"]))
        ]  # fmt: skip
    if missing:
        raise ValueError(_how_to_get(name, about, folder, missing))
    return files


def _how_to_get(name: str, about: Benchmark, folder: Path, missing: list[str]) -> str:
    named = ", ".join(Path(path).name for path in missing)
    are, them = ("is", "it") if len(missing) == 1 else ("are", "them")
    remedy = "the package nonlinear-benchmarks brings only the test signals"
    if about.loadable:
        remedy = f"or let the package nonlinear-benchmarks fetch {them} with data.download=true"
    return (
        f"{name}: {named} {are} not in {folder}; get {them} from {about.page} and put as "
        f"{missing[0]} or "
        f"without its folders into data.folder={folder}; {remedy}"
    )
