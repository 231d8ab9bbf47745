"""One random file of a record."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.attack.record_files.agency_cases import agency_file, universal_file
from benchmarks.attack.record_files.archives import zipped
from benchmarks.attack.record_files.arrays import mat, npz, parquet
from benchmarks.attack.record_files.case import Case
from benchmarks.attack.record_files.damage import damaged
from benchmarks.attack.record_files.hdf5 import hdf5
from benchmarks.attack.record_files.text import csv, json_file
from benchmarks.attack.record_files.values import random_columns

FORMATS = (csv, csv, csv, mat, hdf5, parquet, npz, json_file)


def drawn(draw: random.Random, names: Sequence[str]) -> Case:
    """A random file; `names` are odd names of columns."""
    case = _of_arrays(draw, names) if draw.random() < 0.6 else _of_an_agency(draw)
    if draw.random() < 0.15:
        case = zipped(draw, case)
    if draw.random() < 0.28:
        return damaged(draw, case)
    return case


def _of_arrays(draw: random.Random, names: Sequence[str]) -> Case:
    with np.errstate(all="ignore"):
        columns, mapped = random_columns(draw, names)
    return replace(draw.choice(FORMATS)(draw, columns), mapped=mapped)


def _of_an_agency(draw: random.Random) -> Case:
    return agency_file(draw) if draw.random() < 0.85 else universal_file(draw)
