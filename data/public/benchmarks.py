"""The public benchmarks of nonlinearbenchmark.org by name: source, files, units, usual series."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from data.public.files import Files, download
from data.public.splits import (
    BOUC_WEN,
    BOUC_WEN_TESTS,
    F16,
    SILVERBOX,
    Splits,
    bouc_wen,
    f16,
    silverbox,
)
from data.simulation.scenario import FullState, Scenario

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


def files_of(name: str, folder: Path, fetch: bool = False) -> Files:
    """The files of a benchmark, fetched where asked for. Raises ValueError naming missing files."""
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
