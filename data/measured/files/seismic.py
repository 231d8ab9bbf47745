"""SAC and miniSEED by ObsPy: one column for each trace, named by station, place and component."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.measured.files.columns import Contents, FileError, Request, check_size, choose, damage_in
from data.measured.files.format import Format, Package

KINDS = {"N": "acc", "L": "acc", "H": "vel"}  # second letter of a channel's SEED name


def read_seismic(path: Path, request: Request) -> Contents:
    """Columns such as acc_HNE_00 in the file's own unit, mostly counts, and dt [s].

    Raises FileError for traces with gaps and of unequal rates.
    """
    import obspy  # type: ignore[import-untyped,import-not-found,unused-ignore]

    check_size(path, 64.0 * path.stat().st_size, path.stat().st_size)
    kind = "SAC" if path.suffix.lower() == ".sac" else "MSEED"
    with damage_in(path, "download it again"):
        traces = list(obspy.read(str(path), format=kind, check_compression=False).merge())
    named = {}
    for trace in traces:
        code = trace.stats.channel or "channel"
        name = "_".join(filter(None, (KINDS.get(code[1:2], "c"), code, trace.stats.location)))
        place = f"station {trace.stats.station}, {code}"
        named[name if name not in named else f"{name}_{trace.stats.station}"] = (trace, place)
    contents = Contents(notes=["no unit is known of traces: they are counts unless converted"])
    chosen = choose(path, list(named), request.columns)
    if any(np.ma.is_masked(named[name][0].data) for name in chosen):
        raise FileError(f"{path.name}: a trace has gaps; fill them or cut it before, in ObsPy")
    steps = {named[name][0].stats.delta for name in chosen}
    if len(steps) != 1:
        raise FileError(f"{path.name}: {len(steps)} time steps; name one step's in data.channels")
    start = max(named[name][0].stats.starttime for name in chosen)
    end = min(named[name][0].stats.endtime for name in chosen)
    for name in chosen:
        trace, contents.labels[name] = named[name]
        values = np.asarray(trace.slice(start, end).data, dtype=np.float64)
        contents.columns[name] = values
    shortest = min(map(len, contents.columns.values()), default=0)
    contents.columns = {name: u[:shortest] for name, u in contents.columns.items()}
    contents.facts["dt"] = float(steps.pop())
    return contents


SEISMIC = Format(
    "SAC and miniSEED",
    (".mseed", ".miniseed", ".sac"),
    read_seismic,
    package=Package("obspy", "obspy", "seismic"),
    tried_apart=True,
)
