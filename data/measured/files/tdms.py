"""LabVIEW's binary files (.tdms) by npTDMS: channels of groups, with units and time step.

npTDMS trusts what a file says of itself.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from data.measured.files.arrays import Variable, tabulate
from data.measured.files.columns import Contents, FileError, Request, check_size, damage_in, shorten
from data.measured.files.format import Format, Package
from data.measured.units import split_brackets

UNITS = ("unit_string", "NI_UnitDescription", "Unit", "unit")  # properties of a channel
STEP = "wf_increment"  # property [s]


def read_tdms(path: Path, request: Request) -> Contents:
    """The channels of a group, or of all; names with their group where it tells them apart.

    The step of the waveforms is dt [s]. Raises FileError for unequal steps and lengths, and for
    damage.
    """
    import nptdms  # type: ignore[import-untyped,import-not-found,unused-ignore]
    from nptdms.log import log_manager  # type: ignore[import-untyped,import-not-found,unused-ignore]

    log_manager.set_level(logging.ERROR)  # what it warns of is a note of ours
    with damage_in(path, "export it again"), nptdms.TdmsFile.open(str(path)) as file:
        groups = {group.name: group.channels() for group in file.groups()}
        if request.group is not None and request.group not in groups:
            has = ", ".join(shorten(name) for name in list(groups)[:12])
            raise FileError(
                f"{path.name}: no group {shorten(request.group)}; data.group may name {has}"
            )
        wanted = groups if request.group is None else {request.group: groups[request.group]}
        channels = [channel for group in wanted.values() for channel in group if len(channel)]
        declared = 8.0 * sum(len(channel) for channel in channels)
        check_size(path, declared, path.stat().st_size, fold=64, suspect=2**26)
        names = [channel.name for channel in channels]
        alone = len(set(names)) == len(names)
        called = [c.name if alone else f"{c.group_name}/{c.name}" for c in channels]
        variables = list(map(_variable, channels, called))
        contents = tabulate(path, variables, request)
        if file.file_status.incomplete_final_segment:
            contents.notes.append("the file was cut off in its last segment, read up to there")
        steps = {
            float(channel.properties[STEP])
            for channel, variable in zip(channels, variables, strict=True)
            if {variable.name, split_brackets(variable.name)[0]} & contents.columns.keys()
            and channel.properties.get(STEP, 0.0) > 0.0
        }
    if len(steps) > 1:
        raise FileError(
            f"{path.name}: the channels have time steps from {min(steps):g} to {max(steps):g} s; "
            "expected one; name a group (data.group) or channels of one step (data.channels)"
        )
    if steps:
        contents.facts["dt"] = steps.pop()
    return contents


def _variable(channel: Any, name: str) -> Variable:
    unit = next(
        (str(channel.properties[key]) for key in UNITS if channel.properties.get(key)), None
    )
    read = lambda: np.asarray(channel[:])
    return Variable(name, (len(channel),), np.dtype(channel.dtype), read, unit)


TDMS = Format(
    "TDMS",
    (".tdms",),
    read_tdms,
    {b"TDSm": "TDMS"},
    options=("group",),
    package=Package("nptdms", "npTDMS", "tdms", "; or export it as .lvm or CSV"),
    tried_apart=True,
)
