"""The time history of a prediction as a file: a column each, with its unit, in SI."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np

from data.whole_file import whole_file
from report.prediction.runs import Prediction

FORMATS = ("csv", "parquet")


def columns_of(prediction: Prediction) -> dict[str, np.ndarray]:
    """{"time [s]": (T,), "x1 [m]": …}, names that a measured record may have.

    Half widths of the 95 % band, where there is one, are under "half_a1 [m/s^2]".
    """
    samples = len(prediction.signals[0].values)
    columns = {"time [s]": prediction.dt * np.arange(samples)}
    for signal in prediction.signals:
        unit = f" [{signal.unit}]" if signal.unit else ""
        for number, values in zip(signal.names, signal.values.T, strict=True):
            columns[f"{signal.symbol}{number}{unit}"] = values
        if signal.half is not None:
            for number, half in zip(signal.names, signal.half.T, strict=True):
                columns[f"half_{signal.symbol}{number}{unit}"] = half
    return columns


def require_format(name: str) -> None:
    """Raise ValueError for a format that is none, or that lacks its package."""
    if name not in FORMATS:
        raise ValueError(f"format={name}: choose {', '.join(FORMATS)}")
    if name == "parquet" and importlib.util.find_spec("pyarrow") is None:
        raise ValueError("format=parquet needs the package pyarrow; take format=csv")


def write_history(prediction: Prediction, path: Path, about: str) -> None:
    """Write all columns of a prediction; `path` ends in .csv or .parquet."""
    columns = columns_of(prediction)
    if path.suffix == ".parquet":
        import pyarrow as pa  # type: ignore[import-untyped,unused-ignore]
        import pyarrow.parquet as pq  # type: ignore[import-untyped,unused-ignore]

        table = pa.table(columns).replace_schema_metadata({"about": about})
        with whole_file(path) as aside:
            pq.write_table(table, aside)
    else:
        head = ",".join(columns)
        table = np.column_stack(list(columns.values()))
        with whole_file(path) as aside:
            np.savetxt(aside, table, fmt="%.9g", delimiter=",", header=head, comments="")
