"""Universal files (UFF): time responses of data set 58 and 58b, by the package pyuff.

Responses without a unit are in SI, unless data set 164 says other units: then none is known. pyuff
trusts what a file says of itself.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from data.measured.files.columns import (
    MOST,
    Contents,
    FileError,
    Request,
    check_size,
    choose,
    common_step,
    cut_to_shortest,
    damage_in,
)
from data.measured.files.format import Format, Package

TIME_RESPONSE = 1  # function type
KINDS = {8: ("disp", "m"), 11: ("vel", "m/s"), 12: ("acc", "m/s^2"), 13: ("force", "N"),
         9: ("force", "N")}  # fmt: skip
AXES = {1: "X", 2: "Y", 3: "Z", 4: "RX", 5: "RY", 6: "RZ"}  # with a minus: against the axis
BARE = ("", "none", "null")


def read_uff(path: Path, request: Request) -> Contents:
    """Time responses as columns such as acc_3Z (acceleration of node 3 along Z), and dt [s].

    Raises FileError for files without real, evenly sampled responses.
    """
    import pyuff  # type: ignore[import-untyped,import-not-found,unused-ignore]

    check_size(path, 4.0 * path.stat().st_size, path.stat().st_size)
    with damage_in(path, "export it again"):
        file = pyuff.UFF(str(path))
        kinds = [int(kind) for kind in file.get_set_types()]
        wanted = [k for k, kind in enumerate(kinds) if kind == 58][: MOST + 1]
        sets = [file.read_sets(k) for k in wanted]
        units = [file.read_sets(k) for k, kind in enumerate(kinds) if kind == 164]
    contents = Contents()
    series: dict[str, dict[str, Any]] = {}
    for data in sets:
        if int(data.get("func_type", 0)) == TIME_RESPONSE:
            series[_name(data, series)] = data
    if len(sets) > len(series):
        contents.notes.append(f"{len(sets) - len(series)} functions that are no time response")
    if not series:
        raise FileError(
            f"{path.name} holds no time response (data set 58, function type 1); export time "
            "histories"
        )
    for name in choose(path, list(series), request.columns):
        contents.columns[name] = _values(path, name, series[name])
        if int(series[name].get("rsp_dir", 0)) < 0:
            contents.columns[name] *= -1.0
            contents.notes.append(f"{name}: its sensor points against the axis; sign reversed")
        unit = str(series[name].get("ordinate_axis_units_lab", "")).strip()
        kind = KINDS.get(int(series[name].get("ordinate_spec_data_type", 0)))
        if unit.lower() not in BARE:
            contents.units[name] = unit
        elif kind and all(one["length"] == one["force"] == 1.0 for one in units):
            contents.units[name] = kind[1]
    places = {name: _place(series[name]) for name in contents.columns}
    if len(set(places.values())) == len(places):  # else they are titles of the whole test
        contents.labels = {name: place for name, place in places.items() if place}
        contents.notes += [f"{name}: {place}" for name, place in contents.labels.items()]
    return _even(path, series, contents)


UFF = Format(
    "UFF",
    (".uff", ".unv", ".bunv"),
    read_uff,
    opening=rb"[\r\n]*[ \t]*-1[ \t]*(?:[\r\n]|$)",
    called="a universal file",
    package=Package("pyuff", "pyuff", "uff"),
    tried_apart=True,
)


def _name(data: dict[str, Any], taken: dict[str, Any]) -> str:
    kind = KINDS.get(int(data.get("ordinate_spec_data_type", 0)), ("c", ""))[0]
    axis = AXES.get(abs(int(data.get("rsp_dir", 0))), "")
    name = f"{kind}_{int(data.get('rsp_node', 0))}{axis}"
    same = sum(other == name or other.startswith(f"{name}_") for other in taken)
    return f"{name}_{same + 1}" if same else name


def _place(data: dict[str, Any]) -> str:
    """What the file calls a response: the name of its entity and its first line of text."""
    texts = [" ".join(str(data.get(key) or "").split()) for key in ("rsp_ent_name", "id1")]
    return ", ".join(dict.fromkeys(text for text in texts if text.lower() not in BARE))


def _values(path: Path, name: str, data: dict[str, Any]) -> np.ndarray:
    values = np.asarray(data["data"])
    if values.dtype.kind == "c" and not np.any(values.imag):
        values = values.real
    if values.dtype.kind not in "fiu":
        raise FileError(f"{path.name}: {name!r} holds complex numbers; export time histories")
    if values.size < int(data.get("num_pts", 0)):
        raise FileError(
            f"{path.name} announces {data['num_pts']} values of {name!r} and {values.size} follow; "
            "the file was cut off: export it again"
        )
    return values.astype(np.float64).ravel()


def _even(path: Path, series: dict[str, dict[str, Any]], contents: Contents) -> Contents:
    """The series with their common time step; cut to the shortest. Raises FileError without one."""
    steps = {}
    for name in contents.columns:
        data = series[name]
        dt = float(data.get("abscissa_inc", 0.0))
        x = np.asarray(data.get("x", []), dtype=float)
        if not dt > 0.0 and len(x) > 1:
            dt = float(x[-1] - x[0]) / (len(x) - 1)
            if np.abs(np.diff(x) - dt).max() > 0.01 * dt:
                raise FileError(
                    f"{path.name}: {name!r} is unevenly sampled; resample and export it"
                )
        steps[name] = dt
    contents.facts["dt"] = common_step(path, steps, "responses")
    cut_to_shortest(contents, "responses")
    return contents
