"""Prepared folders of public benchmarks, of random numbers in the official layouts."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat

from data.public.benchmarks import BENCHMARKS, F16
from data.public.datamodule import BenchmarkData
from data.simulation.scenario import FullState

ARCHIVES = {  # whose presence tells the package that nothing is to be downloaded
    "silverbox": "Silverbox/SilverboxFiles.zip",
    "f16": "F16/F16GVT_Files.zip",
}
PERIOD, NOISE = 8192, 7e-6


def contents(name: str) -> dict[str, dict[str, np.ndarray]]:
    """Random signals under the names and in the shapes of the official files."""
    rng = np.random.default_rng(0)
    noise = rng.standard_normal
    files = BENCHMARKS[name].files
    if name == "silverbox":
        return {files[0]: {"V1": noise((1, 127500)), "V2": noise((1, 127500))}}
    if name == "f16":
        sizes = {f: 300 if "FullMSine" in f else 400 for f in F16}
        rate = {"Fs": np.array([[400.0]])}
        return {
            f: {"Force": noise((1, T)), "Voltage": noise((1, T)), "Acceleration": noise((3, T))}
            | rate
            for f, T in sizes.items()
        }
    u, y = 50.0 * noise(PERIOD), 7e-4 * noise(PERIOD)
    repeated = np.tile(y, 4) + NOISE * noise(4 * PERIOD)
    return {files[0]: {"u": np.tile(u, 4)[None]}, files[1]: {"y": repeated[None]}}


def prepare(folder: Path, files: dict[str, dict[str, np.ndarray]]) -> None:
    for path, variables in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        savemat(folder / path, variables, do_compression=False)


def as_version_7_3(place: Path, variables: dict[str, np.ndarray]) -> None:
    """A MAT file of version 7.3: HDF5 behind a block of 512 bytes, rows and columns exchanged."""
    with h5py.File(place, "w", userblock_size=512) as file:
        for name, value in variables.items():
            file[name] = value.T


def as_table(place: Path, variables: dict[str, np.ndarray]) -> None:
    """The CSV of an archive: numbered columns, a sampling rate in the first row alone."""
    columns = {}
    for name, value in variables.items():
        value = value if len(value) >= value.shape[1] else value.T
        width = value.shape[1]
        columns |= {f"{name}{i + 1}" if width > 1 else name: value[:, i] for i in range(width)}
    rows = max(map(len, columns.values()))
    cells = [[repr(float(x)) for x in c] + [""] * (rows - len(c)) for c in columns.values()]
    lines = [",".join(columns), *(",".join(row) for row in zip(*cells, strict=True))]
    place.with_suffix(".csv").write_text("\n".join(lines) + "\n")


def loaded(name: str, folder: Path, **more: object) -> BenchmarkData:
    return BenchmarkData(name, FullState(), folder=str(folder), **more)


def prepared(name: str, folder: Path, **more: object) -> BenchmarkData:
    data = loaded(name, folder, **more)
    data.setup()
    return data


def ours(data: BenchmarkData, split: str) -> list[tuple[np.ndarray, np.ndarray, int]]:
    return [(r.f.numpy(), r.a.numpy(), r.warmup) for r in data.make_records()[split]]
