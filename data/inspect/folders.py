"""A folder of one file per sensor, or of folders of events or of sensors: its files as records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os.path import commonprefix
from pathlib import Path

from data.inspect.inspection import Inspection, lacking, suggest
from data.measured.floors import height, without_shared


def of_folders(folder: Path, records: Sequence[Inspection]) -> dict[str, str]:
    """{channel: file:column} of a folder, of its files or its folders; empty where it has none.

    In folders of events each holds one file per sensor; in folders of sensors each holds one file
    per event, and a * in the name of a file stands for the event.
    """
    inside = {r.path.name: r for r in records if r.path.parent == folder}
    if channels := of_files(inside):
        return channels
    subs: dict[str, dict[str, Inspection]] = {}
    for record in records:
        if record.path.parent.parent == folder:
            subs.setdefault(record.path.parent.name, {})[record.path.name] = record
    by_floor = sum(height(sub) is not None for sub in subs) > len(subs) / 2
    for first in () if by_floor else subs.values():
        if channels := of_files(first):
            return _of_events(channels, subs)
    shared = sorted(set.intersection(*map(set, subs.values()))) if len(subs) > 1 else []
    for name in shared:
        suffix = Path(name).suffix
        if channels := of_files({f"{sub}/*{suffix}": files[name] for sub, files in subs.items()}):
            return channels
    return {}


def _of_events(
    channels: dict[str, str], subs: Mapping[str, Mapping[str, Inspection]]
) -> dict[str, str]:
    """The channels in all folders of events, whose files' names may begin with the event."""
    used = {where.rpartition(":")[0] for where in channels.values()} - {""}
    alike = sum(used <= files.keys() for files in subs.values())
    if alike == len(subs):
        return channels
    event = commonprefix(list(used))  # noqa: RUF071  letter by letter is meant
    ends = {file.removeprefix(event) for file in used}
    beginning = sum(
        all(sum(file.endswith(end) for file in files) == 1 for end in ends)
        for files in subs.values()
    )
    if not event or beginning <= alike:
        return channels
    parts = {channel: where.rpartition(":") for channel, where in channels.items()}
    return {c: f"*{p[0].removeprefix(event)}:{p[2]}" if p[0] else p[2] for c, p in parts.items()}


def of_files(files: Mapping[str, Inspection]) -> dict[str, str]:
    """{channel: file:column} of files that lack something alone and nothing together.

    files: records by what data.channels calls their files. Empty where they do not, or where a
    file is a record by itself.
    """
    some = all(r.guesses and lacking(r.guesses.values()) for r in files.values())
    if len(files) < 2 or not some:
        return {}
    where = {f"{file}:{c}": (file, c) for file, r in files.items() for c in r.raw.channels}
    called = {file: file.partition("/*")[0].removesuffix(Path(file).suffix) for file in files}
    called = dict(zip(called, without_shared(list(called.values())), strict=True))
    guesses = suggest(
        list(where),
        {k: files[file].units[c] for k, (file, c) in where.items() if c in files[file].units},
        {k: files[file].labels[c] for k, (file, c) in where.items() if c in files[file].labels},
        {k: files[file].raw.channels[c] for k, (file, c) in where.items()},
        files={k: (called[file], c) for k, (file, c) in where.items()},
    )
    if not guesses or lacking(guesses.values()):
        return {}
    used = {where[key][0] for key in guesses}
    clocks = {f: c for f in files if f in used for c, g in files[f].guesses.items() if g == "time"}
    channels = {channel: key for key, channel in guesses.items()}
    if len(clocks) < len(used):
        return channels
    first, clock = next(iter(clocks.items()))
    alone = clock if len(set(clocks.values())) == 1 else f"{first}:{clock}"
    return {"time": alone, **channels}
